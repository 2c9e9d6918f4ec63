#include <algorithm>
#include <arpa/inet.h>
#include <array>
#include <cerrno>
#include <charconv>
#include <cstring>
#include <ifaddrs.h>
#include <linux/ethtool.h>
#include <linux/sockios.h>
#include <net/if.h>
#include <netdb.h>
#include <netinet/in.h>
#include <netinet/ip_icmp.h>
#include <poll.h>
#include <sstream>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <thread>
#include <unistd.h>

#include <fmt/format.h>

#include "core/rt/pacer.hpp"
#include "core/rt/thread_setup.hpp"
#include "doctor/examination.hpp"

namespace multipanda::doctor {
namespace {

std::optional<sockaddr_in> resolve(const std::string& address) {
  addrinfo hints{};
  hints.ai_family = AF_INET;
  hints.ai_socktype = SOCK_DGRAM;
  addrinfo* found = nullptr;
  if (getaddrinfo(address.c_str(), nullptr, &hints, &found) != 0 || found == nullptr) return {};
  sockaddr_in result{};
  std::memcpy(&result, found->ai_addr, sizeof(result));
  freeaddrinfo(found);
  return result;
}

// This computer's address on the route: connecting a datagram socket sends nothing but selects the route.
std::optional<in_addr> local_address(const sockaddr_in& remote, std::string& reason) {
  const int file = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  if (file < 0) {
    reason = std::strerror(errno);
    return {};
  }
  sockaddr_in to = remote;
  to.sin_port = htons(9);
  sockaddr_in own{};
  socklen_t size = sizeof(own);
  const bool routed = connect(file, reinterpret_cast<const sockaddr*>(&to), sizeof(to)) == 0 &&
                      getsockname(file, reinterpret_cast<sockaddr*>(&own), &size) == 0;
  if (!routed) reason = std::strerror(errno);
  close(file);
  if (!routed) return {};
  return own.sin_addr;
}

std::string interface_with(const in_addr& own) {
  ifaddrs* list = nullptr;
  if (getifaddrs(&list) != 0) return {};
  std::string name;
  for (const ifaddrs* at = list; at != nullptr; at = at->ifa_next) {
    if (at->ifa_addr == nullptr || at->ifa_addr->sa_family != AF_INET) continue;
    sockaddr_in address{};
    std::memcpy(&address, at->ifa_addr, sizeof(address));
    const bool same_net = (ntohl(own.s_addr) >> 24) == 127 && (at->ifa_flags & IFF_LOOPBACK) != 0;
    if (address.sin_addr.s_addr == own.s_addr || same_net) name = at->ifa_name;
  }
  freeifaddrs(list);
  return name;
}

// Longest matching line of /proc/net/route: interface, destination, gateway, ..., mask; hexadecimal, in the
// machine's order.
std::string gateway_to(const in_addr& remote, const SystemFiles& files) {
  std::uint32_t best_mask = 0, gateway = 0;
  bool found = false;
  for (const auto& line : files.lines("proc/net/route")) {
    std::istringstream fields(line);
    std::string name, destination_text, gateway_text, skipped, mask_text;
    if (!(fields >> name >> destination_text >> gateway_text >> skipped >> skipped >> skipped >> skipped >>
          mask_text))
      continue;
    const auto hex = [](const std::string& text) {
      std::uint32_t value = 0;
      (void)std::from_chars(text.data(), text.data() + text.size(), value, 16);
      return value;
    };
    const std::uint32_t mask = hex(mask_text);
    if ((remote.s_addr & mask) != hex(destination_text)) continue;
    if (found && ntohl(mask) < ntohl(best_mask)) continue;
    best_mask = mask;
    gateway = hex(gateway_text);
    found = true;
  }
  if (!found || gateway == 0) return {};
  char text[INET_ADDRSTRLEN] = {};
  const in_addr address{gateway};
  return inet_ntop(AF_INET, &address, text, sizeof(text)) != nullptr ? text : "";
}

std::optional<double> coalesce_us(const std::string& interface) {
  const int file = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  if (file < 0) return {};
  ethtool_coalesce settings{};
  settings.cmd = ETHTOOL_GCOALESCE;
  ifreq request{};
  interface.copy(request.ifr_name, IFNAMSIZ - 1);
  request.ifr_data = reinterpret_cast<char*>(&settings);
  const bool told = ioctl(file, SIOCETHTOOL, &request) == 0;
  close(file);
  if (!told) return {};
  return settings.rx_coalesce_usecs;
}

constexpr std::size_t kPayload = 1200;  // about the size of a state
constexpr std::uint16_t kControlPort = 1337;

std::uint16_t checksum(const unsigned char* bytes, std::size_t size) {
  std::uint32_t sum = 0;
  for (std::size_t i = 0; i + 1 < size; i += 2) {
    std::uint16_t word = 0;
    std::memcpy(&word, bytes + i, 2);
    sum += word;
  }
  if (size % 2 == 1) sum += bytes[size - 1];
  while (sum >> 16 != 0) sum = (sum & 0xFFFF) + (sum >> 16);
  return static_cast<std::uint16_t>(~sum);
}

double us_between(HostTime from, HostTime to) { return static_cast<double>((to - from).count()) * 1e-3; }

// Datagram sockets work for users in the ping group, raw sockets for the superuser.
class Echo {
 public:
  explicit Echo(const sockaddr_in& to) : to_(to) {
    file_ = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC | SOCK_NONBLOCK, IPPROTO_ICMP);
    if (file_ >= 0) return;
    error_ = errno;
    raw_ = true;
    file_ = socket(AF_INET, SOCK_RAW | SOCK_CLOEXEC | SOCK_NONBLOCK, IPPROTO_ICMP);
  }
  ~Echo() {
    if (file_ >= 0) close(file_);
  }
  Echo(const Echo&) = delete;
  bool allowed() const { return file_ >= 0; }
  std::string reason() const { return std::strerror(error_); }

