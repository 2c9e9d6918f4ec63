#pragma once

#include <geometry_msgs/msg/pose_stamped.hpp>
#include <geometry_msgs/msg/twist_stamped.hpp>
#include <geometry_msgs/msg/wrench_stamped.hpp>
#include <memory>
#include <optional>
#include <sensor_msgs/msg/joint_state.hpp>
#include <std_msgs/msg/float64.hpp>
#include <string>
#include <utility>
#include <vector>

#include "core/model/arm_model.hpp"
#include "core/reference/reference.hpp"

namespace multipanda::ros {

// The arms of a run, as far as messages name them.
struct NamedArm {
  std::string name;
  std::shared_ptr<const ArmModel> model;
};

// Turns messages into set-points of one input. Knows no ROS graph.
//
// Frames: "" is the input's own; "world" and every arm's "<arm>_link0" are taken where the input's own is
// the world: poses are moved, twists and wrenches turned into its axes. Quantities without a frame ignore
// the header's. Joints come in any order by name ("left_joint1"), or without names in the arm's order; those
// of other arms may be there as well.
class InputReader {
 public:
  // `size`: of the input (Reference::size). `arm`: of `arms`, which the input belongs to.
  InputReader(const InputSpec& spec, std::size_t size, std::vector<NamedArm> arms, std::size_t arm);

  // Fills values and size of the target. What came back: nothing, or why it was refused.
  using Refusal = std::optional<std::string>;
  Refusal read(const geometry_msgs::msg::PoseStamped& message, Target& target) const;
  Refusal read(const geometry_msgs::msg::TwistStamped& message, Target& target) const;
  Refusal read(const geometry_msgs::msg::WrenchStamped& message, Target& target) const;
  Refusal read(const sensor_msgs::msg::JointState& message, Target& target) const;
  Refusal read(const std_msgs::msg::Float64& message, Target& target) const;
  // Values in the order of Target, in a frame by name: what a codec delivers.
  Refusal read(const std::vector<double>& values, const std::string& frame, Target& target) const;

  std::vector<std::string> frames() const;  // every name it takes, without ""
  const std::vector<std::string>& joints() const { return joints_; }

 private:
  Refusal take(std::initializer_list<double> values, const std::string& frame, Target& target) const;
  Refusal finish(const std::string& frame, Target& target) const;

  InputSpec spec_;
  std::size_t size_;
  std::vector<NamedArm> arms_;
  std::size_t arm_;
  std::vector<std::string> joints_;                                  // of the input's arm
  std::vector<std::pair<std::string, std::optional<Pose>>> frames_;  // X_WB where it is not the input's own
};

// "geometry_msgs/msg/PoseStamped"
std::string message_type(Quantity quantity);

}  // namespace multipanda::ros
