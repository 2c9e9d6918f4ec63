#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <optional>
#include <vector>

#include "core/model/model_terms.hpp"
#include "core/state/arm_state.hpp"
#include "core/types/codes.hpp"

namespace multipanda {

// An axis-aligned box in the world that the end effector must not leave. [m]
struct WorkspaceBox {
  Vector3 min, max;
};

// The limits of one arm; the maker's by default. A scene may tighten them; loosening is explicit and logged
// by whoever reads the scene.
struct SafetyLimits {
  ArmLimits joints;
  std::optional<WorkspaceBox> workspace;
  double max_state_age_s = 0.002;  // older than this, an arm and the others of its controllet go to hold
  // The same for an arm that its controllet owns alone: nothing is computed from its old state, for torques
  // answer its own packets. As long as the arm itself waits before it gives up: 20 periods.
  double max_silence_s = 0.02;
  double implausible_factor = 10.0;  // torque beyond this many times the limit is nonsense, not an effort
  double period_s = 0.001;           // the arm's control period: a torque step counts over at most this

  static SafetyLimits of(const ArmModel& model) { return {.joints = model.limits(), .workspace = {}}; }
};

// What a check found: nothing (`none`), or which rule, where, and by how much.
struct Finding {
  Intervention rule = Intervention::none;
  std::uint16_t joint = 0xFFFF;  // 0xFFFF: not about one joint
  double value = 0, limit = 0;
  explicit operator bool() const { return rule != Intervention::none; }
};

// The last hand before the wire, for all arms. Loop thread; counters may be read from any thread.
class SafetyStage {
 public:
  explicit SafetyStage(std::vector<SafetyLimits> limits);

  const SafetyLimits& limits(std::size_t arm) const { return arms_[arm].limits; }

  // May the arm's owner go on from this measurement? Position and workspace rules act on outward motion only,
  // so that an arm beyond a limit can be led back. `alone`: the owner has no other arm.
  Finding inspect(std::size_t arm, const ArmState& state, ModelTerms& terms, bool alone = false) const;

  // Is this a torque at all? Non-finite or implausible torques take their author out.
  // A vector of another size than the arm has joints is implausible.
  Finding judge(std::size_t arm, const JointVector& tau) const;
  // The same for the sum of a controllet's torque and its features'.
  Finding judge(std::size_t arm, const JointVector& tau_controllet, const JointVector& tau_feature) const;

  // The last word: brings `wanted` within the torque limit and the torque-rate limit (measured from the last
  // command, over dt but at most one period). Counts what it cut; `cut` tells which rule acted first.
  // Non-finite: towards zero.
  const JointVector& limit(std::size_t arm, const JointVector& wanted, double dt, Finding& cut);

  // The command last given; the rate limit counts from it. At the start: what the arm has in use.
  const JointVector& last_command(std::size_t arm) const { return arms_[arm].tau_cmd; }
  // What is not a number, or not one per joint, counts as zero.
  void set_last_command(std::size_t arm, const JointVector& tau);

  void count(std::size_t arm, Intervention rule) {
    auto& n = arms_[arm].counts[static_cast<std::size_t>(rule)];
    n.store(n.load(std::memory_order_relaxed) + 1, std::memory_order_relaxed);
  }
  std::uint64_t counted(std::size_t arm, Intervention rule) const {
    return arms_[arm].counts[static_cast<std::size_t>(rule)].load(std::memory_order_relaxed);
  }
  std::uint64_t counted(std::size_t arm) const;  // all rules

 private:
  struct Arm {
    SafetyLimits limits;
    JointVector tau_cmd;
    std::array<std::atomic<std::uint64_t>, static_cast<std::size_t>(Intervention::count_)> counts{};
  };
  std::vector<Arm> arms_;
};

}  // namespace multipanda
