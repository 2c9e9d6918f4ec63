#pragma once

#include "core/controllets/damping_design.hpp"
#include "core/controllets/elbow.hpp"

// Joint impedance of one arm, shared by the controllets that follow joints. Loop thread, no allocation.
namespace multipanda {

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
  const Elbow* elbow = nullptr;  // where the pull keeps to the bounds for contact, too
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
  double strain =
      0;  // of the springs K (q_d - q) at hand, elbow and carriages (strain_of()); only if gains.elbow is set
};

// tau = K (q_d - q) + D (dq_d - dq) + C dq [+ M ddq_d], the pull within the bounds for contact, at the hand
// and at every prismatic joint; `dq` is what D sees of the arm's velocity (n x 1). With DampingOf::velocity
// -D dq instead of D (dq_d - dq). The result is in arm.tau; fault if it is not finite.
LawResult joint_impedance_law(const JointGains& gains, const JointTarget& target, const JointVector& dq,
                              const ContactBounds& contact, OwnedArm& arm, JointPull& pull);

}  // namespace multipanda
