#include "core/safety/safety.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace multipanda {
namespace {

// Slower motion is not outward motion: noise at rest at a limit must not trigger an intervention.
constexpr double kOutwardSpeed = 0.01;  // [rad/s], [m/s]
// Slow creep is also prevented: this far beyond a limit, any motion except the return is an intervention.
constexpr double kJointMargin = 0.02;       // [rad]
constexpr double kSlidingMargin = 0.005;    // of a prismatic joint [m]
constexpr double kWorkspaceMargin = 0.005;  // [m]

// Whether a value that is `beyond` its limit, moving away from it at `outwards`, has to stop. `known`: how
// far beyond it may be.
bool leaves(double beyond, double outwards, double known, double margin) {
  if (!(beyond > 0)) return false;
  return outwards > kOutwardSpeed || (beyond > known + margin && outwards >= 0);
}

// Largest speed of a joint in its direction of motion. The formula ends in zero, beyond the position limits:
// there, noise at rest must not trigger an intervention either.
double largest_speed(const ArmLimits& limits, Eigen::Index joint, double q, double dq) {
  const double dq_max = limits.dq_max[joint];
  if (!limits.velocity_by_position) return dq_max;
  const PositionBasedVelocity& law = *limits.velocity_by_position;
  const double allowed = dq > 0 ? law.upwards(joint, q, dq_max) : law.downwards(joint, q, dq_max);
  return std::max(allowed, std::min(kOutwardSpeed, dq_max));
}

Finding at_joint(Intervention rule, Eigen::Index joint, double value, double limit) {
  return {rule, static_cast<std::uint16_t>(joint), value, limit};
}

}  // namespace

SafetyStage::SafetyStage(std::vector<SafetyLimits> limits) : arms_(limits.size()) {
  for (std::size_t i = 0; i < limits.size(); ++i) {
    const ArmLimits& joints = limits[i].joints;
    arms_[i].torque = TorqueLimiter({.tau_max = joints.tau_max,
                                     .tau_rate_max = joints.tau_rate_max,
                                     .period_s = limits[i].period_s,
                                     .low_pass_hz = limits[i].low_pass_hz});
    arms_[i].limits = std::move(limits[i]);
  }
}

std::array<SafetyStage::Point, SafetyStage::kPoints> SafetyStage::points(ModelTerms& terms) {
  const Vector3& p = terms.X_WE().position;
  const Twist& V = terms.V_WE();
  const auto at = [&](const Vector3& from_hand) {
    return Point{p + from_hand, V.linear() + V.angular().cross(from_hand)};
  };
  const auto [flange, tool] = terms.points_from_hand();
  return {at(Vector3::Zero()), at(flange), at(tool)};
}

void SafetyStage::track_limits(std::size_t arm, const ArmState& state, ModelTerms& terms, bool held,
                               bool began) {
  Arm& a = arms_[arm];
  const bool starts = a.held && !held;
  a.held = held;
  const auto track = [&](Beyond& limit, double beyond) {
    beyond = std::max(0.0, beyond);  // zero for a value that is not a number
    if (beyond == 0 || began) limit.most = std::numeric_limits<double>::infinity();
    if (std::exchange(limit.released, false)) limit.most = std::min(limit.most, beyond);
    limit.follows = beyond == 0 || began || (limit.follows && !starts);
    limit.known = held && limit.follows ? std::min(beyond, limit.most) : std::min(limit.known, beyond);
  };
  const ArmLimits& joints = a.limits.joints;
  for (Eigen::Index i = 0; i < state.q.size(); ++i) {
    track(a.joints[static_cast<std::size_t>(i)],
          std::max(state.q[i] - joints.q_max[i], joints.q_min[i] - state.q[i]));
  }
  if (!a.limits.workspace) return;
  const auto all = points(terms);
  for (std::size_t n = 0; n < kPoints; ++n) {
    for (Eigen::Index k = 0; k < 3; ++k) {
      track(a.space[n][static_cast<std::size_t>(k)],
            std::max(all[n].p[k] - a.limits.workspace->max[k], a.limits.workspace->min[k] - all[n].p[k]));
    }
  }
}

