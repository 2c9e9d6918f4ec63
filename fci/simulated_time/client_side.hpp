#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>

#include "core/safety/torque_limiter.hpp"
#include "core/state/arm_state.hpp"
#include "fci/client/arm_mode.hpp"
#include "fci/client/arm_packet.hpp"
#include "fci/client/posture_hold.hpp"
#include "fci/client/state_intake.hpp"

namespace multipanda::fci {

// The program's side of one arm in torque control, without socket, clock and thread: what ArmDriver does in
// the loop, with its parts.
class ClientSide {
 public:
  // `send`: gets the bytes of an answer.
  using Send = std::function<void(std::span<const std::byte>)>;
  ClientSide(const FciArmConfig& config, const Dialect& dialect, Send send);

  void connect();  // accepts states of any number again
  void enter(ArmPhase phase) { phase_ = phase; }
  ArmPhase phase() const { return phase_; }
  void start_of_motion();  // no torque was sent yet

  void take_state(std::span<const std::byte> datagram, std::int64_t now_ns);
  bool is_unread() const { return unread_; }
  void mark_read() { unread_ = false; }
  const RobotState& newest() const { return intake_.state(); }
  std::int64_t received_ns() const { return received_ns_; }

  ArmMode mode(std::int64_t now_ns, double lost_after_s) const;
  bool is_running() const { return takes_commands(newest(), ArmMotion::torque); }
  void fill(std::int64_t now_ns, double lost_after_s, ArmState& state);
  // Answers the newest state. False: the torque is invalid, and the motion must be stopped.
  bool command(const JointVector& tau);
  void hold(bool last);
  void release_hold() { posture_.release(); }

 private:
  const JointVector& limited(const JointVector& tau);
  void send_torque(const JointVector& tau);

  const Dialect& dialect_;
  Send send_;
  ArmPhase phase_ = ArmPhase::offline;
  StateIntake intake_;
  ArmPacket packet_;
  TorqueLimiter limiter_;  // for hold() and a motion's first torque
  PostureHold posture_;
  RobotCommand command_;
  std::array<std::byte, kMaxCommandSize> bytes_{};
  std::int64_t received_ns_ = 0;
  bool unread_ = false, commanded_ = false, refused_ = false;
};

}  // namespace multipanda::fci
