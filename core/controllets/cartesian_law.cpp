#include "core/controllets/cartesian_law.hpp"

#include <algorithm>
#include <cmath>

#include "core/controllets/contact_bounds.hpp"
#include "core/controllets/raised_spring.hpp"
#include "core/model/prismatic_joints.hpp"
#include "core/types/triangular.hpp"

namespace multipanda {

namespace {

TaskSpace task_with_motors(ModelTerms& terms) {
  TaskSpace task;
  compute_task_space(terms.J_V_WE(), mass_with_motors(terms), task);
  return task;
}

}  // namespace

Matrix3 ImpedanceGains::axes_at(const Matrix3& R_W_d) const {
  return axes == StiffnessAxes::end_effector ? R_W_d : Matrix3(Matrix3::Identity());
}

TaskStiffness ImpedanceGains::stiffness(const Matrix3& R_W_d) const {
  if (axes == StiffnessAxes::end_effector) {
    return TaskStiffness::along(R_W_d, translational_stiffness, rotational_stiffness);
  }
  return {translational_stiffness.asDiagonal(), rotational_stiffness.asDiagonal()};
}

Matrix6 ImpedanceGains::given_damping(const Matrix3& R_W_d) const {
  return TaskStiffness::along(axes_at(R_W_d),
                              translational_damping.cwiseMax(kLeastDampingTime * translational_stiffness),
                              rotational_damping.cwiseMax(kLeastDampingTime * rotational_stiffness))
      .matrix();
}

// The squared modes are the eigenvalues of A K, A the mobility along the axes of the diagonal K: none is
// larger than the root of the sum of their squares, k^T (A o A) k. Where that is too much, the axes whose own
// mode a_ii k_i is above a common bound are softened to it.
double ImpedanceGains::soften(const Matrix3& R_W_d, ModelTerms& terms) {
  constexpr double kMost = kFastestMode * kFastestMode;
  Vector6 K;
  K << translational_stiffness, rotational_stiffness;
  Matrix6 A = terms.task().mobility;
  const auto along_axes = [&] {
    if (axes == StiffnessAxes::world) return;
    for (const Eigen::Index i : {0, 3}) {
      A.middleCols<3>(i) = (A.middleCols<3>(i) * R_W_d).eval();
      A.middleRows<3>(i) = (R_W_d.transpose() * A.middleRows<3>(i)).eval();
    }
  };
  const auto fits = [&](const Vector6& k) { return !(k.dot(A.cwiseAbs2() * k) > kMost * kMost); };
  along_axes();
  if (fits(K)) return 1;
  if (states_motors(terms.model())) {
    A = task_with_motors(terms).mobility;
    along_axes();
    if (fits(K)) return 1;
  }
  const Vector6 own = A.diagonal().cwiseMax(1e-12);
  const auto softened = [&](double bound) { return Vector6(K.cwiseMin(bound * own.cwiseInverse())); };
  double low = 0, high = own.cwiseProduct(K).maxCoeff();
  for (int i = 0; i < 40; ++i) {
    const double middle = 0.5 * (low + high);
    (fits(softened(middle)) ? low : high) = middle;
  }
  const Vector6 kept = softened(low);
  const double share = low / own.cwiseProduct(K).maxCoeff();
  translational_stiffness = kept.head<3>();
  rotational_stiffness = kept.tail<3>();
  return share;
}

Matrix6 ImpedanceGains::coasting(const Matrix3& R_W_d) const {
  const auto none = [](const Vector3& stiffness, double whole) {
    return Vector3(Vector3::Ones() - (stiffness / whole).cwiseMin(1.0));
  };
  return TaskStiffness::along(axes_at(R_W_d), none(translational_stiffness, kLedFrom),
                              none(rotational_stiffness, kTurnedFrom))
      .matrix();
}

CartesianTarget ImpedanceGains::led(CartesianTarget target, const Matrix3& R_W_d) const {
  if (leads()) return target;
  const Matrix6 coasts = coasting(R_W_d);
  for (Vector6* motion : {&target.V_d.vector, &target.A_d.vector}) *motion -= Vector6(coasts * *motion);
  return target;
}

Matrix6 ImpedanceGains::brake(const Matrix3& R_W_d, const Matrix6& inertia) const {
  if (leads()) return Matrix6::Zero();
  const Matrix6 coasts = coasting(R_W_d);
  return kBrake * (coasts * inertia * coasts);
}

Matrix6 ImpedanceGains::damping(const Matrix3& R_W_d, const Matrix6& K, ModelTerms& terms) const {
  Matrix6 D;
  if (damping_given) {
    D = given_damping(R_W_d);
    limit_modes(damped_inertia(terms), kLargestModalDamping, D);
  } else {
    D = task_damping(terms.task().Lambda, K, damping_ratio);
    if (states_motors(terms.model())) raise_modes(terms.task().Lambda, Matrix6(kLeastDampingTime * K), D);
  }
  if (!leads()) {
    D += brake(R_W_d, terms.task().Lambda);
    limit_modes(damped_inertia(terms), kLargestModalDamping, D);
  }
  return D;
}

Matrix6 damped_inertia(ModelTerms& terms) {
  if (!states_motors(terms.model())) return terms.task().Lambda;
  return task_with_motors(terms).Lambda;
}

TaskForce impedance_force(const ImpedanceGains& asked, const CartesianTarget& requested, ModelTerms& terms,
                          double dt, RaisedSpring& raised) {
  const CartesianTarget seen = raised.follow(asked, requested, terms, dt);
  ImpedanceGains gains = asked;
  const Matrix3& R_d = requested.X_W_d.rotation;  // a raised stiffness does not turn its axes
  const double stiffness_share = gains.soften(R_d, terms);
  const CartesianTarget target = gains.led(seen, R_d);
  const Vector6& V = terms.V_WE().vector;
  const TaskStiffness K = gains.stiffness(R_d);
  const Matrix6 D = gains.damping(R_d, K.matrix(), terms);
  TaskForce force;
  force.stiffness_share = stiffness_share;
  force.error = pose_error(target.X_W_d, terms.X_WE());
  force.spring = spring_wrench(K, force.error);
  if (!raised.none()) force.error = pose_error(requested.X_W_d, terms.X_WE());
  force.total = force.spring;
  if (gains.damping_of == DampingOf::velocity) {
    force.total.noalias() -= D * V;
  } else {
    force.total.noalias() += D * (target.V_d.vector - V);
  }
  if (gains.acceleration_feedforward) force.total.noalias() += terms.task().Lambda * target.A_d.vector;
  if (gains.coriolis_feedforward) force.total += terms.task_coriolis(target.V_d.vector);
  force.damping = D * V;
  if (!std::isfinite(gains.contact.spring_force + gains.contact.spring_moment)) return force;
  force.pull = force.total + force.damping;
  force.bounded = bound_pull(gains.contact, force.pull, force.damping, V.head<3>());
  if (force.bounded.factor() < 1) {
    const Vector6 taken = force.pull - force.bounded.remaining(force.pull);
    force.spring -= taken;
    force.total -= taken;
  }
  raised.resist(force.pull, force.bounded.force_share, force.bounded.moment_share, dt);
  force.pace = raised.pace();
  return force;
}

namespace {

JointMatrix given_null_space_damping(const NullSpaceGains& gains, OwnedArm& arm) {
  const JointMatrix M = mass_with_motors(*arm.terms);
  const double d = std::max(gains.damping, kLeastDampingTime * gains.stiffness);
  JointMatrix D = d * JointMatrix::Identity(M.rows(), M.cols());
  limit_modes(M, kLargestModalDamping, D);
  return D;
}

// Factor on a damping of kLargestModalDamping times the inertia at most.
double bearable_part(double damping, double inertia) {
  const double most = kLargestModalDamping * inertia;
  return damping > most ? most / damping : 1;
}

// Factor on a torque of the null space, so that it presses at the hand with a twentieth of the bounds at
// most, and at a carriage with the full bounds: a carriage may meet a person while the hand rests.
double share_within(const ContactBounds& contact, const OwnedArm& arm, const TaskSpace& task,
                    const JointVector& tau) {
  constexpr double kShare = 0.05;
  const Vector6 pressing = task.press() * Vector6(task.J_bar.transpose().lazyProduct(tau));
  const double force = pressing.head<3>().norm(), moment = pressing.tail<3>().norm();
  const double carriage = carriage_share(contact, arm.model(), tau, JointVector::Zero(tau.size()), arm.dq());
  return std::min({1.0, kShare * contact.spring_force / force, kShare * contact.spring_moment / moment,
                   1 / std::max(1.0, carriage)});
}

}  // namespace

JointVector null_space_torque(const NullSpaceGains& gains, OwnedArm& arm, const JointVector& q_N,
                              double spring_share) {
  const Eigen::Index n = arm.q().size();
  const JointMatrix& M = arm.terms->M();
  // A self-motion that turns mainly the wrist has hardly more inertia than one of its joints. Every arm is
  // stable with kPosture, whether its model states rotors or not.
  constexpr double kPosture = 10;  // [N m/rad]
  const JointVector asked = JointVector::Constant(n, gains.stiffness);
  const JointVector K =
      asked.cwiseMin((kFastestMode * kFastestMode * arm.model().least_inertia()).cwiseMax(kPosture));
  JointMatrix D_given;
  if (gains.damping_given) D_given = given_null_space_damping(gains, arm);
  JointVector D = diagonal_damping(M, asked, gains.damping_ratio).cwiseMax(kLeastDampingTime * K);
  const auto damped = [&](const JointVector& dq) -> JointVector {
    if (gains.damping_given) return D_given.lazyProduct(dq);
    return D.cwiseProduct(dq);
  };
  const JointVector spring = (spring_share * K).cwiseProduct(q_N - arm.q());
  const Jacobian& J = arm.terms->J_V_WE();
  const TaskSpace& task = arm.terms->task();
  const bool bounded = std::isfinite(gains.contact.spring_force + gains.contact.spring_moment);
  if (gains.projector == Projector::dynamic) {
    const JointVector dq_null = gains.damping_of_joints ? arm.dq() : task.null_space_velocity(J, arm.dq());
    // One self-motion, that of seven joints, is a mode: its damping over its inertia.
    const JointVector mode = gains.damping_of_joints ? task.null_space_velocity(J, dq_null) : dq_null;
    const JointVector damping =
        bearable_part(mode.dot(damped(mode)), mode.dot(JointVector(M.lazyProduct(mode)))) * damped(dq_null);
    if (!bounded || !(task.floored || has_prismatic_joints(arm.model())))
      return task.null_space_torque(J, JointVector(spring - damping));
    const JointVector drawn = task.null_space_torque(J, spring);
    return share_within(gains.contact, arm, task, drawn) * drawn - task.null_space_torque(J, damping);
  }
  // J^+ = J^T (J J^T + eps)^-1. Any eps > 0 keeps N within [0, I]; that of the paper is far below the
  // eigenvalues of a regular pose.
  const double eps = gains.projector == Projector::damped_pseudoinverse ? 0.2 * 0.2 : 1e-9;
  const Matrix6 JJt = J.lazyProduct(J.transpose()) + eps * Matrix6::Identity();
  Matrix6 L;
  cholesky_factor(JJt, L);
  const auto project = [&](const JointVector& x) -> JointVector {  // I - J^+ J is symmetric
    const Vector6 y = cholesky_solve(L, Vector6(J.lazyProduct(x)));
    return x - J.transpose().lazyProduct(y);
  };
  const auto damping_at = [&](const JointVector& dq) -> JointVector {
    return project(damped(gains.damping_of_joints ? dq : project(dq)));
  };
  // For any motion the damping acts along the mode M^-1 n, with n the only self-motion.
  JointMatrix L_M;
  cholesky_factor(M, L_M);
  JointVector damping = damping_at(arm.dq());
  const JointVector mode = cholesky_solve(L_M, damping);
  damping *= bearable_part(cholesky_solve(L_M, damping_at(mode)).norm(), mode.norm());
  if (!bounded) return project(spring) - damping;
  // Not dynamically consistent: in any pose the posture's torque reaches the hand.
  const JointVector drawn = project(spring);
  return share_within(gains.contact, arm, task, drawn) * drawn - damping;
}

LawResult cartesian_impedance_law(const ImpedanceGains& gains, const NullSpaceGains& null_space,
                                  const CartesianTarget& target, OwnedArm& arm, const JointVector& q_N,
                                  double dt, RaisedSpring& raised, TaskForce& force) {
  ModelTerms& terms = *arm.terms;
  force = impedance_force(gains, target, terms, dt, raised);
  *arm.tau = terms.c() + null_space_torque(null_space, arm, q_N);
  *arm.tau += terms.J_V_WE().transpose().lazyProduct(force.total);
  return arm.tau->allFinite() ? LawResult::ok : LawResult::fault;
}

CartesianParameters cartesian_parameters() {
  return {spec_table<kCartesianParameterCount>(
      parameter_at<kTranslationalStiffness>(
          {.name = "translational_stiffness_n_per_m",
           .unit = "N/m",
           .size = 3,
           .initial = {400, 400, 400},
           .max = 5000,
           .doc =
               "Stiffness K_t along x, y, z. Reduced where the natural frequency would exceed 150 rad/s."}),
      parameter_at<kRotationalStiffness>({.name = "rotational_stiffness_nm_per_rad",
                                          .unit = "N m/rad",
                                          .size = 3,
                                          .initial = {20, 20, 20},
                                          .max = 300,
                                          .doc = "Stiffness K_r about x, y, z, softened likewise."}),
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
           .doc =
               "Stiffness K_N of every joint towards the null-space posture; above 10 at most (150 rad/s)^2 "
               "times the joint's least inertia."}),
      parameter_at<kProjector>(choice_parameter("projector",
                                                {"dynamic", "paper_pseudoinverse", "damped_pseudoinverse"},
                                                "Null-space projector: dynamically consistent, the "
                                                "pseudo-inverse of the paper, or the damped one of "
                                                "the reference code.")),
      parameter_at<kDampingOf>(damping_of_parameter()),
      parameter_at<kCartesianDampingDesign>(
          choice_parameter("damping_design", {"coupled", "given"},
                           "D_c from the full Lambda and K_c and D_N from M and K_N, or both from the three "
                           "parameters below.")),
      parameter_at<kTranslationalDamping>({.name = "translational_damping_n_s_per_m",
                                           .unit = "N s/m",
                                           .size = 3,
                                           .initial = {40, 40, 40},
                                           .max = 1000,
                                           .doc = "Damping along x, y, z if damping_design is 'given', in "
                                                  "the axes of the stiffness; limited by the inertia."}),
      parameter_at<kRotationalDamping>({.name = "rotational_damping_nm_s_per_rad",
                                        .unit = "N m s/rad",
                                        .size = 3,
                                        .initial = {7.2, 7.2, 7.2},
                                        .max = 100,
                                        .doc = "The same about x, y, z."}),
      parameter_at<kNullSpaceDamping>({.name = "nullspace_damping_nm_s_per_rad",
                                       .unit = "N m s/rad",
                                       .initial = {6.3},
                                       .max = 50,
                                       .doc = "D_N of every joint if damping_design is 'given'."}),
      parameter_at<kNullSpaceDampingOf>(
          choice_parameter("nullspace_damping_of", {"self_motion", "joints"},
                           "What D_N acts on: the part of dq that does not move the hand, or all of dq as "
                           "the paper prints it, "
                           "which may supply energy.")),
      parameter_at<kCoriolisFeedforward>(
          switch_parameter("coriolis_feedforward", false,
                           "Adds C_c V_d, as the paper prints it, to C dq, which the law always compensates "
                           "in the joints.")))};
}

