#include <algorithm>
#include <array>
#include <cctype>
#include <charconv>
#include <cstdlib>
#include <numeric>
#include <sstream>
#include <unistd.h>

#include <fmt/format.h>

#include "core/types/time.hpp"
#include "doctor/computer.hpp"

namespace multipanda::doctor {
namespace {

// "pid (name) S ppid ... utime stime ...": the name may contain brackets, so fields are counted from the last
// one. utime and stime are the 14th and 15th field.
std::optional<LoadSample::Process> parse_process(const std::string& stat) {
  const auto open = stat.find('('), close = stat.rfind(')');
  if (open == std::string::npos || close == std::string::npos || close < open) return {};
  LoadSample::Process process{.name = stat.substr(open + 1, close - open - 1)};
  std::istringstream fields(stat.substr(close + 1));
  std::string skipped;
  for (int i = 0; i < 11; ++i) fields >> skipped;
  double user = 0, system = 0;
  if (!(fields >> user >> system)) return {};
  process.ticks = user + system;
  return process;
}

// Two lines, names and values: "IpExt: InNoRoutes ...", "IpExt: 0 ...".
std::optional<double> net_counter(const std::vector<std::string>& lines, const std::string& name) {
  for (std::size_t i = 0; i + 1 < lines.size(); ++i) {
    if (!lines[i].starts_with("IpExt:")) continue;
    std::istringstream names(lines[i]), values(lines[i + 1]);
    for (std::string word, value; names >> word && values >> value;) {
      if (word == name) return std::stod(value);
    }
    return {};
  }
  return {};
}

bool is_number(const std::string& text) {
  return !text.empty() &&
         std::all_of(text.begin(), text.end(), [](unsigned char c) { return std::isdigit(c) != 0; });
}

// RTPS 2.2, section 9.6.1: discovery by multicast of domain d is at 7400 + 250 d.
constexpr int kFirstPort = 7400, kPortsPerDomain = 250, kDomains = 233;

std::string environment(const char* name) {
  const char* value = std::getenv(name);
  return value == nullptr ? "" : value;
}

}  // namespace

LoadSample sample_load(const SystemFiles& files) {
  LoadSample sample;
  sample.time_s = static_cast<double>(host_now().ns) * 1e-9;
  for (const auto& line : files.lines("proc/stat")) {
    if (!line.starts_with("cpu") || line.size() < 4 || line[3] == ' ') continue;
    std::istringstream fields(line);
    std::string name;
    fields >> name;
    // user nice system idle iowait irq softirq steal; guests are part of user
    std::array<double, 8> ticks{};
    for (double& value : ticks) fields >> value;
    LoadSample::Core core;
    core.total = std::accumulate(ticks.begin(), ticks.end(), 0.0);
    core.steal = ticks[7];
    core.busy = core.total - ticks[3] - ticks[4] - ticks[7];
    sample.cores.push_back(core);
  }
  for (const auto& name : files.names("proc")) {
    if (!is_number(name)) continue;
    if (const auto stat = files.line("proc/" + name + "/stat")) {
      if (auto process = parse_process(*stat)) sample.processes.emplace(std::stoi(name), std::move(*process));
    }
  }
  const auto counters = files.lines("proc/net/netstat");
  sample.multicast_in = net_counter(counters, "InMcastPkts");
  sample.multicast_out = net_counter(counters, "OutMcastPkts");
  return sample;
}

LoadReading load_between(const LoadSample& before, const LoadSample& after, const SystemFiles& files) {
  LoadReading reading;
  double steal = 0, total = 0;
  for (std::size_t i = 0; i < std::min(before.cores.size(), after.cores.size()); ++i) {
    const double ticks = after.cores[i].total - before.cores[i].total;
    reading.cores.push_back(ticks > 0 ? (after.cores[i].busy - before.cores[i].busy) / ticks : 0);
    steal += after.cores[i].steal - before.cores[i].steal;
    total += ticks;
  }
  if (total > 0) reading.steal = steal / total;
  // Ticks are the same for cores and processes; one core has total / cores of them.
  const double per_core = reading.cores.empty() ? 0 : total / static_cast<double>(reading.cores.size());
  for (const auto& [number, process] : after.processes) {
    if (number == getpid() || per_core <= 0) continue;
    const auto old = before.processes.find(number);
    const double used = (process.ticks - (old == before.processes.end() ? 0 : old->second.ticks)) / per_core;
    if (used >= 0.01) reading.processes.push_back({number, process.name, used});
  }
  std::sort(reading.processes.begin(), reading.processes.end(),
            [](const auto& a, const auto& b) { return a.cores > b.cores; });
  reading.isolated = parse_core_list(files.line("sys/devices/system/cpu/isolated").value_or(""));
  reading.tickless = parse_core_list(files.line("sys/devices/system/cpu/nohz_full").value_or(""));
  return reading;
}

Finding judge_load(const LoadReading& reading, Purpose purpose) {
  Finding finding{.id = "load", .subject = "load on the cores"};
  if (reading.cores.empty()) {
    finding.measured = "cannot be read";
    return finding.because("/proc/stat is not readable or empty");
  }
  const double busy = std::accumulate(reading.cores.begin(), reading.cores.end(), 0.0);
  const auto count = static_cast<double>(reading.cores.size());
  finding.measured = fmt::format("{:.1f} of {:g} cores busy", busy, count);
  finding.figures = {{"busy_cores", busy, "cores"}, {"cores", count, "cores"}};
  if (!reading.processes.empty()) {
    finding.measured += "; most: ";
    for (std::size_t i = 0; i < std::min<std::size_t>(3, reading.processes.size()); ++i) {
      finding.measured += fmt::format("{}{} ({:.2f})", i == 0 ? "" : ", ", reading.processes[i].name,
                                      reading.processes[i].cores);
    }
  }
  // The loop needs a core of its own; a real-time thread gets one, but shares caches and memory.
  const double idle = count - busy;
  if (idle >= 1 || (count == 1 && idle >= 0.7)) return finding.as(Judgment::ok);
  return finding.as(idle < 0.3 ? defect(purpose) : Judgment::warning,
                    "less than one core is idle: the loop shares its core with other programs",
                    reading.processes.empty()
                        ? std::string("end other programs, or use a processor with more cores")
                        : fmt::format("end {} (process {}) or limit it; or use a processor with more cores",
                                      reading.processes[0].name, reading.processes[0].number));
}

Finding judge_isolation(const LoadReading& reading, Purpose purpose) {
  Finding finding{.id = "isolated_cores", .subject = "cores kept free"};
  const auto list = [](const std::vector<int>& cores) {
    std::string text;
    for (const int core : cores) text += fmt::format("{}{}", text.empty() ? "" : ", ", core);
    return text;
  };
  finding.judged = Judgment::ok;
  finding.figures = {{"isolated", reading.isolated.size(), "cores"}};
  if (reading.isolated.empty()) {
    finding.measured = purpose == Purpose::real_arms
                           ? "none; if wake-ups are late: isolcpus=N nohz_full=N at boot, run with --cpu N"
                           : "none (not needed)";
    return finding;
  }
  finding.measured =
      fmt::format("core {} isolated{}; run with --cpu {}", list(reading.isolated),
                  reading.tickless.empty() ? "" : fmt::format(", {} without ticks", list(reading.tickless)),
                  reading.isolated.front());
  return finding;
}

Finding judge_steal(const LoadReading& reading, Purpose purpose) {
  Finding finding{.id = "steal", .subject = "time taken by the host"};
  if (!reading.steal) {
    finding.measured = "cannot be read";
    return finding.because("/proc/stat is not readable or empty");
  }
  finding.measured = fmt::format("{:.2f} %", 100 * *reading.steal);
  finding.figures = {{"steal", 100 * *reading.steal, "%"}};
  if (*reading.steal < 0.001) return finding.as(Judgment::ok);
  return finding.as(*reading.steal < 0.01 ? Judgment::warning : defect(purpose),
                    "the host of this virtual machine runs other work on its cores",
                    "give the virtual machine dedicated (pinned) cores, or run on the host");
}

DdsReading read_dds(const LoadSample& before, const LoadSample& after, const SystemFiles& files) {
  DdsReading reading;
  reading.middleware = environment("RMW_IMPLEMENTATION");
  reading.domain = environment("ROS_DOMAIN_ID");
  for (const char* file : {"proc/net/udp", "proc/net/udp6"}) {
    for (const auto& line : files.lines(file)) {
      // "  12: 0100007F:1CE8 00000000:0000 07 ...": the local address is the second field.
      std::istringstream fields(line);
      std::string number, local;
      if (!(fields >> number >> local)) continue;
      const auto colon = local.rfind(':');
      if (colon == std::string::npos) continue;
      int port = 0;
      if (std::from_chars(local.data() + colon + 1, local.data() + local.size(), port, 16).ec != std::errc())
        continue;
      const int domain = (port - kFirstPort) / kPortsPerDomain;
      if (port < kFirstPort || (port - kFirstPort) % kPortsPerDomain != 0 || domain >= kDomains) continue;
      if (std::find(reading.domains.begin(), reading.domains.end(), domain) == reading.domains.end())
        reading.domains.push_back(domain);
    }
  }
  const double seconds = after.time_s - before.time_s;
  const auto rate = [&](const std::optional<double>& from, const std::optional<double>& to) {
    return from && to && seconds > 0 ? std::optional((*to - *from) / seconds) : std::nullopt;
  };
  reading.multicast_in = rate(before.multicast_in, after.multicast_in);
  reading.multicast_out = rate(before.multicast_out, after.multicast_out);
  return reading;
}

Finding judge_dds(const DdsReading& reading, Purpose purpose) {
  Finding finding{.id = "dds", .subject = "ROS 2 (DDS traffic)"};
  finding.measured = "ROS 2 is not running";
  if (!reading.domains.empty()) {
    finding.measured = "on, domain";
    for (const int domain : reading.domains) finding.measured += fmt::format(" {}", domain);
  }
  if (!reading.middleware.empty()) finding.measured += fmt::format(", {}", reading.middleware);
  if (!reading.domain.empty()) finding.measured += fmt::format(", ROS_DOMAIN_ID {}", reading.domain);
  const double packets = reading.multicast_in.value_or(0) + reading.multicast_out.value_or(0);
  if (reading.multicast_in || reading.multicast_out) {
    finding.measured += fmt::format("; {:.0f} multicast packets/s in, {:.0f} out",
                                    reading.multicast_in.value_or(0), reading.multicast_out.value_or(0));
    finding.figures = {{"multicast_in", reading.multicast_in.value_or(0), "1/s"},
                       {"multicast_out", reading.multicast_out.value_or(0), "1/s"}};
  }
  // An arm sends 1000 states per second: 100 more packets on the same cable delay them noticeably.
  finding.judged = packets > 100 ? defect(purpose) : Judgment::ok;
  if (packets > 100 && packets < 1000) finding.judged = Judgment::warning;
  if (finding.judged == Judgment::ok) return finding;
  return finding.because(
      "multicast goes through every network card, also the arm's, and wakes the kernel for each packet",
      reading.domains.empty()
          ? "find the sender (tcpdump multicast) and keep it off the arm's card"
          : "keep DDS off the arm's card: FASTDDS_BUILTIN_TRANSPORTS=SHM on one computer, "
            "otherwise a profile that names the other cards (docs/ros2.md, Keeping 1 kHz)");
}

}  // namespace multipanda::doctor
