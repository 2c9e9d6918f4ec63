#include "fci/client/udp_port.hpp"

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <linux/sock_diag.h>
#include <stdexcept>
#include <string>
#include <sys/socket.h>
#include <unistd.h>
#include <utility>

namespace multipanda::fci {
namespace {

// Each counter has a single writer.
void add(std::atomic<std::uint64_t>& counter, std::uint64_t n) {
  counter.store(counter.load(std::memory_order_relaxed) + n, std::memory_order_relaxed);
}

}  // namespace

UdpPort::UdpPort() {
  file_ = ::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
  sockaddr_in any{};
  any.sin_family = AF_INET;
  any.sin_addr.s_addr = htonl(INADDR_ANY);
  socklen_t size = sizeof(any);
  if (file_ < 0 || ::bind(file_, reinterpret_cast<const sockaddr*>(&any), sizeof(any)) != 0 ||
      ::getsockname(file_, reinterpret_cast<sockaddr*>(&any), &size) != 0) {
    const std::string why = std::strerror(errno);
    if (file_ >= 0) ::close(file_);
    throw std::runtime_error("cannot open a UDP port for an arm's states: " + why);
  }
  number_ = ntohs(any.sin_port);
  for (int i = 0; i < kTogether; ++i) {
    parts_[i] = {.iov_base = buffers_[i].data(), .iov_len = buffers_[i].size()};
    arrived_[i].msg_hdr = {.msg_name = &from_[i], .msg_iov = &parts_[i], .msg_iovlen = 1};
  }
}

UdpPort::~UdpPort() { ::close(file_); }

void UdpPort::expect(const Dialect* dialect, std::uint32_t peer_address) {
  const std::uint64_t count = (expected_.load(std::memory_order_relaxed) >> 48) + 1;
  const std::uint64_t version = dialect == nullptr ? 0 : dialect->version;
  expected_.store(count << 48 | version << 32 | peer_address, std::memory_order_release);
}

bool UdpPort::receive() noexcept {
  if (const std::uint64_t expected = expected_.load(std::memory_order_acquire); expected != expecting_) {
    expecting_ = expected;
    intake_.expect(dialect(static_cast<std::uint16_t>(expected >> 32)));
    address_ = static_cast<std::uint32_t>(expected);
    counters_.lost_in_a_row.store(0, std::memory_order_relaxed);
  }
  fresh_ = false;
  // More than the socket's buffer holds, so that a delayed loop finds the newest; bounded, so that a flood
  // cannot block the loop.
  constexpr int kMost = 300;
  int count = 0;
  for (int calls = 0, n = 0; calls < kMost && count < kMost; ++calls) {
    for (mmsghdr& each : arrived_) each.msg_hdr.msg_namelen = sizeof(sockaddr_in);
    n = ::recvmmsg(file_, arrived_.data(), kTogether, MSG_DONTWAIT, nullptr);
    if (n < 0 && (errno == EINTR || errno == ECONNREFUSED)) continue;
    for (int i = 0; i < n; ++i) take(std::span(buffers_[i]).first(arrived_[i].msg_len), from_[i]);
    count += std::max(n, 0);
    if (n < kTogether) break;  // none is left
  }
  constexpr int kBacklog = 8;  // datagrams, fewer than any buffer holds
  if (count >= kBacklog && has_overflowed()) {
    fresh_ = false;
    stale_ = true;
  }
  if (fresh_) {
    stale_ = false;
    received_at_ = host_now();
    counters_.success_rate.store(state().control_command_success_rate, std::memory_order_relaxed);
  }
  return fresh_;
}

// A full buffer keeps the oldest datagrams and drops the newest, so its contents may be outdated and are not
// used; the arm's next state comes within a millisecond.
bool UdpPort::has_overflowed() noexcept {
  std::array<std::uint32_t, SK_MEMINFO_VARS> info{};
  socklen_t size = sizeof(info);
  if (::getsockopt(file_, SOL_SOCKET, SO_MEMINFO, info.data(), &size) != 0) return false;
  return std::exchange(dropped_, info[SK_MEMINFO_DROPS]) != info[SK_MEMINFO_DROPS];
}

void UdpPort::take(std::span<const std::byte> datagram, const sockaddr_in& from) noexcept {
  using enum DatagramOrder::Taken;
  const auto taken = from.sin_addr.s_addr == address_ ? intake_.take(datagram, from.sin_port) : refused;
  if (taken == refused) add(counters_.foreign, 1);
  if (taken == late && counters_.lost.load(std::memory_order_relaxed) > 0) {
    counters_.lost.store(counters_.lost.load(std::memory_order_relaxed) - 1, std::memory_order_relaxed);
    add(counters_.superseded, 1);
  }
  if (taken != newest) return;
  if (fresh_) add(counters_.superseded, 1);
  add(counters_.lost, gap());
  counters_.lost_in_a_row.store(gap(), std::memory_order_relaxed);
  counters_.lost_in_a_row_max.store(
      std::max(counters_.lost_in_a_row_max.load(std::memory_order_relaxed), gap()),
      std::memory_order_relaxed);
  add(counters_.received, 1);
  source_ = from;
  fresh_ = true;
}

bool UdpPort::send(RobotCommand& command) noexcept {
  if (intake_.dialect() == nullptr || state().message_id == 0) return false;
  command.message_id = state().message_id;
  const std::size_t size = encode(*intake_.dialect(), command, command_);
  const ssize_t n = ::sendto(file_, command_.data(), size, MSG_DONTWAIT | MSG_NOSIGNAL,
                             reinterpret_cast<const sockaddr*>(&source_), sizeof(source_));
  const bool taken = size != 0 && n == static_cast<ssize_t>(size);
  add(taken ? counters_.sent : counters_.not_sent, 1);
  const double delay = seconds(host_now() - received_at_);
  counters_.delay_sum_s.store(counters_.delay_sum_s.load(std::memory_order_relaxed) + delay,
                              std::memory_order_relaxed);
  counters_.delay_max_s.store(std::max(counters_.delay_max_s.load(std::memory_order_relaxed), delay),
                              std::memory_order_relaxed);
  return taken;
}

ConnectionStatistics UdpPort::statistics() const {
  const auto get = [](const auto& counter) { return counter.load(std::memory_order_relaxed); };
  const auto answers = get(counters_.sent) + get(counters_.not_sent);
  return {.received = get(counters_.received),
          .lost = get(counters_.lost),
          .lost_in_a_row = get(counters_.lost_in_a_row),
          .lost_in_a_row_max = get(counters_.lost_in_a_row_max),
          .superseded = get(counters_.superseded),
          .foreign = get(counters_.foreign),
          .sent = get(counters_.sent),
          .not_sent = get(counters_.not_sent),
          .answer_delay_mean_s = answers == 0 ? 0 : get(counters_.delay_sum_s) / static_cast<double>(answers),
          .answer_delay_max_s = get(counters_.delay_max_s),
          .command_success_rate = get(counters_.success_rate)};
}

}  // namespace multipanda::fci
