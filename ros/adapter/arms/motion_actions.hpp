#pragma once

#include <atomic>
#include <control_msgs/action/follow_joint_trajectory.hpp>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <multipanda_msgs/action/cartesian_via_motion.hpp>
#include <multipanda_msgs/action/joint_via_motion.hpp>
#include <string>
#include <vector>

#include "ros/adapter/adapter_part.hpp"
#include "ros/rcl/rcl.hpp"
#include "runtime/motion/arm_motion.hpp"

namespace multipanda::ros {

// The motions of one arm as actions. A goal is always accepted, since a rejection carries no text; its
// result has the reason of a failure. A new goal of any action takes over from the running one; canceling
// brakes to rest.
class MotionActions : public AdapterPart {
 public:
  MotionActions(const AdapterContext& run, ArmIndex arm);

  void take(const Event& event) override { motion_.take(event); }
  void take(const CycleRecord& record) override;

 private:
  using Joints = multipanda_msgs::action::JointViaMotion;
  using Poses = multipanda_msgs::action::CartesianViaMotion;
  using Follow = control_msgs::action::FollowJointTrajectory;
  template <class A>
  class Running;

  // `begin` may throw MotionRefused.
  template <class A>
  std::unique_ptr<ActionServer<A>> offer(
      const std::string& name, const std::string& doc, Quantity quantity,
      std::function<void(const typename A::Goal&, std::shared_ptr<MotionListener>)> begin);
  std::vector<ViaPose> read_poses(const Poses::Goal& goal) const;

  const AdapterContext& run_;
  const ArmIndex arm_;
  const std::vector<std::string> joints_;
  std::atomic<std::int64_t> now_ns_{0};  // on the clock of the stamps
  ArmMotion motion_;                     // destroyed after the servers, since its listeners keep their goals
  std::unique_ptr<ActionServer<Joints>> via_joints_;
  std::unique_ptr<ActionServer<Poses>> via_poses_;
  std::unique_ptr<ActionServer<Follow>> follow_;
};

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
