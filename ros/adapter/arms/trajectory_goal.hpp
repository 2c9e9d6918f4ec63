#pragma once

#include <control_msgs/action/follow_joint_trajectory.hpp>
#include <cstdint>
#include <string>
#include <vector>

#include "runtime/motion/arm_motion.hpp"

namespace multipanda::ros {

// A trajectory that cannot be followed; `code` as in FollowJointTrajectory's result.
struct TrajectoryRefused : MotionRefused {
  TrajectoryRefused(int code_, const std::string& why) : MotionRefused(why), code(code_) {}
  int code;
};

// Reads a goal for an arm whose joints have these names, in any order, all or some of them. `now_ns`: on the
// clock of the header's stamp. A stamp of 0 starts at once, a later one at that time; one that is more than a
// second old is refused. Throws TrajectoryRefused.
TrajectoryGoal read_trajectory(const control_msgs::action::FollowJointTrajectory::Goal& goal,
                               const std::vector<std::string>& joints, std::int64_t now_ns);

}  // namespace multipanda::ros
