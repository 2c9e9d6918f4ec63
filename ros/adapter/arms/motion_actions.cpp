#include "ros/adapter/arms/motion_actions.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <limits>
#include <span>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "ros/adapter/adapter_part.hpp"
#include "ros/adapter/arms/arm_requests.hpp"
#include "ros/adapter/arms/arm_services.hpp"
#include "ros/adapter/state/messages.hpp"

namespace multipanda::ros {

namespace {

// Waiting time for records from after the goal's arrival; a paused simulation produces none.
constexpr auto kReadyWithin = std::chrono::milliseconds(500);

using FollowResult = control_msgs::action::FollowJointTrajectory::Result;

int code_of(MotionResult end) {
  switch (end) {
    case MotionResult::reached:
      return FollowResult::SUCCESSFUL;
    case MotionResult::path_tolerance:
    case MotionResult::lost:
      return FollowResult::PATH_TOLERANCE_VIOLATED;
    case MotionResult::goal_tolerance:
      return FollowResult::GOAL_TOLERANCE_VIOLATED;
    default:
      return FollowResult::INVALID_GOAL;
  }
}

void set_result(FollowResult& result, bool /*success*/, int code, const std::string& why) {
  result.error_code = code;
  result.error_string = why;
}

void set_result(auto& result, bool success, int /*code*/, const std::string& why) {
  result.success = success;
  result.error = why;
}

std::vector<double> select(const JointVector& values, const std::vector<std::size_t>& order) {
  std::vector<double> out;
  for (const std::size_t j : order) out.push_back(values[static_cast<Eigen::Index>(j)]);
  return out;
}

}  // namespace

// A running goal of one action.
template <class A>
class MotionActions::Running : public MotionListener {
 public:
  using Goal = typename ActionServer<A>::GoalPtr;
  Running(const MotionActions& actions, Goal goal_) : goal(std::move(goal_)), actions_(actions) {
    if constexpr (std::is_same_v<A, Follow>) {
      for (const auto& name : goal->message().trajectory.joint_names) {
        const auto found = std::ranges::find(actions.joints_, name);
        if (found != actions.joints_.end())
          order_.push_back(static_cast<std::size_t>(found - actions.joints_.begin()));
      }
    }
  }

