#pragma once

// A program at an arm's port, for tests: bare sockets, one step at a time. Every wait ends within
// milliseconds; the bound only ends a test that hangs.
#include <array>
#include <optional>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "fci/server/sockets.hpp"
#include "fci/server/virtual_arms.hpp"
#include "fci/wire/frame_reader.hpp"
#include "fci/wire/requests.hpp"
#include "fci/wire/state_layout.hpp"

namespace multipanda::fci::test {

constexpr int kBoundMs = 10000;

// Addresses of this process: parallel tests do not interfere.
inline std::string own_address(int i) {
  return "127.1." + std::to_string(getpid() % 250 + 1) + "." +
         std::to_string(getpid() / 250 % 50 * 5 + i + 1);
}

class TestProgram {
 public:
  explicit TestProgram(const ArmPlace& place, std::uint16_t version = kNewestVersion)
      : d_(dialect(version) != nullptr ? *dialect(version) : kDialects.back()) {
    const sockaddr_in to = ipv4(place.address, place.port);
    tcp_ = Socket(::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0));
    EXPECT_EQ(::connect(tcp_.file(), reinterpret_cast<const sockaddr*>(&to), sizeof(to)), 0);
    udp_ = Socket(::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0));
    const sockaddr_in any = ipv4("0.0.0.0", 0);
    EXPECT_EQ(::bind(udp_.file(), reinterpret_cast<const sockaddr*>(&any), sizeof(any)), 0);
    const auto id = send(ConnectRequest{version, port_of(udp_)});
    Message message;
    if (!wait(id, message)) return;  // the connection was refused
    EXPECT_EQ(decode_connect_reply(message.payload, answer_, server_version_), WireResult::ok);
  }

  bool connected() const { return answer_ == Status::success; }
  Status answer() const { return answer_; }
  std::uint16_t server_version() const { return server_version_; }
  const Dialect& d() const { return d_; }

  // --- TCP ---
  template <typename Request>
  std::uint32_t send(const Request& request) {
    std::array<std::byte, kMaxRequestSize> bytes{};
    const std::size_t size = encode_request(d_, next_id_, request, bytes);
    EXPECT_GT(size, 0u);
    EXPECT_EQ(::send(tcp_.file(), bytes.data(), size, MSG_NOSIGNAL), static_cast<ssize_t>(size));
    kinds_.push_back(Request::kCommand);
    return next_id_++;
  }
  // The reply to `id`, which must be the next one; nothing: none arrived in time.
  std::optional<Status> reply(std::uint32_t id, int bound_ms = kBoundMs) {
    Message message;
    if (!wait(id, message, bound_ms)) return std::nullopt;
    Status status{};
    std::span<const std::byte> rest;
    EXPECT_EQ(decode_reply(d_, kinds_[id], message.payload, status, rest), WireResult::ok);
    rest_.assign(rest.begin(), rest.end());
    return status;
  }
  template <typename Request>
  std::optional<Status> ask(const Request& request) {
    return reply(send(request));
  }
  const std::vector<std::byte>& rest() const { return rest_; }  // of the last reply, behind its status
  // Whether the arm has closed the connection.
  bool is_closed() {
    std::byte one{};
    pollfd look{.fd = tcp_.file(), .events = POLLIN, .revents = 0};
    return ::poll(&look, 1, kBoundMs) > 0 && ::recv(tcp_.file(), &one, 1, MSG_PEEK) <= 0;
  }
  void hang_up() { tcp_.close(); }

  // --- UDP ---
  // The next state, in the order of arrival; size 0: none arrived in time.
  RobotState read(int bound_ms = kBoundMs) {
    RobotState state;
    std::array<std::byte, kMaxStateSize + 1> bytes{};
    pollfd look{.fd = udp_.file(), .events = POLLIN, .revents = 0};
    size_ = 0;
    if (::poll(&look, 1, bound_ms) <= 0) return state;
    socklen_t length = sizeof(arm_);
    const auto size =
        ::recvfrom(udp_.file(), bytes.data(), bytes.size(), 0, reinterpret_cast<sockaddr*>(&arm_), &length);
    size_ = static_cast<std::size_t>(size);
    EXPECT_EQ(decode(d_, {bytes.data(), size_}, state), WireResult::ok);
    return state;
  }
  std::size_t size() const { return size_; }  // of the last state [bytes]
  // The same without sleeping; decoding_s(): what it took once the state was there.
  RobotState read_spinning() {
    RobotState state;
    std::array<std::byte, kMaxStateSize + 1> bytes;
    ssize_t size = -1;
    const HostTime bound = host_now() + std::chrono::milliseconds(kBoundMs);
    while (size < 0 && host_now() < bound) {
      size = ::recv(udp_.file(), bytes.data(), bytes.size(), MSG_DONTWAIT);
    }
    const HostTime there = host_now();
    size_ = size < 0 ? 0 : static_cast<std::size_t>(size);
    EXPECT_EQ(decode(d_, {bytes.data(), size_}, state), WireResult::ok);
    decoding_s_ = seconds(host_now() - there);
    return state;
  }
  double decoding_s() const { return decoding_s_; }
  // The newest state that arrived after `before`, otherwise `before`.
  RobotState read_newest_or(RobotState before) {
    for (;;) {
      const RobotState next = read(0);
      if (size_ == 0) return before;
      before = next;
    }
  }
  // Discards the states that have accumulated.
  RobotState read_newest() {
    RobotState state = read();
    while (size_ > 0) {
      const RobotState next = read(0);
      if (size_ == 0) break;
      state = next;
    }
    return state;
  }
  void command(const RobotCommand& command) {
    std::array<std::byte, kMaxCommandSize> bytes{};
    const std::size_t size = encode(d_, command, bytes);
    ::sendto(udp_.file(), bytes.data(), size, 0, reinterpret_cast<const sockaddr*>(&arm_), sizeof(arm_));
  }

  // --- torque motions ---
  // Begins one and synchronizes with the world, which follows the wall clock until then.
  RobotState start_torques() { return step_in(begin_torques()); }
  RobotState step_in(RobotState state) {
    for (int i = 0; i < 1000; ++i) {
      state = read_newest_or(state);
      const RobotState next = exchange(state);
      if (next.message_id == state.message_id + 1 || size_ == 0) return next;
      state = next;
    }
    ADD_FAILURE() << "the world does not wait";
    return state;
  }
  // Begins one and reads until a state shows it.
  RobotState begin_torques() {
    MoveRequest request;
    request.generator =
        d_.torque_only_needs_generator() ? MoveGenerator::joint_velocity : MoveGenerator::none;
    return begin(request);
  }
  RobotState begin_positions() {
    return begin({.controller = MoveController::joint_impedance, .generator = MoveGenerator::joint_position});
  }
  RobotState begin(const MoveRequest& request) {
    read_newest_or({});
    move_ = send(request);
    EXPECT_EQ(reply(move_), Status::motion_started);
    return read_until([&](const RobotState& s) {
      return s.controller_mode == static_cast<std::uint8_t>(request.controller) &&
             s.motion_generator_mode == static_cast<std::uint8_t>(published(request.generator));
    });
  }
  template <typename Condition>
  RobotState read_until(Condition condition) {
    for (int i = 0; i < 5000; ++i) {
      const RobotState state = read();
      if (size_ == 0 || condition(state)) return state;
    }
    ADD_FAILURE() << "5000 states, and none as expected";
    return {};
  }
  std::uint32_t move() const { return move_; }  // id of the last Move
  // No torque beyond gravity: a light arm floats, at rest it stays where it is.
  RobotCommand torques(const RobotState& state, bool finished = false) const {
    RobotCommand command;
    command.message_id = state.message_id;
    command.torque_command_finished = finished && !d_.torque_only_needs_generator();
    command.motion_generation_finished = finished && d_.torque_only_needs_generator();
    return command;
  }
  // One period of a motion: answers `state`, returns the next.
  RobotState exchange(const RobotState& state, bool finished = false) {
    command(torques(state, finished));
    return read();
  }

 private:
  bool wait(std::uint32_t id, Message& message, int bound_ms = kBoundMs) {
    for (;;) {
      switch (reader_.next(message)) {
        case FrameReader::Next::message:
          EXPECT_EQ(message.command_id, id);
          return message.command_id == id;
        case FrameReader::Next::bad_size:
          ADD_FAILURE() << "the arm sent no message of the protocol";
          return false;
        case FrameReader::Next::incomplete:
          break;
      }
      pollfd look{.fd = tcp_.file(), .events = POLLIN, .revents = 0};
      if (::poll(&look, 1, bound_ms) <= 0) return false;
      const auto room = reader_.room();
      const auto size = ::recv(tcp_.file(), room.data(), room.size(), 0);
      if (size <= 0) return false;
      reader_.received(static_cast<std::size_t>(size));
    }
  }

  const Dialect& d_;
  Socket tcp_, udp_;
  sockaddr_in arm_{};
  FrameReader reader_{HeaderKind::arm, std::size_t{1} << 20};
  std::vector<Command> kinds_;  // of the requests, by id
  std::vector<std::byte> rest_;
  std::uint32_t next_id_ = 0, move_ = 0;
  Status answer_ = Status::error;
  std::uint16_t server_version_ = 0;
  std::size_t size_ = 0;
  double decoding_s_ = 0;
};

}  // namespace multipanda::fci::test
