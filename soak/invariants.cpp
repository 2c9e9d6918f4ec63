#include "soak/invariants.hpp"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

namespace multipanda {
namespace {

constexpr std::size_t kKept = 100;
// Torques pass the wire in single or double precision and are subtracted: a share, not a tolerance of safety.
constexpr double kRounding = 1e-5;

// Reported, but nothing is taken from anybody.
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
      report(t, fmt::format("{} took torques that differ by {:.1f} N m/s, limit {} N m/s", name,
                            now.torque_rate_max, rate_limit));
    // The first cycle waits for the first state of every arm: arms whose state came early miss the period
    // that follows. An arm's periods are judged from its second state on.
    const bool judged = states_[i] == 2;
    if (arm.due && !judged) ++states_[i];
    if (judged && !disturbed.contains(i)) {
      if (now.periods_missed != before.periods_missed)
        report(t, fmt::format("{} had no command in {} of its periods, and no fault was injected on it", name,
                              now.periods_missed - before.periods_missed));
      if (now.motions_ended != before.motions_ended)
        report(t, fmt::format("{} stopped itself, and no fault was injected on it: {}", name,
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
         fmt::format("{} was held: {}{}; no fault was injected on it",
                     event.arm < layout_.arms.size() ? layout_.arms[event.arm].name : "an arm",
                     to_string(event.intervention), values));
}

}  // namespace multipanda
