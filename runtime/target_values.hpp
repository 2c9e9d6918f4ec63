#pragma once

#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "core/model/arm_model.hpp"
#include "core/modes/multimode_controller.hpp"
#include "core/reference/target.hpp"

// Checks and transformations of set-points before they are posted, for socket and ROS.
namespace multipanda {

// From a base frame to the world: poses are transformed, twists and wrenches rotated.
void to_world(Quantity quantity, const Pose& X_WB, std::span<double> values);

// The first joint whose value is outside its limits; none if all are inside.
std::optional<std::size_t> joint_beyond_limit(const ArmModel& model, std::span<const double> q);

// Why the end effector cannot come to this place in the world, whatever the joints do; empty: it may. The
// bound is the length of the stretched arm: the distances from the first joint to the second, and so on to
// the end effector, which turning joints do not change. Off the loop: builds the model's data.
std::string beyond_reach(const std::shared_ptr<const ArmModel>& model, const Pose& X_FE, const Vector3& p_WE);

// The same for the poses of a timeline. Throws std::invalid_argument with the time of the event. `X_FE` has
// one element per arm.
void check_reach(const std::vector<ScheduledRequest>& timeline, const MultimodeController& modes,
                 const std::vector<std::shared_ptr<const ArmModel>>& models, const std::vector<Pose>& X_FE);

// Whether an input is the pose of one arm's end effector in the world.
bool is_end_effector_pose(const Instance& instance, const InputSpec& input);

}  // namespace multipanda