  bool send(std::uint16_t number) {
    std::array<unsigned char, sizeof(icmphdr) + kPayload> packet{};
    icmphdr header{};
    header.type = ICMP_ECHO;
    header.un.echo.id = htons(id_);
    header.un.echo.sequence = htons(number);
    std::memcpy(packet.data(), &header, sizeof(header));
    header.checksum = checksum(packet.data(), packet.size());
    std::memcpy(packet.data(), &header, sizeof(header));
    return sendto(file_, packet.data(), packet.size(), 0, reinterpret_cast<const sockaddr*>(&to_),
                  sizeof(to_)) > 0;
  }

  // Waits for the answer to `number`, at most `patience_us`.
  bool receive(std::uint16_t number, HostTime sent, double patience_us) {
    for (;;) {
      const double left = patience_us - us_between(sent, host_now());
      if (left <= 0) return false;
      pollfd waiting{file_, POLLIN, 0};
      const timespec patience{0, static_cast<long>(left * 1000)};
      if (ppoll(&waiting, 1, &patience, nullptr) <= 0) return false;
      std::array<unsigned char, 2048> packet{};
      const ssize_t size = recv(file_, packet.data(), packet.size(), 0);
      // A raw socket also receives the IP header and the replies to other programs.
      const std::size_t skipped = raw_ ? std::size_t{4} * (packet[0] & 0x0Fu) : 0;
      if (size < static_cast<ssize_t>(skipped + sizeof(icmphdr))) continue;
      icmphdr header{};
      std::memcpy(&header, packet.data() + skipped, sizeof(header));
      const bool ours = !raw_ || header.un.echo.id == htons(id_);
      if (header.type == ICMP_ECHOREPLY && ours && header.un.echo.sequence == htons(number)) return true;
    }
  }

 private:
  sockaddr_in to_;
  int file_ = -1, error_ = 0;
  bool raw_ = false;
  std::uint16_t id_ = static_cast<std::uint16_t>(getpid());
};

void echo_for(Echo& echo, double seconds, RoundTripReading& reading) {
  const auto count = static_cast<std::size_t>(std::max(1.0, seconds * 1000));
  reading.us.reserve(count);
  std::thread([&] {
    ThreadSetup setup;
    setup.lock_memory = false;
    (void)set_up_thread(setup);
    Pacer pacer;
    pacer.start();
    for (std::size_t k = 0; k < count; ++k) {
      pacer.wait();
      const auto number = static_cast<std::uint16_t>(k);
      const HostTime begin = host_now();
      if (!echo.send(number)) continue;
      ++reading.sent;
      // An answer after the next period is lost: the arm would have continued without it.
      if (echo.receive(number, begin, 900)) reading.us.push_back(us_between(begin, host_now()));
      if (k == 200 && reading.us.empty()) return;  // no answers
    }
  }).join();
}

// Time until the other side accepts or refuses: both take one round trip.
void connect_some(const sockaddr_in& to, RoundTripReading& reading) {
  for (int k = 0; k < 10; ++k) {
    const int file = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
    if (file < 0) return;
    const HostTime begin = host_now();
    ++reading.sent;
    bool answered =
        connect(file, reinterpret_cast<const sockaddr*>(&to), sizeof(to)) == 0 || errno == ECONNREFUSED;
    if (!answered && errno == EINPROGRESS) {
      pollfd waiting{file, POLLOUT, 0};
      answered = poll(&waiting, 1, 1000) > 0;
      int error = 0;
      socklen_t size = sizeof(error);
      getsockopt(file, SOL_SOCKET, SO_ERROR, &error, &size);
      answered = answered && (error == 0 || error == ECONNREFUSED);
    }
    if (answered) reading.us.push_back(us_between(begin, host_now()));
    close(file);
    if (!answered && reading.us.empty()) return;  // no answer; each further attempt would wait as long
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  }
}

}  // namespace

