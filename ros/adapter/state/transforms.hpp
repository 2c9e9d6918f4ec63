#pragma once

#include <builtin_interfaces/msg/time.hpp>
#include <string>
#include <tf2_msgs/msg/tf_message.hpp>
#include <utility>
#include <vector>

#include "ros/adapter/state/arms_view.hpp"
#include "ros/adapter/state/topic.hpp"

namespace multipanda::ros {

// A frame in its parent, by name.
struct Placed {
  std::string parent, child;
  Pose X;
};

// What never moves: world -> link0, the last link -> flange -> hand -> hand_tcp.
std::vector<Placed> fixed_frames(const ArmsView::Arm& arm, const Pose& X_WB);
// What moves: links by their joints, fingers, and the frames that users set: flange -> ee -> k. Always the
// same frames in the same order; the names stay as they are once they were written.
void moving_frames(const ArmsView::Arm& arm, const ArmSample& sample, ModelTerms& terms,
                   std::vector<Placed>& out);

// /tf and /tf_static.
class Transforms {
 public:
  Transforms(const AdapterWorld& world, const std::vector<ArmsView::Arm>& arms);
  void take(const CycleRecord& record, const builtin_interfaces::msg::Time& stamp, ArmsView& view);

 private:
  Topic<tf2_msgs::msg::TFMessage> moving_;
  Publisher<tf2_msgs::msg::TFMessage> fixed_;
  std::vector<std::vector<Placed>> frames_;  // of each arm
  builtin_interfaces::msg::Time stamp_;      // of the newest message
};

}  // namespace multipanda::ros
