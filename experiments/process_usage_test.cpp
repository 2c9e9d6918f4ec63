#include <ctime>
#include <unistd.h>
#include <vector>

#include <gtest/gtest.h>

#include "experiments/processes.hpp"

namespace multipanda::process_usage_test {
namespace {

double thread_clock_s() {
  timespec now{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

// A busy machine takes longer.
void use_cpu(double s) {
  const double end = thread_clock_s() + s;
  while (thread_clock_s() < end) {
  }
}

TEST(ProcessUsage, CountsCoreTimeAndNotElapsedTime) {
  const ProcessUsage before = process_usage(getpid());
  const ThreadUsage thread_before = thread_usage(gettid());
  const double clock_before = thread_clock_s();
  use_cpu(0.2);
  const double used = thread_clock_s() - clock_before;
  const ProcessUsage after = process_usage(getpid());
  const ThreadUsage thread_after = thread_usage(gettid());
  ASSERT_TRUE(before.present && after.present);
  constexpr double kTick = 0.02;  // the kernel updates a running thread's time at its ticks
  EXPECT_NEAR(after.cpu_s - before.cpu_s, used, kTick);
  EXPECT_NEAR(thread_after.cpu_s - thread_before.cpu_s, used, kTick);
  EXPECT_GE(thread_after.waited_s, thread_before.waited_s);
}

TEST(ProcessUsage, CountsMemoryThatIsTouched) {
  const double before = process_usage(getpid()).memory_mb;
  const std::vector<char> block(64u << 20, 1);
  EXPECT_NEAR(process_usage(getpid()).memory_mb - before, 64, 4);
  EXPECT_GT(machine_memory_mb(), before + 64);
  EXPECT_EQ(block.back(), 1);
}

TEST(ProcessUsage, MissingProcessIsNotPresent) {
  const ProcessUsage none = process_usage(1 << 30);  // beyond the kernel's largest number
  EXPECT_FALSE(none.present);
  EXPECT_EQ(none.cpu_s, 0);
  EXPECT_EQ(thread_usage(1 << 30).cpu_s, 0);
}

TEST(MachineUsage, GrowsUnderLoad) {
  const MachineUsage before = machine_usage();
  use_cpu(0.1);
  EXPECT_GT(machine_usage().busy_s, before.busy_s);
  EXPECT_GE(before.load_1min, 0);
}

}  // namespace
}  // namespace multipanda::process_usage_test
