#include "doctor/processor.hpp"

#include <algorithm>
#include <cctype>

#include <fmt/format.h>

namespace multipanda::doctor {
namespace {

constexpr const char* kCores = "sys/devices/system/cpu";
// A slower wake-up is reported: this is a tenth of the time that an arm waits for a torque.
constexpr double kDeepSleep_us = 50;

bool is_core(const std::string& name) {
  return name.size() > 3 && name.starts_with("cpu") &&
         std::all_of(name.begin() + 3, name.end(), [](unsigned char c) { return std::isdigit(c) != 0; });
}

}  // namespace

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
    finding.cause = "no frequency control is visible here, as usual in a virtual machine: the host decides";
    finding.cure = "check the host or the BIOS: the cores should keep one high frequency";
    return finding;
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
  if (reading.governors.size() == 1 && reading.governors.contains("performance")) {
    finding.judged = Judgment::ok;
    return finding;
  }
  finding.judged = defect(purpose);
  finding.cause =
      "the cores slow down when idle, and the loop is idle most of the time: its cycles then take "
      "several times as long";
  finding.cure =
      "cpupower frequency-set -g performance (package linux-cpupower; on the desktop: power profile "
      "'performance')";
  return finding;
}

Finding judge_idle_states(const ProcessorReading& reading, Purpose purpose) {
  Finding finding{.id = "idle_states", .subject = "sleep of the cores"};
  const ProcessorReading::IdleState* deepest = nullptr;
  for (const auto& state : reading.idle_states) {
    if (state.enabled && (deepest == nullptr || state.latency_us > deepest->latency_us)) deepest = &state;
  }
  if (deepest == nullptr) {
    finding.measured = "not reported by the kernel";
    finding.cause = "no idle states are visible here, as usual in a virtual machine: the host decides";
    return finding;
  }
  finding.measured = fmt::format("deepest state {} wakes within {:g} us", deepest->name, deepest->latency_us);
  finding.figures = {{"wake_up", deepest->latency_us, "us"}};
  if (deepest->latency_us <= kDeepSleep_us) {
    finding.judged = Judgment::ok;
    return finding;
  }
  // Only a hint: cores sleep this deeply if nothing is due for a long time, and 1 ms is short. The wake-up
  // figures show the real cost.
  finding.judged = Judgment::warning;
  finding.cause =
      fmt::format("a core that sleeps this deeply wakes the loop up to {:g} us late", deepest->latency_us);
  finding.cure =
      fmt::format("cpupower idle-set -D {:g}, or processor.max_cstate=1 at boot{}", kDeepSleep_us,
                  purpose == Purpose::real_arms ? "" : "; without real arms deep sleep does no harm");
  return finding;
}

}  // namespace multipanda::doctor