Preset paper_preset(std::vector<Preset::Value> more) {
  Preset preset{.name = "paper",
                .doc = "The law as the paper prints it, without this project's additions.",
                .values = {{"translational_stiffness_n_per_m", {100, 100, 50}},
                           {"rotational_stiffness_nm_per_rad", {10}},
                           {"projector", {static_cast<double>(Projector::paper_pseudoinverse)}},
                           {"nullspace_damping_of", {1}},
                           {"coriolis_feedforward", {1}}}};
  for (auto& value : more) {
    std::erase_if(preset.values, [&](const auto& own) { return own.parameter == value.parameter; });
    preset.values.push_back(std::move(value));
  }
  return preset;
}

Preset reference_preset() {
  return {.name = "reference",
          .doc =
              "The Cartesian impedance example of the reference code: fixed D = 2 sqrt(K) on the hand's "
              "velocity (rotation 1.6 sqrt(K)), the damped pseudo-inverse, no feed-forward.",
          .values = {{"translational_stiffness_n_per_m", {400}},
                     {"rotational_stiffness_nm_per_rad", {20}},
                     {"acceleration_feedforward", {0}},
                     {"nullspace_stiffness_nm_per_rad", {10}},
                     {"projector", {static_cast<double>(Projector::damped_pseudoinverse)}},
                     {"damping_of", {1}},
                     {"damping_design", {1}},
                     {"translational_damping_n_s_per_m", {40}},  // 2 sqrt(400)
                     {"rotational_damping_nm_s_per_rad", {1.6 * std::sqrt(20.0)}},
                     {"nullspace_damping_nm_s_per_rad", {2 * std::sqrt(10.0)}},
                     {"nullspace_damping_of", {1}}}};
}

