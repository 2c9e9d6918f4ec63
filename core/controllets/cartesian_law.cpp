#include "core/controllets/cartesian_law.hpp"

#include <algorithm>

#include <Eigen/Cholesky>

#include "core/controllets/damping_design.hpp"

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
  return force;
}

JointVector null_space_torque(const NullSpaceGains& gains, OwnedArm& arm, const JointVector& q_N,
                              double spring_share) {
  const Eigen::Index n = arm.q().size();
  JointVector tau_null(n);
  const JointMatrix& M = arm.terms->M();
  const JointVector stiffness = JointVector::Constant(n, gains.stiffness);
  const JointVector D = diagonal_damping(M, stiffness, gains.damping_ratio);
  const JointVector spring = spring_share * gains.stiffness * (q_N - arm.q());
  const Jacobian& J = arm.terms->J_V_WE();
  if (gains.projector == Projector::dynamic) {
    const TaskSpace& task = arm.terms->task();
    const JointVector dq_null = task.null_space_velocity(J, arm.dq());
    const JointVector wanted = spring - D.cwiseProduct(dq_null);
    return task.null_space_torque(J, wanted);
  }
  // J^+ = J^T (J J^T + eps)^-1. Any eps > 0 keeps N within [0, I]; this one is far below what a regular pose
  // has.
  constexpr double kEps = 1e-9;
  const Matrix6 JJt = J.lazyProduct(J.transpose()) + kEps * Matrix6::Identity();
  const Eigen::LLT<Matrix6> cholesky(JJt);
  const auto project = [&](const JointVector& x) -> JointVector {  // I - J^+ J is symmetric
    const Vector6 y = cholesky.solve(Vector6(J.lazyProduct(x)));
    return x - J.transpose().lazyProduct(y);
  };
  const JointVector dq_null = project(arm.dq());
  return project(spring - D.cwiseProduct(dq_null));
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

std::vector<ParameterSpec> cartesian_parameters() {
  return {
      {"translational_stiffness_n_per_m", "N/m", 3, {400, 400, 400}, 0, 5000, "K_t along x, y, z."},
      {"rotational_stiffness_nm_per_rad", "N m/rad", 3, {20, 20, 20}, 0, 300, "K_r about x, y, z."},
      {"damping_ratio", "", 1, {1.0}, 0.1, 2, "zeta of every coupled mode, and of the null space."},
      {"stiffness_axes",
       "",
       1,
       {0},
       0,
       1,
       "Axes in which both stiffnesses are given: the world's, or the set-point's end effector's.",
       {"world", "end_effector"}},
      switch_parameter("acceleration_feedforward", true, "Adds Lambda times the set-point's acceleration."),
      {"nullspace_stiffness_nm_per_rad",
       "N m/rad",
       1,
       {10.0},
       0,
       200,
       "K_N of every joint towards the null-space posture."},
      {"projector",
       "",
       1,
       {0},
       0,
       1,
       "Null-space projector: dynamically consistent, or the paper's pseudo-inverse.",
       {"dynamic", "paper_pseudoinverse"}}};
}

ImpedanceGains impedance_gains(const ParameterSet& parameters) {
  return {parameters.vector3(kTranslationalStiffness), parameters.vector3(kRotationalStiffness),
          parameters.number(kCartesianDampingRatio),
          static_cast<StiffnessAxes>(parameters.choice(kStiffnessAxes)),
          parameters.flag(kAccelerationFeedforward)};
}

NullSpaceGains null_space_gains(const ParameterSet& parameters) {
  return {parameters.number(kNullSpaceStiffness), parameters.number(kCartesianDampingRatio),
          static_cast<Projector>(parameters.choice(kProjector))};
}

std::vector<OutputSpec> cartesian_outputs(const std::string& prefix) {
  return {{prefix + "position_error_m", 3, "p_d - p, world axes."},
          {prefix + "orientation_error_rad", 3, "log(R_d R^T), world axes."},
          {prefix + "force_n", 3, "Force that the law asks for at E, world axes."},
          {prefix + "moment_nm", 3, "Moment that the law asks for at E, world axes."}};
}

void show(const TaskForce& force, std::span<double> outputs) {
  std::copy_n(force.error.data(), 6, outputs.begin());
  std::copy_n(force.total.data(), 6, outputs.begin() + 6);
}

}  // namespace multipanda
