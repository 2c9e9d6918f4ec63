#pragma once

#include <multipanda_msgs/msg/robot_model.hpp>
#include <multipanda_msgs/msg/robot_state.hpp>

#include "core/model/model_terms.hpp"
#include "core/record/cycle_record.hpp"
#include "core/state/arm_state.hpp"

namespace multipanda::ros {

// Content of the messages about one arm. Each function writes into a message that may have been used before
// and keeps its memory.

// Sets what the arm measured and reported, and its configuration. Leaves header, names, owner and
// commands alone.
void fill_state(const ArmSample& sample, const ArmFrames& frames, const Load& tool, const Load& load,
                ModelTerms& terms, multipanda_msgs::msg::RobotState& out);
void fill_state(const ArmState& state, ModelTerms& terms, multipanda_msgs::msg::RobotState& out);
// Sets everything but header and names.
void fill_model(ModelTerms& terms, multipanda_msgs::msg::RobotModel& out);

}  // namespace multipanda::ros
