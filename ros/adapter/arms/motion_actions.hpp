#pragma once

#include <atomic>
#include <control_msgs/action/follow_joint_trajectory.hpp>
#include <functional>
#include <map>
#include <memory>
#include <multipanda_msgs/action/cartesian_via_motion.hpp>
#include <multipanda_msgs/action/joint_via_motion.hpp>
#include <string>
#include <vector>

#include "ros/adapter/arms/arm_motion.hpp"
#include "ros/adapter/part.hpp"
#include "ros/rcl/rcl.hpp"

namespace multipanda::ros {

// The motions of one arm as actions. What is wrong with a goal is told in its result: a rejection has no
// words. A new goal, of whatever action, takes over from the one that runs; cancelling brakes to rest.
class MotionActions : public Part {
 public:
  MotionActions(const AdapterWorld& world, ArmIndex arm);

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

  const AdapterWorld& world_;
  const ArmIndex arm_;
  const std::vector<std::string> joints_;
  std::atomic<std::int64_t> now_ns_{0};  // of the stamps' clock
  ArmMotion motion_;                     // goes after the servers: its listeners keep their goals
  std::unique_ptr<ActionServer<Joints>> via_joints_;
  std::unique_ptr<ActionServer<Poses>> via_poses_;
  std::unique_ptr<ActionServer<Follow>> follow_;
};

}  // namespace multipanda::ros
