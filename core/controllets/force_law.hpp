#pragma once

#include <limits>
#include <numbers>
#include <vector>

#include "core/controllets/spec_table.hpp"
#include "core/types/spatial.hpp"

// Building blocks of the force controllets: the force along one direction, its contact, and friction across
// it. All forces, including F_d and the estimate F_hat, are those that the ARM EXERTS on its environment.
// Everything runs in the loop's thread and never allocates; states begin at start(). Time steps are the dt of
// the tick, so gains do not depend on the rate.
//
//   f = max(0, F_d + w (P e_f + D de_f/dt + I int w e_f dt)),   e = F_d - F_hat, e_f low-passed
// F_d is always fed forward. The clamp reflects that a tool cannot pull on a surface. w fades the feedback in
// at contact and out at its loss.
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

// A weight between 0 and 1 that follows a switch along a smooth curve, because a step of a reference causes a
// torque spike.
class Fade {
 public:
  static constexpr double kDuration = 0.2;  // from one end to the other [s]

  void reset(bool on) { u_ = on ? 1 : 0; }
  double towards(bool on, double dt);                          // advances by dt and returns value()
  double value() const { return u_ * u_ * (3.0 - 2.0 * u_); }  // zero slope at both ends

 private:
  double u_ = 0;
};

// Detects contact: the low-passed estimate rose above the threshold and has not fallen below half of it
// since, both beyond what it may be wrong by, `doubt_n`. There is no contact within kBlind of the start,
// while the estimate settles. Raw estimates, or thresholds below 1 N, cause false contacts; laws add what
// motion needs (felt_wrench.hpp).
class ContactDetector {
 public:
  static constexpr double kCutoff = 15;  // [Hz]
  static constexpr double kBlind = 0.1;  // [s]

  void start();
  // Force along the direction of pressing.
  bool update(double force_n, double threshold_n, double dt, double doubt_n = 0);
  bool in_contact() const { return in_contact_; }
  double force() const { return filtered_.value(); }  // low-passed [N]

 private:
  LowPass<double> filtered_;
  double age_ = 0;
  bool in_contact_ = false;
};

// The pressing direction, unit length, world axes. It follows F_d while F_d is above kLeastForce, otherwise
// it does not change. It turns no faster than kTurningSpeed, and never towards a force that is more than a
// right angle away: such a force is a desired pressing force of 0.
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
  double derivative_s = 0;      // D [s]; 0 if the force is estimated
  double integral_per_s = 0;    // I [1/s]
  double error_cutoff_hz = 10;  // of e [Hz]
  double integral_limit_n = 0;  // limit of |I int e| [N]
  bool feedforward = true;      // F_d itself, beside the feedback
  bool may_pull = false;        // f may be negative
};

// The law above for one scalar force.
class ForceLoop {
 public:
  void start();
  // Returns f in [0, most_n] [N], or in [-deepest_n, most_n] if it may pull, for the desired and estimated
  // force [N] and the weight w in [0, 1]. The integral grows with w only and not while clamped. Without
  // contact (w = 0) it decays with time constant Fade::kDuration.
  double update(const ForceGains& gains, double desired_n, double estimated_n, double weight, double dt,
                double most_n = std::numeric_limits<double>::infinity(),
                double deepest_n = std::numeric_limits<double>::infinity());
  double integral() const { return integral_; }  // I int e dt [N]
  // Before update(): the integral keeps to [low, high], which contains 0, from now on. The excess decays with
  // time constant kRestraint, since removing it at once would be a step of the torque.
  static constexpr double kRestraint = 0.02;  // [s]
  void restrain(double low_n, double high_n, double dt);
  void release();  // ends restrain()

 private:
  LowPass<double> error_;
  double integral_ = 0;
  double low_ = -std::numeric_limits<double>::infinity(), high_ = -low_;  // of the integral [N]
};

// Bound of a force besides the pulls across it, which bound_pull() has already bounded. It falls at once with
// the remainder that they leave, and rises slowly: a pull that shakes does not shake the force, and a tool
// that was held aside and is released presses again softly.
class ForceRoom {
 public:
  void start() { room_ = 0; }
  // `left` and the bound `most` [N]; infinite: unbounded.
  double update(double left, double most, double dt);

 private:
  double room_ = 0;
};

// --- descriptor parts shared by force controllets ---
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
  kForceFeedforward,
  kForceMayPull,
  kMotionShare,
  kForceParameterCount
};
using ForceParameters = SpecsAt<ParameterSpec, 0, kForceParameterCount>;
ForceParameters force_parameters();
ParameterSpec force_feedforward_parameter();
ParameterSpec force_may_pull_parameter();
ParameterSpec press_direction_parameter();
ParameterSpec motion_share_parameter();
InputSpec wrench_input();  // F_d
// The threshold of contact of controlled moments.
inline constexpr double kMomentThresholdNm = 1.5;
inline constexpr const char* kMomentThresholdDoc =
    "Estimated moment that counts as contact while the hand rests, more while it moves; contact is lost "
    "below "
    "half of it.";

// Their values; `first` is the index of the group's first parameter in the controllet's descriptor.
struct ForceSettings {
  ForceGains gains;
  double damping = 0;            // D_z along the force, in addition to the impedance's damping [N s/m]
  double contact_threshold = 0;  // [N]
  double tangential_gain = 0;    // fraction of the estimated tangential force that is fed forward
  double tangential_cutoff = 0;  // [Hz]
  double motion_share = 1;       // of FeltWrench::motion() and doubt()
  double contact_doubt = 0;      // [N]
};
ForceSettings force_settings(const ParameterSet& parameters, std::size_t first);

}  // namespace multipanda
