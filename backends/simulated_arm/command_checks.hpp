#pragma once

#include "core/types/joints.hpp"
#include "device/arm_error.hpp"

namespace multipanda {

// The arm's check of commanded torques: each joint's torque may change by at most rate_max per second, over
// one period. The change is counted from the last command and from the torque that the arm last published in
// single precision, because a client only knows the latter (at 87 N m one ulp is 8 N m/s at 1 kHz). A torque
// is refused only if it is too far from both. A motion begins at 0, as Franka documents it, or at the torque
// in use that the arm published; with begin(X) only at the latter.
class TorqueRateCheck {
 public:
  static constexpr double kSlack = 1e-5;  // relative

  // rate_max (n x 1) [N m/s].
  TorqueRateCheck(const JointVector& rate_max, double period_s);

  void begin() { begin(JointVector::Zero(last_.size())); }
  void begin(const JointVector& tau) { last_ = replaced_ = tau; }
  // The joint that violates the limit by most, with its rate [N m/s]; or nothing.
  ReflexDetail check(const JointVector& tau) const;
  void accept(const JointVector& tau) { last_ = replaced_ = tau; }
  // Until accept(): a torque that passed the check and is replaced by the one of the same period.
  void replace(const JointVector& tau) { replaced_ = tau; }
  void publish(const JointVector& tau_J_d) { published_ = tau_J_d.cast<float>().cast<double>(); }

 private:
  JointVector rate_max_, last_, replaced_, published_;
  double period_;
};

}  // namespace multipanda
