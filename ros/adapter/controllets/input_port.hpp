#pragma once

#include <cstdint>
#include <geometry_msgs/msg/pose_stamped.hpp>
#include <geometry_msgs/msg/twist_stamped.hpp>
#include <geometry_msgs/msg/wrench_stamped.hpp>
#include <memory>
#include <mutex>
#include <optional>
#include <sensor_msgs/msg/joint_state.hpp>
#include <std_msgs/msg/float64.hpp>
#include <string>
#include <utility>
#include <vector>

#include "core/model/arm_model.hpp"
#include "core/reference/reference.hpp"
#include "ros/adapter/adapter_part.hpp"

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

// Receives the messages for one input, streams and goals: reads, posts and counts them. A refused message
// does not reach the loop, so a controllet whose stream consists of such messages is held by its timeout.
class InputPort {
 public:
  InputPort(const AdapterContext& run, InstanceIndex instance, std::size_t input);

  struct Counts {
    std::uint64_t received = 0, refused = 0;
    std::string last_reason;       // of the newest refusal; empty: none so far
    bool last_accepted = true;     // of the newest message
    bool last_not_active = false;  // refused only because the controllet is not active
  };

  // Runs in the executor's thread. `waited_s`: waiting time of the message before this thread took it.
  // `from`: the topic. While one topic streams, streams of others are refused, so that the arm is held when
  // an operator releases the dead-man switch. Returns whether the message was accepted.
  template <class M>
  bool receive(const M& message, Delivery delivery, double waited_s = 0, const void* from = nullptr) {
    Target target;
    target.delivery = delivery;
    InputReader::Refusal refusal = reader_.read(message, target);
    return conclude(std::move(refusal), target, waited_s, from);
  }
  bool receive(const std::vector<double>& values, const std::string& frame, Delivery delivery,
               double waited_s = 0, const void* from = nullptr);
  // Result of the checks before a stream's values are posted.
  struct Admission {
    Target target;
    std::string why;          // reason of a refusal; empty: accepted
    bool not_active = false;  // only because the controllet is not active
  };
  // All checks of receive(), without side effects: for messages with values for several inputs, which are
  // taken together or not at all.
  Admission admits(const std::vector<double>& values, const std::string& frame, double waited_s,
                   const void* from, HostTime now) const;
  // Posts values that admits() accepted. Until `until`, streams of other topics are refused; inputs of one
  // message share `until`, so that no other topic takes only one of them. Returns whether it was accepted.
  bool post(const Target& sample, const void* from, HostTime until);
  // For a message that cannot be read, or that is not for this controllet (`not_active`: warned about once).
  void refuse(const std::string& why, bool not_active = false);

  const std::string& name() const { return name_; }  // "pose0/pose"
  const InputSpec& spec() const { return reference_->spec(); }
  const InputReader& reader() const { return reader_; }
  Counts counts() const;  // any thread
  Diagnostic diagnostic() const;

 private:
  bool conclude(InputReader::Refusal refusal, const Target& target, double waited_s, const void* from);
  // Why it cannot be posted; empty: it can. Adds checks of the present state to those of the reader.
  std::string obstacle(const Target& target, double waited_s, const void* from, HostTime now,
                       bool& not_active) const;
  Request request_for(const Target& target) const;
  bool settle(Verdict verdict, const Request& request);
  void note(std::string reason, bool not_active);

  const AdapterContext& run_;
  InstanceIndex instance_;
  std::uint16_t input_;
  Reference* reference_;
  InputReader reader_;
  std::string name_;
  const void* streams_ = nullptr;  // the streaming topic, until that time
  HostTime streams_until_{};
  mutable std::mutex mutex_;
  Counts counts_;
};

}  // namespace multipanda::ros
