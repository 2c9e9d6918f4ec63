#pragma once

#include <array>
#include <bit>
#include <cstdint>
#include <span>

#include "core/modes/goal_end.hpp"
#include "core/reference/target.hpp"
#include "core/types/arm_set.hpp"
#include "core/types/codes.hpp"
#include "core/types/joints.hpp"
#include "core/types/time.hpp"

namespace multipanda {

using InstanceIndex = std::uint16_t;
inline constexpr InstanceIndex kNoInstance = 0xFFFF;

// A set of controllet instances as bits.
using InstanceSet = std::uint64_t;
inline constexpr InstanceSet bit(InstanceIndex i) { return InstanceSet{1} << i; }
static_assert(kMaxInstances <= 64);

// Instances of a set, lowest index first: the order in which they are computed is always the same.
template <typename Visit>
void for_each(InstanceSet set, Visit visit) {
  for (; set != 0; set &= set - 1) visit(static_cast<InstanceIndex>(std::countr_zero(set)));
}

template <typename Visit>
void for_each(ArmSet arms, Visit visit) {
  for (std::uint32_t bits = arms.bits(); bits != 0; bits &= bits - 1) {
    visit(static_cast<ArmIndex>(std::countr_zero(bits)));
  }
}

// A request to the multimode controller. Plain data that is copied between threads.
struct Request {
  enum class Kind : std::uint8_t { switch_controllets, set_parameter, set_feature, set_target, resume };

  Kind kind = Kind::switch_controllets;

  // switch_controllets: activates these; other owners of their arms stop. With `only`, all others stop, too.
  // Arms without an owner are held.
  InstanceSet activate = 0, deactivate = 0;
  bool only = false;

  InstanceIndex instance = kNoInstance;  // set_*
  std::uint16_t index = 0;               // parameter, feature or input of that instance
  bool on = false;                       // set_feature
  std::uint8_t size = 0;                 // set_parameter: numbers used
  std::array<double, kMaxParameterSize> values{};
  Target target;  // set_target
  GoalEnd until;  // set_target: of a goal for a pose or joints

  ArmSet arms;  // resume, unless one of them was stopped after the state that the sender saw
  static constexpr std::uint32_t kEveryStop = 0xFFFFFFFF;
  std::uint32_t stops = kEveryStop;  // MultimodeController::stops() of that state

  std::uint16_t batch = 1;  // number of requests of one call, taken in the same cycle
};

// Result of a switch, as instance bits.
struct SwitchPlan {
  InstanceSet start = 0, stop = 0, keep = 0;
};

// The answer to a request, with the times of its steps.
struct Answer {
  Request::Kind kind = Request::Kind::switch_controllets;
  Verdict verdict = Verdict::pending;
  std::uint64_t ticket = 0;
  std::uint64_t cycle = 0;  // in which it was taken
  LoopTime t;               // of that cycle
  // When requested; at the cycle boundary; after the first torque was written.
  HostTime received, taken, first_torque;
  SwitchPlan plan;                         // of a switch
  Intervention rule = Intervention::none;  // by which an arm of a refused switch would be held again at once
  // Switch: largest step of any joint at the hand-over, per arm [N m]: as computed, and as sent after the
  // rate limit.
  std::array<double, kMaxArms> step_requested{}, step_sent{};

  bool accepted() const { return verdict == Verdict::accepted; }
};

}  // namespace multipanda
