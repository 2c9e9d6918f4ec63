#include "doctor/machine_kind.hpp"

#include <thread>

#include <fmt/format.h>

#include "core/types/time.hpp"

namespace multipanda::doctor {

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
  finding.figures = {{"cores", static_cast<double>(reading.cores), "cores"}};
  if (reading.container) finding.measured += ", in a container";
  if (!reading.hypervisor) {
    finding.cause = "the processor does not report whether it is virtual";
    return finding;
  }
  finding.figures.push_back({"virtual", *reading.hypervisor ? 1.0 : 0.0, ""});
  if (!*reading.hypervisor) {
    finding.judged = Judgment::ok;
    return finding;
  }
  finding.judged = purpose == Purpose::real_arms ? Judgment::bad : Judgment::warning;
  finding.measured += reading.product.empty() ? ", virtual" : fmt::format(", virtual ({})", reading.product);
  finding.cause = "the host decides when a virtual machine runs: 1 kHz cannot be guaranteed";
  finding.cure = purpose == Purpose::real_arms
                     ? "control real arms from a computer without a hypervisor"
                     : "sufficient for simulation; real arms need a physical computer";
  return finding;
}

Finding judge_clock_source(const MachineKindReading& reading, Purpose purpose) {
  Finding finding{.id = "clock_source", .subject = "clock"};
  finding.measured = fmt::format("{}, {:.0f} ns to read it",
                                 reading.clock_source.empty() ? "source unknown" : reading.clock_source,
                                 reading.clock_read_ns);
  finding.figures = {{"read", reading.clock_read_ns, "ns"}};
  // Fast clocks are read without entering the kernel, in 20 to 60 ns; slow ones take microseconds.
  if (reading.clock_read_ns < 500) {
    finding.judged = Judgment::ok;
    return finding;
  }
  finding.judged = reading.clock_read_ns < 5000 ? Judgment::warning : defect(purpose);
  finding.cause = "this clock is read through the kernel several times per cycle";
  finding.cure =
      "boot with clocksource=tsc tsc=reliable if the processor's counter is steady; otherwise use another "
      "computer";
  return finding;
}

}  // namespace multipanda::doctor
