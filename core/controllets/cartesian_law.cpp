#include "core/controllets/cartesian_law.hpp"

#include <algorithm>
#include <cmath>

#include "core/controllets/damping_design.hpp"
#include "core/types/triangular.hpp"

namespace multipanda {

TaskStiffness ImpedanceGains::stiffness(const Matrix3& R_W_d) const {
  if (axes == StiffnessAxes::end_effector) {
    return TaskStiffness::along(R_W_d, translational_stiffness, rotational_stiffness);
  }
  return {translational_stiffness.asDiagonal(), rotational_stiffness.asDiagonal()};
}

TaskForce impedance_force(const ImpedanceGains& gains, const CartesianTarget& target, const Pose& X,
                          const Vector6& V, const Matrix6& Lambda) {
  const TaskStiffness K = gains.stiffness(target.X_W_d.rotation);
  const Matrix6 D = task_damping(Lambda, K.matrix(), gains.damping_ratio);
  TaskForce force;
  force.error = pose_error(target.X_W_d, X);
  force.spring = spring_wrench(K, force.error);
  force.total = force.spring;
  force.total.noalias() += D * (target.V_d.vector - V);
  if (gains.acceleration_feedforward) force.total.noalias() += Lambda * target.A_d.vector;
  if (!std::isfinite(gains.contact.spring_force + gains.contact.spring_moment)) return force;
  const Vector6 damping = D * V;
  force.pull = force.total + damping;
  force.bounded = bound_pull(gains.contact, force.pull, damping, V.head<3>());
  if (force.bounded.factor() < 1) {
    const Vector6 taken = force.pull - force.bounded.remaining(force.pull);
    force.spring -= taken;
    force.total -= taken;
  }
  return force;
}

namespace {

// Factor on a torque of the null space, with which the hand presses with a twentieth of the bounds at most.
double share_within(const ContactBounds& contact, const TaskSpace& task, const JointVector& tau) {
  constexpr double kShare = 0.05;
  const Vector6 pressing = task.press() * Vector6(task.J_bar.transpose().lazyProduct(tau));
  const double force = pressing.head<3>().norm(), moment = pressing.tail<3>().norm();
  return std::min({1.0, kShare * contact.spring_force / force, kShare * contact.spring_moment / moment});
}

}  // namespace

JointVector null_space_torque(const NullSpaceGains& gains, OwnedArm& arm, const JointVector& q_N,
                              double spring_share) {
  const Eigen::Index n = arm.q().size();
  JointVector tau_null(n);
  const JointMatrix& M = arm.terms->M();
  const JointVector stiffness = JointVector::Constant(n, gains.stiffness);
  const JointVector D = diagonal_damping(M, stiffness, gains.damping_ratio);
  const JointVector spring = spring_share * gains.stiffness * (q_N - arm.q());
  const Jacobian& J = arm.terms->J_V_WE();
  const TaskSpace& task = arm.terms->task();
  const bool bounded = std::isfinite(gains.contact.spring_force + gains.contact.spring_moment);
  if (gains.projector == Projector::dynamic) {
    const JointVector dq_null = task.null_space_velocity(J, arm.dq());
    const JointVector damping = D.cwiseProduct(dq_null);
    if (!task.floored || !bounded) return task.null_space_torque(J, JointVector(spring - damping));
    const JointVector drawn = task.null_space_torque(J, spring);
    return share_within(gains.contact, task, drawn) * drawn - task.null_space_torque(J, damping);
  }
  // J^+ = J^T (J J^T + eps)^-1. Any eps > 0 keeps N within [0, I]; this value is far below the eigenvalues of
  // a regular pose.
  constexpr double kEps = 1e-9;
  const Matrix6 JJt = J.lazyProduct(J.transpose()) + kEps * Matrix6::Identity();
  Matrix6 L;
  cholesky_factor(JJt, L);
  const auto project = [&](const JointVector& x) -> JointVector {  // I - J^+ J is symmetric
    const Vector6 y = cholesky_solve(L, Vector6(J.lazyProduct(x)));
    return x - J.transpose().lazyProduct(y);
  };
  const JointVector damping = D.cwiseProduct(project(arm.dq()));
  if (!bounded) return project(spring - damping);
  // Not consistent with the dynamics: in any pose, what the posture draws reaches the hand.
  const JointVector drawn = project(spring);
  return share_within(gains.contact, task, drawn) * drawn - project(damping);
}

LawResult cartesian_impedance_law(const ImpedanceGains& gains, const NullSpaceGains& null_space,
                                  const CartesianTarget& target, OwnedArm& arm, const JointVector& q_N,
                                  TaskForce& force) {
  ModelTerms& terms = *arm.terms;
  force = impedance_force(gains, target, terms.X_WE(), terms.V_WE().vector, terms.task().Lambda);
  *arm.tau = terms.c() + null_space_torque(null_space, arm, q_N);
  *arm.tau += terms.J_V_WE().transpose().lazyProduct(force.total);
  return arm.tau->allFinite() ? LawResult::ok : LawResult::fault;
}

CartesianParameters cartesian_parameters() {
  return {spec_table<kCartesianParameterCount>(
      parameter_at<kTranslationalStiffness>({.name = "translational_stiffness_n_per_m",
                                             .unit = "N/m",
                                             .size = 3,
                                             .initial = {400, 400, 400},
                                             .max = 5000,
                                             .doc = "Stiffness K_t along x, y, z."}),
      parameter_at<kRotationalStiffness>({.name = "rotational_stiffness_nm_per_rad",
                                          .unit = "N m/rad",
                                          .size = 3,
                                          .initial = {20, 20, 20},
                                          .max = 300,
                                          .doc = "Stiffness K_r about x, y, z."}),
      parameter_at<kCartesianDampingRatio>(
          {.name = "damping_ratio",
           .initial = {1.0},
           .min = 0.1,
           .max = 2,
           .doc = "Damping ratio zeta of every coupled mode, and of the null space."}),
      parameter_at<kStiffnessAxes>(choice_parameter(
          "stiffness_axes", {"world", "end_effector"},
          "Axes of both stiffnesses: those of the world, or those of the set-point's end effector.")),
      parameter_at<kAccelerationFeedforward>(switch_parameter(
          "acceleration_feedforward", true, "Adds Lambda times the acceleration of the set-point.")),
      parameter_at<kNullSpaceStiffness>(
          {.name = "nullspace_stiffness_nm_per_rad",
           .unit = "N m/rad",
           .initial = {10.0},
           .max = 200,
           .doc = "Stiffness K_N of every joint towards the null-space posture."}),
      parameter_at<kProjector>(choice_parameter(
          "projector", {"dynamic", "paper_pseudoinverse"},
          "Null-space projector: dynamically consistent, or the pseudo-inverse of the paper.")))};
}

ImpedanceGains impedance_gains(const ParameterSet& parameters, const ContactBounds& contact) {
  return {parameters.vector3(kTranslationalStiffness),
          parameters.vector3(kRotationalStiffness),
          parameters.number(kCartesianDampingRatio),
          static_cast<StiffnessAxes>(parameters.choice(kStiffnessAxes)),
          parameters.flag(kAccelerationFeedforward),
          contact};
}

NullSpaceGains null_space_gains(const ParameterSet& parameters, const ContactBounds& contact) {
  return {parameters.number(kNullSpaceStiffness), parameters.number(kCartesianDampingRatio),
          static_cast<Projector>(parameters.choice(kProjector)), contact};
}

CartesianOutputs cartesian_outputs(const std::string& prefix) {
  return {spec_table<kCartesianOutputSize>(
      output_at<0, 3>(prefix + "position_error_m", "p_d - p, world axes."),
      output_at<3, 3>(prefix + "orientation_error_rad", "log(R_d R^T), world axes."),
      output_at<6, 3>(prefix + "force_n", "Force commanded at E, world axes."),
      output_at<9, 3>(prefix + "moment_nm", "Moment commanded at E, world axes."))};
}

void show(const TaskForce& force, std::span<double> outputs) {
  std::copy_n(force.error.data(), 6, outputs.begin());
  std::copy_n(force.total.data(), 6, outputs.begin() + 6);
}

}  // namespace multipanda
