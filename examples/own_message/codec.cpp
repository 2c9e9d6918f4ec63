// Set-points in message types other than the default: a user's own, or here two of geometry_msgs. The codecs
// only read the messages; topics, frames, checks, counters and goals stay multipanda's.
//   cartesian_impedance's pose takes TransformStamped, as trackers send it, in place of PoseStamped;
//   every input that takes poses, of any law, also takes a plain Pose, on .../plain and .../plain/goal.
#include <geometry_msgs/msg/pose.hpp>
#include <geometry_msgs/msg/transform_stamped.hpp>

#include "core/plugin/plugin.hpp"
#include "ros/adapter/controllets/input_codec.hpp"

namespace {

using geometry_msgs::msg::TransformStamped;

void values_of(const TransformStamped& message, multipanda::ros::InputValues& values) {
  if (message.child_frame_id != "goal") {
    values.refusal =
        "the transform's child frame is '" + message.child_frame_id.substr(0, 60) + "', expected 'goal'";
    return;
  }
  const auto& p = message.transform.translation;
  const auto& q = message.transform.rotation;
  values.numbers = {p.x, p.y, p.z, q.w, q.x, q.y, q.z};  // in the order of Target
  values.frame = message.header.frame_id;
}

void values_of_plain(const geometry_msgs::msg::Pose& message, multipanda::ros::InputValues& values) {
  const auto& p = message.position;
  const auto& q = message.orientation;
  values.numbers = {p.x, p.y, p.z, q.w, q.x, q.y, q.z};  // in the frame of the input
}

}  // namespace

// A library in a scene's `plugins:` registers its controllets; this one has none.
MULTIPANDA_PLUGIN(registry) { (void)registry; }

MULTIPANDA_INPUT_CODECS(codecs) {
  codecs.push_back(multipanda::ros::input_codec<TransformStamped>("cartesian_impedance", "pose", values_of));
  codecs.push_back(multipanda::ros::input_codec_for<geometry_msgs::msg::Pose>(multipanda::Quantity::pose,
                                                                              "plain", values_of_plain));
}