ImpedanceGains impedance_gains(const ParameterSet& parameters, const ContactBounds& contact) {
  return {parameters.vector3(kTranslationalStiffness),
          parameters.vector3(kRotationalStiffness),
          parameters.number(kCartesianDampingRatio),
          static_cast<StiffnessAxes>(parameters.choice(kStiffnessAxes)),
          parameters.flag(kAccelerationFeedforward),
          contact,
          static_cast<DampingOf>(parameters.choice(kDampingOf)),
          parameters.choice(kCartesianDampingDesign) != 0,
          parameters.vector3(kTranslationalDamping),
          parameters.vector3(kRotationalDamping),
          parameters.flag(kCoriolisFeedforward)};
}

NullSpaceGains null_space_gains(const ParameterSet& parameters, const ContactBounds& contact) {
  return {parameters.number(kNullSpaceStiffness),
          parameters.number(kCartesianDampingRatio),
          static_cast<Projector>(parameters.choice(kProjector)),
          contact,
          parameters.choice(kCartesianDampingDesign) != 0,
          parameters.number(kNullSpaceDamping),
          parameters.choice(kNullSpaceDampingOf) != 0};
}

CartesianOutputs cartesian_outputs(const std::string& prefix) {
  return {spec_table<kCartesianOutputSize>(
      output_at<0, 3>(prefix + "position_error_m", "p_d - p, world axes."),
      output_at<3, 3>(prefix + "orientation_error_rad", "log(R_d R^T), world axes."),
      output_at<6, 3>(prefix + "force_n", "Force commanded at E, world axes."),
      output_at<9, 3>(prefix + "moment_nm", "Moment commanded at E, world axes."),
      output_at<12>(prefix + "stiffness_share", kStiffnessShareDoc))};
}

void show(const TaskForce& force, std::span<double> outputs) {
  std::copy_n(force.error.data(), 6, outputs.begin());
  std::copy_n(force.total.data(), 6, outputs.begin() + 6);
  outputs[12] = force.stiffness_share;
}

}  // namespace multipanda
