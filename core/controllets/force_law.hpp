#pragma once

#include <numbers>
#include <vector>

#include "core/controllets/statement.hpp"
#include "core/types/spatial.hpp"

// The parts that every force controllet is made of: one force along one direction, its contact, and what
// friction does across it. Signs: forces are what the ARM EXERTS on its surroundings, as F_d and the estimate
// F_hat are. All of it runs in the loop's thread and never allocates; states begin at start(). Lengths of
// time are the tick's own dt, so gains mean the same at any rate.
//
//   f = max(0, F_d + w (P e_f + D de_f/dt + I int w e_f dt)),   e = F_d - F_hat, e_f low-passed
//
// F_d is always fed forward. The clamp says that a tool cannot pull on a surface. w fades the feedback in
// with the contact and out with its loss.
namespace multipanda {

// First-order low-pass, exact for an input held over dt.
template <typename Value>
class LowPass {
 public:
  void reset(const Value& value) { value_ = value; }
  const Value& update(const Value& input, double cutoff_hz, double dt) {
    value_ += (1.0 - std::exp(-2.0 * std::numbers::pi * cutoff_hz * dt)) * (input - value_);
    return value_;
  }
  const Value& value() const { return value_; }

 private:
  Value value_{};
};

// A weight between 0 and 1 that follows a yes or no along a smooth curve: steps of references make blows.
class Fade {
 public:
  static constexpr double kDuration = 0.2;  // from one end to the other [s]

  void reset(bool on) { u_ = on ? 1 : 0; }
  double towards(bool on, double dt);                          // moves on by dt, gives value()
  double value() const { return u_ * u_ * (3.0 - 2.0 * u_); }  // zero slope at both ends

 private:
  double u_ = 0;
};

// Yes while the tool presses: the estimate, low-passed, rose above the threshold and has not fallen below
// half of it since. Never within kBlind of the start, where an estimate settles. Raw estimates or thresholds
// below 1 N find contacts in the air.
class ContactDetector {
 public:
  static constexpr double kCutoff = 15;  // [Hz]
  static constexpr double kBlind = 0.1;  // [s]

  void start();
  bool update(double force_n, double threshold_n, double dt);  // force along the direction of pressing
  bool in_contact() const { return in_contact_; }
  double force() const { return filtered_.value(); }  // low-passed [N]

 private:
  LowPass<double> filtered_;
  double age_ = 0;
  bool in_contact_ = false;
};

// The direction in which to press, unit length, world axes. It is that of F_d while that is above
// kLeastForce, and stays where it was below; it turns no faster than kTurningSpeed, and never towards a force
// that pulls back (more than a right angle away): such a force is a desired pressing force of 0.
class ForceDirection {
 public:
  static constexpr double kLeastForce = 0.5;    // [N]
  static constexpr double kTurningSpeed = 0.5;  // [rad/s]

  void start(const Vector3& n);
  const Vector3& update(const Vector3& F_d, double dt);
  const Vector3& n() const { return n_; }
  Vector3 across(const Vector3& v) const { return v - n_.dot(v) * n_; }

 private:
  Vector3 n_ = -Vector3::UnitZ();
};

struct ForceGains {
  double proportional = 0;      // P []
  double derivative_s = 0;      // D [s]; 0 with an observer in place of a sensor
  double integral_per_s = 0;    // I [1/s]
  double error_cutoff_hz = 10;  // of e [Hz]
  double integral_limit_n = 0;  // |I int e| stays below [N]
};

// The law above for one scalar force.
class ForceLoop {
 public:
  void start();
  // Desired and estimated force [N], `weight` w in 0 ... 1. The integral only grows with w, not against the
  // clamp, and is forgotten with Fade::kDuration where there is no contact (w = 0). Gives f >= 0 [N].
  double update(const ForceGains& gains, double desired_n, double estimated_n, double weight, double dt);
  double integral() const { return integral_; }  // I int e dt [N]

 private:
  LowPass<double> error_;
  double integral_ = 0;
};

// --- statement parts that force controllets share, in this order ---
enum ForceParameter : std::size_t {
  kForceProportional,
  kForceDerivative,
  kForceIntegral,
  kForceDamping,
  kErrorCutoff,
  kIntegralLimit,
  kContactThreshold,
  kTangentialGain,
  kTangentialCutoff,
  kForceParameterCount
};
std::vector<ParameterSpec> force_parameters();
ParameterSpec press_direction_parameter();
InputSpec wrench_input();  // F_d

// Their values; `first` is the index of the group's first parameter in the controllet's statement.
struct ForceSettings {
  ForceGains gains;
  double damping = 0;            // D_z, on top of the impedance's own, along the force [N s/m]
  double contact_threshold = 0;  // [N]
  double tangential_gain = 0;    // share of the estimated force across that is fed forward
  double tangential_cutoff = 0;  // [Hz]
};
ForceSettings force_settings(const ParameterSet& parameters, std::size_t first);

}  // namespace multipanda
