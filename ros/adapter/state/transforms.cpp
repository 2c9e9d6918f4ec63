#include "ros/adapter/state/transforms.hpp"

#include "ros/adapter/names.hpp"
#include "ros/adapter/state/messages.hpp"

namespace multipanda::ros {
namespace {

std::string link(const ArmModels::Arm& arm, std::size_t i) { return arm.prefix + "link" + std::to_string(i); }
// The link after the last moving joint: link8 of an arm with seven joints.
std::string flange(const ArmModels::Arm& arm) { return link(arm, arm.joint_count + 1); }

void set(const Placed& frame, const builtin_interfaces::msg::Time& stamp,
         geometry_msgs::msg::TransformStamped& out) {
  out.header.stamp = stamp;
  out.header.frame_id = frame.parent;
  out.child_frame_id = frame.child;
  set_transform(out.transform, frame.X);
}

}  // namespace

std::vector<Placed> fixed_frames(const ArmModels::Arm& arm, const Pose& X_WB) {
  std::vector<Placed> frames{{kWorldFrame, link(arm, 0), X_WB},
                             {link(arm, arm.joint_count), flange(arm), arm.robot.flange.pose()}};
  if (arm.hand && arm.robot.hand) {
    frames.push_back({flange(arm), arm.prefix + "hand", arm.robot.hand->mount.pose()});
    frames.push_back({arm.prefix + "hand", arm.prefix + "hand_tcp", arm.robot.hand->tcp.pose()});
  }
  return frames;
}

void moving_frames(const ArmModels::Arm& arm, const ArmSample& sample, ModelTerms& terms,
                   std::vector<Placed>& out) {
  std::size_t at = 0;
  // Names are set once; afterwards only poses change.
  const auto put = [&](auto parent, auto child, const Pose& X) {
    if (at == out.size()) out.push_back({parent(), child(), X});
    out[at++].X = X;
  };
  Pose X_WP = terms.model().X_WB();
  for (std::size_t i = 0; i < arm.joint_count; ++i) {
    const Pose X_WJ = terms.X_WJ(i);
    put([&] { return link(arm, i); }, [&] { return link(arm, i + 1); }, X_WP.inverse() * X_WJ);
    X_WP = X_WJ;
  }
  if (arm.hand && arm.robot.hand) {
    const Pose closed = arm.robot.hand->finger_mount.pose();
    const double open = sample.has_gripper ? 0.5 * sample.gripper_width : 0;
    const Pose X_HL = closed * Pose{Matrix3::Identity(), {0, open, 0}};
    const Pose half_turn{Vector3(-1, -1, 1).asDiagonal(), Vector3::Zero()};
    const auto hand = [&] { return arm.prefix + "hand"; };
    put(
        hand, [&] { return arm.prefix + "leftfinger"; }, X_HL);
    put(
        hand, [&] { return arm.prefix + "rightfinger"; }, half_turn * X_HL);
  }
  put([&] { return flange(arm); }, [&] { return arm.prefix + "ee"; }, arm.frames.X_FE);
  put([&] { return arm.prefix + "ee"; }, [&] { return arm.prefix + "k"; }, arm.frames.X_EK);
}

Transforms::Transforms(const AdapterContext& run, const std::vector<ArmModels::Arm>& arms)
    : moving_(*run.node, "/tf", Qos::reliable(100), run.options->rates_hz.tf, period_of(run),
              "Links of all arms from `<arm>_link0` on, fingers, and the configured frames: `<arm>_ee` (end "
              "effector) in the flange `<arm>_link8`, `<arm>_k` (stiffness) in `<arm>_ee`."),
      fixed_(*run.node, "/tf_static", Qos::latched(),
             Doc{"once", "Bases in `world`, the flange `<arm>_link8`, `<arm>_hand`, `<arm>_hand_tcp`."}),
      frames_(arms.size()) {
  tf2_msgs::msg::TFMessage message;
  for (std::size_t i = 0; i < arms.size(); ++i) {
    for (const auto& frame : fixed_frames(arms[i], run.models[i]->X_WB())) {
      set(frame, builtin_interfaces::msg::Time(), message.transforms.emplace_back());
    }
  }
  fixed_.publish(message);
}

void Transforms::take(const CycleRecord& record, const builtin_interfaces::msg::Time& stamp,
                      ArmModels& view) {
  // While time stands still (paused simulation), listeners would reject repeated transforms with a warning.
  if (stamp == stamp_ || !moving_.due(record.cycle)) return;
  stamp_ = stamp;
  std::size_t at = 0;
  auto& transforms = moving_.message.transforms;
  for (std::size_t i = 0; i < frames_.size(); ++i) {
    moving_frames(view.arms()[i], record.arms[i], view.terms(i), frames_[i]);
    for (const auto& frame : frames_[i]) {
      if (at == transforms.size()) transforms.emplace_back();
      set(frame, stamp, transforms[at++]);
    }
  }
  moving_.publish();
}

}  // namespace multipanda::ros
