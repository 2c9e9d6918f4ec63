#pragma once

#include <multipanda_msgs/msg/robot_model.hpp>
#include <multipanda_msgs/msg/robot_state.hpp>

#include "core/model/model_terms.hpp"
#include "core/record/cycle_record.hpp"
#include "core/state/arm_state.hpp"

namespace multipanda::ros {

// Content of messages about one arm. Each function writes into a message that may have been used before, and
// reuses its memory.

// Sets the measured and reported state and the configuration of the arm. Leaves header, names, owner and
// commands unchanged.
void fill_state(const ArmSample& sample, const ArmFrames& frames, const Load& tool, const Load& load,
                ModelTerms& terms, multipanda_msgs::msg::RobotState& out);
void fill_state(const ArmState& state, ModelTerms& terms, multipanda_msgs::msg::RobotState& out);
// Sets everything except header and names.
void fill_model(ModelTerms& terms, multipanda_msgs::msg::RobotModel& out);

}  // namespace multipanda::ros
