#include "core/controllets/force_law.hpp"

#include <algorithm>

namespace multipanda {

double Fade::towards(bool on, double dt) {
  u_ = std::clamp(u_ + (on ? dt : -dt) / kDuration, 0.0, 1.0);
  return value();
}

void ContactDetector::start() {
  filtered_.reset(0);
  age_ = 0;
  in_contact_ = false;
}

bool ContactDetector::update(double force_n, double threshold_n, double dt, double doubt_n) {
  const double force = filtered_.update(force_n, kCutoff, dt);
  age_ += dt;
  if (age_ < kBlind) return in_contact_;
  in_contact_ = force > doubt_n + (in_contact_ ? 0.5 * threshold_n : threshold_n);
  return in_contact_;
}

void ForceDirection::start(const Vector3& n) {
  const double length = n.norm();
  n_ = length > 1e-9 ? Vector3(n / length) : Vector3(-Vector3::UnitZ());
}

const Vector3& ForceDirection::update(const Vector3& F_d, double dt) {
  const double size = F_d.norm();
  if (!(size > kLeastForce) || n_.dot(F_d) <= 0) return n_;
  const Vector3 turn = n_.cross(F_d / size);
  const double sine = turn.norm();
  if (sine < 1e-12) return n_;
  const double angle = std::min(std::asin(std::min(sine, 1.0)), kTurningSpeed * dt);
  n_ = (exp_rotation(angle / sine * turn) * n_).normalized();
  return n_;
}

void ForceLoop::start() {
  error_.reset(0);
  integral_ = 0;
  release();
}

void ForceLoop::release() {
  high_ = std::numeric_limits<double>::infinity();
  low_ = -high_;
}

void ForceLoop::restrain(double low_n, double high_n, double dt) {
  const double inside = std::clamp(integral_, low_n, high_n);
  integral_ = inside + (integral_ - inside) * std::exp(-dt / kRestraint);
  low_ = std::min(low_n, integral_);
  high_ = std::max(high_n, integral_);
}

double ForceLoop::update(const ForceGains& gains, double desired_n, double estimated_n, double weight,
                         double dt, double most_n, double deepest_n) {
  const double before = error_.value();
  const double e = error_.update(desired_n - estimated_n, gains.error_cutoff_hz, dt);
  const double feedback = gains.proportional * e + gains.derivative_s * (e - before) / dt;
  const double grown = integral_ + gains.integral_per_s * weight * e * dt;
  // While clamped, the integral may only change away from the clamp.
  const double base = gains.feedforward ? desired_n : 0, least_n = gains.may_pull ? -deepest_n : 0;
  const double unclamped = base + weight * (feedback + integral_);
  const bool low = unclamped < least_n;
  const bool high = unclamped > most_n;
  if ((!low || grown > integral_) && (!high || grown < integral_)) {
    integral_ =
        std::clamp(grown, std::max(low_, -gains.integral_limit_n), std::min(high_, gains.integral_limit_n));
  }
  if (weight <= 0) integral_ *= std::exp(-dt / Fade::kDuration);
  return std::clamp(base + weight * (feedback + integral_), least_n, most_n);
}

double ForceRoom::update(double left, double most, double dt) {
  const double rise = std::isfinite(most) ? most / Fade::kDuration * dt : most;
  return room_ = std::clamp(left, 0.0, room_ + rise);
}

ForceParameters force_parameters() {
  return {spec_table<kForceParameterCount>(
      parameter_at<kForceProportional>(
          {.name = "force_proportional", .initial = {0.1}, .max = 5, .doc = "Gain P on the force error."}),
      parameter_at<kForceDerivative>({.name = "force_derivative_s",
                                      .unit = "s",
                                      .initial = {0},
                                      .max = 0.2,
                                      .doc = "Gain D; use 0 if the force is estimated and not measured."}),
      parameter_at<kForceIntegral>({.name = "force_integral_per_s",
                                    .unit = "1/s",
                                    .initial = {5},
                                    .max = 50,
                                    .doc = "Gain I: removes joint friction and offsets."}),
      parameter_at<kForceDamping>({.name = "force_damping_n_s_per_m",
                                   .unit = "N s/m",
                                   .initial = {100},
                                   .max = 300,
                                   .doc = "D_z along the force, in addition to the damping of the impedance: "
                                          "reduces bounces, and the speed if a surface disappears."}),
      parameter_at<kErrorCutoff>({.name = "force_error_cutoff_hz",
                                  .unit = "Hz",
                                  .initial = {10},
                                  .min = 1,
                                  .max = 200,
                                  .doc = "Cut-off of the low-pass on the force error."}),
      parameter_at<kIntegralLimit>({.name = "force_integral_limit_n",
                                    .unit = "N",
                                    .initial = {20},
                                    .max = 100,
                                    .doc = "Limit of the integral part."}),
      parameter_at<kContactThreshold>(
          {.name = "contact_threshold_n",
           .unit = "N",
           .initial = {6},
           .min = 0.5,
           .max = 20,
           .doc = "Estimated force that counts as contact while the hand rests, more while it moves; contact "
                  "is lost below half of it."}),
      parameter_at<kTangentialGain>(
          {.name = "tangential_gain",
           .initial = {1},
           .max = 1,
           .doc = "Fraction of the estimated tangential force that is fed forward to compensate friction."}),
      parameter_at<kTangentialCutoff>(
          {.name = "tangential_cutoff_hz",
           .unit = "Hz",
           .initial = {3},
           .min = 0.1,
           .max = 10,
           .doc = "Cut-off of the low-pass on that estimate; it chatters above 5 Hz."}),
      parameter_at<kForceFeedforward>(force_feedforward_parameter()),
      parameter_at<kForceMayPull>(force_may_pull_parameter()),
      parameter_at<kMotionShare>(motion_share_parameter()))};
}

ForceSettings force_settings(const ParameterSet& parameters, std::size_t first) {
  const auto number = [&](ForceParameter p) { return parameters.number(first + p); };
  return {{number(kForceProportional), number(kForceDerivative), number(kForceIntegral), number(kErrorCutoff),
           number(kIntegralLimit), parameters.flag(first + kForceFeedforward),
           parameters.flag(first + kForceMayPull)},
          number(kForceDamping),
          number(kContactThreshold),
          number(kTangentialGain),
          number(kTangentialCutoff),
          number(kMotionShare)};
}

ParameterSpec force_feedforward_parameter() {
  return switch_parameter("force_feedforward", true,
                          "Feeds F_d forward; without it, the feedback alone produces the force.");
}

ParameterSpec force_may_pull_parameter() {
  return switch_parameter("force_may_pull", false,
                          "Allows a negative commanded force, as the paper prints it; a tool that only rests "
                          "on a surface then lifts off.");
}

ParameterSpec motion_share_parameter() {
  return {.name = "contact_motion_share",
          .initial = {1},
          .max = 1,
          .doc =
              "Share of what motion adds to the thresholds of contact, 20 N per m/s and 10 N per m/s^2; 0 "
              "where forces are measured and not estimated."};
}

ParameterSpec press_direction_parameter() {
  return {.name = "press_direction",
          .size = 3,
          .initial = {0, 0, -1},
          .min = -1,
          .max = 1,
          .doc = "Initial pressing direction, world axes; above 0.5 N the direction of F_d replaces it."};
}

InputSpec wrench_input() {
  return {.name = "wrench",
          .quantity = Quantity::wrench,
          .doc = "F_d, desired force that the arm exerts, world axes; the moment is ignored.",
          .max_speed = 60};
}

}  // namespace multipanda
