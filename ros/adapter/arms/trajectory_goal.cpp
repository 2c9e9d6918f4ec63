#include "ros/adapter/arms/trajectory_goal.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <span>

#include <fmt/format.h>
#include <fmt/ranges.h>

namespace multipanda::ros {
namespace {

using Action = control_msgs::action::FollowJointTrajectory;
using Result = Action::Result;

constexpr double kOldStamp = 1.0;  // [s]

[[noreturn]] void refuse(int code, const std::string& why) { throw TrajectoryRefused(code, why); }

double to_seconds(const builtin_interfaces::msg::Duration& duration) {
  return duration.sec + 1e-9 * duration.nanosec;
}

std::size_t index_of(const std::string& name, const std::vector<std::string>& joints) {
  const auto found = std::ranges::find(joints, name);
  if (found == joints.end())
    refuse(Result::INVALID_JOINTS,
           fmt::format("there is no joint '{}'; expected names of {}", name, fmt::join(joints, ", ")));
  return static_cast<std::size_t>(found - joints.begin());
}

// Reorders values of the goal's joints to the arm's joints; other joints get `rest`. Empty if no values
// are given.
JointVector spread(const std::vector<double>& values, const std::vector<std::size_t>& order, std::size_t n,
                   double rest, const char* what, std::size_t point) {
  if (values.empty()) return {};
  if (values.size() != order.size())
    refuse(Result::INVALID_GOAL, fmt::format("point {} has {} {} for {} joint names", point + 1,
                                             values.size(), what, order.size()));
  JointVector out = joint_constant(n, rest);
  for (std::size_t i = 0; i < order.size(); ++i) {
    if (!std::isfinite(values[i]))
      refuse(Result::INVALID_GOAL, fmt::format("point {} has {} that are not finite", point + 1, what));
    out[static_cast<Eigen::Index>(order[i])] = values[i];
  }
  return out;
}

void read_tolerances(const auto& tolerances, const std::vector<std::string>& joints, JointVector& position,
                     JointVector& velocity) {
  for (const auto& each : tolerances) {
    const auto j = static_cast<Eigen::Index>(index_of(each.name, joints));
    for (const double value : {each.position, each.velocity}) {
      if (std::isnan(value))
        refuse(Result::INVALID_GOAL, fmt::format("the tolerance of '{}' is not finite", each.name));
    }
    if (position.size() == 0) position = velocity = joint_constant(joints.size(), 0);
    position[j] = std::max(0.0, each.position);  // 0: the default, meaning no tolerance; -1: none
    velocity[j] = std::max(0.0, each.velocity);
  }
}

}  // namespace

TrajectoryGoal read_trajectory(const Action::Goal& goal, const std::vector<std::string>& joints,
                               std::int64_t now_ns) {
  const auto& trajectory = goal.trajectory;
  const std::size_t n = joints.size();
  if (!goal.multi_dof_trajectory.points.empty())
    refuse(Result::INVALID_GOAL,
           "trajectories of frames (multi_dof_trajectory) are not supported; give a joint trajectory");
  if (trajectory.joint_names.empty())
    refuse(Result::INVALID_JOINTS,
           fmt::format("no joint is named; expected some of {}", fmt::join(joints, ", ")));
  if (trajectory.points.empty()) refuse(Result::INVALID_GOAL, "the trajectory has no point");
  std::vector<std::size_t> order;
  for (const auto& name : trajectory.joint_names) {
    order.push_back(index_of(name, joints));
    if (std::ranges::count(order, order.back()) > 1)
      refuse(Result::INVALID_JOINTS, fmt::format("'{}' is named twice", name));
  }

  TrajectoryGoal out;
  double last = -1;
  for (std::size_t i = 0; i < trajectory.points.size(); ++i) {
    const auto& point = trajectory.points[i];
    TrajectoryPoint& to = out.points.emplace_back();
    to.time_s = to_seconds(point.time_from_start);
    if (to.time_s < 0 || to.time_s <= last)
      refuse(Result::INVALID_GOAL,
             fmt::format("times must increase: point {} is at {:.4g} s, the previous one at {:.4g} s", i + 1,
                         to.time_s, last));
    last = to.time_s;
    if (point.positions.empty())
      refuse(Result::INVALID_GOAL,
             fmt::format("point {} has no positions; velocities alone are not supported", i + 1));
    to.position = spread(point.positions, order, n, std::numeric_limits<double>::quiet_NaN(), "positions", i);
    to.velocity = spread(point.velocities, order, n, 0, "velocities", i);
    to.acceleration = spread(point.accelerations, order, n, 0, "accelerations", i);
  }
  // The trajectory must end at rest, since nothing follows its last point.
  const TrajectoryPoint& end = out.points.back();
  if (end.velocity.size() > 0 && end.velocity.lpNorm<Eigen::Infinity>() > 1e-3)
    refuse(Result::INVALID_GOAL, "the last point's velocities must be 0");

  read_tolerances(goal.path_tolerance, joints, out.path_position, out.path_velocity);
  read_tolerances(goal.goal_tolerance, joints, out.goal_position, out.goal_velocity);
  const double goal_time = to_seconds(goal.goal_time_tolerance);
  if (goal_time < 0) refuse(Result::INVALID_GOAL, "goal_time_tolerance must not be negative");
  if (goal_time > 0) out.goal_time_s = goal_time;

  const std::int64_t stamp =
      std::int64_t{trajectory.header.stamp.sec} * 1'000'000'000 + trajectory.header.stamp.nanosec;
  if (stamp != 0) {
    const double ahead = 1e-9 * static_cast<double>(stamp - now_ns);
    if (ahead < -kOldStamp)
      refuse(Result::OLD_HEADER_TIMESTAMP,
             fmt::format("the trajectory should have started {:.4g} s ago; a stamp of 0 starts at once",
                         -ahead));
    out.delay_s = std::max(0.0, ahead);
  }
  return out;
}

}  // namespace multipanda::ros
