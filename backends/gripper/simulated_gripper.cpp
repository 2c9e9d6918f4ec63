#include "backends/gripper/simulated_gripper.hpp"

#include <algorithm>
#include <cmath>

namespace multipanda {
namespace {

// Servo of one finger with its part of the drive (about 0.23 kg, models/to_mjcf.cpp): 35 Hz, well damped, and
// stable with steps of 1 ms.
constexpr double kStiffness = 10000;   // [N/m]
constexpr double kDamping = 70;        // [N s/m]
constexpr double kOffDamping = 20;     // of the drive without current [N s/m]
constexpr double kAcceleration = 4.0;  // of the width [m/s^2]

constexpr double kHomingSpeed = 0.1, kHomingForce = 20;  // [m/s, N]
constexpr double kReached = 5e-4;                        // from the requested width [m]
constexpr double kFollowed = 2e-3;                       // from a width that is followed [m]
constexpr double kStill = 1e-3;                          // below this rate the fingers are at rest [m/s]
constexpr double kStalled = 0.1;                         // fingers at rest for this long are blocked [s]

}  // namespace

SimulatedGripper::SimulatedGripper(const GripperLimits& limits, double width) : limits_(limits) {
  state_.present = true;
  reset(width);
}

void SimulatedGripper::reset(double width) {
  results_.end(GripperResult::aborted);
  state_.width = width;
  state_.grasped = state_.moving = false;
  w_ref_ = target_ = width;
  v_ref_ = 0;
  go(Drive::hold, width, 0, limits_.force);
}

void SimulatedGripper::go(Drive drive, double target, double speed, double force) {
  drive_ = drive;
  target_ = target;
  speed_ = std::min(speed, limits_.speed);
  force_ = std::min(force, limits_.force);
  still_s_ = 0;
}

SimulatedGripper::Ticket SimulatedGripper::start(const GripperHoming&) {
  const Ticket ticket = results_.begin();
  state_.grasped = false;
  w_ref_ = state_.width;
  v_ref_ = 0;
  go(Drive::find_closed, -limits_.width, kHomingSpeed, kHomingForce);
  return ticket;
}

SimulatedGripper::Ticket SimulatedGripper::start(const GripperMove& request) {
  const Ticket ticket = results_.begin();
  state_.grasped = false;
  w_ref_ = state_.width;
  v_ref_ = 0;
  go(Drive::move, request.width, request.speed, limits_.force);
  return ticket;
}

// Always closes; what is held is not grasped again.
SimulatedGripper::Ticket SimulatedGripper::start(const GripperGrasp& request) {
  const Ticket ticket = results_.begin();
  if (state_.grasped) {
    results_.end(GripperResult::unsuccessful);
    return ticket;
  }
  grasp_ = request;
  w_ref_ = state_.width;
  v_ref_ = 0;
  go(Drive::press, -limits_.width, request.speed, request.force);
  return ticket;
}

void SimulatedGripper::follow(const GripperFollow& request) {
  if (results_.running()) return;
  if (!request.width) {
    if (drive_ == Drive::follow) silent_in_ = 0;
    return;
  }
  silent_in_ = request.silence;
  if (state_.grasped && *request.width < state_.width + kFollowed) return;
  if (drive_ != Drive::follow) {
    w_ref_ = state_.width;
    v_ref_ = 0;
  }
  state_.grasped = false;
  const double still = still_s_;
  go(Drive::follow, std::min(*request.width, limits_.width), request.speed, request.force);
  still_s_ = still;
}

void SimulatedGripper::stop() {
  results_.end(GripperResult::aborted);
  state_.grasped = false;
  go(Drive::off, 0, 0, 0);
}

// The reference moves to the target with limited speed and acceleration. It stays close enough to blocked
// fingers to limit the servo to full force.
double SimulatedGripper::servo(double width, double rate, double dt) {
  if (drive_ == Drive::off) return -0.5 * kOffDamping * rate;
  const double distance = target_ - w_ref_;
  const double desired =
      std::copysign(std::min(speed_, std::sqrt(2 * kAcceleration * std::abs(distance))), distance);
  v_ref_ += std::clamp(desired - v_ref_, -kAcceleration * dt, kAcceleration * dt);
  if (std::abs(distance) <= std::abs(v_ref_) * dt || drive_ == Drive::hold) {
    w_ref_ = target_;
    v_ref_ = 0;
  } else {
    w_ref_ += v_ref_ * dt;
  }
  const double lead = 2 * (limits_.force / kStiffness) + 1e-3;
  w_ref_ = std::clamp(w_ref_, width - lead, width + lead);
  const double force = 0.5 * (kStiffness * (w_ref_ - width) + kDamping * (v_ref_ - rate));
  // A finger presses with the requested force and resists opening with the full force of the motor.
  const double most_opening = drive_ == Drive::press ? limits_.force : force_;
  blocked_ = w_ref_ == target_ || force <= -force_ || force >= most_opening;
  return std::clamp(force, -force_, most_opening);
}

void SimulatedGripper::judge(double width, double rate, double dt) {
  still_s_ = blocked_ && std::abs(rate) < kStill ? still_s_ + dt : 0;
  const bool stalled = still_s_ > kStalled;
  switch (drive_) {
    case Drive::off:
    case Drive::hold:
      return;
    case Drive::move:
      if (w_ref_ == target_ && std::abs(width - target_) < kReached && std::abs(rate) < 5 * kStill) {
        results_.end(GripperResult::success);
      } else if (stalled) {
        results_.end(GripperResult::unsuccessful);
        target_ = width;
      } else {
        return;
      }
      return go(Drive::hold, target_, 0, limits_.force);
    case Drive::press: {
      const bool fits =
          grasp_.width - grasp_.tolerance_inner < width && width < grasp_.width + grasp_.tolerance_outer;
      if (stalled) results_.end(fits ? GripperResult::success : GripperResult::unsuccessful);
      if (stalled && !fits && !state_.grasped) return go(Drive::off, 0, 0, 0);
      state_.grasped = fits && (stalled || state_.grasped);
      return;
    }
    case Drive::follow:
      if (stalled && width > target_ + kFollowed) {
        state_.grasped = true;
        target_ = -limits_.width;  // with the whole force
      }
      silent_in_ -= dt;
      if (silent_in_ > 0 || state_.grasped) return;
      target_ = w_ref_;  // keeps what is pressed under force
      return;
    case Drive::find_closed:
      if (!stalled) return;
      w_ref_ = width;
      v_ref_ = 0;
      return go(Drive::find_open, 2 * limits_.width, kHomingSpeed, kHomingForce);
    case Drive::find_open:
      if (!stalled) return;
      state_.max_width = width;
      results_.end(GripperResult::success);
      return go(Drive::hold, width, 0, limits_.force);
  }
}

double SimulatedGripper::step(double width, double rate, double dt) {
  const double force = servo(width, rate, dt);
  judge(width, rate, dt);
  state_.width = std::max(0.0, width);
  state_.moving = results_.running() || (drive_ == Drive::follow && std::abs(rate) > kStill);
  return force;
}

}  // namespace multipanda
