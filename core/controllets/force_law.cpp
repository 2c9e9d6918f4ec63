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

bool ContactDetector::update(double force_n, double threshold_n, double dt) {
  const double force = filtered_.update(force_n, kCutoff, dt);
  age_ += dt;
  if (age_ < kBlind) return in_contact_;
  in_contact_ = force > (in_contact_ ? 0.5 * threshold_n : threshold_n);
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
}

double ForceLoop::update(const ForceGains& gains, double desired_n, double estimated_n, double weight,
                         double dt) {
  const double before = error_.value();
  const double e = error_.update(desired_n - estimated_n, gains.error_cutoff_hz, dt);
  const double feedback = gains.proportional * e + gains.derivative_s * (e - before) / dt;
  const double grown = integral_ + gains.integral_per_s * weight * e * dt;
  // Against the clamp the integral may only come back.
  const bool clamped = desired_n + weight * (feedback + integral_) < 0;
  if (!clamped || grown > integral_) {
    integral_ = std::clamp(grown, -gains.integral_limit_n, gains.integral_limit_n);
  }
  if (weight <= 0) integral_ *= std::exp(-dt / Fade::kDuration);
  return std::max(0.0, desired_n + weight * (feedback + integral_));
}

std::vector<ParameterSpec> force_parameters() {
  return {
      {"force_proportional", "", 1, {0.1}, 0, 5, "P, on the force error."},
      {"force_derivative_s", "s", 1, {0}, 0, 0.2, "D. With an observer in place of a sensor: 0."},
      {"force_integral_per_s", "1/s", 1, {5}, 0, 50, "I: takes joint friction and offsets out."},
      {"force_damping_n_s_per_m",
       "N s/m",
       1,
       {100},
       0,
       300,
       "D_z along the force, on top of the impedance's damping: bounces, and speed where a surface is gone."},
      {"force_error_cutoff_hz", "Hz", 1, {10}, 1, 200, "Low-pass of the force error."},
      {"force_integral_limit_n", "N", 1, {20}, 0, 100, "The integral part stays below."},
      {"contact_threshold_n",
       "N",
       1,
       {2},
       0.5,
       20,
       "Estimated force that counts as contact; lost below half of it."},
      {"tangential_gain",
       "",
       1,
       {1},
       0,
       1,
       "Share of the estimated force across the direction of pressing that is fed forward: friction."},
      {"tangential_cutoff_hz", "Hz", 1, {3}, 0.1, 10, "Low-pass of that estimate; above 5 Hz it chatters."}};
}

ForceSettings force_settings(const ParameterSet& parameters, std::size_t first) {
  const auto number = [&](ForceParameter p) { return parameters.number(first + p); };
  return {{number(kForceProportional), number(kForceDerivative), number(kForceIntegral), number(kErrorCutoff),
           number(kIntegralLimit)},
          number(kForceDamping),
          number(kContactThreshold),
          number(kTangentialGain),
          number(kTangentialCutoff)};
}

ParameterSpec press_direction_parameter() {
  return {"press_direction",
          "",
          3,
          {0, 0, -1},
          -1,
          1,
          "Where to press from the start, world axes; the direction of F_d takes over above 0.5 N."};
}

InputSpec wrench_input() {
  return {.name = "wrench",
          .quantity = Quantity::wrench,
          .doc = "F_d, what the arm is to exert, world axes; its force counts, its moment does not.",
          .max_speed = 60};
}

}  // namespace multipanda
