#include "backends/simulated_arm/desired_motion.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include <Eigen/LU>

namespace multipanda {
namespace {

bool is_placed(MotionGenerator g) {  // commands positions or poses
  return g == MotionGenerator::joint_position || g == MotionGenerator::cartesian_pose;
}

}  // namespace

Vector6 pose_difference(const Pose& X, const Pose& X_before) {
  const Matrix3 R = X.rotation * X_before.rotation.transpose();
  const Vector3 s = 0.5 * Vector3(R(2, 1) - R(1, 2), R(0, 2) - R(2, 0), R(1, 0) - R(0, 1));
  const double sine = s.norm(), cosine = 0.5 * (R.trace() - 1);
  Vector6 dX;
  dX.head<3>() = X.position - X_before.position;
  if (cosine < 0) {
    dX.tail<3>() = log_rotation(R);
  } else {
    dX.tail<3>() = sine < 1e-9 ? s : Vector3((std::atan2(sine, cosine) / sine) * s);
  }
  return dX;
}

Pose displaced(const Pose& X, const Vector6& dX) {
  return {exp_rotation(dX.tail<3>()) * X.rotation, X.position + dX.head<3>()};
}

Matrix3 nearest_rotation(Matrix3 R) {
  for (int k = 0; k < 2; ++k) R = 0.5 * R * (3 * Matrix3::Identity() - R.transpose() * R);
  return R;
}

double error_of_frame(const Eigen::Matrix4d& T) {
  const Matrix3 R = T.topLeftCorner<3, 3>();
  const bool last_row = T(3, 0) == 0 && T(3, 1) == 0 && T(3, 2) == 0 && T(3, 3) == 1;
  if (!last_row || !(R.determinant() > 0)) return 1;
  const Matrix3 off = R.transpose() * R - Matrix3::Identity();
  // The product of two columns with errors x has the error 2 x.
  return std::max({(R.colwise().norm().array() - 1).abs().maxCoeff(),
                   (R.rowwise().norm().array() - 1).abs().maxCoeff(), off.cwiseAbs().maxCoeff() / 2.1});
}

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
  violations_.count = 0;
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
  second_ = false;
  if_continued_.count = 0;
  stopping_ = elbow_commanded_ = false;
  return MotionStart::started;
}

MotionStep DesiredMotion::step(const InterfaceCommand* command) {
  violations_.count = 0;
  if (asynchronous_) return step_planned(command);
  if (generator_ == MotionGenerator::idle || generator_ == MotionGenerator::none) {
    const bool finished = command != nullptr && (command->motion_finished || command->torque_finished);
    return finished ? MotionStep::at_rest : MotionStep::moving;
  }
  const MotionStep result = step_from_start(command);
  if (result == MotionStep::input_error) return result;
  if (command != nullptr && command->motion_finished) {
    // The command with the finish flag may repeat the last one, be the next one, or be zeros. It is used if
    // it continues the motion; otherwise the motion so far is evaluated.
    violations_.count = 0;
    return end_of_motion();
  }
  return result;
}

// A first position or pose near the commanded one, such as the measured one, either begins a motion or
// continues the rest. The second one decides: the reading in which it breaks no rule counts.
MotionStep DesiredMotion::step_from_start(const InterfaceCommand* command) {
  const auto follow = [&] {
    return is_cartesian(generator_) ? step_cartesian(command) : step_joints(command);
  };
  const bool first = first_, second = command != nullptr && std::exchange(second_, false);
  MotionStep step = follow();
  second_ = second_ || (first && !first_ && is_placed(generator_));
  if (step != MotionStep::violation || !second) return step;
  if (if_continued_.count == 0) {
    if_continued_ = violations_;
    violations_.count = 0;
    begin_at(state_.q);
    state_.V_BE_c = {};
    state_.A_BE_c.setZero();
    state_.delbow_c = state_.ddelbow_c = {};
    publish();
    step = follow();
  }
  if (step == MotionStep::violation) violations_ = if_continued_;
  return step;
}

