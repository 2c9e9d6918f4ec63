#include "core/controllets/axis_force.hpp"

#include <algorithm>
#include <cmath>
#include <string>

#include "core/controllets/energy_tank.hpp"
#include "core/model/task_space.hpp"

namespace multipanda {

SpecsAt<ParameterSpec, 0, 7> axis_selection_parameters() {
  SpecsAt<ParameterSpec, 0, 7> specs;
  for (const std::string quantity : {"force", "moment"}) {
    for (const char* axis : {"_x", "_y", "_z"})
      specs.specs.push_back(switch_parameter(quantity + axis, false,
                                             "Controls the " + quantity +
                                                 (quantity == "force" ? " along" : " about") +
                                                 " this axis of the force frame."));
  }
  specs.specs.push_back(
      choice_parameter("force_frame", {"world", "end_effector"},
                       "Axes that are selected: those of the world, or those of the end effector."));
  return specs;
}

void AxisForce::start() {
  selection_.reset(false);
  plus_.start();
  minus_.start();
  selected_ = contact_ = false;
  rest();
}

void AxisForce::rest() {
  pressing_fade_.reset(false);
  loop_.start();
  free_ = beyond_ = pushed_ = borne_ = 0;
  gamma_ = 1;
  sign_ = 0;
  pressing_ = false;
}

void AxisForce::select(bool selected, double dt) {
  selected_ = selected;
  selection_.towards(selected, dt);
}

// Pressing begins with the first contact. Under a desired force it ends only beyond the loss distance, so
// that a bounce does not end it; an axis that was pushed back farther ends it within twice that distance.
void AxisForce::update_contact(const AxisSettings& settings, const AxisState& now, int sign, double dt) {
  const bool plus = plus_.update(now.estimated, settings.threshold, dt, settings.doubt);
  const bool minus = minus_.update(-now.estimated, settings.threshold, dt, settings.doubt);
  contact_ = (sign >= 0 && plus) || (sign <= 0 && minus);
  if (sign != 0 && sign != sign_) {
    sign_ = sign;
    beyond_ = 0;
  }
  if (contact_) {
    pressing_ = true;
    beyond_ = 0;
  } else {
    beyond_ = std::max(beyond_ + sign * now.speed * dt, -settings.kind.loss);
    if (sign == 0 || beyond_ > settings.kind.loss) pressing_ = false;
  }
}

double AxisForce::update(const AxisSettings& settings, const AxisState& now, double dt) {
  const AxisKind& kind = settings.kind;
  const int sign = now.desired > kind.least ? 1 : now.desired < -kind.least ? -1 : 0;
  update_contact(settings, now, sign, dt);
  if (idle()) {
    rest();
    return 0;
  }
  const double w = pressing_fade_.towards(pressing_, dt);
  // Decreases at once, increases no faster than a fade.
  gamma_ = std::min(contact_shape(std::max(0.0, beyond_), settings.reach), gamma_ + dt / Fade::kDuration);
  const bool slow = std::abs(now.speed)<now.slow, withstands = std::abs(pushed_)> 0.5 * now.unfelt;
  borne_ += !slow ? -dt / kGivingWay : withstands ? dt / kBearing : -dt / kBearing;
  borne_ = std::clamp(borne_, 0.0, 1.0);

  const auto room = [&](double reaction, double pull) {
    return std::min(std::max(0.0, now.room - pull), now.unfelt + borne_ * std::max(0.0, reaction));
  };
  const double up = room(plus_.force(), now.pull), down = room(minus_.force(), -now.pull);
  // Continuous in F_d, also where the bound is infinite.
  const double against = std::max(0.0, 1 - std::abs(now.desired) / kind.pulls_up_to);
  const auto bound = [&](double left, bool along) {
    return along ? std::min(left, kind.most + 2 * std::abs(now.desired))
                 : against * std::min(left, kind.most);
  };
  ForceGains gains = settings.gains;
  gains.feedforward = gains.may_pull = true;
  if (contact_) {
    loop_.release();
  } else {
    loop_.restrain(std::min(0.0, plus_.force()), std::max(0.0, plus_.force()), dt);
  }
  const double pressed = loop_.update(gains, now.desired, now.estimated, w * gamma_, dt,
                                      bound(up, now.desired >= 0), bound(down, now.desired <= 0));

  if (selected_ && sign != 0 && !pressing_) {
    free_ += now.stiffness * (sign * settings.approach_speed - now.speed) * dt;
  } else {
    free_ *= std::exp(-dt / Fade::kDuration);
  }
  free_ = std::clamp(free_, std::max(std::min(0.0, now.desired), -down),
                     std::min(std::max(0.0, now.desired), up));
  pushed_ = w * gamma_ * pressed + (1 - w) * free_;
  return weight() * pushed_;
}

Vector6 borne_inertias(const Matrix6& mobility, const Vector6& weight) {
  const Vector6 own = mobility.diagonal().cwiseMax(1e-6);
  const Vector6 scale = weight.cwiseQuotient(own).cwiseSqrt();
  const Matrix6 B = scale.asDiagonal() * mobility * scale.asDiagonal();
  return own.cwiseInverse() / std::max(1.0, eigenvalues(B)[5]);
}

double share_at_axis_speed(double force, double along, double limit, double steepest) {
  if (!(along > 0.5 * limit) || !std::isfinite(limit)) return 1;
  const double falls_within = std::max(limit, std::abs(force) / steepest);
  return std::max(0.0, 1 - (along - 0.5 * limit) / falls_within);
}

}  // namespace multipanda
