// The Cartesian generators: commanded pose and elbow to joints.
#include <cmath>
#include <optional>

#include "backends/simulated_arm/desired_motion.hpp"

namespace multipanda {

MotionStep DesiredMotion::step_cartesian(const InterfaceCommand* command) {
  CartesianCommand requested;
  if (command == nullptr) {
    extrapolate(requested);
  } else if (const MotionStep read = read_cartesian(*command, requested); read != MotionStep::moving) {
    return read;
  }
  check_twist(requested.V, requested.V_published);
  const bool twist_broken = violations_.count > 0;
  const std::size_t before_elbow = violations_.count;
  if (requested.has_elbow) check_elbow(requested.elbow);
  const bool elbow_broken = violations_.count > before_elbow;
  // A velocity generator has no start pose, so its violations are final.
  const bool posed = generator_ == MotionGenerator::cartesian_pose;
  if (first_ && command != nullptr && (twist_broken || elbow_broken) && (posed || !twist_broken)) {
    begin_cartesian(requested, twist_broken, elbow_broken);
  }
  if (violations_.count > 0) return MotionStep::violation;

  const auto& solution = inverse_.solve(
      requested.X, requested.has_elbow ? std::optional(requested.elbow) : std::nullopt, state_.q);
  const JointVector dq_c = (solution.q - state_.q) / kArmPeriod;
  if (!requested.begins_here) {
    const Vector6 dA = (requested.V_published - published_.V.cast<double>()) / kArmPeriod - requested.A;
    // First-order estimate of the joint motion for the published history.
    check_solution(solution, dq_c,
                   dq_c + inverse_.differential(requested.V_published - requested.V,
                                                requested.delbow_published - requested.delbow),
                   (dq_c - state_.dq) / kArmPeriod +
                       inverse_.differential(dA, requested.ddelbow_published - requested.ddelbow));
    if (first_ && command != nullptr && posed && solution.met && violations_.count > 0) {
      if_continued_ = violations_;
      begin_cartesian(requested, true, requested.has_elbow);
    }
  }
  if (requested.begins_here) check_joint_positions(solution.q);
  if (violations_.count > 0) return MotionStep::violation;

  if (command != nullptr) first_ = false;
  elbow_commanded_ = requested.has_elbow;
  if (requested.begins_here) begin_at(solution.q);
  const JointVector dq = (solution.q - state_.q) / kArmPeriod;
  set_joints(solution.q, dq);
  state_.X_BE_c = requested.X;
  state_.V_BE_c.vector = requested.V;
  state_.A_BE_c = requested.A;
  if (requested.has_elbow) {
    state_.elbow_c = {requested.elbow, state_.elbow_d[1]};
    state_.delbow_c = {requested.delbow, 0};
    state_.ddelbow_c = {requested.ddelbow, 0};
  } else if (model_->joint_count() == 7) {
    state_.elbow_c = state_.elbow_d;
    state_.delbow_c = {state_.dq[2], 0};
    state_.ddelbow_c = {state_.ddq[2], 0};
  }
  publish();
  return MotionStep::moving;
}

// No command: extrapolates with the last acceleration.
void DesiredMotion::extrapolate(CartesianCommand& requested) const {
  requested.A = state_.A_BE_c;
  requested.V = requested.V_published = state_.V_BE_c.vector + kArmPeriod * requested.A;
  requested.X = displaced(state_.X_BE_c, kArmPeriod * requested.V);
  requested.has_elbow = elbow_commanded_;
  requested.ddelbow = requested.ddelbow_published = state_.ddelbow_c[0];
  requested.delbow = requested.delbow_published = state_.delbow_c[0] + kArmPeriod * requested.ddelbow;
  requested.elbow = state_.elbow_c[0] + kArmPeriod * requested.delbow;
}

MotionStep DesiredMotion::read_cartesian(const InterfaceCommand& command, CartesianCommand& requested) {
  if (generator_ == MotionGenerator::cartesian_pose) {
    const Eigen::Matrix4d T = Eigen::Map<const Eigen::Matrix4d>(command.O_T_EE_c.data());
    if (!T.allFinite()) return MotionStep::input_error;
    if (const double error = error_of_frame(T); !(error <= kOrthonormal)) {
      report(ArmError::cartesian_position_motion_generator_invalid_frame, -1, error, kOrthonormal);
      return MotionStep::violation;
    }
    requested.X = {nearest_rotation(T.topLeftCorner<3, 3>()), T.topRightCorner<3, 1>()};
    requested.V = pose_difference(requested.X, state_.X_BE_c) / kArmPeriod;
    requested.V_published = pose_difference(requested.X, published_.pose()) / kArmPeriod;
  } else {
    requested.V = requested.V_published = command.O_dP_EE_c;
    if (!requested.V.allFinite()) return MotionStep::input_error;
    requested.X = displaced(state_.X_BE_c, kArmPeriod * requested.V);
  }
  requested.A = (requested.V - state_.V_BE_c.vector) / kArmPeriod;
  requested.has_elbow = command.has_elbow && model_->joint_count() == 7;
  if (!requested.has_elbow) return MotionStep::moving;
  const auto [elbow, side] = command.elbow_c;
  if (!std::isfinite(elbow) || !std::isfinite(side)) return MotionStep::input_error;
  const double side_now = state_.elbow_d[1];
  if (std::abs(side) != 1 || (side_now != 0 && side != side_now)) {
    report(ArmError::cartesian_motion_generator_elbow_sign_inconsistent, -1, side, side_now);
    return MotionStep::violation;
  }
  requested.elbow = elbow;
  requested.delbow = (elbow - state_.elbow_c[0]) / kArmPeriod;
  requested.ddelbow = (requested.delbow - state_.delbow_c[0]) / kArmPeriod;
  requested.delbow_published = (elbow - static_cast<double>(published_.elbow)) / kArmPeriod;
  requested.ddelbow_published =
      (requested.delbow_published - static_cast<double>(published_.delbow)) / kArmPeriod;
  return MotionStep::moving;
}

// A first command that does not continue the start may be a new start, if it is close enough and at rest.
void DesiredMotion::begin_cartesian(CartesianCommand& requested, bool other_pose, bool other_elbow) {
  violations_.count = 0;
  const Vector6 off = pose_difference(requested.X, state_.X_BE_c);
  const double off_p = off.head<3>().norm(), off_r = off.tail<3>().norm();
  const double off_elbow = requested.elbow - state_.elbow_c[0];
  if (other_pose && off_p > kStartPosition) {
    report(ArmError::cartesian_position_motion_generator_start_pose_invalid, 0, off_p, kStartPosition);
  }
  if (other_pose && off_r > kStartRotation) {
    report(ArmError::cartesian_position_motion_generator_start_pose_invalid, 3, off_r, kStartRotation);
  }
  if (other_elbow && std::abs(off_elbow) > kStartJoint) {
    report(ArmError::cartesian_motion_generator_start_elbow_invalid, -1, off_elbow, kStartJoint);
  }
  requested.begins_here = true;
  requested.delbow = requested.ddelbow = 0;
  if (other_pose) {
    requested.V.setZero();
    requested.A.setZero();
  }
}

}  // namespace multipanda
