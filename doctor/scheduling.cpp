#include "doctor/scheduling.hpp"

#include <cerrno>
#include <charconv>
#include <cstring>
#include <pthread.h>
#include <sched.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <thread>
#include <unistd.h>

#include <fmt/format.h>

#include "core/rt/thread_setup.hpp"

namespace multipanda::doctor {
namespace {

constexpr const char* kLimits =
    "add '@realtime - rtprio 99' and '@realtime - memlock unlimited' to /etc/security/limits.conf, add "
    "yourself to the group (groupadd realtime; usermod -aG realtime $USER), then log in again";

// Bit 14 of the effective capabilities permits locks beyond the limit.
bool may_lock_any(const SystemFiles& files) {
  for (const auto& line : files.lines("proc/self/status")) {
    if (!line.starts_with("CapEff:")) continue;
    const auto digits = line.find_first_not_of(" \t", 7);
    if (digits == std::string::npos) return false;
    std::uint64_t bits = 0;
    (void)std::from_chars(line.data() + digits, line.data() + line.size(), bits, 16);
    return (bits >> 14 & 1u) != 0;
  }
  return false;
}

}  // namespace

SchedulingReading read_scheduling(const SystemFiles& files) {
  SchedulingReading reading;
  reading.priority = ThreadSetup{}.fifo_priority.value_or(0);
  reading.superuser = geteuid() == 0;
  std::thread([&] {
    sched_param parameters{};
    parameters.sched_priority = reading.priority;
    reading.fifo_error = pthread_setschedparam(pthread_self(), SCHED_FIFO, &parameters);
    reading.fifo = reading.fifo_error == 0;
  }).join();
  rlimit limit{};
  if (getrlimit(RLIMIT_RTPRIO, &limit) == 0) reading.priority_limit = limit.rlim_cur;
  if (getrlimit(RLIMIT_MEMLOCK, &limit) == 0) {
    reading.memory_limit_bytes = limit.rlim_cur;
    reading.memory_unlimited = limit.rlim_cur == RLIM_INFINITY || may_lock_any(files);
  }
  // With a limit, locking future memory would let later allocations fail: only present memory is locked.
  reading.memory_locks = mlockall(MCL_CURRENT) == 0;
  if (reading.memory_locks) munlockall();
  reading.rt_runtime_us = files.number("proc/sys/kernel/sched_rt_runtime_us");
  reading.rt_period_us = files.number("proc/sys/kernel/sched_rt_period_us");
  return reading;
}

Finding judge_fifo(const SchedulingReading& reading, Purpose purpose) {
  Finding finding{.id = "sched_fifo", .subject = "permission to use SCHED_FIFO"};
  finding.figures = {{"priority_wanted", static_cast<double>(reading.priority), ""},
                     {"priority_limit", static_cast<double>(reading.priority_limit), ""}};
  if (reading.fifo) {
    finding.judged = Judgment::ok;
    finding.measured =
        fmt::format("priority {} granted{}", reading.priority,
                    reading.superuser ? " (superuser)" : fmt::format(" (limit {})", reading.priority_limit));
    return finding;
  }
  finding.judged = defect(purpose);
  finding.measured = fmt::format("priority {} refused: {} (limit {})", reading.priority,
                                 std::strerror(reading.fifo_error), reading.priority_limit);
  if (reading.superuser) {
    finding.cause =
        "refused even for the superuser: the container lacks the permission, or the control group has no "
        "real-time budget";
    finding.cure =
        "start the container with --cap-add=sys_nice --ulimit rtprio=99, or give the group "
        "cpu.rt_runtime_us";
  } else {
    finding.cause = "without it any other program may delay the loop";
    finding.cure = kLimits;
  }
  return finding;
}

Finding judge_memory_lock(const SchedulingReading& reading, Purpose purpose) {
  Finding finding{.id = "memory_lock", .subject = "permission to lock memory"};
  if (reading.memory_unlimited && reading.memory_locks) {
    finding.judged = Judgment::ok;
    finding.measured = "no limit";
    return finding;
  }
  finding.judged = defect(purpose);
  const double megabytes = static_cast<double>(reading.memory_limit_bytes) / 1e6;
  finding.measured =
      reading.memory_unlimited ? std::string("refused") : fmt::format("limit {:.3g} MB", megabytes);
  finding.figures = {{"limit", megabytes, "MB"}};
  finding.cause =
      "memory that is not locked may be swapped out or first touched in the loop; such a page fault "
      "costs up to milliseconds";
  finding.cure =
      reading.superuser ? "start the container with --ulimit memlock=-1 --cap-add=ipc_lock" : kLimits;
  return finding;
}

Finding judge_throttling(const SchedulingReading& reading, Purpose purpose) {
  Finding finding{.id = "rt_throttling", .subject = "real-time throttling"};
  if (!reading.rt_runtime_us || !reading.rt_period_us || *reading.rt_period_us <= 0) {
    finding.measured = "cannot be read";
    finding.cause = "/proc/sys/kernel/sched_rt_runtime_us is missing or not readable";
    return finding;
  }
  if (*reading.rt_runtime_us < 0) {
    finding.judged = Judgment::ok;
    finding.measured = "off";
    return finding;
  }
  const double share = *reading.rt_runtime_us / *reading.rt_period_us;
  finding.figures = {{"share", share, ""}};
  finding.measured =
      fmt::format("real-time threads get {:.0f} % of {:g} ms", 100 * share, *reading.rt_period_us / 1000);
  // A loop that computes for about 100 us per millisecond never reaches the usual 95 %.
  if (share >= 0.5) {
    finding.judged = Judgment::ok;
    return finding;
  }
  finding.judged = defect(purpose);
  finding.cause = "the kernel suspends real-time threads that use more than this";
  finding.cure = "sysctl -w kernel.sched_rt_runtime_us=950000";
  return finding;
}

}  // namespace multipanda::doctor
