#include "backends/arm/desired_motion.hpp"

#include <algorithm>
#include <cmath>
#include <optional>

#include <Eigen/LU>

namespace multipanda {
namespace {

constexpr double dt = DesiredMotion::kPeriod;
// Start tolerances and positions are absolute; a client may stand on a limit exactly.
constexpr double kPositionSlack = 1e-6;  // [rad]
// What rounding a position makes of a jerk.
constexpr double kJointJerkSlack = DesiredMotion::kJointUlp / (dt * dt * dt);  // [rad/s^3]
constexpr double kPoseJerkSlack = DesiredMotion::kPoseUlp / (dt * dt * dt);    // [m/s^3, rad/s^3]

bool is_cartesian(MotionGenerator g) {
  return g == MotionGenerator::cartesian_pose || g == MotionGenerator::cartesian_velocity;
}

// Rotation vector of R = B A^T by its skew part, which errors of orthonormality in B or A do not reach.
Vector3 turned(const Matrix3& B, const Matrix3& A) {
  const Matrix3 R = B * A.transpose();
  const Vector3 s = 0.5 * Vector3(R(2, 1) - R(1, 2), R(0, 2) - R(2, 0), R(1, 0) - R(0, 1));
  const double sine = s.norm(), cosine = 0.5 * (R.trace() - 1);
  if (cosine < 0) return log_rotation(R);
  return sine < 1e-9 ? s : (std::atan2(sine, cosine) / sine) * s;
}

// Motion from one pose to another, per period.
Vector6 difference(const Pose& X, const Pose& X_before) {
  Vector6 V;
  V << (X.position - X_before.position) / dt, turned(X.rotation, X_before.rotation) / dt;
  return V;
}

Pose moved(const Pose& X, const Vector6& V) {
  return {exp_rotation(dt * V.tail<3>()) * X.rotation, X.position + dt * V.head<3>()};
}

// The nearest rotation: two steps of Newton's iteration for the polar factor, error 1e-5 -> 1e-20.
Matrix3 orthonormal(Matrix3 R) {
  for (int k = 0; k < 2; ++k) R = 0.5 * R * (3 * Matrix3::Identity() - R.transpose() * R);
  return R;
}

// How far T is from a right-handed rotation with a last row 0 0 0 1. Lengths of rows and columns are what the
// maker's client checks itself, so they have its tolerance.
double error_of_frame(const Eigen::Matrix4d& T) {
  const Matrix3 R = T.topLeftCorner<3, 3>();
  const bool last_row = T(3, 0) == 0 && T(3, 1) == 0 && T(3, 2) == 0 && T(3, 3) == 1;
  if (!last_row || !(R.determinant() > 0)) return 1;
  const Matrix3 off = R.transpose() * R - Matrix3::Identity();
  return std::max({(R.colwise().norm().array() - 1).abs().maxCoeff(),
                   (R.rowwise().norm().array() - 1).abs().maxCoeff(), off.cwiseAbs().maxCoeff() / 2.1});
}

}  // namespace

// Keeps of a rule where it is broken worst: by how much it is exceeded, as a share.
struct DesiredMotion::Worst {
  double share = 1 + kSlack;
  int index = kNowhere;
  double value = 0, limit = 0;
  static constexpr int kNowhere = -2;
  bool found() const { return index != kNowhere; }

  // Broken against both histories only.
  void see(int i, double exact, double published, double bound) {
    const double least = std::abs(exact) < std::abs(published) ? exact : published;
    if (std::abs(least) <= share * bound) return;
    share = std::abs(least) / bound;
    index = i;
    value = least;
    limit = std::copysign(bound, least);
  }

