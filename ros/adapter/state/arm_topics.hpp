#pragma once

#include <builtin_interfaces/msg/time.hpp>
#include <geometry_msgs/msg/wrench_stamped.hpp>
#include <memory>
#include <multipanda_msgs/msg/robot_model.hpp>
#include <multipanda_msgs/msg/robot_state.hpp>
#include <optional>
#include <sensor_msgs/msg/joint_state.hpp>
#include <std_msgs/msg/string.hpp>
#include <string>
#include <tf2_msgs/msg/tf_message.hpp>
#include <utility>
#include <vector>

#include "ros/adapter/state/arm_models.hpp"
#include "ros/adapter/topic.hpp"

namespace multipanda::ros {

// A frame's pose in its parent, by name.
struct Placed {
  std::string parent, child;
  Pose X;
};

// Fixed frames: world -> link0, last link -> flange -> hand -> hand_tcp.
std::vector<Placed> fixed_frames(const ArmModels::Arm& arm, const Pose& X_WB);
// Moving frames: links, fingers, and configurable frames (flange -> ee -> k). Always the same frames in the
// same order; names are set once.
void moving_frames(const ArmModels::Arm& arm, const ArmSample& sample, ModelTerms& terms,
                   std::vector<Placed>& out);

// /tf and /tf_static.
class Transforms {
 public:
  Transforms(const AdapterContext& run, const std::vector<ArmModels::Arm>& arms);
  void take(const CycleRecord& record, const builtin_interfaces::msg::Time& stamp, ArmModels& view);

 private:
  Topic<tf2_msgs::msg::TFMessage> moving_;
  Publisher<tf2_msgs::msg::TFMessage> fixed_;
  std::vector<std::vector<Placed>> frames_;  // one list per arm
  builtin_interfaces::msg::Time stamp_;      // of the newest message
};

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
