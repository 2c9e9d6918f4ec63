#include "core/controllets/grasp_sequence.hpp"

#include <algorithm>

namespace multipanda {

void GraspSequence::start(double distance_m) {
  phase_ = Phase::rest;
  first_.start();
  second_.start();
  force_.reset(false);
  distance_d_ = distance_m;
  rate_ = to_open_ = ramp_u_ = at_touch_ = desired_ = apart_s_ = 0;
  touched_now_ = false;
}

double GraspSequence::ramp() const {
  const double u = ramp_u_;
  return u * u * u * (10 - 15 * u + 6 * u * u);
}

void GraspSequence::update(const Measured& measured, const GraspSettings& settings, double dt) {
  first_.update(measured.first_n, settings.contact_threshold_n, dt, measured.first_doubt_n);
  second_.update(measured.second_n, settings.contact_threshold_n, dt, measured.second_doubt_n);
  const bool requested = measured.requested_n > kLeastSqueeze;
  const bool released = measured.requested_n < 0.5 * kLeastSqueeze;
  touched_now_ = false;
  switch (phase_) {
    case Phase::rest:
      if (requested) phase_ = Phase::approach;
      break;
    case Phase::approach:
      if (released) phase_ = Phase::rest;
      if (!both_touch()) break;
      phase_ = Phase::grasp;
      touched_now_ = true;
      ramp_u_ = apart_s_ = 0;
      at_touch_ = std::max(0.0, 0.5 * (first_.force() + second_.force()));
      break;
    case Phase::grasp:
      apart_s_ = both_touch() ? 0 : apart_s_ + dt;
      if (!released && apart_s_ < kLossTime) break;
      phase_ = released ? Phase::rest : Phase::lost;
      distance_d_ = measured.distance_m;
      rate_ = 0;
      to_open_ = released ? settings.release_distance_m : 0;
      break;
    case Phase::lost:
      if (released) phase_ = Phase::rest;
      break;
  }
  const bool pressing = phase_ == Phase::grasp;
  force_.towards(pressing, dt);
  ramp_u_ = pressing ? std::min(1.0, ramp_u_ + dt / settings.ramp_s)
                     : std::max(0.0, ramp_u_ - dt / Fade::kDuration);
  desired_ = at_touch_ + ramp() * (std::max(0.0, measured.requested_n) - at_touch_);

  double aim = 0;
  if (phase_ == Phase::approach) aim = -settings.closing_speed;
  if (phase_ == Phase::rest && to_open_ > 0 && force_.value() <= 0) aim = settings.closing_speed;
  move_set_point(aim, measured.distance_m, settings, dt);
}

// The speed of the set-point approaches `aim_speed` over Fade::kDuration. Its lead is limited so that the
// spring force stays below kStrongestClosing.
void GraspSequence::move_set_point(double aim_speed, double distance, const GraspSettings& settings,
                                   double dt) {
  const double change = settings.closing_speed * dt / Fade::kDuration;
  rate_ = std::clamp(aim_speed, rate_ - change, rate_ + change);
  double next = distance_d_ + rate_ * dt;
  if (rate_ < 0 && settings.closing_stiffness > 0) {
    next = std::max(next, std::min(distance_d_, distance - kStrongestClosing / settings.closing_stiffness));
  }
  if (dt > 0) rate_ = (next - distance_d_) / dt;
  distance_d_ = next;
  if (rate_ > 0) to_open_ -= rate_ * dt;
}

}  // namespace multipanda
