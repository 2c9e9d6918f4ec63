#include "fci/client/net_ft.hpp"

#include <array>
#include <cerrno>
#include <chrono>
#include <cstdio>
#include <cstring>
#include <limits>
#include <netinet/in.h>
#include <poll.h>
#include <stdexcept>
#include <sys/socket.h>
#include <unistd.h>

#include "fci/client/tcp_channel.hpp"

namespace multipanda::fci {
namespace {

constexpr std::size_t kRecord = 36;
constexpr std::uint16_t kStop = 0, kStream = 2;
constexpr std::uint32_t kMonitor = 1u << 16;    // a threshold set by the user: not a fault
constexpr std::uint32_t kSaturated = 1u << 17;  // transducer saturated, or an error of its converter
constexpr std::int32_t kLate = 1000;            // largest lateness of a sample, in samples
constexpr double kMostSamples = 8000;           // of any device, per second
constexpr double kStall = 60;                   // allowance for a stall of this computer [s]

std::uint32_t big_endian(const unsigned char* p) {
  return std::uint32_t{p[0]} << 24 | std::uint32_t{p[1]} << 16 | std::uint32_t{p[2]} << 8 | p[3];
}

std::string hexadecimal(std::uint32_t status) {
  std::array<char, 16> text{};
  std::snprintf(text.data(), text.size(), "0x%08x", status);
  return text.data();
}

}  // namespace

NetFt::NetFt(Config config) : config_(std::move(config)) {}

NetFt::~NetFt() { stop(); }

void NetFt::tell(const std::string& what) const {
  if (config_.report) config_.report(config_.who + " at " + config_.address + ": " + what);
}

void NetFt::ask(std::uint16_t command) const {
  const std::array<unsigned char, 8> request{
      0x12, 0x34, static_cast<unsigned char>(command >> 8), static_cast<unsigned char>(command), 0, 0, 0, 0};
  (void)::send(socket_, request.data(), request.size(), MSG_NOSIGNAL | MSG_DONTWAIT);
}

void NetFt::start() {
  stop();
  sockaddr_in device{};
  device.sin_family = AF_INET;
  device.sin_port = htons(config_.port);
  device.sin_addr = resolve(config_.address, config_.who);
  socket_ = ::socket(AF_INET, SOCK_DGRAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
  if (socket_ < 0 || ::connect(socket_, reinterpret_cast<const sockaddr*>(&device), sizeof device) != 0) {
    const std::string why = std::strerror(errno);
    stop();
    throw std::runtime_error(config_.who + " at " + config_.address + ": no UDP socket: " + why);
  }
  last_ = {};
  sample_ = status_ = 0;
  restarted_ = silent_ = false;
  summed_ = 0;
  newest_.write(last_);
  ending_ = ready_ = false;
  thread_ = std::thread([this] { run(); });
  constexpr auto kPatience = std::chrono::seconds(5);
  const auto deadline = std::chrono::steady_clock::now() + kPatience;
  while (!ready_ && std::chrono::steady_clock::now() < deadline)
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  if (ready_) return;
  stop();
  throw std::runtime_error(
      config_.who + " at " + config_.address + ": no records from UDP port " + std::to_string(config_.port) +
      " within 5 s; look at its power, cable and address, and switch RDT on in its page");
}

void NetFt::stop() {
  ending_ = true;
  if (thread_.joinable()) thread_.join();
  if (socket_ < 0) return;
  ask(kStop);
  ::close(socket_);
  socket_ = -1;
}

void NetFt::run() {
  HostTime asked = host_now(), heard = asked;
  ask(kStream);
  pollfd readable{.fd = socket_, .events = POLLIN, .revents = 0};
  while (!ending_) {
    (void)::poll(&readable, 1, 50);
    std::array<unsigned char, 64> datagram{};
    for (int k = 0; k < 1000; ++k) {  // bounded: a flood must not keep it from ending
      const ssize_t size = ::recv(socket_, datagram.data(), datagram.size(), 0);
      if (size < 0 && errno == ECONNREFUSED) continue;
      if (size < 0) break;
      if (size != static_cast<ssize_t>(kRecord)) {
        foreign_.fetch_add(1, std::memory_order_relaxed);
        continue;
      }
      const std::uint64_t before = last_.reading.records;
      const HostTime now = host_now();
      take(datagram.data(), now);
      if (last_.reading.records != before) heard = now;
    }
    const HostTime now = host_now();
    const bool silent = seconds(now - heard) > kAgain;
    if (silent && seconds(now - asked) > kAgain) {
      ask(kStream);
      asked = now;
    }
    if (silent != silent_ && last_.reading.records > 0)
      tell(silent ? "it is silent; laws that need its force end in hold" : "it sends again");
    silent_ = silent;
  }
}

// The newest number of a stream that may wrap around.
void NetFt::take(const unsigned char* record, HostTime now) {
  const std::uint32_t sample = big_endian(record + 4), status = big_endian(record + 8);
  const auto ahead = static_cast<std::int32_t>(sample - sample_);
  const double silence_s = seconds(now - last_.received);
  if (last_.reading.records > 0) {
    if (ahead <= 0 && ahead >= -kLate) {
      late_.fetch_add(1, std::memory_order_relaxed);
      return;
    }
    const bool too_far = ahead > kMostSamples * (silence_s + kStall);
    const bool begun_since = silence_s > 1 && sample < kMostSamples * silence_s;
    if (!restarted_ && (ahead < 0 || too_far || begun_since)) {
      tell("it was restarted; start the run again for a new tare");
      restarted_ = true;
    }
  }
  sample_ = sample;
  ForceReading& reading = last_.reading;
  for (Eigen::Index i = 0; i < 6; ++i) {
    const auto counts = static_cast<std::int32_t>(big_endian(record + 12 + 4 * i));
    reading.F_S.vector[i] = counts / (i < 3 ? config_.counts_per_n : config_.counts_per_nm);
  }
  const std::uint32_t wrong = status & ~kMonitor;
  reading.fault = (wrong & kSaturated) != 0  ? Intervention::force_sensor_saturated
                  : wrong != 0 || restarted_ ? Intervention::force_sensor_fault
                                             : Intervention::none;
  if (wrong != status_ && wrong != 0) tell("its status is " + hexadecimal(status) + "; see its manual");
  status_ = wrong;
  ++reading.records;
  average(now);
  last_.received = now;
  newest_.write(last_);
}

void NetFt::average(HostTime now) {
  constexpr double kLongestGap = 0.05;  // [s]
  const bool follows = summed_ > 0 && seconds(now - last_.received) < kLongestGap;
  if (!follows || last_.reading.fault != Intervention::none) {
    summed_ = 0;
    sum_.setZero();
    sum_began_ = now;
    last_.reading.mean_S.vector.setConstant(std::numeric_limits<double>::quiet_NaN());  // of another time
    if (last_.reading.fault != Intervention::none) return;
  }
  sum_ += last_.reading.F_S.vector;
  ++summed_;
  if (seconds(now - sum_began_) < SensedForce::kTareTime) return;
  last_.reading.mean_S.vector = sum_ / summed_;
  summed_ = 0;
  ready_ = true;
}

const ForceReading& NetFt::latest() noexcept {
  (void)newest_.take();
  seen_ = newest_.value().reading;
  seen_.age_s = seconds(host_now() - newest_.value().received);
  return seen_;
}

}  // namespace multipanda::fci
