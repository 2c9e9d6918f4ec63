#include "core/safety/safety.hpp"

#include <algorithm>
#include <cmath>

namespace multipanda {
namespace {

// Slower motion does not count as outwards: noise at rest at a limit must not trigger an intervention.
constexpr double kOutwardSpeed = 0.01;  // [rad/s], [m/s]

Finding at_joint(Intervention rule, Eigen::Index joint, double value, double limit) {
  return {rule, static_cast<std::uint16_t>(joint), value, limit};
}

}  // namespace

SafetyStage::SafetyStage(std::vector<SafetyLimits> limits) : arms_(limits.size()) {
  for (std::size_t i = 0; i < limits.size(); ++i) {
    arms_[i].tau_cmd = JointVector::Zero(limits[i].joints.tau_max.size());
    arms_[i].limits = std::move(limits[i]);
  }
}

Finding SafetyStage::inspect(std::size_t arm, const ArmState& state, ModelTerms& terms, bool alone) const {
  const SafetyLimits& limits = arms_[arm].limits;
  if (!takes_commands(state.mode)) return {Intervention::arm_not_ready};
  const double max_age =
      alone ? std::max(limits.max_silence_s, limits.max_state_age_s) : limits.max_state_age_s;
  if (state.age_s > max_age) {
    return {Intervention::state_old, 0xFFFF, state.age_s, max_age};
  }
  if (!state.q.allFinite() || !state.dq.allFinite()) return {Intervention::state_not_finite};
  for (Eigen::Index i = 0; i < state.q.size(); ++i) {
    const double q = state.q[i], dq = state.dq[i];
    if (std::abs(dq) > limits.joints.dq_max[i]) {
      return at_joint(Intervention::joint_velocity_limit, i, dq, limits.joints.dq_max[i]);
    }
    if (q > limits.joints.q_max[i] && dq > kOutwardSpeed) {
      return at_joint(Intervention::joint_position_limit, i, q, limits.joints.q_max[i]);
    }
    if (q < limits.joints.q_min[i] && dq < -kOutwardSpeed) {
      return at_joint(Intervention::joint_position_limit, i, q, limits.joints.q_min[i]);
    }
  }
  if (limits.workspace) {
    const Vector3& p = terms.X_WE().position;
    const Twist& V = terms.V_WE();
    for (Eigen::Index k = 0; k < 3; ++k) {
      const bool out = (p[k] > limits.workspace->max[k] && V.linear()[k] > kOutwardSpeed) ||
                       (p[k] < limits.workspace->min[k] && V.linear()[k] < -kOutwardSpeed);
      if (out) {
        const double bound =
            p[k] > limits.workspace->max[k] ? limits.workspace->max[k] : limits.workspace->min[k];
        return {Intervention::workspace_limit, 0xFFFF, p[k], bound};
      }
    }
  }
  return {};
}

Finding SafetyStage::judge(std::size_t arm, const JointVector& tau) const {
  const SafetyLimits& limits = arms_[arm].limits;
  const Eigen::Index n = limits.joints.tau_max.size();
  if (tau.size() != n) {
    return {Intervention::torque_implausible, 0xFFFF, static_cast<double>(tau.size()),
            static_cast<double>(n)};
  }
  for (Eigen::Index i = 0; i < n; ++i) {
    if (!std::isfinite(tau[i]))
      return at_joint(Intervention::torque_not_finite, i, tau[i], limits.joints.tau_max[i]);
    const double bound = limits.implausible_factor * limits.joints.tau_max[i];
    if (std::abs(tau[i]) > bound) return at_joint(Intervention::torque_implausible, i, tau[i], bound);
  }
  return {};
}

Finding SafetyStage::judge(std::size_t arm, const JointVector& tau_controllet,
                           const JointVector& tau_feature) const {
  if (const Finding finding = judge(arm, tau_feature)) return finding;
  if (const Finding finding = judge(arm, tau_controllet)) return finding;
  const JointVector sum = tau_controllet + tau_feature;
  return judge(arm, sum);
}

void SafetyStage::set_last_command(std::size_t arm, const JointVector& tau) {
  JointVector& last = arms_[arm].tau_cmd;
  for (Eigen::Index i = 0; i < last.size(); ++i) {
    last[i] = i < tau.size() && std::isfinite(tau[i]) ? tau[i] : 0.0;
  }
}

const JointVector& SafetyStage::limit(std::size_t arm, const JointVector& requested, double dt,
                                      Finding& cut) {
  Arm& a = arms_[arm];
  const double step_time = std::clamp(dt, 0.0, a.limits.period_s);
  bool clamped = false, rate_clamped = false;
  cut = {};
  for (Eigen::Index i = 0; i < a.tau_cmd.size(); ++i) {
    const double bound = a.limits.joints.tau_max[i];
    const double w = std::isfinite(requested[i]) ? requested[i] : 0.0;
    const double within = std::clamp(w, -bound, bound);
    const double step = a.limits.joints.tau_rate_max[i] * step_time;
    const double sent = std::clamp(within, a.tau_cmd[i] - step, a.tau_cmd[i] + step);
    if (within != w && !clamped) {
      clamped = true;
      cut = at_joint(Intervention::torque_clamped, i, w, bound);
    }
    if (sent != within && !rate_clamped) {
      rate_clamped = true;
      if (!cut) {
        cut = at_joint(Intervention::torque_rate_clamped, i,
                       step_time > 0 ? (within - a.tau_cmd[i]) / step_time : 0,
                       a.limits.joints.tau_rate_max[i]);
      }
    }
    a.tau_cmd[i] = sent;
  }
  if (clamped) count(arm, Intervention::torque_clamped);
  if (rate_clamped) count(arm, Intervention::torque_rate_clamped);
  return a.tau_cmd;
}

std::uint64_t SafetyStage::counted(std::size_t arm) const {
  std::uint64_t sum = 0;
  for (const auto& n : arms_[arm].counts) sum += n.load(std::memory_order_relaxed);
  return sum;
}

}  // namespace multipanda
