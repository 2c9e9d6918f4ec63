#include "core/controllets/joint_law.hpp"

#include <algorithm>
#include <cmath>

#include "core/controllets/contact_bounds.hpp"
#include "core/controllets/raised_spring.hpp"
#include "core/types/time.hpp"

namespace multipanda {
namespace {

// The pull of all joints acts at the hand like the wrench J_bar^T tau, J_bar = M^-1 J^T Lambda (Khatib
// 1987), more near a singular pose (TaskSpace::press): the force that keeps the hand where it is. The whole
// pull is scaled until that keeps to its bounds. A motion of the null space does not show at the hand, so the
// force at the elbow may be bounded likewise, and that at the hand of an arm that stands on this one, with
// the joints of that arm taken as locked, as they nearly are in a hold. A carriage is bounded by the pull of
// its own joint alone.
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

// D (n x n) of the softened stiffness K (n x n). Values chosen for each joint alone may be too large for all
// of them together.
JointMatrix damping_of(const JointGains& gains, const JointMatrix& K, const JointVector& led,
                       ModelTerms& terms) {
  const JointMatrix& M = terms.M();
  JointMatrix D;
  if (gains.design == JointGains::Damping::coupled) {
    D = coupled_damping(M, K, gains.damping_ratio);
  } else {
    const bool given = gains.design == JointGains::Damping::given;
    D = (given ? gains.given
               : JointVector(
                     diagonal_damping(M, gains.stiffness, gains.damping_ratio).cwiseMin(gains.bearable)))
            .asDiagonal();
    limit_modes(mass_with_motors(terms), given ? kBearableShare / kArmPeriod : kLargestModalDamping, D);
  }
  if (gains.design != JointGains::Damping::coupled || states_motors(terms.model()))
    raise_modes(M, JointMatrix(kLeastDampingTime * K), D);
  if (led.minCoeff() < 1) {
    const JointVector coasts = JointVector::Ones(led.size()) - led;
    D += kBrake * (coasts.asDiagonal() * M * coasts.asDiagonal());
    limit_modes(mass_with_motors(terms), kLargestModalDamping, D);
  }
  return D;
}

}  // namespace

Elbow::Elbow(ModelTerms& terms) {
  const std::size_t middle = terms.joint_count() / 2;
  J_.setZero(3, static_cast<Eigen::Index>(terms.joint_count()));
  if (middle > 0) terms.point_jacobian(middle - 1, terms.X_WJ(middle).position, J_);
  see_inertia(terms, kDamping);
}

Elbow::Elbow(ModelTerms& terms, std::size_t joint, const Vector3& p_W) {
  J_.setZero(3, static_cast<Eigen::Index>(terms.joint_count()));
  terms.point_jacobian(joint, p_W, J_);
  see_inertia(terms, kDampingOfPoint);
}

void Elbow::see_inertia(ModelTerms& terms, double damping) {
  J_M_.setZero(3, J_.cols());
  const Eigen::LLT<JointMatrix> M(terms.M());
  for (Eigen::Index row = 0; row < 3; ++row) J_M_.row(row) = M.solve(JointVector(J_.row(row))).transpose();
  const Matrix3 A = J_M_.lazyProduct(J_.transpose());
  inertia_ = (A + damping * Matrix3::Identity()).inverse();
}

Vector3 Elbow::force(const JointVector& tau) const { return inertia_ * Vector3(J_M_.lazyProduct(tau)); }

ParameterSpec joint_stiffness_parameter() {
  return {.name = "stiffness_nm_per_rad",
          .unit = "N m/rad",
          .size = ParameterSpec::kPerJoint,
          .initial = {600, 600, 600, 600, 250, 150, 50, 50, 50, 50, 50, 50, 50, 50, 50, 50},
          .max = 1000,
          .doc =
              "Joint stiffness K. Modes with a natural frequency above 150 rad/s are softened to it "
              "(stiffness_share)."};
}

ParameterSpec joint_damping_ratio_parameter() {
  return {.name = "damping_ratio",
          .initial = {1.0},
          .min = 0.1,
          .max = 2,
          .doc = "Damping ratio zeta of every mode."};
}

LawResult joint_impedance_law(const JointGains& gains, const JointTarget& rule, const JointVector& dq,
                              const ContactBounds& contact, OwnedArm& arm, double dt, RaisedJoints& raised,
                              JointPull& pull) {
  const JointTarget target = raised.follow(gains.stiffness, rule, contact, arm, dt);
  const JointMatrix& M = arm.terms->M();
  const JointVector error = target.q_d - arm.q();
  JointMatrix K = gains.stiffness.asDiagonal();
  pull = {JointVector::Zero(arm.q().size()), 0, 0, soften(mass_with_motors(*arm.terms), K)};
  const JointVector spring = K.lazyProduct(error);
  const JointVector led = led_shares(gains.stiffness, arm.model());
  const JointMatrix D = damping_of(gains, K, led, *arm.terms);
  const JointVector velocity_error = gains.damping_of == DampingOf::velocity
                                         ? JointVector(-dq)
                                         : JointVector(led.cwiseProduct(target.dq_d) - dq);
  const JointVector damping = D.lazyProduct(dq);
  JointVector tau = spring + arm.terms->c();
  tau += D.lazyProduct(velocity_error);
  if (gains.acceleration_feedforward) tau += M.lazyProduct(JointVector(led.cwiseProduct(target.ddq_d)));
  if (gains.elbow != nullptr || std::isfinite(contact.spring_force + contact.spring_moment))
    bound(contact, gains.elbow, arm, spring, damping, tau, pull);
  raised.resist(pull.torque, pull.share, dt);
  if (!tau.allFinite()) return LawResult::fault;
  *arm.tau = tau;
  return LawResult::ok;
}

}  // namespace multipanda
