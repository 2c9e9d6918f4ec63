#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>

#include "backends/simulated_arm/simulated_arm.hpp"
#include "fci/server/wire.hpp"
#include "fci/simulated_time/simulated_time.hpp"
#include "fci/wire/state_layout.hpp"

namespace multipanda::fci {

// One arm's control interface without sockets: accepts answers, and sends its newest measurements at its own
// times. The rules of ArmPort in `strict`, for one program; torque control only.
class ArmSide {
 public:
  struct Rules {
    LateAnswers late = LateAnswers::dropped;
    FirstTorque first_torque = FirstTorque::zero;
    std::int64_t answer_ns = 0;  // longest time to the arrival of an answer
  };
  ArmSide(SimulatedArm& arm, FixedConfig fixed, const Dialect& dialect, std::uint64_t first_number,
          const Rules& rules);

  // One of the arm's periods: applies the command, if any; returns its next state as bytes.
  std::span<const std::byte> period(std::int64_t now_ns);
  void take_answer(std::span<const std::byte> datagram, std::int64_t now_ns);

  // --- requests, as they arrive ---
  MotionStart start_motion();
  void stop_motion();
  bool recover();  // false: not possible now
  bool is_recovering() const { return arm_.mode() == ArmMode::recovering; }
  bool apply(const ArmRequest& request);

  bool runs() const { return runs_; }                     // a motion
  std::uint64_t motions_ended() const { return ended_; }  // without a request
  SimulatedArm& arm() { return arm_; }
  const SimulatedArm& arm() const { return arm_; }
  ArmCounts& counts() { return counts_; }
  const ArmCounts& counts() const { return counts_; }

 private:
  void command();
  void notice_end();
  void show_torque();

  SimulatedArm& arm_;
  FixedConfig fixed_;
  const Dialect& dialect_;
  Rules rules_;
  std::uint64_t number_;  // of the last state
  std::int64_t sent_ns_ = 0;
  RobotState state_;
  std::array<std::byte, kMaxStateSize> bytes_{};

  bool runs_ = false, commanded_ = false, has_pending_ = false;
  bool taken_ = false;  // a command was accepted in this motion
  std::uint64_t first_state_ = 0, newest_answer_ = 0;
  std::uint64_t motions_ended_ = 0, ended_ = 0;
  RobotCommand received_, pending_;
  InterfaceCommand command_;
  JointVector accepted_;  // the last accepted torque of this motion; before the first: its reference
  int missed_ = 0;        // consecutive
  ArmCounts counts_;
};

}  // namespace multipanda::fci
