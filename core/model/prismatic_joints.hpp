#pragma once

#include "core/model/arm_model.hpp"

namespace multipanda {

inline bool has_prismatic_joints(const ArmModel& model) {
  for (std::size_t i = 0; i < model.joint_count(); ++i) {
    if (model.is_prismatic(i)) return true;
  }
  return false;
}

}  // namespace multipanda