NetworkCardReading read_network_card(const std::string& address, const SystemFiles& files) {
  NetworkCardReading reading;
  reading.address = address;
  const auto remote = resolve(address);
  if (!remote) {
    reading.reason = "unknown host name";
    return reading;
  }
  const auto own = local_address(*remote, reading.reason);
  if (!own) return reading;
  reading.interface = interface_with(*own);
  if (reading.interface.empty()) {
    reading.reason = "no network card has this computer's address on that route";
    return reading;
  }
  const std::string folder = "sys/class/net/" + reading.interface + "/";
  reading.loopback = (ntohl(own->s_addr) >> 24) == 127;
  reading.wireless = files.exists(folder + "wireless") || files.exists(folder + "phy80211");
  std::error_code error;
  const auto bus = std::filesystem::read_symlink(files.path(folder + "device/subsystem"), error);
  reading.usb = !error && bus.filename() == "usb";
  reading.virtual_card = !files.exists(folder + "device");
  reading.gateway = gateway_to(remote->sin_addr, files);
  reading.mtu = files.number(folder + "mtu");
  reading.speed = files.number(folder + "speed");
  if (reading.speed && *reading.speed <= 0) reading.speed.reset();
  reading.full_duplex = files.line(folder + "duplex").value_or("full") != "half";
  for (const char* name : {"rx_errors", "tx_errors", "rx_crc_errors", "rx_over_errors"})
    reading.damaged += files.number(folder + "statistics/" + name).value_or(0);
  for (const char* name : {"rx_dropped", "tx_dropped", "rx_missed_errors"})
    reading.dropped += files.number(folder + "statistics/" + name).value_or(0);
  if (!reading.loopback) reading.coalesce_us = coalesce_us(reading.interface);
  return reading;
}

Finding judge_network_card(const NetworkCardReading& reading, Purpose purpose) {
  Finding finding{.id = "network_card:" + reading.address,
                  .subject = fmt::format("card to {}", reading.address)};
  if (reading.interface.empty()) {
    finding.measured = fmt::format("no route to {}: {}", reading.address, reading.reason);
    return finding.as(
        Judgment::bad, "this computer has no network to that address, or the name is wrong",
        "connect the card by cable and give it an address in the arm's network (see the network settings on "
        "the arm's web page)");
  }
  finding.measured = reading.interface;
  if (reading.loopback) {
    finding.measured += " (this computer itself: a virtual arm)";
    return finding.as(Judgment::ok);
  }
  finding.measured += reading.wireless ? ", wireless" : reading.virtual_card ? ", virtual" : ", wired";
  if (reading.usb) finding.measured += " by USB";
  if (reading.speed) finding.measured += fmt::format(", {:g} Mbit/s", *reading.speed);
  if (reading.mtu) finding.measured += fmt::format(", MTU {:g}", *reading.mtu);
  if (reading.coalesce_us)
    finding.measured += fmt::format(", collects packets for {:g} us", *reading.coalesce_us);
  if (!reading.gateway.empty()) finding.measured += fmt::format(", through {}", reading.gateway);
  finding.measured += fmt::format(", {:g} damaged and {:g} dropped packets since its start", reading.damaged,
                                  reading.dropped);
  if (reading.speed) finding.figures.push_back({"speed", *reading.speed, "Mbit/s"});
  if (reading.mtu) finding.figures.push_back({"mtu", *reading.mtu, "bytes"});
  if (reading.coalesce_us) finding.figures.push_back({"coalesce", *reading.coalesce_us, "us"});
  finding.figures.push_back({"damaged", reading.damaged, "packets"});
  finding.figures.push_back({"dropped", reading.dropped, "packets"});

  finding.judged = Judgment::ok;
  // Most severe first; only one is reported.
  const auto fault = [&](bool holds, Judgment judged, const std::string& cause, const std::string& cure) {
    if (!holds || finding.judged != Judgment::ok) return;
    finding.judged = judged;
    finding.cause = cause;
    finding.cure = cure;
  };
  fault(reading.wireless, defect(purpose),
        "a wireless connection can delay packets by milliseconds at any time",
        "connect the arm's control unit by cable");
  fault(reading.speed && *reading.speed < 100, defect(purpose),
        "too slow for one packet per millisecond in each direction",
        "use a card, cable and switch with at least 100 Mbit/s, preferably 1000 Mbit/s");
  fault(!reading.full_duplex, defect(purpose), "half duplex: packets of both directions collide",
        "enable autonegotiation of card and switch, or set full duplex on both ends");
  fault(!reading.gateway.empty(), Judgment::warning, "packets to the arm pass through a router",
        "connect the arm's control unit directly to a card of this computer, with addresses of one network");
  fault(reading.mtu && *reading.mtu < 1500, Judgment::warning, "states are fragmented into several packets",
        fmt::format("ip link set {} mtu 1500", reading.interface));
  fault(reading.coalesce_us && *reading.coalesce_us > 60, Judgment::warning,
        "the card collects packets before it notifies the kernel",
        fmt::format("ethtool -C {} rx-usecs 0 tx-usecs 0", reading.interface));
  fault(reading.damaged > 0, Judgment::warning, "packets were damaged on the wire since the card was started",
        "replace the cable and check whether the number grows: ip -s link");
  fault(reading.usb, Judgment::warning, "a USB card is polled every 125 us", "use a PCIe card");
  return finding;
}

