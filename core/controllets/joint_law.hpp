#pragma once

#include "core/controllets/controllet.hpp"
#include "core/controllets/damping_design.hpp"

namespace multipanda {

class RaisedJoints;

// The elbow of an arm, the origin of its middle joint: its motion and force in the null space of the hand. Or
// another point p_W of the link behind `joint`, such as the hand of an arm mounted there. World axes. Loop
// thread, no allocation.
class Elbow {
 public:
  explicit Elbow(ModelTerms& terms);
  Elbow(ModelTerms& terms, std::size_t joint, const Vector3& p_W);
  Vector3 velocity(const JointVector& dq) const { return J_.lazyProduct(dq); }  // (3 x 1) [m/s]
  // The force of a joint torque tau on something that holds the elbow: A^-1 J M^-1 tau, A = J M^-1 J^T
  // (Khatib 1987), (3 x 1) [N]. The force is less where the elbow hardly moves, A + kDamping I in place of A.
  Vector3 force(const JointVector& tau) const;

 private:
  void see_inertia(ModelTerms& terms, double damping);
  static constexpr double kDamping = 0.005;  // [1/kg]
  // A torso of 10 kg m^2 has 0.01 1/kg at 0.3 m: the damping lets 5 % more than the bound act there.
  static constexpr double kDampingOfPoint = 0.0005;

  Eigen::Matrix<double, 3, Eigen::Dynamic, Eigen::ColMajor, 3, kMaxJoints> J_;    // (3 x n)
  Eigen::Matrix<double, 3, Eigen::Dynamic, Eigen::ColMajor, 3, kMaxJoints> J_M_;  // J M^-1 (3 x n)
  Matrix3 inertia_;                                                               // (A + kDamping I)^-1
};

// Joint impedance of one arm, shared by the controllets that follow joints. Loop thread, no allocation.
struct JointGains {
  enum class Damping : std::uint8_t {
    coupled,   // D from the full M and K
    diagonal,  // from M_ii and K_i of each joint, no more than `bearable`
    given
  };
  JointVector stiffness;  // K [N m/rad] (n x 1)
  double damping_ratio = 1;
  Damping design = Damping::coupled;
  JointVector given;     // D, if it is given [N m s/rad] (n x 1)
  JointVector bearable;  // for `diagonal` (n x 1)
  bool acceleration_feedforward = true;
  DampingOf damping_of = DampingOf::error;
  const Elbow* elbow = nullptr;  // point at which the pull also respects the bounds for contact
};

struct JointTarget {
  JointVector q_d, dq_d, ddq_d;  // (n x 1)
};

ParameterSpec joint_stiffness_parameter();
ParameterSpec joint_damping_ratio_parameter();

// The pull of the set-point, without damping, and its share of what the bounds for contact allow, zero where
// they are lifted.
struct JointPull {
  JointVector torque;
  double share = 0;
  // The strain (strain_of()) of the springs K (q_d - q) at hand, elbow and carriages; if gains.elbow is set.
  double strain = 0;
  double stiffness_share = 1;  // share of K that the arm's fastest mode keeps
};

// tau = K (q_d - q) + D (dq_d - dq) + C dq [+ M ddq_d], the pull within the bounds for contact, at the hand
// and at every prismatic joint; `dq` is the arm's velocity on which D acts (n x 1). With DampingOf::velocity
// -D dq instead of D (dq_d - dq). K and D are limited for stability (damping_design.hpp); joints without
// stiffness are braked and follow no set-point. Where K rises, the set-point that acts is at first nearer
// (raised_spring.hpp). The result is in arm.tau; fault if it is not finite.
LawResult joint_impedance_law(const JointGains& gains, const JointTarget& rule, const JointVector& dq,
                              const ContactBounds& contact, OwnedArm& arm, double dt, RaisedJoints& raised,
                              JointPull& pull);

}  // namespace multipanda
