#pragma once

#include <control_msgs/action/gripper_command.hpp>
#include <functional>
#include <memory>
#include <multipanda_msgs/action/grasp.hpp>
#include <multipanda_msgs/action/homing.hpp>
#include <multipanda_msgs/action/move.hpp>
#include <mutex>
#include <sensor_msgs/msg/joint_state.hpp>
#include <std_srvs/srv/trigger.hpp>
#include <string>

#include "ros/adapter/adapter_part.hpp"
#include "ros/adapter/topic.hpp"
#include "ros/rcl/rcl.hpp"

namespace multipanda::ros {

// Converts a GripperCommand: with an effort above 0, closing is a grasp of any object. Throws
// std::invalid_argument.
GripperRequest read_gripper_command(const control_msgs::action::GripperCommand::Goal& goal, double width,
                                    double max_width);

// The gripper of one arm: actions with the names in Franka's packages. One motion at a time; a new goal of
// any action ends the running one. Canceling stops the fingers.
class Gripper : public AdapterPart {
 public:
  Gripper(const AdapterContext& run, ArmIndex arm);

  void take(const CycleRecord& record) override;

 private:
  using Homing = multipanda_msgs::action::Homing;
  using Move = multipanda_msgs::action::Move;
  using Grasp = multipanda_msgs::action::Grasp;
  using Command = control_msgs::action::GripperCommand;

  struct Width {
    double now = 0, max = 0;  // [m]
    bool grasped = false, moving = false;
  };
  // The running motion of any of the actions.
  struct Running {
    std::function<void(const Width&)> feedback;
    bool preempted = false;
  };

  template <class A>
  std::unique_ptr<ActionServer<A>> offer(
      const std::string& name, const std::string& doc,
      std::function<GripperRequest(const typename A::Goal&)> read,
      std::function<void(typename A::Feedback&, const Width&)> fill,
      std::function<void(typename A::Result&, const typename A::Goal&, const Width&, const RequestAnswer&)>
          conclude);
  Width width() const;

  const AdapterContext& run_;
  const ArmIndex arm_;
  const std::string prefix_;  // "left_gripper/"
  Topic<sensor_msgs::msg::JointState> joints_;
  RateDivider feedback_due_;

  mutable std::mutex mutex_;
  Width width_;                       // of the newest record
  std::shared_ptr<Running> running_;  // none: at rest

  std::unique_ptr<ActionServer<Homing>> homing_;
  std::unique_ptr<ActionServer<Move>> move_;
  std::unique_ptr<ActionServer<Grasp>> grasp_;
  std::unique_ptr<ActionServer<Command>> command_;
  Service<std_srvs::srv::Trigger> stop_;
};

}  // namespace multipanda::ros