void SafetyStage::release_limits(std::size_t arm) {
  const auto release = [](Beyond& limit) { limit.released = !std::exchange(limit.follows, true); };
  std::ranges::for_each(arms_[arm].joints, release);
  for (auto& point : arms_[arm].space) std::ranges::for_each(point, release);
}

Finding SafetyStage::inspect(std::size_t arm, const ArmCondition& condition, const ArmState& state,
                             ModelTerms& terms, bool alone) const {
  const SafetyLimits& limits = arms_[arm].limits;
  if (!condition.usable) return {Intervention::arm_not_ready};
  const double max_age = alone ? std::max(limits.max_silence_s, limits.max_state_age_s)
                               : limits.max_state_age_s + limits.own_clock_slack_s;
  if (condition.age_s > max_age) return {Intervention::state_old, 0xFFFF, condition.age_s, max_age};
  if (condition.gap_s > limits.longest_gap_s()) {
    return {Intervention::state_old, 0xFFFF, condition.gap_s, limits.longest_gap_s()};
  }
  if (!state.q.allFinite() || !state.dq.allFinite()) return {Intervention::state_not_finite};
  for (Eigen::Index i = 0; i < state.q.size(); ++i) {
    const double q = state.q[i], dq = state.dq[i];
    const double fastest = largest_speed(limits.joints, i, q, dq);
    if (std::abs(dq) > fastest) return at_joint(Intervention::joint_velocity_limit, i, dq, fastest);
    const double known = arms_[arm].joints[static_cast<std::size_t>(i)].known;
    const double margin =
        terms.model().is_prismatic(static_cast<std::size_t>(i)) ? kSlidingMargin : kJointMargin;
    if (leaves(q - limits.joints.q_max[i], dq, known, margin)) {
      return at_joint(Intervention::joint_position_limit, i, q, limits.joints.q_max[i]);
    }
    if (leaves(limits.joints.q_min[i] - q, -dq, known, margin)) {
      return at_joint(Intervention::joint_position_limit, i, q, limits.joints.q_min[i]);
    }
  }
  if (!limits.workspace) return {};
  const auto all = points(terms);
  for (std::size_t n = 0; n < kPoints; ++n) {
    const auto& [p, v] = all[n];
    for (Eigen::Index k = 0; k < 3; ++k) {
      const double known = arms_[arm].space[n][static_cast<std::size_t>(k)].known;
      const double low = limits.workspace->min[k], high = limits.workspace->max[k];
      if (leaves(p[k] - high, v[k], known, kWorkspaceMargin))
        return {Intervention::workspace_limit, 0xFFFF, p[k], high};
      if (leaves(low - p[k], -v[k], known, kWorkspaceMargin))
        return {Intervention::workspace_limit, 0xFFFF, p[k], low};
    }
  }
  return {};
}

Finding SafetyStage::inspect_observed(std::size_t arm, const ArmCondition& condition,
                                      const ArmState& state) const {
  constexpr auto kLost = Intervention::observed_arm_lost;
  const double longest = arms_[arm].limits.longest_gap_s();
  if (!takes_commands(state.mode) && state.mode != ArmMode::guiding) return {kLost};
  if (condition.age_s > longest) return {kLost, 0xFFFF, condition.age_s, longest};
  if (condition.gap_s > longest) return {kLost, 0xFFFF, condition.gap_s, longest};
  if (!state.q.allFinite() || !state.dq.allFinite()) return {kLost};
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

const JointVector& SafetyStage::limit(std::size_t arm, const JointVector& requested, double dt,
                                      Finding& cut) {
  TorqueLimiter::Cuts cuts;
  const JointVector& tau_cmd = arms_[arm].torque.limit(requested, dt, cuts);
  if (cuts.torque) count(arm, Intervention::torque_clamped);
  if (cuts.rate) count(arm, Intervention::torque_rate_clamped);
  cut = cuts.torque ? cuts.torque : cuts.rate;
  return tau_cmd;
}

std::uint64_t SafetyStage::counted(std::size_t arm) const {
  std::uint64_t sum = 0;
  for (const auto& n : arms_[arm].counts) sum += n.load(std::memory_order_relaxed);
  return sum;
}

}  // namespace multipanda
