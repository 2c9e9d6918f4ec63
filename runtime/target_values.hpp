#pragma once

#include <optional>
#include <span>

#include "core/model/arm_model.hpp"
#include "core/reference/target.hpp"

// Checks and transformations of set-points before they are posted, for socket and ROS.
namespace multipanda {

// From a base frame to the world: poses are transformed, twists and wrenches rotated.
void to_world(Quantity quantity, const Pose& X_WB, std::span<double> values);

// The first joint whose value is outside its limits; none if all are inside.
std::optional<std::size_t> joint_beyond_limit(const ArmModel& model, std::span<const double> q);

}  // namespace multipanda
