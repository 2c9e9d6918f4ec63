#include "backends/gripper/simulated_vacuum.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace multipanda {
namespace {

constexpr double kPumpTime = 0.08;   // time constant of the pump on a sealed cup [s]
constexpr double kLeakTime = 3.0;    // of a sealed cup without pump [s]
constexpr double kVentTime = 0.01;   // of an open cup, and of blowing off [s]
constexpr double kOpenMbar = 20;     // reached by the pump with an open cup
constexpr double kLetsGoMbar = 5;    // below this vacuum the part is released
constexpr double kTearTime = 0.005;  // duration of an overload that detaches the part [s]
constexpr double kInRange = 0.95;    // fraction of the requested vacuum
constexpr double kPascal = 100;      // of a millibar

}  // namespace

SimulatedVacuum::Ticket SimulatedVacuum::start(const VacuumOn& request) {
  const Ticket ticket = results_.begin();
  pump_ = Pump::suction;
  requested_mbar_ = std::min(request.pressure_mbar, limits_.vacuum_mbar);
  time_left_s_ = request.timeout_s;
  state_.part_detached = false;
  return ticket;
}

SimulatedVacuum::Ticket SimulatedVacuum::start(const VacuumDrop& request) {
  const Ticket ticket = results_.begin();
  pump_ = Pump::blow_off;
  time_left_s_ = request.timeout_s;
  return ticket;
}

void SimulatedVacuum::stop() {
  results_.end(GripperResult::aborted);
  pump_ = Pump::off;
}

void SimulatedVacuum::reset() {
  stop();
  state_ = {};
  holds_ = false;
  overload_s_ = 0;
}

double SimulatedVacuum::holding_force() const {
  const double radius = 0.5 * limits_.cup_diameter;
  return std::numbers::pi * radius * radius * state_.vacuum_mbar * kPascal;
}

GripperState SimulatedVacuum::gripper_state() const {
  return {.present = true, .grasped = state_.part_present, .moving = results_.running()};
}

bool SimulatedVacuum::overloaded(const Wrench& F_E, double dt) {
  const double pull = std::max(0.0, -F_E.force().z());
  const double shear = F_E.force().head<2>().norm();
  const double moment = F_E.torque().norm();
  const double load = pull + shear / limits_.friction + moment / (0.5 * limits_.cup_diameter);
  overload_s_ = load > holding_force() ? overload_s_ + dt : 0;
  return overload_s_ > kTearTime;
}

bool SimulatedVacuum::step(bool in_reach, const Wrench& F_E, double dt) {
  const auto approach = [&](double target, double time) {
    state_.vacuum_mbar += -std::expm1(-dt / time) * (target - state_.vacuum_mbar);
  };
  const bool sucks = pump_ == Pump::suction;
  const bool sealed = sucks && in_reach;
  if (sucks) {
    approach(in_reach ? requested_mbar_ : std::min(requested_mbar_, kOpenMbar),
             in_reach ? kPumpTime : kVentTime);
  } else {
    approach(0, pump_ == Pump::off && holds_ ? kLeakTime : kVentTime);
  }

  if (holds_) {
    const bool lost = !in_reach || (!sucks && state_.vacuum_mbar < kLetsGoMbar);
    if (lost || overloaded(F_E, dt)) {
      holds_ = false;
      state_.part_detached = true;
      if (!lost) state_.vacuum_mbar = std::min(state_.vacuum_mbar, kOpenMbar);
    }
  } else if (sealed) {
    holds_ = true;
    overload_s_ = 0;
  }
  state_.part_present = holds_ && state_.vacuum_mbar > kOpenMbar;
  state_.in_control_range = sucks && state_.vacuum_mbar >= kInRange * requested_mbar_;
  state_.power_percent = sucks ? (state_.in_control_range ? 30 : 100) : 0;

  if (!results_.running()) return holds_;
  time_left_s_ -= dt;
  if (sucks && holds_ && state_.in_control_range) {
    results_.end(GripperResult::success);
  } else if (pump_ == Pump::blow_off && !holds_) {
    results_.end(GripperResult::success);
    pump_ = Pump::off;
  } else if (time_left_s_ <= 0) {
    results_.end(GripperResult::unsuccessful);
    pump_ = Pump::off;
  }
  return holds_;
}

}  // namespace multipanda
