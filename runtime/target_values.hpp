#pragma once

#include <optional>
#include <span>

#include "core/model/arm_model.hpp"
#include "core/reference/target.hpp"

// What every way into a run does with the values of a set-point before it is posted.
namespace multipanda {

// From a base's frame into the world's axes: poses are moved, twists and wrenches turned.
void to_world(Quantity quantity, const Pose& X_WB, std::span<double> values);

// The first joint that the values would send beyond its limits; nothing: none does.
std::optional<std::size_t> joint_beyond_limit(const ArmModel& model, std::span<const double> q);

}  // namespace multipanda
