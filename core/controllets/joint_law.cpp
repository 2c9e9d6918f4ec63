#include "core/controllets/joint_law.hpp"

#include <algorithm>
#include <cmath>

#include "core/controllets/damping_design.hpp"

namespace multipanda {

Vector6 press_at_hand(ModelTerms& terms, const JointVector& tau) {
  const TaskSpace& task = terms.task();
  return task.press() * Vector6(task.J_bar.transpose().lazyProduct(tau));
}

namespace {

// The pull of all joints acts at the hand like a wrench, the force that keeps the hand where it is. The whole
// pull is scaled until that keeps to its bounds. A motion of the null space does not show at the hand, so the
// force at the elbow may be bounded likewise.
void bound(const ContactBounds& contact, const Elbow* elbow, OwnedArm& arm, const JointVector& damping,
           JointVector& tau, JointPull& drawn) {
  const TaskSpace& task = arm.terms->task();
  const Matrix6 press = task.press();
  const auto at_hand = [&](const JointVector& x) {
    return Vector6(press * Vector6(task.J_bar.transpose().lazyProduct(x)));
  };
  const JointVector pull = tau - arm.terms->c() + damping;
  BoundedPull bounded = bound_pull(contact, at_hand(pull), at_hand(damping), arm.terms->V_WE().linear());
  if (elbow != nullptr) {
    Vector6 pushes = Vector6::Zero(), damps = Vector6::Zero();
    pushes.head<3>() = elbow->force(pull);
    damps.head<3>() = elbow->force(damping);
    const double share = bound_pull(contact, pushes, damps, elbow->velocity(arm.dq())).force_share;
    bounded.force_share = std::max(bounded.force_share, share);
  }
  drawn = {pull, std::max(bounded.force_share, bounded.moment_share)};
  if (bounded.factor() < 1) tau -= (1 - bounded.factor()) * pull;
}

}  // namespace

LawResult joint_impedance_law(const JointGains& gains, const JointTarget& target,
                              const ContactBounds& contact, OwnedArm& arm, JointPull& pull) {
  const JointMatrix& M = arm.terms->M();
  const JointVector& K = gains.stiffness;
  const JointVector error = target.q_d - arm.q();
  const JointVector velocity_error = target.dq_d - arm.dq();
  JointVector tau = K.cwiseProduct(error) + arm.terms->c();
  JointVector damping;  // D dq
  switch (gains.design) {
    case JointGains::Damping::coupled: {
      const JointMatrix D = joint_damping(M, K, gains.damping_ratio);
      tau += D.lazyProduct(velocity_error);
      damping = D.lazyProduct(arm.dq());
      break;
    }
    case JointGains::Damping::diagonal: {  // of each joint while all others stand still, so perhaps more than
                                           // it bears
      const JointVector D = diagonal_damping(M, K, gains.damping_ratio).cwiseMin(gains.bearable);
      tau += D.cwiseProduct(velocity_error);
      damping = D.cwiseProduct(arm.dq());
      break;
    }
    case JointGains::Damping::given: {
      tau += gains.given.cwiseProduct(velocity_error);
      damping = gains.given.cwiseProduct(arm.dq());
      break;
    }
  }
  if (gains.acceleration_feedforward) tau += M.lazyProduct(target.ddq_d);
  pull = {JointVector::Zero(arm.q().size()), 0};
  if (std::isfinite(contact.spring_force + contact.spring_moment))
    bound(contact, gains.elbow, arm, damping, tau, pull);
  if (!tau.allFinite()) return LawResult::fault;
  *arm.tau = tau;
  return LawResult::ok;
}

}  // namespace multipanda
