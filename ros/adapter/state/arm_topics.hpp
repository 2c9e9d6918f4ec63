#pragma once

#include <geometry_msgs/msg/wrench_stamped.hpp>
#include <memory>
#include <multipanda_msgs/msg/robot_model.hpp>
#include <multipanda_msgs/msg/robot_state.hpp>
#include <optional>
#include <sensor_msgs/msg/joint_state.hpp>
#include <std_msgs/msg/string.hpp>
#include <vector>

#include "ros/adapter/state/arm_models.hpp"
#include "ros/adapter/state/topic.hpp"
#include "ros/adapter/state/transforms.hpp"

namespace multipanda::ros {

// Fill joint_states: names once, values at every message.
void fill_names(const std::vector<ArmModels::Arm>& arms, sensor_msgs::msg::JointState& out);
void fill(const std::vector<ArmModels::Arm>& arms, const CycleRecord& record,
          sensor_msgs::msg::JointState& out);

// Publishes joint_states, <arm>/robot_state, <arm>/model, <arm>/wrench, tf and robot_description.
class ArmTopics : public AdapterPart {
 public:
  explicit ArmTopics(const AdapterContext& run);
  void take(const CycleRecord& record) override;
  void take(const Event& event) override;

 private:
  struct PerArm {
    Topic<multipanda_msgs::msg::RobotState> state;
    Topic<multipanda_msgs::msg::RobotModel> model;
    Topic<geometry_msgs::msg::WrenchStamped> wrench;
  };

  const AdapterContext& run_;
  ArmModels models_;
  Topic<sensor_msgs::msg::JointState> joint_states_;
  std::vector<std::unique_ptr<PerArm>> arms_;
  Transforms transforms_;
  std::optional<Publisher<std_msgs::msg::String>>
      description_;  // none if another node publishes the transforms
};

}  // namespace multipanda::ros
