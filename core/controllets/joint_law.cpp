#include "core/controllets/joint_law.hpp"

#include <algorithm>
#include <cmath>

#include "core/controllets/carriage.hpp"

namespace multipanda {
namespace {

// The pull of all joints acts at the hand like the wrench J_bar^T tau, J_bar = M^-1 J^T Lambda (Khatib
// 1987), more near a singular pose (TaskSpace::press): the force that keeps the hand where it is. The whole
// pull is scaled until that keeps to its bounds. A motion of the null space does not show at the hand, so the
// force at the elbow may be bounded likewise. So is that at the hand of an arm that stands on this one, as if
// its joints were locked: in a hold they nearly are. A carriage is bounded by its own joint's pull, which no
// other joint has to press for.
void bound(const ContactBounds& contact, const Elbow* elbow, OwnedArm& arm, const JointVector& spring,
           const JointVector& damping, JointVector& tau, JointPull& drawn) {
  const TaskSpace& task = arm.terms->task();
  const Matrix6 press = task.press();
  const auto at_hand = [&](const JointVector& x) {
    return Vector6(press * Vector6(task.J_bar.transpose().lazyProduct(x)));
  };
  const JointVector pull = tau - arm.terms->c() + damping;
  BoundedPull bounded = bound_pull(contact, at_hand(pull), at_hand(damping), arm.terms->V_WE().linear());
  const auto bound_at = [&](const Elbow& point) {
    Vector6 pushes = Vector6::Zero(), damps = Vector6::Zero();
    pushes.head<3>() = point.force(pull);
    damps.head<3>() = point.force(damping);
    const double share = bound_pull(contact, pushes, damps, point.velocity(arm.dq())).force_share;
    bounded.force_share = std::max(bounded.force_share, share);
  };
  if (arm.carried != nullptr) bound_at(Elbow(*arm.terms, arm.carried_joint, arm.carried->X_WE().position));
  if (elbow != nullptr) {
    bound_at(*elbow);
    Vector6 pushes = Vector6::Zero();
    pushes.head<3>() = elbow->force(spring);
    drawn.strain = std::max({strain_of(at_hand(spring), contact), strain_of(pushes, contact),
                             carriage_strain(contact, arm.model(), spring)});
  }
  const double carriage = carriage_share(contact, arm.model(), pull, damping, arm.dq());
  bounded.force_share = std::max(bounded.force_share, carriage);
  drawn.torque = pull;
  drawn.share = std::max(bounded.force_share, bounded.moment_share);
  if (bounded.factor() < 1) tau -= (1 - bounded.factor()) * pull;
}

}  // namespace

ParameterSpec joint_stiffness_parameter() {
  return {.name = "stiffness_nm_per_rad",
          .unit = "N m/rad",
          .size = ParameterSpec::kPerJoint,
          .initial = {600, 600, 600, 600, 250, 150, 50, 50, 50, 50, 50, 50, 50, 50, 50, 50},
          .max = 1000,
          .doc = "Joint stiffness K."};
}

ParameterSpec joint_damping_ratio_parameter() {
  return {.name = "damping_ratio",
          .initial = {1.0},
          .min = 0.1,
          .max = 2,
          .doc = "Damping ratio zeta of every mode."};
}

LawResult joint_impedance_law(const JointGains& gains, const JointTarget& target, const JointVector& dq,
                              const ContactBounds& contact, OwnedArm& arm, JointPull& pull) {
  const JointMatrix& M = arm.terms->M();
  const JointVector& K = gains.stiffness;
  const JointVector error = target.q_d - arm.q();
  const JointVector velocity_error =
      gains.damping_of == DampingOf::velocity ? JointVector(-dq) : JointVector(target.dq_d - dq);
  const JointVector spring = K.cwiseProduct(error);
  JointVector tau = spring + arm.terms->c();
  JointVector damping;  // D dq
  switch (gains.design) {
    case JointGains::Damping::coupled: {
      const JointMatrix D = joint_damping(M, K, gains.damping_ratio);
      tau += D.lazyProduct(velocity_error);
      damping = D.lazyProduct(dq);
      break;
    }
    case JointGains::Damping::diagonal: {  // of each joint while all others stand still, so perhaps more than
                                           // it bears
      const JointVector D = diagonal_damping(M, K, gains.damping_ratio).cwiseMin(gains.bearable);
      tau += D.cwiseProduct(velocity_error);
      damping = D.cwiseProduct(dq);
      break;
    }
    case JointGains::Damping::given: {
      tau += gains.given.cwiseProduct(velocity_error);
      damping = gains.given.cwiseProduct(dq);
      break;
    }
  }
  if (gains.acceleration_feedforward) tau += M.lazyProduct(target.ddq_d);
  pull = {JointVector::Zero(arm.q().size()), 0, 0};
  if (gains.elbow != nullptr || std::isfinite(contact.spring_force + contact.spring_moment))
    bound(contact, gains.elbow, arm, spring, damping, tau, pull);
  if (!tau.allFinite()) return LawResult::fault;
  *arm.tau = tau;
  return LawResult::ok;
}

}  // namespace multipanda
