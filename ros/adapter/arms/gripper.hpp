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

#include "ros/adapter/part.hpp"
#include "ros/adapter/state/topic.hpp"
#include "ros/rcl/rcl.hpp"

namespace multipanda::ros {

// What a GripperCommand asks for: with an effort above 0, closing is a grasp of whatever is met. Throws
// std::invalid_argument.
ArmRequest read_gripper_command(const control_msgs::action::GripperCommand::Goal& goal, double width,
                                double max_width);

// The gripper of one arm: actions under the names of the maker's packages. One motion at a time; a new goal,
// of whatever action, ends the one that runs. Cancelling stops the fingers.
class Gripper : public Part {
 public:
  Gripper(const AdapterWorld& world, ArmIndex arm);

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
  // The motion that runs, whichever action it is of.
  struct Running {
    std::function<void(const Width&)> feedback;
    bool preempted = false;
  };

  template <class A>
  std::unique_ptr<ActionServer<A>> offer(
      const std::string& name, const std::string& doc,
      std::function<ArmRequest(const typename A::Goal&)> read,
      std::function<void(typename A::Feedback&, const Width&)> fill,
      std::function<void(typename A::Result&, const typename A::Goal&, const Width&, const ArmAnswer&)>
          conclude);
  Width width() const;

  const AdapterWorld& world_;
  const ArmIndex arm_;
  const std::string prefix_;  // "left_gripper/"
  Topic<sensor_msgs::msg::JointState> joints_;
  Every feedback_due_;

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