  void progress(const MotionProgress& now) override {
    typename A::Feedback feedback;
    if constexpr (std::is_same_v<A, Follow>) {
      feedback.header.stamp = to_time(actions_.now_ns_.load(std::memory_order_relaxed));
      feedback.joint_names = goal->message().trajectory.joint_names;
      feedback.desired.positions = select(now.desired.position, order_);
      feedback.desired.velocities = select(now.desired.velocity, order_);
      feedback.desired.accelerations = select(now.desired.acceleration, order_);
      feedback.actual.positions = select(now.q, order_);
      feedback.actual.velocities = select(now.dq, order_);
      feedback.error.positions = select(now.desired.position - now.q, order_);
      feedback.error.velocities = select(now.desired.velocity - now.dq, order_);
      const auto at = std::chrono::nanoseconds(LoopTime::from_seconds(now.time_s).ns);
      for (auto* point : {&feedback.desired, &feedback.actual, &feedback.error}) {
        point->time_from_start.sec = static_cast<std::int32_t>(at.count() / 1'000'000'000);
        point->time_from_start.nanosec = static_cast<std::uint32_t>(at.count() % 1'000'000'000);
      }
    } else {
      feedback.progress = now.duration_s > 0 ? now.time_s / now.duration_s : 1;
      feedback.time_left = now.duration_s - now.time_s;
    }
    goal->feedback(feedback);
  }

  void over(MotionResult end, const std::string& why) override {
    typename A::Result result;
    set_result(result, end == MotionResult::reached, code_of(end), why);
    actions_.run_.count_request(true);
    if (end == MotionResult::reached) return goal->succeed(result);
    if (end == MotionResult::canceled) return goal->canceled(result);
    goal->abort(result);
  }

  void refuse(int code, const std::string& why) {
    typename A::Result result;
    set_result(result, false, code, why);
    actions_.run_.count_request(false);
    goal->abort(result);
  }

  const Goal goal;
  bool started = false;  // executor's thread

 private:
  const MotionActions& actions_;
  std::vector<std::size_t> order_;  // indices of the goal's joints in the arm
};

template <class A>
std::unique_ptr<ActionServer<A>> MotionActions::offer(
    const std::string& name, const std::string& doc, Quantity quantity,
    std::function<void(const typename A::Goal&, std::shared_ptr<MotionListener>)> begin) {
  using Goal = typename ActionServer<A>::GoalPtr;
  // A cancel request concerns the newest goal only: older goals have ended.
  auto newest = std::make_shared<std::weak_ptr<Running<A>>>();
  typename ActionServer<A>::Callbacks callbacks;
  callbacks.on_goal = [this](const typename A::Goal&) {
    std::string why = run_.executor->late(kRequestPatience);
    return why.empty() ? GoalDecision::accept() : GoalDecision::reject(std::move(why));
  };
  callbacks.on_accepted = [this, quantity, begin, newest](Goal goal) {
    auto running = std::make_shared<Running<A>>(*this, std::move(goal));
    *newest = running;
    const auto until = std::chrono::steady_clock::now() + kReadyWithin;
    const auto try_it = [this, running, quantity, begin, until, since = host_now()] {
      if (!running->goal->active()) return true;  // canceled in the meantime
      if (!motion_.ready(quantity, since) && std::chrono::steady_clock::now() < until) return false;
      try {
        begin(running->goal->message(), running);
        running->started = true;
      } catch (const TrajectoryRefused& refused) {
        running->refuse(refused.code, refused.what());
      } catch (const MotionRefused& refused) {
        running->refuse(FollowResult::INVALID_GOAL, refused.what());
      }
      return true;
    };
    if (!try_it()) run_.executor->poll_until(try_it);
  };
  callbacks.on_cancel = [this, newest](const Goal& goal) {
    const auto running = newest->lock();
    if (!running || running->goal != goal) return false;
    if (running->started) return motion_.cancel(*running);
    running->over(MotionResult::canceled, "canceled before it started");
    return true;
  };
  return std::make_unique<ActionServer<A>>(*run_.executor, *run_.node, name, Doc{"", doc},
                                           std::move(callbacks));
}

MotionActions::MotionActions(const AdapterContext& run, ArmIndex arm)
    : run_(run),
      arm_(arm),
      joints_(joint_names(run.modes->arm_name(arm), run.models[arm]->joint_count())),
      motion_(run, arm) {
  const std::string& name = run.modes->arm_name(arm);
  via_joints_ = offer<Joints>(
      name + "/joint_via_motion",
      "Moves through joint positions without stopping, from rest to rest, by the active controllet that "
      "takes joint positions.",
      Quantity::joints, [this](const Joints::Goal& goal, std::shared_ptr<MotionListener> listener) {
        std::vector<JointVector> via;
        for (const auto& each : goal.via_poses) {
          if (each.positions.size() > kMaxJoints)
            throw MotionRefused(
                fmt::format("a point has {} positions for {} joints", each.positions.size(), joints_.size()));
          via.emplace_back(Eigen::Map<const Eigen::VectorXd>(
              each.positions.data(), static_cast<Eigen::Index>(each.positions.size())));
        }
        motion_.through_joints(via, goal.velocity_scale, std::move(listener));
      });
  via_poses_ =
      offer<Poses>(name + "/cartesian_via_motion",
                   "Moves through poses of the end effector without stopping, from rest to rest, by the "
                   "active controllet that takes a pose.",
                   Quantity::pose, [this](const Poses::Goal& goal, std::shared_ptr<MotionListener> listener) {
                     motion_.through_poses(read_poses(goal), goal.velocity_scale, std::move(listener));
                   });
  // On a ros2_control node a trajectory controller may use that name.
  const std::string below = run_.options->parameter_services ? "" : "~/";
  follow_ = offer<Follow>(
      below + name + "_arm_controller/follow_joint_trajectory",
      "Follows a joint trajectory, for example of MoveIt: all or some joints in any order; cubic or quintic "
      "pieces, according to the given velocities and accelerations; by the active controllet that takes "
      "joint positions.",
      Quantity::joints, [this](const Follow::Goal& goal, std::shared_ptr<MotionListener> listener) {
        motion_.follow(read_trajectory(goal, joints_, now_ns_.load(std::memory_order_relaxed)),
                       std::move(listener));
      });
}

std::vector<ViaPose> MotionActions::read_poses(const Poses::Goal& goal) const {
  Pose X_WR;  // frame of the poses
  if (goal.frame_id == base_frame(run_.modes->arm_name(arm_))) {
    X_WR = run_.models[arm_]->X_WB();
  } else if (!goal.frame_id.empty() && goal.frame_id != kWorldFrame) {
    throw MotionRefused(fmt::format("unknown frame '{}'; expected '{}' or '{}'", goal.frame_id, kWorldFrame,
                                    base_frame(run_.modes->arm_name(arm_))));
  }
  std::vector<ViaPose> out;
  for (std::size_t i = 0; i < goal.via_poses.size(); ++i) {
    auto pose = goal.via_poses[i];
    auto& q = pose.orientation;
    const bool keeps = q.w == 0 && q.x == 0 && q.y == 0 && q.z == 0;
    if (keeps) q.w = 1;
    try {
      const Pose X_WE = X_WR * read_pose(pose, fmt::format("pose {}", i + 1));
      out.push_back({X_WE.position, keeps ? std::optional<Matrix3>() : X_WE.rotation});
    } catch (const std::invalid_argument& error) {
      throw MotionRefused(error.what());
    }
  }
  return out;
}

void MotionActions::take(const CycleRecord& record) {
  now_ns_.store(run_.stamps.of(record), std::memory_order_relaxed);
  motion_.take(record);
}

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
