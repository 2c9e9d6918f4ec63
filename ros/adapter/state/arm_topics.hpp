#pragma once

#include <geometry_msgs/msg/wrench_stamped.hpp>
#include <memory>
#include <multipanda_msgs/msg/robot_model.hpp>
#include <multipanda_msgs/msg/robot_state.hpp>
#include <optional>
#include <sensor_msgs/msg/joint_state.hpp>
#include <std_msgs/msg/string.hpp>
#include <vector>

#include "ros/adapter/state/arms_view.hpp"
#include "ros/adapter/state/topic.hpp"
#include "ros/adapter/state/transforms.hpp"

namespace multipanda::ros {

// The messages' content, apart from how it is sent. Each writes into a message that was used before.
void fill_names(const std::vector<ArmsView::Arm>& arms, sensor_msgs::msg::JointState& out);
void fill(const std::vector<ArmsView::Arm>& arms, const CycleRecord& record,
          sensor_msgs::msg::JointState& out);
void fill(const ArmsView::Arm& arm, const ArmSample& sample, ModelTerms& terms,
          multipanda_msgs::msg::RobotState& out);
void fill(const ArmsView::Arm& arm, ModelTerms& terms, multipanda_msgs::msg::RobotModel& out);

// joint_states, <arm>/robot_state, <arm>/model, <arm>/wrench, tf, robot_description.
class ArmTopics : public Part {
 public:
  explicit ArmTopics(const AdapterWorld& world);
  void take(const CycleRecord& record) override;
  void take(const Event& event) override;

 private:
  struct PerArm {
    Topic<multipanda_msgs::msg::RobotState> state;
    Topic<multipanda_msgs::msg::RobotModel> model;
    Topic<geometry_msgs::msg::WrenchStamped> wrench;
  };

  const AdapterWorld& world_;
  ArmsView view_;
  Topic<sensor_msgs::msg::JointState> joint_states_;
  std::vector<std::unique_ptr<PerArm>> arms_;
  Transforms transforms_;
  std::optional<Publisher<std_msgs::msg::String>>
      description_;  // none where the transforms are somebody else's
};

}  // namespace multipanda::ros
