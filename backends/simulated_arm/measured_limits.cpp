#include "backends/simulated_arm/measured_limits.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace multipanda {
namespace {

// Keeps the largest excess of one rule.
struct Worst {
  ReflexDetail detail;
  double excess = 0;
  void see(ArmError error, Eigen::Index index, double value, double limit, double by) {
    if (!(by > excess)) return;
    excess = by;
    detail = {.error = error, .index = static_cast<std::int8_t>(index), .value = value, .limit = limit};
  }
};

}  // namespace

MotionLimits MotionLimits::of(const RobotDescription& robot) {
  MotionLimits limits;
  const JointLimits& joints = robot.limits;
  limits.q_min = joints.q_min;
  limits.q_max = joints.q_max;
  limits.dq_max = joints.dq_max;
  limits.ddq_max = joints.ddq_max;
  limits.dddq_max = joints.dddq_max;
  if (const auto& tied = robot.position_based_velocity) {
    limits.q_min = tied->q_min;
    limits.q_max = tied->q_max;
    limits.velocity_offset = tied->offset;
    limits.deceleration = tied->deceleration;
  }
  limits.cartesian = robot.cartesian.value_or(CartesianLimits{.velocity = 3.0,
                                                              .acceleration = 9.0,
                                                              .jerk = 4500,
                                                              .rotation_velocity = 2.5,
                                                              .rotation_acceleration = 17,
                                                              .rotation_jerk = 8500,
                                                              .elbow_velocity = 1.5,
                                                              .elbow_acceleration = 10,
                                                              .elbow_jerk = 5000});
  return limits;
}

double MotionLimits::upper_velocity(Eigen::Index joint, double q) const {
  if (velocity_offset.size() == 0) return dq_max[joint];
  const double room = std::max(0.0, 2 * deceleration[joint] * (q_max[joint] - q));
  return std::min(dq_max[joint], std::max(0.0, std::sqrt(room) - velocity_offset[joint]));
}

double MotionLimits::lower_velocity(Eigen::Index joint, double q) const {
  if (velocity_offset.size() == 0) return -dq_max[joint];
  const double room = std::max(0.0, 2 * deceleration[joint] * (q - q_min[joint]));
  return -std::min(dq_max[joint], std::max(0.0, std::sqrt(room) - velocity_offset[joint]));
}

MeasuredLimits::MeasuredLimits(MotionLimits limits, const JointVector& tau_max,
                               std::optional<WorkspaceBox> workspace)
    : limits_(std::move(limits)),
      tau_max_(tau_max),
      workspace_(std::move(workspace)),
      power_max_(kPowerShare * tau_max_.dot(limits_.dq_max)),
      q_min_(limits_.q_min),
      q_max_(limits_.q_max) {}

void MeasuredLimits::stand_at(const JointVector& q) {
  for (Eigen::Index i = 0; i < q.size(); ++i) {
    q_min_[i] = q[i] < limits_.q_min[i] ? q[i] - kLeadBack : limits_.q_min[i];
    q_max_[i] = q[i] > limits_.q_max[i] ? q[i] + kLeadBack : limits_.q_max[i];
  }
}

ReflexDetail MeasuredLimits::check(const Measured& m) {
  Worst worst;
  for (Eigen::Index i = 0; i < m.q.size(); ++i) {
    worst.see(ArmError::joint_position_limits_violation, i, m.q[i], q_max_[i], m.q[i] - q_max_[i]);
    worst.see(ArmError::joint_position_limits_violation, i, m.q[i], q_min_[i], q_min_[i] - m.q[i]);
    // Back inside: the limit applies again.
    if (m.q[i] > limits_.q_min[i] && m.q[i] < limits_.q_max[i]) {
      q_min_[i] = limits_.q_min[i];
      q_max_[i] = limits_.q_max[i];
    }
  }
  if (worst.detail) return worst.detail;
  for (Eigen::Index i = 0; i < m.dq.size(); ++i) {
    const double limit = kVelocityMargin * limits_.dq_max[i], speed = std::abs(m.dq[i]);
    worst.see(ArmError::joint_velocity_violation, i, m.dq[i], limit, speed / limit - 1);
  }
  if (worst.detail) return worst.detail;
  for (Eigen::Index i = 0; i < m.tau_J.size(); ++i) {
    worst.see(ArmError::tau_j_range_violation, i, m.tau_J[i], tau_max_[i],
              std::abs(m.tau_J[i]) / tau_max_[i] - 1);
  }
  if (worst.detail) return worst.detail;
  const double power = m.tau_J.cwiseProduct(m.dq).cwiseAbs().sum();
  worst.see(ArmError::power_limit_violation, -1, power, power_max_, power - power_max_);
  if (worst.detail) return worst.detail;
  for (Eigen::Index k = 0; workspace_ && k < 3; ++k) {
    const double p = m.p_BE[k];
    worst.see(ArmError::cartesian_position_limits_violation, k, p, workspace_->max[k],
              p - workspace_->max[k]);
    worst.see(ArmError::cartesian_position_limits_violation, k, p, workspace_->min[k],
              workspace_->min[k] - p);
  }
  if (worst.detail || !m.cartesian_motion) return worst.detail;
  // Norm of translation or rotation: index 0 and 3.
  const double linear = kVelocityMargin * limits_.cartesian.velocity;
  const double angular = kVelocityMargin * limits_.cartesian.rotation_velocity;
  const double v = m.V_BE.head<3>().norm(), w = m.V_BE.tail<3>().norm();
  worst.see(ArmError::cartesian_velocity_violation, 0, v, linear, v / linear - 1);
  worst.see(ArmError::cartesian_velocity_violation, 3, w, angular, w / angular - 1);
  return worst.detail;
}

TorqueRateCheck::TorqueRateCheck(const JointVector& rate_max, double period_s)
    : rate_max_(rate_max),
      last_(JointVector::Zero(rate_max.size())),
      replaced_(last_),
      published_(last_),
      period_(period_s) {}

ReflexDetail TorqueRateCheck::check(const JointVector& tau) const {
  ReflexDetail worst;
  double excess = 1 + kSlack;
  for (Eigen::Index i = 0; i < tau.size(); ++i) {
    const double step = std::min(
        {std::abs(tau[i] - last_[i]), std::abs(tau[i] - replaced_[i]), std::abs(tau[i] - published_[i])});
    const double rate = step / period_;
    if (rate <= excess * rate_max_[i]) continue;
    excess = rate / rate_max_[i];
    worst = {.error = ArmError::controller_torque_discontinuity,
             .index = static_cast<std::int8_t>(i),
             .value = rate,
             .limit = rate_max_[i]};
  }
  return worst;
}

}  // namespace multipanda
