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

// Why a payload of `mass` kg is too heavy for a prismatic joint; empty: it is not. All that the joint carries
// acts along its axis with its whole weight, whatever the lever. The axis is that of the mounting; behind a
// revolute joint it counts as vertical, since it may be. The payload is in addition to the arm with its tool.
// Not for the loop.
std::string too_heavy_for_an_axis(const ArmModel& model, double mass);

}  // namespace multipanda
