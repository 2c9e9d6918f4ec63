#include "doctor/kernel.hpp"

#include <sys/utsname.h>

#include <fmt/format.h>

namespace multipanda::doctor {

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
          "the kernel is named PREEMPT_RT, but /sys/kernel/realtime is not 1: libfranka "
          "would refuse it";
      finding.cure = "use a kernel with the full PREEMPT_RT patch; multipanda runs anyway";
    }
    return finding;
  }
  finding.judged = defect(purpose);
  finding.cause = "drivers and interrupts of a kernel without PREEMPT_RT can delay the loop by milliseconds";
  finding.cure =
      purpose == Purpose::real_arms
          ? "boot a PREEMPT_RT kernel: Debian 'apt install linux-image-rt-amd64', Ubuntu 'pro enable "
            "realtime-kernel'"
          : "fine for simulation; before real arms, boot a PREEMPT_RT kernel (Debian: "
            "linux-image-rt-amd64)";
  return finding;
}

}  // namespace multipanda::doctor
