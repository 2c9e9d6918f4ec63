#pragma once

#include <string>

#include "core/model/arm_model.hpp"

namespace multipanda {

inline bool has_prismatic_joints(const ArmModel& model) {
  for (std::size_t i = 0; i < model.joint_count(); ++i) {
    if (model.is_prismatic(i)) return true;
  }
  return false;
}

// Why a prismatic joint would carry weight, as text with the remedy; empty: none does. Its load acts along
// the axis with its whole weight, so such a joint falls as soon as its force is missing, bounded, or computed
// for another payload, and this program closes no brake. An axis may be kLevel from level, in every pose that
// revolute joints before it can reach, and the weight along it may take kWeightShare of the joint's force and
// kMostWeight, with the tool and the heaviest payload that may be declared. `tau_max` (n x 1): what the
// commands are limited to, if that is less than the model's. Not for the loop.
inline constexpr double kLevel = 0.05;  // sine of the angle: 2.9 degrees
inline constexpr double kWeightShare = 0.25;
inline constexpr double kMostWeight = 60;  // [N], what may rest on a person: the default of ContactBounds
std::string weight_on_an_axis(const ArmModel& model, const JointVector& tau_max);

}  // namespace multipanda
