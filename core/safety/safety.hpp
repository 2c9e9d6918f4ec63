#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <optional>
#include <vector>

#include "core/model/model_terms.hpp"
#include "core/state/arm_state.hpp"
#include "core/types/codes.hpp"
#include "core/types/time.hpp"

namespace multipanda {

// An axis-aligned box in the world that the end effector must not leave [m].
struct WorkspaceBox {
  Vector3 min, max;
};

// The limits of one arm; those of the manufacturer by default. A scene may tighten them. Looser limits need
// an explicit key in the scene and are logged.
struct SafetyLimits {
  ArmLimits joints;
  std::optional<WorkspaceBox> workspace;
  double max_state_age_s = 0.002;  // if a state is older, all arms of the controllet are held
  // The same for the only arm of a controllet. Its torques are computed from its own packets only, so never
  // from an old state. The default is 20 periods, after which the arm itself stops.
  double max_silence_s = 0.02;
  double implausible_factor = 10.0;  // a torque above this multiple of the limit is implausible
  double period_s = kArmPeriod;      // control period; the rate limit covers at most this

  static SafetyLimits of(const ArmModel& model) { return {.joints = model.limits(), .workspace = {}}; }
};

// Result of a check: nothing (`none`), or the rule, the joint, and the values.
struct Finding {
  Intervention rule = Intervention::none;
  std::uint16_t joint = 0xFFFF;  // 0xFFFF: not specific to a joint
  double value = 0, limit = 0;
  explicit operator bool() const { return rule != Intervention::none; }
};

// The last check before torques are sent, for all arms. Loop thread; counters may be read from any thread.
class SafetyStage {
 public:
  explicit SafetyStage(std::vector<SafetyLimits> limits);

  const SafetyLimits& limits(std::size_t arm) const { return arms_[arm].limits; }

  // Checks whether the arm's owner may continue from this measurement. Position and workspace rules
  // act on outward motion only, so that an arm beyond a limit can be moved back. `alone`: the owner
  // has no other arm.
  Finding inspect(std::size_t arm, const ArmState& state, ModelTerms& terms, bool alone = false) const;

  // Checks a controllet's torque. Non-finite or implausible torques deactivate the controllet. A vector whose
  // size is not the arm's joint count is implausible.
  Finding judge(std::size_t arm, const JointVector& tau) const;
  // The same for the sum of a controllet's torque and its features'.
  Finding judge(std::size_t arm, const JointVector& tau_controllet, const JointVector& tau_feature) const;

  // Clamps `requested` to the torque limit and to the torque-rate limit (relative to the last command, over
  // dt but at most one period). Counts each clamped torque; `cut` is the first rule that acted. Values that
  // are not finite become zero.
  const JointVector& limit(std::size_t arm, const JointVector& requested, double dt, Finding& cut);

  // The last command, to which the rate limit is relative. At the start it is the torque that
  // the arm applies.
  const JointVector& last_command(std::size_t arm) const { return arms_[arm].tau_cmd; }
  // Values that are not finite count as zero, as does a vector of the wrong size.
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
