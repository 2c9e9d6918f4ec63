#include "benchmarks/soak/invariants.hpp"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

namespace multipanda {
namespace {

constexpr std::size_t kKept = 100;
// Relative tolerance: torques are sent in single or double precision and subtracted.
constexpr double kRounding = 1e-5;

// Reported without taking an arm from its controllet.
bool only_clamps(Intervention code) {
  return code == Intervention::torque_clamped || code == Intervention::torque_rate_clamped ||
         code == Intervention::none;
}

}  // namespace

Invariants::Invariants(RecordLayout layout, std::vector<ArmBounds> bounds)
    : layout_(std::move(layout)),
      bounds_(std::move(bounds)),
      before_(layout_.arms.size()),
      states_(layout_.arms.size()) {}

void Invariants::report(double at_s, std::string what) {
  ++count_;
  if (violations_.size() < kKept) violations_.push_back({at_s, std::move(what)});
}

void Invariants::check(const CycleRecord& cycle, std::uint64_t active, std::span<const ArmCount> counts,
                       ArmSet disturbed) {
  const double t = cycle.t.seconds();
  if (cycles_ > 0 && cycle.cycle != last_cycle_ + 1)
    report(t, fmt::format("cycle {} follows cycle {}", cycle.cycle, last_cycle_));
  last_cycle_ = cycle.cycle;
  ++cycles_;

  for (ArmIndex i = 0; i < cycle.arms.size(); ++i) {
    const ArmSample& arm = cycle.arms[i];
    const std::string& name = layout_.arms[i].name;

    int owners = 0;
    for (std::size_t k = 0; k < layout_.instances.size(); ++k) {
      if ((active >> k & 1u) != 0 && (layout_.instances[k].arms >> i & 1u) != 0) ++owners;
    }
    const bool owner_is_active = arm.owner < layout_.instances.size() && (active >> arm.owner & 1u) != 0 &&
                                 (layout_.instances[arm.owner].arms >> i & 1u) != 0;
    if (owners != 1 || !owner_is_active)
      report(t, fmt::format("{} has {} active owners, and its torque is of instance {}", name, owners,
                            arm.owner));

    for (std::size_t j = 0; arm.due && j < layout_.arms[i].joint_count; ++j) {
      const double limit = bounds_[i].tau_max[static_cast<Eigen::Index>(j)];
      if (!(std::abs(arm.tau_cmd[j]) <= limit * (1 + kRounding)))
        report(t, fmt::format("{}: torque of joint {} is {} N m, limit {} N m", name, j + 1, arm.tau_cmd[j],
                              limit));
    }

    const ArmCount& now = counts[i];
    ArmCount& before = before_[i];
    const double rate_limit = bounds_[i].tau_rate_max.maxCoeff();
    if (now.torque_rate_max > before.torque_rate_max &&
        !(now.torque_rate_max <= rate_limit * (1 + kRounding)))
      report(t, fmt::format("{} received a torque rate of {:.1f} N m/s, limit {} N m/s", name,
                            now.torque_rate_max, rate_limit));
    // The first cycle waits for the first state of every arm, so early arms miss the following period:
    // periods count from an arm's second state.
    const bool judged = states_[i] == 2;
    if (arm.due && !judged) ++states_[i];
    if (judged && !disturbed.contains(i)) {
      if (now.periods_missed != before.periods_missed)
        report(t, fmt::format("{} had no command in {} of its periods, although no fault was injected on it",
                              name, now.periods_missed - before.periods_missed));
      if (now.motions_ended != before.motions_ended)
        report(t, fmt::format("{} stopped itself, although no fault was injected on it: {}", name,
                              describe(now.last_reflex)));
    }
    before = now;
  }
}

void Invariants::check(const Event& event, ArmSet disturbed) {
  if (event.kind != EventKind::intervention || only_clamps(event.intervention)) return;
  ArmSet arms;
  if (event.arm < layout_.arms.size()) arms = ArmSet::of(event.arm);
  if (event.instance < layout_.instances.size())
    arms |= ArmSet::from_bits(layout_.instances[event.instance].arms);
  if (disturbed.overlaps(arms)) return;
  const std::string joint = event.joint == 0xFFFF ? "" : fmt::format("joint {}: ", event.joint + 1);
  const std::string_view unit = unit_of(event.intervention);
  const std::string values = unit.empty() ? ""
                                          : fmt::format(" ({}{:.4g}, limit {:.4g} {})", joint,
                                                        event.values[0], event.values[1], unit);
  report(event.t.seconds(),
         fmt::format("{} was held: {}{}, although no fault was injected on it",
                     event.arm < layout_.arms.size() ? layout_.arms[event.arm].name : "an arm",
                     to_string(event.intervention), values));
}

void WorkBalance::arm_period(const JointVector& q, const JointVector* tau) {
  if (arm_commanded_) arm_ += tau_arm_.dot(q - q_arm_);
  arm_commanded_ = tau != nullptr;
  if (arm_commanded_) tau_arm_ = *tau;
  q_arm_ = q;
}

void WorkBalance::state(const JointVector& q, const JointVector& tau_in_use, bool seen, bool counts) {
  if (counts && tau_program_.size() == q.size()) {
    // The torque changed during the gap: its mean is the best estimate.
    const JointVector tau = seen ? tau_program_ : JointVector(0.5 * (tau_program_ + tau_in_use));
    const double work = tau.dot(q - q_program_);
    program_ += work;
    if (!seen) unseen_ += std::abs((tau_in_use - tau_program_).dot(q - q_program_));
  }
  q_program_ = q;
  tau_program_ = tau_in_use;
}

}  // namespace multipanda
