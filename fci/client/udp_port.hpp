#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <netinet/in.h>
#include <sys/socket.h>

#include "core/state/arm_state.hpp"
#include "core/types/time.hpp"
#include "fci/client/state_intake.hpp"
#include "fci/wire/state_layout.hpp"

namespace multipanda::fci {

// The datagrams of one arm: states in, commands out, on one socket that survives reconnections. The loop's
// functions do not allocate, lock, throw or wait.
class UdpPort {
 public:
  // Binds any free port. Throws std::runtime_error.
  UdpPort();
  ~UdpPort();
  UdpPort(const UdpPort&) = delete;
  UdpPort& operator=(const UdpPort&) = delete;

  int file() const { return file_; }
  std::uint16_t number() const { return number_; }

  // --- any thread ---
  // From now on states of this arm (network byte order) in this dialect are accepted, whatever their number;
  // nullptr: none. The first one fixes the arm's port. Takes effect at the next receive().
  void expect(const Dialect* dialect, std::uint32_t peer_address);
  ConnectionStatistics statistics() const;

  // --- one thread: the loop's ---
  // Receives datagrams; true: state() is newer than before.
  bool receive() noexcept;
  // The newest state; its message_id is 0 before the first one.
  const RobotState& state() const noexcept { return intake_.state(); }
  HostTime received_at() const noexcept { return received_at_; }
  // Whether state() may be outdated: the socket's buffer overflowed, and no state has arrived since.
  bool is_stale() const noexcept { return stale_; }
  // Consecutive states missing before state(), and the arm's clock between the last two states taken.
  std::uint64_t gap() const noexcept { return intake_.gap(); }
  // Answers state(): sends `command` with the number of the state.
  bool send(RobotCommand& command) noexcept;

 private:
  struct Expected {
    const Dialect* dialect = nullptr;
    std::uint32_t address = 0;
  };
  void take(std::span<const std::byte> datagram, const sockaddr_in& from) noexcept;
  bool has_overflowed() noexcept;  // since the last call

  int file_ = -1;
  std::uint16_t number_ = 0;

  // Written by expect(): dialect by its version, address; one word, so that both change at once.
  std::atomic<std::uint64_t> expected_{0};  // (count << 48) | (version << 32) | address
  std::uint64_t expecting_ = 0;
  std::uint32_t address_ = 0;

  StateIntake intake_;
  bool fresh_ = false, stale_ = false;
  std::uint32_t dropped_ = 0;  // datagrams dropped by a full socket buffer, as of has_overflowed()
  sockaddr_in source_{};
  HostTime received_at_;

  // One call reads what has arrived; fewer datagrams than this mean that none is left.
  static constexpr int kTogether = 4;
  std::array<std::array<std::byte, 4096>, kTogether> buffers_;
  std::array<sockaddr_in, kTogether> from_{};
  std::array<iovec, kTogether> parts_{};
  std::array<mmsghdr, kTogether> arrived_{};
  std::array<std::byte, kMaxCommandSize> command_;

  // Written by the loop, read by any thread.
  struct Counters {
    std::atomic<std::uint64_t> received{0}, lost{0}, lost_in_a_row{0}, lost_in_a_row_max{0}, superseded{0},
        foreign{0}, sent{0}, not_sent{0};
    std::atomic<double> delay_sum_s{0}, delay_max_s{0}, success_rate{0};
  } counters_;
};

}  // namespace multipanda::fci
