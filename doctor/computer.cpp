#include "doctor/computer.hpp"

#include <algorithm>
#include <cctype>
#include <cerrno>
#include <charconv>
#include <cstring>
#include <pthread.h>
#include <sched.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <sys/utsname.h>
#include <thread>
#include <unistd.h>

#include <fmt/format.h>

#include "core/rt/thread_setup.hpp"
#include "core/types/time.hpp"

namespace multipanda::doctor {
namespace {

constexpr const char* kCores = "sys/devices/system/cpu";
// Limit for late wake-ups: a tenth of the time that an arm waits for a torque.
constexpr double kDeepSleep_us = 50;

bool is_core(const std::string& name) {
  return name.size() > 3 && name.starts_with("cpu") &&
         std::all_of(name.begin() + 3, name.end(), [](unsigned char c) { return std::isdigit(c) != 0; });
}

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

KernelReading read_kernel(const SystemFiles& files) {
  KernelReading reading;
  utsname system{};
  if (uname(&system) == 0) {
    reading.release = system.release;
    reading.version = system.version;
  }
  if (const auto flag = files.number("sys/kernel/realtime")) reading.realtime_flag = static_cast<int>(*flag);
  return reading;
}

Finding judge_kernel(const KernelReading& reading, Purpose purpose) {
  Finding finding{.id = "realtime_kernel", .subject = "kernel"};
  const bool named = reading.version.find("PREEMPT_RT") != std::string::npos ||
                     reading.version.find("PREEMPT RT") != std::string::npos;
  const bool flag = reading.realtime_flag == 1;
  finding.measured = fmt::format("{}, {}", reading.release.empty() ? "release unknown" : reading.release,
                                 named || flag ? "real-time (PREEMPT_RT)" : "not real-time");
  finding.figures = {{"realtime", named || flag ? 1.0 : 0.0, ""}};
  if (named || flag) {
    finding.judged = Judgment::ok;
    if (!flag) {
      finding.judged = Judgment::warning;
      finding.cause =
          "the kernel is named PREEMPT_RT, but /sys/kernel/realtime is not 1: libfranka would refuse it";
      finding.cure = "use a kernel with the full PREEMPT_RT patch; multipanda runs anyway";
    }
    return finding;
  }
  return finding.as(
      defect(purpose),
      "drivers and interrupts of a kernel without PREEMPT_RT can delay the loop by milliseconds",
      purpose == Purpose::real_arms
          ? "boot a PREEMPT_RT kernel: Debian 'apt install linux-image-rt-amd64', Ubuntu 'pro enable "
            "realtime-kernel'"
          : "fine for simulation; before real arms, boot a PREEMPT_RT kernel (Debian: linux-image-rt-amd64)");
}

MachineKindReading read_machine_kind(const SystemFiles& files) {
  MachineKindReading reading;
  reading.cores = static_cast<int>(std::thread::hardware_concurrency());
  for (const auto& line : files.lines("proc/cpuinfo")) {
    const auto colon = line.find(": ");
    if (colon == std::string::npos) continue;
    if (line.starts_with("model name")) reading.processor = line.substr(colon + 2);
    if (line.starts_with("flags")) {
      reading.hypervisor = line.find(" hypervisor") != std::string::npos;
      break;
    }
  }
  for (const char* file : {"sys/class/dmi/id/sys_vendor", "sys/class/dmi/id/product_name"}) {
    if (const auto word = files.line(file)) reading.product += (reading.product.empty() ? "" : " ") + *word;
  }
  reading.container = files.exists(".dockerenv") || files.exists("run/.containerenv");
  reading.clock_source =
      files.line("sys/devices/system/clocksource/clocksource0/current_clocksource").value_or("");
  constexpr int kReads = 2000;
  const HostTime begin = host_now();
  HostTime end = begin;
  for (int i = 0; i < kReads; ++i) end = host_now();
  reading.clock_read_ns = static_cast<double>((end - begin).count()) / kReads;
  return reading;
}

Finding judge_virtual_machine(const MachineKindReading& reading, Purpose purpose) {
  Finding finding{.id = "virtual_machine", .subject = "computer"};
  finding.measured =
      fmt::format("{}{} core(s)", reading.processor.empty() ? "" : reading.processor + ", ", reading.cores);
  finding.figures = {{"cores", reading.cores, "cores"}};
  if (reading.container) finding.measured += ", in a container";
  if (!reading.hypervisor) return finding.because("the processor does not report whether it is virtual");
  finding.figures.push_back({"virtual", *reading.hypervisor ? 1.0 : 0.0, ""});
  if (!*reading.hypervisor) return finding.as(Judgment::ok);
  finding.measured += reading.product.empty() ? ", virtual" : fmt::format(", virtual ({})", reading.product);
  return finding.as(purpose == Purpose::real_arms ? Judgment::bad : Judgment::warning,
                    "the host decides when a virtual machine runs: 1 kHz cannot be guaranteed",
                    purpose == Purpose::real_arms
                        ? "control real arms from a computer without a hypervisor"
                        : "sufficient for simulation; real arms need a physical computer");
}

Finding judge_clock_source(const MachineKindReading& reading, Purpose purpose) {
  Finding finding{.id = "clock_source", .subject = "clock"};
  finding.measured = fmt::format("{}, {:.0f} ns to read it",
                                 reading.clock_source.empty() ? "source unknown" : reading.clock_source,
                                 reading.clock_read_ns);
  finding.figures = {{"read", reading.clock_read_ns, "ns"}};
  // Fast clocks are read without entering the kernel, in 20 to 60 ns; slow ones take microseconds.
  if (reading.clock_read_ns < 500) return finding.as(Judgment::ok);
  return finding.as(
      reading.clock_read_ns < 5000 ? Judgment::warning : defect(purpose),
      "this clock is read through the kernel several times per cycle",
      "boot with clocksource=tsc tsc=reliable if the processor's counter is steady; otherwise use another "
      "computer");
}

ProcessorReading read_processor(const SystemFiles& files) {
  ProcessorReading reading;
  for (const auto& name : files.names(kCores)) {
    if (!is_core(name)) continue;
    const std::string core = fmt::format("{}/{}/", kCores, name);
    if (const auto governor = files.line(core + "cpufreq/scaling_governor")) ++reading.governors[*governor];
    if (const auto khz = files.number(core + "cpufreq/scaling_cur_freq")) {
      const double mhz = *khz / 1000;
      reading.slowest_mhz = std::min(reading.slowest_mhz.value_or(mhz), mhz);
      reading.fastest_mhz = std::max(reading.fastest_mhz.value_or(mhz), mhz);
    }
    if (const auto khz = files.number(core + "cpufreq/cpuinfo_max_freq")) {
      reading.max_mhz = std::max(reading.max_mhz.value_or(0), *khz / 1000);
    }
  }
  if (const auto none = files.number("sys/devices/system/cpu/intel_pstate/no_turbo")) {
    reading.turbo = *none == 0;
  } else if (const auto boost = files.number("sys/devices/system/cpu/cpufreq/boost")) {
    reading.turbo = *boost != 0;
  }
  const std::string idle = fmt::format("{}/cpu0/cpuidle/", kCores);
  for (const auto& state : files.names(idle)) {
    if (!state.starts_with("state")) continue;
    reading.idle_states.push_back({.name = files.line(idle + state + "/name").value_or(state),
                                   .latency_us = files.number(idle + state + "/latency").value_or(0),
                                   .enabled = files.number(idle + state + "/disable").value_or(0) == 0});
  }
  return reading;
}

Finding judge_governor(const ProcessorReading& reading, Purpose purpose) {
  Finding finding{.id = "governor", .subject = "frequency of the cores"};
  if (reading.governors.empty()) {
    finding.measured = "not reported by the kernel";
    return finding.because(
        "no frequency control is visible here, as usual in a virtual machine: the host decides",
        "check the host or the BIOS: the cores should keep one high frequency");
  }
  std::string governors;
  for (const auto& [name, cores] : reading.governors) {
    governors += fmt::format("{}{} on {}", governors.empty() ? "" : ", ", name, cores);
  }
  finding.measured = fmt::format("governor {} core(s)", governors);
  if (reading.slowest_mhz && reading.fastest_mhz) {
    finding.measured += fmt::format(", now {:.0f} to {:.0f} MHz", *reading.slowest_mhz, *reading.fastest_mhz);
    finding.figures.push_back({"slowest", *reading.slowest_mhz, "MHz"});
    finding.figures.push_back({"fastest", *reading.fastest_mhz, "MHz"});
  }
  if (reading.max_mhz) {
    finding.measured += fmt::format(" of {:.0f}", *reading.max_mhz);
    finding.figures.push_back({"maximum", *reading.max_mhz, "MHz"});
  }
  if (reading.turbo) finding.measured += *reading.turbo ? ", turbo on" : ", turbo off";
  if (reading.governors.size() == 1 && reading.governors.contains("performance"))
    return finding.as(Judgment::ok);
  return finding.as(
      defect(purpose),
      "the cores slow down when idle, and the loop is idle most of the time: its cycles then take "
      "several times as long",
      "cpupower frequency-set -g performance (package linux-cpupower; on the desktop: power profile "
      "'performance')");
}

Finding judge_idle_states(const ProcessorReading& reading, Purpose purpose) {
  Finding finding{.id = "idle_states", .subject = "idle states of the cores"};
  const ProcessorReading::IdleState* deepest = nullptr;
  for (const auto& state : reading.idle_states) {
    if (state.enabled && (deepest == nullptr || state.latency_us > deepest->latency_us)) deepest = &state;
  }
  if (deepest == nullptr) {
    finding.measured = "not reported by the kernel";
    return finding.because(
        "no idle states are visible here, as usual in a virtual machine: the host decides");
  }
  finding.measured = fmt::format("deepest state {} wakes within {:g} us", deepest->name, deepest->latency_us);
  finding.figures = {{"wake_up", deepest->latency_us, "us"}};
  if (deepest->latency_us <= kDeepSleep_us) return finding.as(Judgment::ok);
  // Only a hint: cores sleep this deeply if nothing is due for a long time, and 1 ms is short. The wake-up
  // figures show the actual cost.
  return finding.as(
      Judgment::warning,
      fmt::format("a core that sleeps this deeply wakes the loop up to {:g} us late", deepest->latency_us),
      fmt::format("cpupower idle-set -D {:g}, or processor.max_cstate=1 at boot{}", kDeepSleep_us,
                  purpose == Purpose::real_arms ? "" : "; without real arms deep sleep does no harm"));
}

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
  finding.figures = {{"priority_required", reading.priority, ""},
                     {"priority_limit", reading.priority_limit, ""}};
  if (reading.fifo) {
    finding.measured =
        fmt::format("priority {} granted{}", reading.priority,
                    reading.superuser ? " (superuser)" : fmt::format(" (limit {})", reading.priority_limit));
    return finding.as(Judgment::ok);
  }
  finding.judged = defect(purpose);
  finding.measured = fmt::format("priority {} refused: {} (limit {})", reading.priority,
                                 std::strerror(reading.fifo_error), reading.priority_limit);
  if (reading.superuser) {
    finding.cause =
        "refused even for the superuser: the container lacks the permission, or the control group has no "
        "real-time budget";
    finding.cure =
        "start the container with --cap-add=sys_nice --ulimit rtprio=99, or give the group cpu.rt_runtime_us";
  } else {
    finding.cause = "without it any other program may delay the loop";
    finding.cure = kLimits;
  }
  return finding;
}

Finding judge_memory_lock(const SchedulingReading& reading, Purpose purpose) {
  Finding finding{.id = "memory_lock", .subject = "permission to lock memory"};
  if (reading.memory_unlimited && reading.memory_locks) {
    finding.measured = "no limit";
    return finding.as(Judgment::ok);
  }
  finding.judged = defect(purpose);
  const double megabytes = static_cast<double>(reading.memory_limit_bytes) / 1e6;
  finding.measured =
      reading.memory_unlimited ? std::string("refused") : fmt::format("limit {:.3g} MB", megabytes);
  finding.figures = {{"limit", megabytes, "MB"}};
  return finding.because(
      "memory that is not locked may be swapped out or first touched in the loop; such a page fault "
      "costs up to milliseconds",
      reading.superuser ? "start the container with --ulimit memlock=-1 --cap-add=ipc_lock" : kLimits);
}

Finding judge_throttling(const SchedulingReading& reading, Purpose purpose) {
  Finding finding{.id = "rt_throttling", .subject = "real-time throttling"};
  if (!reading.rt_runtime_us || !reading.rt_period_us || *reading.rt_period_us <= 0) {
    finding.measured = "cannot be read";
    return finding.because("/proc/sys/kernel/sched_rt_runtime_us is missing or not readable");
  }
  if (*reading.rt_runtime_us < 0) {
    finding.measured = "off";
    return finding.as(Judgment::ok);
  }
  const double share = *reading.rt_runtime_us / *reading.rt_period_us;
  finding.figures = {{"share", share, ""}};
  finding.measured =
      fmt::format("real-time threads get {:.0f} % of {:g} ms", 100 * share, *reading.rt_period_us / 1000);
  // A loop that computes for about 100 us per millisecond never reaches the usual 95 %.
  if (share >= 0.5) return finding.as(Judgment::ok);
  return finding.as(defect(purpose), "the kernel suspends real-time threads that use more than this",
                    "sysctl -w kernel.sched_rt_runtime_us=950000");
}

}  // namespace multipanda::doctor
