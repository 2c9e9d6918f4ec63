#pragma once

#include <array>
#include <cstdint>
#include <span>

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

// What anyone may ask of the multimode controller. Plain data: it crosses threads by copying.
struct Request {
  enum class Kind : std::uint8_t { switch_controllets, set_parameter, set_feature, set_target, resume };

  Kind kind = Kind::switch_controllets;

  // switch_controllets: these run afterwards; whoever owned their arms stops. With `only`, nothing else goes
  // on. Arms that end up without an owner are held.
  InstanceSet activate = 0, deactivate = 0;
  bool only = false;

  InstanceIndex instance = kNoInstance;  // set_*
  std::uint16_t index = 0;               // parameter, feature or input of that instance
  bool on = false;                       // set_feature
  std::uint8_t size = 0;                 // set_parameter: numbers used
  std::array<double, kMaxParameterSize> values{};
  Target target;  // set_target
  ArmSet arms;    // resume

  std::uint16_t batch = 1;  // requests of one call: taken in the same cycle (the first one says how many)
};

// What became of a switch, as bits.
struct SwitchPlan {
  InstanceSet start = 0, stop = 0, keep = 0;
};

// The answer to a request, complete with the times of what happened.
struct Answer {
  Request::Kind kind = Request::Kind::switch_controllets;
  Verdict verdict = Verdict::pending;
  std::uint64_t ticket = 0;
  std::uint64_t cycle = 0;                 // that took it
  LoopTime t;                              // of that cycle
  HostTime received, taken, first_torque;  // asked; at the cycle boundary; after the first torque was written
  SwitchPlan plan;                         // of a switch
  // Switch: largest step of any joint at the hand-over, per arm [N m]: as computed, and as sent after the
  // rate limit.
  std::array<double, kMaxArms> step_wanted{}, step_sent{};

  bool accepted() const { return verdict == Verdict::accepted; }
};

}  // namespace multipanda