MotionStep DesiredMotion::end_of_motion() const {
  return is_at_rest() ? MotionStep::at_rest : MotionStep::still_moving;
}

// At rest: stopping in the next period keeps the limits of acceleration and jerk.
bool DesiredMotion::is_at_rest() const {
  const double near = 1 + 1e-2;  // published positions are rounded to this size
  if (!is_cartesian(generator_)) {
    return (state_.dq.cwiseAbs().array() <= near * kArmPeriod * limits_.ddq_max.array()).all() &&
           (state_.ddq.cwiseAbs().array() <= near * kArmPeriod * limits_.dddq_max.array()).all();
  }
  const CartesianLimits& c = limits_.cartesian;
  const Vector6& V = state_.V_BE_c.vector;
  const Vector6& A = state_.A_BE_c;
  const bool elbow =
      !elbow_commanded_ || (std::abs(state_.delbow_c[0]) <= near * kArmPeriod * c.elbow_acceleration &&
                            std::abs(state_.ddelbow_c[0]) <= near * kArmPeriod * c.elbow_jerk);
  return elbow && V.head<3>().norm() <= near * kArmPeriod * c.acceleration &&
         V.tail<3>().norm() <= near * kArmPeriod * c.rotation_acceleration &&
         A.head<3>().norm() <= near * kArmPeriod * c.jerk &&
         A.tail<3>().norm() <= near * kArmPeriod * c.rotation_jerk;
}

// --- joint generators ---

MotionStep DesiredMotion::step_joints(const InterfaceCommand* command) {
  JointVector q, dq, dq_published;
  if (command == nullptr) {
    dq = dq_published = state_.dq + kArmPeriod * state_.ddq;
    q = state_.q + kArmPeriod * dq;
  } else if (generator_ == MotionGenerator::joint_position) {
    q = command->q_c;
    if (q.size() != state_.q.size() || !q.allFinite()) return MotionStep::input_error;
    dq = (q - state_.q) / kArmPeriod;
    dq_published = (q - published_.q.cast<double>()) / kArmPeriod;
  } else {
    dq = dq_published = command->dq_c;
    if (dq.size() != state_.q.size() || !dq.allFinite()) return MotionStep::input_error;
    q = state_.q + kArmPeriod * dq;
  }
  check_joint_command(q, dq, dq_published);

  if (first_ && command != nullptr) {
    if (violations_.count > 0 && generator_ == MotionGenerator::joint_position) {
      int joint = 0;
      const double off = (q - state_.q).cwiseAbs().maxCoeff(&joint);
      violations_.count = 0;
      if (off > kStartJoint) {
        report(ArmError::joint_position_motion_generator_start_pose_invalid, joint,
               q[joint] - state_.q[joint], kStartJoint);
      } else if (check_joint_positions(q)) {
        dq.setZero();
        begin_at(q);
      }
    }
    if (violations_.count == 0) first_ = false;
  }
  if (violations_.count > 0) return MotionStep::violation;
  set_joints(q, dq);
  state_.X_BE_c = state_.X_BE_d;
  state_.elbow_c = state_.elbow_d;
  publish();
  return MotionStep::moving;
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

// --- published state ---

// A new position at rest: the history is discarded.
void DesiredMotion::begin_at(const JointVector& q) {
  state_.q = q;
  state_.dq.setZero();
  state_.ddq.setZero();
  state_.X_BE_d = inverse_.chain().X_BE(q);
  state_.V_BE_d = {};
}

void DesiredMotion::set_joints(const JointVector& q, const JointVector& dq) {
  state_.ddq = (dq - state_.dq) / kArmPeriod;
  state_.dq = dq;
  state_.q = q;
  const Pose X = inverse_.chain().X_BE(q);
  Twist V;
  V.vector = pose_difference(X, state_.X_BE_d) / kArmPeriod;
  state_.A_BE_d = (V.vector - state_.V_BE_d.vector) / kArmPeriod;
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

}  // namespace multipanda
