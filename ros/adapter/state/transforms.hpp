#pragma once

#include <builtin_interfaces/msg/time.hpp>
#include <string>
#include <tf2_msgs/msg/tf_message.hpp>
#include <utility>
#include <vector>

#include "ros/adapter/state/arm_models.hpp"
#include "ros/adapter/state/topic.hpp"

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

}  // namespace multipanda::ros