RoundTripReading read_round_trip(const std::string& address, double seconds) {
  RoundTripReading reading;
  reading.address = address;
  addrinfo hints{};
  hints.ai_family = AF_INET;
  hints.ai_socktype = SOCK_STREAM;
  addrinfo* found = nullptr;
  if (getaddrinfo(address.c_str(), nullptr, &hints, &found) != 0 || found == nullptr) {
    reading.reason = "unknown host name";
    return reading;
  }
  sockaddr_in to{};
  std::memcpy(&to, found->ai_addr, sizeof(to));
  freeaddrinfo(found);
  if (Echo echo(to); echo.allowed()) {
    reading.method = fmt::format("ICMP echo of {} bytes", kPayload);
    echo_for(echo, seconds, reading);
  } else {
    reading.reason = "this user is not permitted to send ICMP: " + echo.reason();
  }
  if (reading.us.empty()) {
    reading.sent = 0;
    to.sin_port = htons(kControlPort);
    connect_some(to, reading);
    reading.method = fmt::format("TCP connections to port {}", kControlPort);
  }
  return reading;
}

Finding judge_round_trip(const RoundTripReading& reading, Purpose purpose) {
  Finding finding{.id = "round_trip:" + reading.address,
                  .subject = fmt::format("round trip {}", reading.address)};
  if (reading.us.empty()) {
    finding.measured = fmt::format("no answer{}", reading.reason.empty() ? "" : " (" + reading.reason + ")");
    return finding.as(
        Judgment::bad,
        "no reply to echo requests, and no answer from the control port: wrong address, arm switched off, or "
        "a firewall",
        "check address, cable and power; open the arm's web page in a browser from this computer");
  }
  const Distribution trip = distribution_of(reading.us);
  const std::size_t lost = reading.sent - reading.us.size();
  finding.measured = fmt::format("{}; {} of {} lost; {}", trip.text(), lost, reading.sent, reading.method);
  finding.show(trip);
  finding.figures.push_back({"lost", lost, "packets"});
  finding.figures.push_back({"sent", reading.sent, "packets"});
  const double lost_share =
      static_cast<double>(lost) / static_cast<double>(std::max<std::size_t>(1, reading.sent));
  if (trip.p99 > kRoundTripLimit_us || lost_share > 0.01) {
    finding.judged = defect(purpose);
  } else if (trip.worst > kRoundTripLimit_us || lost > 0) {
    finding.judged = Judgment::warning;
  } else {
    return finding.as(Judgment::ok);
  }
  return finding.because(
      fmt::format(
          "the arm requires its torque within a round trip of {:g} us; {:.2g} % took longer, {:.2g} % "
          "did not return in time",
          kRoundTripLimit_us, 100 * share_above(reading.us, kRoundTripLimit_us), 100 * lost_share),
      "connect the control unit directly to a wired card of its own; if wake-ups above are late, fix those "
      "first");
}

}  // namespace multipanda::doctor
