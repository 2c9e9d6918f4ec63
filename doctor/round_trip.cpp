#include "doctor/round_trip.hpp"

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <netdb.h>
#include <netinet/in.h>
#include <netinet/ip_icmp.h>
#include <poll.h>
#include <sys/socket.h>
#include <thread>
#include <unistd.h>

#include <fmt/format.h>

#include "core/rt/pacer.hpp"
#include "core/rt/thread_setup.hpp"

namespace multipanda::doctor {
namespace {

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

// The time until the other side accepts or refuses: both take one round trip.
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
    finding.judged = Judgment::bad;
    finding.measured = fmt::format("no answer{}", reading.reason.empty() ? "" : " (" + reading.reason + ")");
    finding.cause =
        "no reply to echo requests, and no answer from the control port: wrong address, arm switched off, or "
        "a firewall";
    finding.cure = "check address, cable and power; open the arm's web page in a browser from this computer";
    return finding;
  }
  const Distribution trip = distribution_of(reading.us);
  const std::size_t lost = reading.sent - reading.us.size();
  finding.measured = fmt::format("{}; {} of {} lost; {}", trip.text(), lost, reading.sent, reading.method);
  finding.figures = trip.figures();
  finding.figures.push_back({"lost", static_cast<double>(lost), "packets"});
  finding.figures.push_back({"sent", static_cast<double>(reading.sent), "packets"});
  finding.histogram = trip.bars;
  const double lost_share =
      static_cast<double>(lost) / static_cast<double>(std::max<std::size_t>(1, reading.sent));
  if (trip.p99 > kRoundTripLimit_us || lost_share > 0.01) {
    finding.judged = defect(purpose);
  } else if (trip.worst > kRoundTripLimit_us || lost > 0) {
    finding.judged = Judgment::warning;
  } else {
    finding.judged = Judgment::ok;
    return finding;
  }
  finding.cause = fmt::format(
      "the arm requires its torque within a round trip of {:g} us; {:.2g} % took longer, {:.2g} % "
      "did not return in time",
      kRoundTripLimit_us, 100 * share_above(reading.us, kRoundTripLimit_us), 100 * lost_share);
  finding.cure =
      "connect the control unit directly to a wired card of its own; if wake-ups above are late, fix those "
      "first";
  return finding;
}

}  // namespace multipanda::doctor
