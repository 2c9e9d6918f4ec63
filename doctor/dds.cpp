#include "doctor/dds.hpp"

#include <algorithm>
#include <charconv>
#include <cstdlib>
#include <sstream>

#include <fmt/format.h>

namespace multipanda::doctor {
namespace {

// RTPS 2.2, section 9.6.1: discovery by multicast of domain d is at 7400 + 250 d.
constexpr int kFirstPort = 7400, kPortsPerDomain = 250, kDomains = 233;

std::string environment(const char* name) {
  const char* value = std::getenv(name);
  return value == nullptr ? "" : value;
}

}  // namespace

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
  // An arm sends 1000 states per second: 100 more packets on the same wire delay them noticeably.
  finding.judged = packets > 100 ? defect(purpose) : Judgment::ok;
  if (packets > 100 && packets < 1000) finding.judged = Judgment::warning;
  if (finding.judged == Judgment::ok) return finding;
  finding.cause =
      "multicast goes through every network card, also the arm's, and wakes the kernel for each packet";
  finding.cure = reading.domains.empty()
                     ? "find the sender (tcpdump multicast) and keep it off the arm's card"
                     : "keep DDS off the arm's card: FASTDDS_BUILTIN_TRANSPORTS=SHM on one computer, "
                       "otherwise a profile "
                       "that names the other cards (docs/ros2.md, Keeping 1 kHz)";
  return finding;
}

}  // namespace multipanda::doctor
