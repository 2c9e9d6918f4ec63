#include "ros/adapter/state/arm_topics.hpp"

#include "logs/arm_state_fields.hpp"
#include "ros/adapter/adapter_part.hpp"
#include "ros/adapter/state/arm_models.hpp"
#include "ros/adapter/state/messages.hpp"

namespace multipanda::ros {

namespace {

constexpr std::size_t kFingers = 2;

}  // namespace

void fill_names(const std::vector<ArmModels::Arm>& arms, sensor_msgs::msg::JointState& out) {
  out.name.clear();
  for (const auto& arm : arms) {
    out.name.insert(out.name.end(), arm.joint_names.begin(), arm.joint_names.end());
    if (!arm.hand) continue;
    for (std::size_t finger = 1; finger <= kFingers; ++finger) {
      out.name.push_back(arm.prefix + "finger_joint" + std::to_string(finger));
    }
  }
  out.position.resize(out.name.size());
  out.velocity.resize(out.name.size());
  out.effort.resize(out.name.size());
}

void fill(const std::vector<ArmModels::Arm>& arms, const CycleRecord& record,
          sensor_msgs::msg::JointState& out) {
  std::size_t at = 0;
  for (std::size_t i = 0; i < arms.size(); ++i) {
    const ArmSample& sample = record.arms[i];
    for (std::size_t joint = 0; joint < arms[i].joint_count; ++joint, ++at) {
      out.position[at] = sample.q[joint];
      out.velocity[at] = sample.dq[joint];
      out.effort[at] = sample.tau_J[joint];
    }
    if (!arms[i].hand) continue;
    // Each finger moves by half of the width. A hand with fixed fingers is closed.
    for (std::size_t finger = 0; finger < kFingers; ++finger, ++at) {
      out.position[at] = sample.has_gripper ? 0.5 * sample.gripper_width : 0;
    }
  }
}

ArmTopics::ArmTopics(const AdapterContext& run)
    : run_(run),
      models_(run),
      joint_states_(*run.node, "joint_states", Qos::reliable(), run.options->rates_hz.joint_states,
                    period_of(run),
                    "Joints of all arms, each followed by its hand's fingers: position [rad, m], velocity, "
                    "measured torque with gravity [N m]."),
      transforms_(run, models_.arms()) {
  const RosSection::Rates& rates = run.options->rates_hz;
  const double period = period_of(run);
  Node& node = *run.node;
  fill_names(models_.arms(), joint_states_.message);
  for (std::size_t i = 0; i < models_.arms().size(); ++i) {
    const ArmModels::Arm& arm = models_.arms()[i];
    arms_.push_back(std::unique_ptr<PerArm>(
        new PerArm{{node, arm.name + "/robot_state", Qos::reliable(), rates.robot_state, period,
                    "The complete state of the arm."},
                   {node, arm.name + "/model", Qos::reliable(), rates.model, period,
                    "Rigid-body model at the measured state: M, C dq, g, Jacobian, poses."},
                   {node, arm.name + "/wrench", Qos::reliable(), rates.wrench, period,
                    "Estimated wrench that the arm exerts on its environment, about the origin of `<arm>_k`, "
                    "in the axes of `world` [N, N m]."}}));
    const auto head = [&](auto& message) {
      message.header.frame_id = kWorldFrame;
      message.arm = arm.name;
      message.joint_names = arm.joint_names;
    };
    head(arms_.back()->state.message);
    head(arms_.back()->model.message);
    arms_.back()->wrench.message.header.frame_id = kWorldFrame;
  }
  if (rates.tf == 0) return;
  description_.emplace(node, "robot_description", Qos::latched(),
                       Doc{"once", "One URDF with all arms on the link `world`."});
  std_msgs::msg::String urdf;
  urdf.data = scene_urdf(*run.scene);
  description_->publish(urdf);
}

void ArmTopics::take(const Event& event) { models_.take(event); }

void ArmTopics::take(const CycleRecord& record) {
  models_.take(record);
  const auto stamp = to_time(run_.stamps.of(record));
  if (joint_states_.due(record.cycle)) {
    joint_states_.message.header.stamp = stamp;
    fill(models_.arms(), record, joint_states_.message);
    joint_states_.publish();
  }
  const std::uint32_t stops = run_.modes->stops();
  const ArmSet stopped = run_.modes->stopped();
  for (std::size_t i = 0; i < arms_.size(); ++i) {
    PerArm& topics = *arms_[i];
    const ArmSample& sample = record.arms[i];
    if (topics.state.due(record.cycle)) {
      auto& message = topics.state.message;
      message.header.stamp = stamp;
      message.cycle = record.cycle;
      message.owner =
          sample.owner < run_.layout->instances.size() ? run_.layout->instances[sample.owner].name : "";
      message.stopped = stopped.contains(static_cast<ArmIndex>(i));
      message.stops = stops;
      const ArmModels::Arm& arm = models_.arms()[i];
      fill_state(sample, arm.frames, arm.tool, arm.load, models_.terms(i), message);
      set_commanded(message, sample, arm.joint_count);
      topics.state.publish();
    }
    if (topics.model.due(record.cycle)) {
      topics.model.message.header.stamp = stamp;
      topics.model.message.cycle = record.cycle;
      fill_model(models_.terms(i), topics.model.message);
      topics.model.publish();
    }
    if (sample.has_wrench_estimate && topics.wrench.due(record.cycle)) {
      topics.wrench.message.header.stamp = stamp;
      set_wrench(topics.wrench.message.wrench, sample.F_K_W_est);
      topics.wrench.publish();
    }
  }
  transforms_.take(record, stamp, models_);
}

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