  // A velocity against limits of its sign; at the end of the range they are zero.
  void see_velocity(int i, double exact, double published, double lower, double upper) {
    constexpr double kStill = 1e-9;  // [rad/s]
    const double least = std::abs(exact) < std::abs(published) ? exact : published;
    see(i, exact, published, std::max(kStill, least > 0 ? upper : -lower));
  }
};

DesiredMotion::DesiredMotion(std::shared_ptr<const ArmModel> model, MotionLimits limits)
    : model_(std::move(model)), limits_(std::move(limits)), inverse_(model_), planner_(limits_) {
  hold(model_->q_home(), {});
}

void DesiredMotion::hold(const JointVector& q, const Pose& X_FE) {
  inverse_.set_end_effector(X_FE);
  generator_ = MotionGenerator::idle;
  asynchronous_ = stopping_ = elbow_commanded_ = false;
  first_ = true;
  state_ = {};
  state_.q = q;
  state_.dq = state_.ddq = JointVector::Zero(q.size());
  state_.X_BE_d = state_.X_BE_c = inverse_.chain().X_BE(q);
  state_.elbow_d = state_.elbow_c = elbow_of(q);
  violation_count_ = 0;
  publish();
}

MotionStart DesiredMotion::start(const MotionRequest& request) {
  const JointVector q = state_.q;
  if (request.generator == MotionGenerator::idle) return MotionStart::invalid_argument;
  if (request.asynchronous) {
    if (request.generator != MotionGenerator::joint_position || request.dq_max.size() != q.size() ||
        !request.dq_max.allFinite() || !(request.dq_max.minCoeff() > 0)) {
      return MotionStart::invalid_argument;
    }
    planner_.start(q, request.dq_max);
  }
  if (is_cartesian(request.generator) && inverse_.singular(q)) return MotionStart::singular;
  generator_ = request.generator;
  asynchronous_ = request.asynchronous;
  first_ = true;
  stopping_ = elbow_commanded_ = false;
  return MotionStart::started;
}

MotionStep DesiredMotion::step(const InterfaceCommand* command) {
  violation_count_ = 0;
  if (asynchronous_) return step_planned(command);
  if (generator_ == MotionGenerator::idle || generator_ == MotionGenerator::none) {
    const bool finished = command != nullptr && (command->motion_finished || command->torque_finished);
    return finished ? MotionStep::at_rest : MotionStep::moving;
  }
  const MotionStep result = is_cartesian(generator_) ? step_cartesian(command) : step_joints(command);
  if (result == MotionStep::input_error) return result;
  if (command != nullptr && command->motion_finished) {
    // What comes with the word may be the last command again, the next one, or nothing at all (zeros): taken
    // where it continues the motion, else left. The motion so far is judged.
    violation_count_ = 0;
    return end_of_motion();
  }
  return result;
}

MotionStep DesiredMotion::end_of_motion() const {
  return is_at_rest() ? MotionStep::at_rest : MotionStep::still_moving;
}

// At rest: standing still in the next period would itself keep the limits of acceleration and jerk.
bool DesiredMotion::is_at_rest() const {
  const double near = 1 + 1e-2;  // rounding of published positions is of this size
  if (!is_cartesian(generator_)) {
    return (state_.dq.cwiseAbs().array() <= near * dt * limits_.ddq_max.array()).all() &&
           (state_.ddq.cwiseAbs().array() <= near * dt * limits_.dddq_max.array()).all();
  }
  const CartesianLimits& c = limits_.cartesian;
  const Vector6& V = state_.V_BE_c.vector;
  const Vector6& A = state_.A_BE_c;
  const bool elbow = !elbow_commanded_ || (std::abs(state_.delbow_c[0]) <= near * dt * c.elbow_acceleration &&
                                           std::abs(state_.ddelbow_c[0]) <= near * dt * c.elbow_jerk);
  return elbow && V.head<3>().norm() <= near * dt * c.acceleration &&
         V.tail<3>().norm() <= near * dt * c.rotation_acceleration &&
         A.head<3>().norm() <= near * dt * c.jerk && A.tail<3>().norm() <= near * dt * c.rotation_jerk;
}

// --- joint generators ---

MotionStep DesiredMotion::step_joints(const InterfaceCommand* command) {
  JointVector q, dq, dq_published;
  if (command == nullptr) {
    dq = dq_published = state_.dq + dt * state_.ddq;
    q = state_.q + dt * dq;
  } else if (generator_ == MotionGenerator::joint_position) {
    q = command->q_c;
    if (q.size() != state_.q.size() || !q.allFinite()) return MotionStep::input_error;
    dq = (q - state_.q) / dt;
    dq_published = (q - published_.q.cast<double>()) / dt;
  } else {
    dq = dq_published = command->dq_c;
    if (dq.size() != state_.q.size() || !dq.allFinite()) return MotionStep::input_error;
    q = state_.q + dt * dq;
  }
  check_joint_command(q, dq, dq_published);

  if (first_ && command != nullptr) {
    if (violation_count_ > 0 && generator_ == MotionGenerator::joint_position) {
      int joint = 0;
      const double off = (q - state_.q).cwiseAbs().maxCoeff(&joint);
      violation_count_ = 0;
      if (off > kStartJoint) {
        report(ArmError::joint_position_motion_generator_start_pose_invalid, joint,
               q[joint] - state_.q[joint], kStartJoint);
      } else if (check_joint_positions(q)) {
        dq.setZero();
        begin_at(q);
      }
    }
    if (violation_count_ == 0) first_ = false;
  }
  if (violation_count_ > 0) return MotionStep::violation;
  set_joints(q, dq);
  state_.X_BE_c = state_.X_BE_d;
  state_.elbow_c = state_.elbow_d;
  publish();
  return MotionStep::moving;
}

bool DesiredMotion::check_joint_positions(const JointVector& q) {
  for (Eigen::Index i = 0; i < q.size(); ++i) {
    const bool above = q[i] > limits_.q_max[i] + kPositionSlack;
    if (above || q[i] < limits_.q_min[i] - kPositionSlack) {
      report(ArmError::joint_position_limits_violation, static_cast<int>(i), q[i],
             above ? limits_.q_max[i] : limits_.q_min[i]);
      return false;
    }
  }
  return true;
}

// dq: from the history; dq_published: from the history as published.
void DesiredMotion::check_joint_command(const JointVector& q, const JointVector& dq,
                                        const JointVector& dq_published) {
  check_joint_positions(q);
  const JointVector dq_p = published_.dq.cast<double>(), ddq_before = published_.ddq.cast<double>();
  Worst velocity, acceleration, jerk;
  for (Eigen::Index i = 0; i < dq.size(); ++i) {
    const int joint = static_cast<int>(i);
    const double ddq = (dq[i] - state_.dq[i]) / dt, ddq_p = (dq_published[i] - dq_p[i]) / dt;
    velocity.see_velocity(joint, dq[i], dq_published[i], lower_velocity(i), upper_velocity(i));
    acceleration.see(joint, ddq, ddq_p, limits_.ddq_max[i]);
    jerk.see(joint, (ddq - state_.ddq[i]) / dt, (ddq_p - ddq_before[i]) / dt,
             limits_.dddq_max[i] + kJointJerkSlack);
  }
  report(ArmError::joint_motion_generator_velocity_limits_violation, velocity);
  report(ArmError::joint_motion_generator_velocity_discontinuity, acceleration);
  report(ArmError::joint_motion_generator_acceleration_discontinuity, jerk);
}

// Of the last desired position, with what a braking client is late (see the header).
double DesiredMotion::upper_velocity(Eigen::Index i) const {
  return std::min(limits_.dq_max[i], limits_.upper_velocity(i, state_.q[i]) + late(i));
}
double DesiredMotion::lower_velocity(Eigen::Index i) const {
  return std::max(-limits_.dq_max[i], limits_.lower_velocity(i, state_.q[i]) - late(i));
}
double DesiredMotion::late(Eigen::Index i) const {
  return limits_.deceleration.size() == 0 ? 0 : 2 * dt * limits_.deceleration[i];
}

// --- Cartesian generators ---

MotionStep DesiredMotion::step_cartesian(const InterfaceCommand* command) {
  Pose X;
  Vector6 V, V_published;
  bool has_elbow = elbow_commanded_;
  const bool posed = generator_ == MotionGenerator::cartesian_pose;
  double elbow = state_.elbow_c[0] + dt * (state_.delbow_c[0] + dt * state_.ddelbow_c[0]);
  if (command == nullptr) {
    V = V_published = state_.V_BE_c.vector + dt * state_.A_BE_c;
    X = moved(state_.X_BE_c, V);
  } else {
    if (posed) {
      const Eigen::Matrix4d T = Eigen::Map<const Eigen::Matrix4d>(command->O_T_EE_c.data());
      if (!T.allFinite()) return MotionStep::input_error;
      if (const double frame_error = error_of_frame(T); !(frame_error <= kOrthonormal)) {
        report(ArmError::cartesian_position_motion_generator_invalid_frame, -1, frame_error, kOrthonormal);
        return MotionStep::violation;
      }
      X = {orthonormal(T.topLeftCorner<3, 3>()), T.topRightCorner<3, 1>()};
      V = difference(X, state_.X_BE_c);
      V_published = difference(X, published_.pose());
    } else {
      V = V_published = command->O_dP_EE_c;
      if (!V.allFinite()) return MotionStep::input_error;
      X = moved(state_.X_BE_c, V);
    }
    has_elbow = command->has_elbow && model_->joint_count() == 7;
    if (has_elbow) {
      elbow = command->elbow_c[0];
      if (!std::isfinite(elbow) || !std::isfinite(command->elbow_c[1])) return MotionStep::input_error;
      const double side = state_.elbow_d[1];
      if (std::abs(command->elbow_c[1]) != 1 || (side != 0 && command->elbow_c[1] != side)) {
        report(ArmError::cartesian_motion_generator_elbow_sign_inconsistent, -1, command->elbow_c[1], side);
        return MotionStep::violation;
      }
    }
  }
  check_twist(V, V_published);
  const std::size_t twist_violations = violation_count_;
  if (has_elbow) check_elbow(elbow);
  const bool elbow_violated = violation_count_ > twist_violations;

  bool begins_here = false, elbow_begins_here = false;
  // A velocity has no start pose: what it breaks it breaks.
  if (first_ && command != nullptr && violation_count_ > 0 && (posed || twist_violations == 0)) {
    violation_count_ = 0;
    begins_here = twist_violations > 0;
    elbow_begins_here = elbow_violated;
    const Vector6 off = dt * difference(X, state_.X_BE_c);
    const double off_p = off.head<3>().norm(), off_r = off.tail<3>().norm();
    const double off_elbow = elbow - state_.elbow_c[0];
    if (begins_here && off_p > kStartPosition) {
      report(ArmError::cartesian_position_motion_generator_start_pose_invalid, 0, off_p, kStartPosition);
    }
    if (begins_here && off_r > kStartRotation) {
      report(ArmError::cartesian_position_motion_generator_start_pose_invalid, 3, off_r, kStartRotation);
    }
    if (elbow_begins_here && std::abs(off_elbow) > kStartJoint) {
      report(ArmError::cartesian_motion_generator_start_elbow_invalid, -1, off_elbow, kStartJoint);
    }
    if (begins_here) V = V_published = Vector6::Zero();
  }
  if (violation_count_ > 0) return MotionStep::violation;

  const auto& solution = inverse_.solve(X, has_elbow ? std::optional(elbow) : std::nullopt, state_.q);
  JointVector dq = (solution.q - state_.q) / dt;
  const Vector6 A = begins_here ? Vector6::Zero() : Vector6((V - state_.V_BE_c.vector) / dt);
  double delbow = 0, ddelbow = 0;
  if (begins_here || elbow_begins_here) {
    check_joint_positions(solution.q);
    dq.setZero();
  } else {
    const Vector6 A_published = (V_published - published_.V.cast<double>()) / dt;
    double ddelbow_published = 0, delbow_published = 0;
    if (has_elbow) {
      delbow = (elbow - state_.elbow_c[0]) / dt;
      ddelbow = (delbow - state_.delbow_c[0]) / dt;
      delbow_published = command == nullptr ? delbow : (elbow - static_cast<double>(published_.elbow)) / dt;
      ddelbow_published = (delbow_published - static_cast<double>(published_.delbow)) / dt;
    }
    // What the joints would do, had the motion really been as published: by first order.
    check_solution(
        solution, dq, dq + inverse_.differential(V_published - V, delbow_published - delbow),
        (dq - state_.dq) / dt + inverse_.differential(A_published - A, ddelbow_published - ddelbow));
  }
  if (violation_count_ > 0) return MotionStep::violation;

  if (command != nullptr) first_ = false;
  elbow_commanded_ = has_elbow;
  if (begins_here || elbow_begins_here) begin_at(solution.q);
  set_joints(solution.q, dq);
  state_.X_BE_c = X;
  state_.V_BE_c.vector = V;
  state_.A_BE_c = A;
  if (has_elbow) {
    state_.elbow_c = {elbow, state_.elbow_d[1]};
    state_.delbow_c = {delbow, 0};
    state_.ddelbow_c = {ddelbow, 0};
  } else if (model_->joint_count() == 7) {
    state_.elbow_c = state_.elbow_d;
    state_.delbow_c = {state_.dq[2], 0};
    state_.ddelbow_c = {state_.ddq[2], 0};
  }
  publish();
  return MotionStep::moving;
}

void DesiredMotion::check_twist(const Vector6& V, const Vector6& V_published) {
  const Vector6 A = (V - state_.V_BE_c.vector) / dt, A_p = (V_published - published_.V.cast<double>()) / dt;
  const Vector6 J = (A - state_.A_BE_c) / dt, J_p = (A_p - published_.A.cast<double>()) / dt;
  const CartesianLimits& c = limits_.cartesian;
  const auto rule = [this](ArmError error, const Vector6& exact, const Vector6& published, double linear,
                           double angular) {
    Worst worst;
    worst.see(0, exact.head<3>().norm(), published.head<3>().norm(), linear);
    worst.see(3, exact.tail<3>().norm(), published.tail<3>().norm(), angular);
    report(error, worst);
  };
  rule(ArmError::cartesian_motion_generator_velocity_limits_violation, V, V_published, c.velocity,
       c.rotation_velocity);
  rule(ArmError::cartesian_motion_generator_velocity_discontinuity, A, A_p, c.acceleration,
       c.rotation_acceleration);
  rule(ArmError::cartesian_motion_generator_acceleration_discontinuity, J, J_p, c.jerk + kPoseJerkSlack,
       c.rotation_jerk + kPoseJerkSlack);
}

void DesiredMotion::check_elbow(double elbow) {
  const double v = (elbow - state_.elbow_c[0]) / dt,
               v_p = (elbow - static_cast<double>(published_.elbow)) / dt;
  const double a = (v - state_.delbow_c[0]) / dt, a_p = (v_p - static_cast<double>(published_.delbow)) / dt;
  const double j = (a - state_.ddelbow_c[0]) / dt, j_p = (a_p - static_cast<double>(published_.ddelbow)) / dt;
  const CartesianLimits& c = limits_.cartesian;
  Worst worst;
  if (c.elbow_velocity > 0) worst.see(-1, v, v_p, c.elbow_velocity);
  if (c.elbow_acceleration > 0) worst.see(-1, a, a_p, c.elbow_acceleration);
  if (c.elbow_jerk > 0) worst.see(-1, j, j_p, c.elbow_jerk + kJointJerkSlack);
  if (elbow > limits_.q_max[2] + kPositionSlack || elbow < limits_.q_min[2] - kPositionSlack) {
    worst.index = -1;
    worst.value = elbow;
    worst.limit = elbow > 0 ? limits_.q_max[2] : limits_.q_min[2];
  }
  report(ArmError::cartesian_motion_generator_elbow_limit_violation, worst);
}

void DesiredMotion::check_solution(const InverseKinematics::Solution& solution, const JointVector& dq,
                                   const JointVector& dq_published, const JointVector& ddq_published) {
  check_joint_positions(solution.q);
  Worst velocity, acceleration;
  for (Eigen::Index i = 0; i < dq.size(); ++i) {
    const int joint = static_cast<int>(i);
    velocity.see_velocity(joint, dq[i], dq_published[i], lower_velocity(i), upper_velocity(i));
    acceleration.see(joint, (dq[i] - state_.dq[i]) / dt, ddq_published[i], limits_.ddq_max[i]);
  }
  if (!solution.met && !velocity.found()) {
    // Out of reach: the joints would have to be faster than anything.
    Eigen::Index joint = 0;
    dq.cwiseAbs().maxCoeff(&joint);
    velocity.index = static_cast<int>(joint);
    velocity.value = dq[joint];
    velocity.limit = limits_.dq_max[joint];
  }
  report(ArmError::cartesian_motion_generator_joint_velocity_limits_violation, velocity);
  report(ArmError::cartesian_motion_generator_joint_velocity_discontinuity, acceleration);
}

// --- asynchronous joint motion ---

MotionStep DesiredMotion::step_planned(const InterfaceCommand* command) {
  if (command != nullptr && !stopping_) {
    if (command->motion_finished) {
      planner_.stop();
      stopping_ = true;
    } else {
      const JointVector& q = command->q_c;
      if (q.size() != state_.q.size() || !q.allFinite()) return MotionStep::input_error;
      if (!check_joint_positions(q)) return MotionStep::violation;
      planner_.set_target(q);
    }
  }
  const bool stands = planner_.at_rest();
  planner_.step();
  set_joints(planner_.q(), planner_.dq());
  state_.X_BE_c = state_.X_BE_d;
  state_.elbow_c = state_.elbow_d;
  publish();
  return stopping_ && stands ? MotionStep::at_rest : MotionStep::moving;
}

// --- what is published ---

// Another place, at rest: what was before does not count.
void DesiredMotion::begin_at(const JointVector& q) {
  state_.q = q;
  state_.dq.setZero();
  state_.ddq.setZero();
  state_.X_BE_d = inverse_.chain().X_BE(q);
  state_.V_BE_d = {};
}

void DesiredMotion::set_joints(const JointVector& q, const JointVector& dq) {
  state_.ddq = (dq - state_.dq) / dt;
  state_.dq = dq;
  state_.q = q;
  const Pose X = inverse_.chain().X_BE(q);
  Twist V;
  V.vector = difference(X, state_.X_BE_d);
  state_.A_BE_d = (V.vector - state_.V_BE_d.vector) / dt;
  state_.V_BE_d = V;
  state_.X_BE_d = X;
  state_.elbow_d = elbow_of(q);
}

void DesiredMotion::publish() {
  published_ = {.q = state_.q.cast<float>(),
                .dq = state_.dq.cast<float>(),
                .ddq = state_.ddq.cast<float>(),
                .R = state_.X_BE_c.rotation.cast<float>(),
                .p = state_.X_BE_c.position.cast<float>(),
                .V = state_.V_BE_c.vector.cast<float>(),
                .A = state_.A_BE_c.cast<float>(),
                .elbow = static_cast<float>(state_.elbow_c[0]),
                .delbow = static_cast<float>(state_.delbow_c[0]),
                .ddelbow = static_cast<float>(state_.ddelbow_c[0])};
}

void DesiredMotion::report(ArmError error, int index, double value, double limit) {
  if (violation_count_ == violations_.size()) return;
  violations_[violation_count_++] = {
      .error = error, .index = static_cast<std::int8_t>(index), .value = value, .limit = limit};
}
void DesiredMotion::report(ArmError error, const Worst& worst) {
  if (worst.found()) report(error, worst.index, worst.value, worst.limit);
}

}  // namespace multipanda
