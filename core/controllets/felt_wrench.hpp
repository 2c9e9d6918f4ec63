#pragma once

#include <cmath>
#include <limits>

#include "core/controllets/controllet.hpp"
#include "core/controllets/force_law.hpp"

namespace multipanda {

// The wrench that an arm exerts, as far as a law may rely on it, and the error that motion may add. All
// figures are those of real arms (docs/forces.md).
//
// Tare. Sensors and model leave a bias b in the estimated joint torques: up to 0.75 N m per joint at rest, 1
// to 2.4 N at the hand. b is their mean from kSettling to kTaking after the start, if the arm was at rest all
// that time and b is no larger than a bias may be, otherwise that of the first rest without contact:
//   |dq_i| < kRest,   |b_i| < kMostTorque,   |f(b)| < kMostForce,   |m(b)| < kMostMoment
//   F = F_hat - s (J J^T)^-1 J b     at K; s <= 1 so that in every pose no more than these bounds comes off
// What is larger is a contact or an undeclared load: it stays felt, bias included. A light contact at the
// start, opposed by the bias up to the sum of both, is no longer felt: the law then presses harder than it
// says by at most kMostForce. At the start desired forces and contact wait meanwhile, and no force is felt.
// Nothing comes off an estimate of exactly 0, which arms send near singular poses.
//
// Another declared load (or tool) changes the estimate by its weight, within LoadRamp::kDuration. b may
// contain that weight or not: it is measured again afterwards, and used until then.
//
// Doubt. While no b is known, any force may be wrong by as much as a bias: only what is felt beyond doubt()
// is contact, and what is not is lost.
//
// Motion. Friction behind the sensors and a wrong inertia look like forces. A force counts as contact above
//   threshold + motion(),   motion() = kPerSpeed |v| + kPerAcceleration |a|
// v of E, a its low-passed change. Over 19 s of free motion of a Research 3, up to 0.35 m/s and 1.4 m/s^2,
// 6 N + motion() is never exceeded, and half of it, below which contact is lost, in no axis at any time; half
// of 6 N alone is in a third of the time, so that an arm that was let go would go on pressing. Pandas show 10
// N at 0.25 m/s and 20 N above 1 m/s^2. For moments: the same at a lever of kLever.
// Loop thread, no allocation.
class FeltWrench {
 public:
  enum class Tare : std::uint8_t { taking, taken, moved, too_large };
  static constexpr const char* kTareDoc =
      "Bias of the estimate: 0 being measured, 1 known; unknown, so that contact needs more force: 2 the arm "
      "moved or another load was declared, 3 too large for a bias: the arm touches something or carries an "
      "undeclared load.";
  static constexpr double kSettling = 0.1, kTaking = 0.2;                          // [s]
  static constexpr double kRest = 0.02;                                            // [rad/s]
  static constexpr double kMostTorque = 0.8, kMostForce = 3.0, kMostMoment = 1.0;  // [N m], [N], [N m]
  static constexpr double kPerSpeed = 20, kPerAcceleration = 10;                   // [N s/m], [N s^2/m]
  static constexpr double kCutoff = 4;    // of a, as late as the estimate [Hz]
  static constexpr double kLever = 0.25;  // [m]

  void start(const OwnedArm& arm);
  // Once per tick, before the others. `touches`: as far as the law knows; then no tare is taken.
  void update(const OwnedArm& arm, bool touches, double dt);
  Tare tare() const { return tare_; }
  bool waits() const { return tare_ == Tare::taking; }
  const Vector6& at_E() const { return F_; }  // world axes [N, N m]
  // What motion adds to a threshold, for the share of it that counts; infinite while the tare is taken.
  double motion(double share) const {  // [N]
    return waits() ? std::numeric_limits<double>::infinity() : share * motion_n_;
  }
  double turning(double share) const { return kLever * motion(share); }  // [N m]
  // What a force, or moment, may be wrong by because no tare is taken, for the share of it that counts.
  double doubt(double share) const { return share * doubt_n_; }           // [N]
  double turning_doubt(double share) const { return share * doubt_nm_; }  // [N m]
  // The same for a motion that is not this hand's: two hands that move together keep what they hold.
  static double motion_of(double speed, double acceleration) {
    return kPerSpeed * std::abs(speed) + kPerAcceleration * std::abs(acceleration);
  }
  const Vector3& acceleration() const { return acceleration_; }  // of E, low-passed [m/s^2]

 private:
  void take(const OwnedArm& arm, bool touches, double dt);
  void watch_load(const ArmState& state);

  Tare tare_ = Tare::taking;
  bool known_ = false;       // there are joint torques
  JointVector bias_, mean_;  // in use, and measured at present [N m] (n x 1)
  double rested_ = 0;        // at rest; negative: not before a declared load acts in full [s]
  double summed_ = 0;        // of it in mean_ [s]
  double doubt_n_ = 0, doubt_nm_ = 0, motion_n_ = 0;
  std::uint32_t config_version_ = 0;
  Eigen::Vector4d weight_ = Eigen::Vector4d::Zero();  // m, m p of tool and load
  LowPass<Vector3> velocity_;
  Vector3 acceleration_ = Vector3::Zero();
  Vector6 F_ = Vector6::Zero();
};

}  // namespace multipanda
