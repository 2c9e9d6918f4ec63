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

// An arm of a run, by its names in messages.
struct NamedArm {
  std::string name;
  std::shared_ptr<const ArmModel> model;
};

// Turns messages into set-points of one input. Needs no ROS graph.
//
// Frames: "" is the input's own frame. Inputs in the world frame also accept every arm's "<arm>_link0":
// poses are transformed, twists and wrenches are rotated into the world's axes. Quantities without a frame
// ignore the header's frame. Joints come in any order with names ("left_joint1"), or without names in the
// arm's order; joints of other arms in the same message are ignored.
class InputReader {
 public:
  // `arm`: index in `arms` of the input's arm.
  InputReader(const InputSpec& spec, std::vector<NamedArm> arms, std::size_t arm);

  // Fills values and size of the target. Returns nothing, or why the message cannot be read: unknown joints
  // and frames. The loop checks the numbers.
  using Refusal = std::optional<std::string>;
  Refusal read(const geometry_msgs::msg::PoseStamped& message, Target& target) const;
  Refusal read(const geometry_msgs::msg::TwistStamped& message, Target& target) const;
  Refusal read(const geometry_msgs::msg::WrenchStamped& message, Target& target) const;
  Refusal read(const sensor_msgs::msg::JointState& message, Target& target) const;
  Refusal read(const std_msgs::msg::Float64& message, Target& target) const;
  // Takes values in the order of Target, in a named frame, from a codec.
  Refusal read(const std::vector<double>& values, const std::string& frame, Target& target) const;

  std::vector<std::string> frames() const;  // all accepted names but ""
  const std::vector<std::string>& joints() const { return joints_; }

 private:
  Refusal take(std::initializer_list<double> values, const std::string& frame, Target& target) const;
  Refusal finish(const std::string& frame, Target& target) const;

  InputSpec spec_;
  std::vector<NamedArm> arms_;
  std::size_t arm_;
  std::vector<std::string> joints_;                                  // names of the joints of the input's arm
  std::vector<std::pair<std::string, std::optional<Pose>>> frames_;  // X_WB if it is not the input's own
};

// Calls f.operator()<M>() for the message M of a quantity.
template <class F>
auto with_message(Quantity quantity, F f) {
  switch (quantity) {
    case Quantity::pose:
      return f.template operator()<geometry_msgs::msg::PoseStamped>();
    case Quantity::twist:
      return f.template operator()<geometry_msgs::msg::TwistStamped>();
    case Quantity::wrench:
      return f.template operator()<geometry_msgs::msg::WrenchStamped>();
    case Quantity::joints:
      return f.template operator()<sensor_msgs::msg::JointState>();
    case Quantity::scalar:
      break;
  }
  return f.template operator()<std_msgs::msg::Float64>();
}
// "geometry_msgs/msg/PoseStamped"
std::string message_type(Quantity quantity);

}  // namespace multipanda::ros
