// The Cartesian generators: commanded pose and elbow to joints.
#include <cmath>
#include <optional>

#include "backends/arm/desired_motion.hpp"
#include "backends/arm/pose_steps.hpp"

namespace multipanda {
namespace {

constexpr double dt = DesiredMotion::kPeriod;

}  // namespace

MotionStep DesiredMotion::step_cartesian(const InterfaceCommand* command) {
  CartesianCommand wanted;
  if (command == nullptr) {
    extrapolate(wanted);
  } else if (const MotionStep read = read_cartesian(*command, wanted); read != MotionStep::moving) {
    return read;
  }
  check_twist(wanted.V, wanted.V_published);
  const bool twist_broken = violation_count_ > 0;
  const std::size_t before_elbow = violation_count_;
  if (wanted.has_elbow) check_elbow(wanted.elbow);
  const bool elbow_broken = violation_count_ > before_elbow;
  // A velocity has no start pose: what it breaks it breaks.
  const bool posed = generator_ == MotionGenerator::cartesian_pose;
  if (first_ && command != nullptr && (twist_broken || elbow_broken) && (posed || !twist_broken)) {
    begin_cartesian(wanted, twist_broken, elbow_broken);
  }
  if (violation_count_ > 0) return MotionStep::violation;

  const auto& solution =
      inverse_.solve(wanted.X, wanted.has_elbow ? std::optional(wanted.elbow) : std::nullopt, state_.q);
  if (wanted.begins_here) {
    check_joint_positions(solution.q);
  } else {
    const JointVector dq = (solution.q - state_.q) / dt;
    const Vector6 dA = (wanted.V_published - published_.V.cast<double>()) / dt - wanted.A;
    // What the joints would do, had the motion really been as published: by first order.
    check_solution(
        solution, dq,
        dq + inverse_.differential(wanted.V_published - wanted.V, wanted.delbow_published - wanted.delbow),
        (dq - state_.dq) / dt + inverse_.differential(dA, wanted.ddelbow_published - wanted.ddelbow));
  }
  if (violation_count_ > 0) return MotionStep::violation;

  if (command != nullptr) first_ = false;
  elbow_commanded_ = wanted.has_elbow;
  if (wanted.begins_here) begin_at(solution.q);
  const JointVector dq = (solution.q - state_.q) / dt;
  set_joints(solution.q, dq);
  state_.X_BE_c = wanted.X;
  state_.V_BE_c.vector = wanted.V;
  state_.A_BE_c = wanted.A;
  if (wanted.has_elbow) {
    state_.elbow_c = {wanted.elbow, state_.elbow_d[1]};
    state_.delbow_c = {wanted.delbow, 0};
    state_.ddelbow_c = {wanted.ddelbow, 0};
  } else if (model_->joint_count() == 7) {
    state_.elbow_c = state_.elbow_d;
    state_.delbow_c = {state_.dq[2], 0};
    state_.ddelbow_c = {state_.ddq[2], 0};
  }
  publish();
  return MotionStep::moving;
}

// No command: the last acceleration goes on.
void DesiredMotion::extrapolate(CartesianCommand& wanted) const {
  wanted.A = state_.A_BE_c;
  wanted.V = wanted.V_published = state_.V_BE_c.vector + dt * wanted.A;
  wanted.X = displaced(state_.X_BE_c, dt * wanted.V);
  wanted.has_elbow = elbow_commanded_;
  wanted.ddelbow = wanted.ddelbow_published = state_.ddelbow_c[0];
  wanted.delbow = wanted.delbow_published = state_.delbow_c[0] + dt * wanted.ddelbow;
  wanted.elbow = state_.elbow_c[0] + dt * wanted.delbow;
}

MotionStep DesiredMotion::read_cartesian(const InterfaceCommand& command, CartesianCommand& wanted) {
  if (generator_ == MotionGenerator::cartesian_pose) {
    const Eigen::Matrix4d T = Eigen::Map<const Eigen::Matrix4d>(command.O_T_EE_c.data());
    if (!T.allFinite()) return MotionStep::input_error;
    if (const double error = error_of_frame(T); !(error <= kOrthonormal)) {
      report(ArmError::cartesian_position_motion_generator_invalid_frame, -1, error, kOrthonormal);
      return MotionStep::violation;
    }
    wanted.X = {nearest_rotation(T.topLeftCorner<3, 3>()), T.topRightCorner<3, 1>()};
    wanted.V = pose_difference(wanted.X, state_.X_BE_c) / dt;
    wanted.V_published = pose_difference(wanted.X, published_.pose()) / dt;
  } else {
    wanted.V = wanted.V_published = command.O_dP_EE_c;
    if (!wanted.V.allFinite()) return MotionStep::input_error;
    wanted.X = displaced(state_.X_BE_c, dt * wanted.V);
  }
  wanted.A = (wanted.V - state_.V_BE_c.vector) / dt;
  wanted.has_elbow = command.has_elbow && model_->joint_count() == 7;
  if (!wanted.has_elbow) return MotionStep::moving;
  const auto [elbow, side] = command.elbow_c;
  if (!std::isfinite(elbow) || !std::isfinite(side)) return MotionStep::input_error;
  const double side_now = state_.elbow_d[1];
  if (std::abs(side) != 1 || (side_now != 0 && side != side_now)) {
    report(ArmError::cartesian_motion_generator_elbow_sign_inconsistent, -1, side, side_now);
    return MotionStep::violation;
  }
  wanted.elbow = elbow;
  wanted.delbow = (elbow - state_.elbow_c[0]) / dt;
  wanted.ddelbow = (wanted.delbow - state_.delbow_c[0]) / dt;
  wanted.delbow_published = (elbow - static_cast<double>(published_.elbow)) / dt;
  wanted.ddelbow_published = (wanted.delbow_published - static_cast<double>(published_.delbow)) / dt;
  return MotionStep::moving;
}

// The first command does not continue the start: it may be a start of its own, near enough and at rest.
void DesiredMotion::begin_cartesian(CartesianCommand& wanted, bool other_pose, bool other_elbow) {
  violation_count_ = 0;
  const Vector6 off = pose_difference(wanted.X, state_.X_BE_c);
  const double off_p = off.head<3>().norm(), off_r = off.tail<3>().norm();
  const double off_elbow = wanted.elbow - state_.elbow_c[0];
  if (other_pose && off_p > kStartPosition) {
    report(ArmError::cartesian_position_motion_generator_start_pose_invalid, 0, off_p, kStartPosition);
  }
  if (other_pose && off_r > kStartRotation) {
    report(ArmError::cartesian_position_motion_generator_start_pose_invalid, 3, off_r, kStartRotation);
  }
  if (other_elbow && std::abs(off_elbow) > kStartJoint) {
    report(ArmError::cartesian_motion_generator_start_elbow_invalid, -1, off_elbow, kStartJoint);
  }
  wanted.begins_here = true;
  wanted.delbow = wanted.ddelbow = 0;
  if (other_pose) {
    wanted.V.setZero();
    wanted.A.setZero();
  }
}

}  // namespace multipanda
