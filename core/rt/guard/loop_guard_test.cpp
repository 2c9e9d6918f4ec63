#include "core/rt/guard/loop_guard.hpp"

#include <condition_variable>
#include <cstdlib>
#include <memory>
#include <mutex>
#include <pthread.h>
#include <semaphore.h>
#include <shared_mutex>
#include <string>
#include <sys/mman.h>
#include <sys/syscall.h>
#include <thread>
#include <unistd.h>
#include <vector>

#include <gtest/gtest.h>

namespace multipanda::loop_guard_test {
namespace {

// A guard that detects nothing would let every test pass: each kind of violation must be detected.
class LoopGuardTest : public testing::Test {
 protected:
  void SetUp() override {
    if (!kLoopGuardWorks) GTEST_SKIP() << "sanitizers replace malloc themselves";
  }
  template <typename Work>
  LoopGuardCounts during(Work work) {
    LoopGuard::arm();
    work();
    return LoopGuard::disarm();
  }
};

volatile int sink = 0;

TEST_F(LoopGuardTest, PlainArithmeticIsNothing) {
  const auto counts = during([] {
    for (int i = 0; i < 1000; ++i) sink = sink + i;
  });
  EXPECT_EQ(counts.heap_calls, 0u);
  EXPECT_EQ(counts.lock_calls, 0u);
  EXPECT_EQ(counts.page_faults, 0u);
}

TEST_F(LoopGuardTest, SeesEveryHeapCall) {
  void* volatile p = nullptr;
  EXPECT_EQ(during([&] { p = std::malloc(10); }).heap_calls, 1u);
  EXPECT_EQ(during([&] { p = std::realloc(p, 100000); }).heap_calls, 1u);
  EXPECT_EQ(during([&] { std::free(p); }).heap_calls, 1u);
  EXPECT_EQ(during([&] { p = std::calloc(3, 4); }).heap_calls, 1u);
  std::free(p);
  EXPECT_EQ(during([&] { p = std::aligned_alloc(64, 64); }).heap_calls, 1u);
  std::free(p);
  void* q = nullptr;
  EXPECT_EQ(during([&] { sink = posix_memalign(&q, 64, 64); }).heap_calls, 1u);
  std::free(q);
  std::unique_ptr<std::vector<int>> v;
  EXPECT_GE(during([&] { v = std::make_unique<std::vector<int>>(5); }).heap_calls, 2u);
  std::string text;
  EXPECT_GE(during([&] { text.assign(200, 'x'); }).heap_calls, 1u);
}

TEST_F(LoopGuardTest, SeesMutexes) {
  std::mutex mutex;
  EXPECT_EQ(during([&] { const std::lock_guard lock(mutex); }).lock_calls, 1u);
  EXPECT_EQ(during([&] {
              if (mutex.try_lock()) mutex.unlock();
            }).lock_calls,
            1u);
  std::timed_mutex timed;
  EXPECT_GE(during([&] {
              if (timed.try_lock()) timed.unlock();
            }).lock_calls,
            1u);
  std::recursive_mutex recursive;
  EXPECT_EQ(during([&] { const std::lock_guard lock(recursive); }).lock_calls, 1u);
}

TEST_F(LoopGuardTest, SeesReadWriteLocks) {
  std::shared_mutex mutex;
  EXPECT_EQ(during([&] { const std::shared_lock lock(mutex); }).lock_calls, 1u);
  EXPECT_EQ(during([&] { const std::unique_lock lock(mutex); }).lock_calls, 1u);
  EXPECT_EQ(during([&] {
              if (mutex.try_lock()) mutex.unlock();
            }).lock_calls,
            1u);
  EXPECT_EQ(during([&] {
              if (mutex.try_lock_shared()) mutex.unlock_shared();
            }).lock_calls,
            1u);
}

TEST_F(LoopGuardTest, SeesConditionVariables) {
  std::mutex mutex;
  std::condition_variable condition;
  std::unique_lock lock(mutex);
  EXPECT_GE(during([&] { condition.wait_for(lock, std::chrono::nanoseconds(1)); }).lock_calls, 1u);
}

TEST_F(LoopGuardTest, SeesSemaphores) {
  sem_t semaphore;
  sem_init(&semaphore, 0, 3);
  EXPECT_EQ(during([&] { sem_wait(&semaphore); }).lock_calls, 1u);
  EXPECT_EQ(during([&] { sem_trywait(&semaphore); }).lock_calls, 1u);
  sem_destroy(&semaphore);
}

TEST_F(LoopGuardTest, SeesFutexes) {
  int word = 0;
  // FUTEX_WAKE (1) of a word without waiters.
  EXPECT_EQ(during([&] { syscall(SYS_futex, &word, 1, 1, nullptr, nullptr, 0); }).lock_calls, 1u);
}

TEST_F(LoopGuardTest, SeesPageFaults) {
  constexpr std::size_t kBytes = 16 * 4096;
  void* memory = mmap(nullptr, kBytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
  ASSERT_NE(memory, MAP_FAILED);
  madvise(memory, kBytes, MADV_NOHUGEPAGE);
  auto* bytes = static_cast<volatile char*>(memory);
  const auto touch = [&] {
    for (std::size_t i = 0; i < kBytes; i += 4096) bytes[i] = 1;
  };
  EXPECT_GE(during(touch).page_faults, 16u);
  EXPECT_EQ(during(touch).page_faults, 0u);
  munmap(memory, kBytes);
}

TEST_F(LoopGuardTest, CountsOnlyItsOwnThread) {
  LoopGuard::arm();
  const auto before = LoopGuard::disarm();
  EXPECT_EQ(before.heap_calls, 0u);
  std::thread other([] { sink = static_cast<int>(std::string(300, 'x').size()); });
  LoopGuard::arm();
  // The other thread may allocate now or may have allocated already; it does not count for this thread.
  for (int i = 0; i < 1000; ++i) sink = sink + i;
  const auto counts = LoopGuard::disarm();
  other.join();
  EXPECT_EQ(counts.heap_calls, 0u);
}

}  // namespace
}  // namespace multipanda::loop_guard_test
