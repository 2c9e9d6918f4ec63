#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "core/cycle/backend.hpp"
#include "core/state/arm_state.hpp"

namespace multipanda {

// How a motion of a gripper ended.
enum class GripperResult : std::uint8_t {
  none,          // unknown or no longer stored
  running,       // not over yet
  success,       //
  unsuccessful,  // ended without success: nothing grasped, width not reached, or no vacuum in time
  aborted        // ended by a stop, or by another motion
};

// Results of the last motions, by ticket. Tickets count from 1.
class MotionResults {
 public:
  using Ticket = std::uint64_t;

  // Starts a motion and aborts the running one.
  Ticket begin() {
    end(GripperResult::aborted);
    at(++last_) = GripperResult::running;
    return last_;
  }
  // Ends the running motion, if any.
  void end(GripperResult result) {
    if (running()) at(last_) = result;
  }
  bool running() const { return last_ > 0 && at(last_) == GripperResult::running; }
  GripperResult of(Ticket ticket) const {
    return ticket == 0 || ticket > last_ || last_ - ticket >= kKept ? GripperResult::none : at(ticket);
  }

 private:
  static constexpr std::size_t kKept = 64;
  GripperResult& at(Ticket ticket) { return results_[static_cast<std::size_t>(ticket % kKept)]; }
  const GripperResult& at(Ticket ticket) const { return results_[static_cast<std::size_t>(ticket % kKept)]; }

  std::array<GripperResult, kKept> results_{};
  Ticket last_ = 0;
};

struct GripperLimits {
  double width = 0.08;  // largest width [m]
  double speed = 0.2;   // largest rate of the width [m/s]
  double force = 70;    // largest force of each finger on the object between them [N]
};

// Behavior of a parallel gripper whose two fingers are coupled: the motor's force for each request. The owner
// of the fingers calls step() once per control period with their motion and applies the returned force.
// docs/gripper.md describes what is simulated.
//
// Width: between the fingers' pads. Speeds are the width's. Forces are those of each finger, and both press
// equally: a grasp of 40 N squeezes with 40 N.
//
// One motion at a time; a new one aborts the running one. After a motion the fingers hold the width
// (homing, move) or keep pressing (grasp). After stop(), and after a grasp outside its tolerance, the motor
// is off and a held object falls. A grasp of an object that is already held is unsuccessful and changes
// nothing. No allocation, no lock.
class SimulatedGripper {
 public:
  using Ticket = MotionResults::Ticket;

  // width: the initial width [m].
  SimulatedGripper(const GripperLimits& limits, double width);

  // Requests that passed check() (core/cycle/requests.hpp). Speed and force are reduced to the limits.
  Ticket start(const GripperHoming& request);
  Ticket start(const GripperMove& request);
  Ticket start(const GripperGrasp& request);
  void follow(const GripperFollow& request);  // not more than the widest opening
  void stop();
  GripperResult result(Ticket ticket) const { return results_.of(ticket); }

  // One control period of `dt`: width and its rate now [m, m/s]. Returns the force of the motor on each
  // finger in this period [N]; above 0 opens.
  double step(double width, double rate, double dt);

  // max_width is 0 until the first homing.
  const GripperState& state() const { return state_; }
  const GripperLimits& limits() const { return limits_; }

  // Resets to the state after construction, except homing; aborts the running motion.
  void reset(double width);

 private:
  enum class Drive : std::uint8_t { off, hold, move, press, find_closed, find_open, follow };
  void go(Drive drive, double target, double speed, double force);
  double servo(double width, double rate, double dt);
  void judge(double width, double rate, double dt);

  GripperLimits limits_;
  MotionResults results_;
  GripperState state_;
  Drive drive_ = Drive::hold;
  GripperGrasp grasp_;  // the last request
  double target_ = 0, speed_ = 0, force_ = 0;
  double w_ref_ = 0, v_ref_ = 0;  // reference of the servo [m, m/s]
  bool blocked_ = false;          // full force, or the reference has reached the target
  double silent_in_ = 0;          // of the widths to follow [s]
  double still_s_ = 0;            // time at rest while blocked [s]
};

}  // namespace multipanda
