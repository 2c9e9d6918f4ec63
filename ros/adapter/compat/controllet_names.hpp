#pragma once

#include <optional>
#include <span>
#include <string>

#include "core/modes/multimode_controller.hpp"

namespace multipanda::ros {

// The controllets of multipanda_ros2 and their counterparts here.
struct TheirControllet {
  enum class Goal { none, joints, joint_velocity, pose, common_pose, two_poses };
  enum class Parameters { none, joints, cartesian };
  const char* name;
  const char* type;  // type of our controllet; nullptr: none, see `instead`
  std::size_t arms = 1;
  Goal goal = Goal::none;
  Parameters parameters = Parameters::none;
  const char* instead = "";
};

std::span<const TheirControllet> their_controllets();

// The instance for a name and a resource ("left", "left&right") of multipanda_ros2: the first one in the
// scene of that type and with those arms. Instance names are also valid. Returns nothing and fills `refusal`
// if there is none.
std::optional<InstanceIndex> instance_of(const MultimodeController& modes, const std::string& name,
                                         const std::string& resource, std::string& refusal);

// The first instance of that type and these arms; kNoInstance: none.
InstanceIndex first_instance(const MultimodeController& modes, const TheirControllet& theirs,
                             const std::string& resource);
// "left&right"
std::string resource_of(const MultimodeController& modes, InstanceIndex instance);
// The name in multipanda_ros2 for an instance, of those with a goal if there are any; otherwise its own.
std::string their_name(const MultimodeController& modes, InstanceIndex instance);

}  // namespace multipanda::ros
