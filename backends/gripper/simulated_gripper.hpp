#pragma once

#include "backends/gripper/motion_results.hpp"
#include "core/cycle/backend.hpp"
#include "core/state/arm_state.hpp"

namespace multipanda {

struct GripperLimits {
  double width = 0.08;  // fully open [m]
  double speed = 0.2;   // of the width, most [m/s]
  double force = 70;    // of each finger on what is between them, most [N]
};

// Behaviour of a parallel gripper whose two fingers are coupled: what its motor does for each request. No
// wire, no clock, no physics: whoever owns the fingers calls step() once per control period with what they
// do and applies the force that it gives. docs/gripper.md says what is simulated and what is not.
//
// Width: between the fingers' pads. Speeds are the width's. Forces are those of each finger, and both press
// equally: a grasp of 40 N squeezes with 40 N.
//
// One motion at a time; a new one aborts the one that runs. After a motion the fingers are held at the width
// (homing, move) or go on pressing (grasp); after stop(), and after an abort by it, the motor is off: what
// was held falls. Nothing allocates or locks.
class SimulatedGripper {
 public:
  using Ticket = MotionResults::Ticket;

  // width: where the fingers stand [m].
  SimulatedGripper(const GripperLimits& limits, double width);

  // Requests that passed check() (core/cycle/gripper_requests.hpp). Speed and force above the limits are
  // limited.
  Ticket start(const GripperHoming& request);
  Ticket start(const GripperMove& request);
  Ticket start(const GripperGrasp& request);
  void stop();
  GripperResult result(Ticket ticket) const { return results_.of(ticket); }

  // One control period of `dt`: width and its rate now [m, m/s]. Returns the force of the motor on each
  // finger in this period [N]; above 0 opens.
  double step(double width, double rate, double dt);

  // max_width is 0 until the first homing.
  const GripperState& state() const { return state_; }
  const GripperLimits& limits() const { return limits_; }

  // As at construction; a motion that runs is aborted. Homing is kept.
  void reset(double width);

 private:
  enum class Drive : std::uint8_t { off, hold, move, press, find_closed, find_open };
  void go(Drive drive, double target, double speed, double force);
  double servo(double width, double rate, double dt);
  void judge(double width, double rate, double dt);

  GripperLimits limits_;
  MotionResults results_;
  GripperState state_;
  Drive drive_ = Drive::hold;
  GripperGrasp grasp_;  // the last one asked for
  double target_ = 0, speed_ = 0, force_ = 0;
  double w_ref_ = 0, v_ref_ = 0;  // what the servo follows [m, m/s]
  bool blocked_ = false;          // the motor gives what it may, or the reference has arrived
  double still_s_ = 0;            // how long the fingers have not moved although blocked [s]
};

}  // namespace multipanda
