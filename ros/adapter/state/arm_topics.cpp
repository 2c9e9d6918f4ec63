#include "ros/adapter/state/arm_topics.hpp"

#include "logs/arm_state_fields.hpp"
#include "ros/adapter/names.hpp"
#include "ros/adapter/state/arm_messages.hpp"
#include "ros/adapter/state/messages.hpp"
#include "ros/adapter/state/scene_description.hpp"

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

}  // namespace multipanda::ros
