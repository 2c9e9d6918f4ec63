#include "ros/adapter/state/arm_topics.hpp"

#include "backends/arm/arm_error.hpp"
#include "ros/adapter/names.hpp"
#include "ros/adapter/state/messages.hpp"
#include "ros/adapter/state/scene_description.hpp"

namespace multipanda::ros {
namespace {

constexpr std::size_t kFingers = 2;

void set_load(multipanda_msgs::msg::ArmLoad& out, const Load& load) {
  out.mass = load.mass;
  set_vector(out.centre, load.p_FC);
  const Matrix3& I = load.inertia_C;
  out.inertia = {I(0, 0), I(0, 1), I(0, 2), I(1, 1), I(1, 2), I(2, 2)};
}

void set_errors(std::uint64_t errors, std::vector<std::string>& names) {
  names.clear();
  for (std::size_t i = 0; errors != 0 && i < kArmErrorCount; ++i) {
    if ((errors >> i & 1u) != 0) names.emplace_back(to_string(static_cast<ArmError>(i)));
  }
}

}  // namespace

void fill_names(const std::vector<ArmsView::Arm>& arms, sensor_msgs::msg::JointState& out) {
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

void fill(const std::vector<ArmsView::Arm>& arms, const CycleRecord& record,
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
    // Both fingers open by half of the width; a hand whose fingers do not move is closed.
    for (std::size_t finger = 0; finger < kFingers; ++finger, ++at) {
      out.position[at] = sample.has_gripper ? 0.5 * sample.gripper_width : 0;
    }
  }
}

void fill(const ArmsView::Arm& arm, const ArmSample& sample, ModelTerms& terms,
          multipanda_msgs::msg::RobotState& out) {
  const std::size_t n = arm.joint_count;
  out.mode = sample.mode;
  if (out.errors != sample.errors) set_errors(sample.errors, out.error_names);
  out.errors = sample.errors;
  out.sequence = sample.sequence;
  out.robot_time_ns = sample.t_robot_ns;
  out.age = sample.age_s;
  out.command_success_rate = sample.command_success_rate;
  out.interventions = sample.interventions;

  set_joints(out.q, sample.q, n);
  set_joints(out.dq, sample.dq, n);
  set_joints(out.tau_j, sample.tau_J, n);
  set_joints(out.tau_j_d, sample.tau_J_d, n);
  set_joints(out.tau_ext, sample.tau_ext, sample.has_tau_ext ? n : 0);
  out.due = sample.due;
  set_joints(out.tau_controllet, sample.tau_controllet, n);
  set_joints(out.tau_feature, sample.tau_feature, n);
  set_joints(out.tau_cmd, sample.tau_cmd, n);

  set_pose(out.pose, terms.X_WE());
  set_vector(out.twist.linear, Vector3(terms.V_WE().linear()));
  set_vector(out.twist.angular, Vector3(terms.V_WE().angular()));
  out.has_wrench = sample.has_wrench_estimate;
  set_wrench(out.wrench, sample.F_K_W_est);
  out.has_contact = sample.has_contact_truth;
  set_wrench(out.contact, sample.F_K_W_true);

  out.config_version = sample.config_version;
  set_pose(out.end_effector, arm.frames.X_FE);
  set_pose(out.stiffness, arm.frames.X_EK);
  set_load(out.tool, arm.tool);
  set_load(out.load, arm.load);

  out.has_gripper = sample.has_gripper;
  out.gripper_width = sample.gripper_width;
  out.gripper_max_width = sample.gripper_max_width;
  out.gripper_grasped = sample.gripper_grasped;
  out.gripper_moving = sample.gripper_moving;
}

void fill(const ArmsView::Arm&, ModelTerms& terms, multipanda_msgs::msg::RobotModel& out) {
  set_matrix(out.mass, terms.M());
  set_matrix(out.coriolis, terms.c());
  set_matrix(out.gravity, terms.g());
  set_matrix(out.jacobian, terms.J_V_WE());
  set_pose(out.flange, terms.X_WF());
  set_pose(out.pose, terms.X_WE());
  set_pose(out.stiffness, terms.X_WK());
  out.manipulability = terms.manipulability();
}

ArmTopics::ArmTopics(const AdapterWorld& world)
    : world_(world),
      view_(world),
      joint_states_(*world.node, "joint_states", Qos::reliable(), world.options->rates_hz.joint_states,
                    period_of(world),
                    "Joints of all arms, then of each the hand's fingers: position [rad, m], velocity, "
                    "measured torque with gravity [N m]."),
      transforms_(world, view_.arms()) {
  const RosSection::Rates& rates = world.options->rates_hz;
  const double period = period_of(world);
  Node& node = *world.node;
  fill_names(view_.arms(), joint_states_.message);
  for (std::size_t i = 0; i < view_.arms().size(); ++i) {
    const ArmsView::Arm& arm = view_.arms()[i];
    arms_.push_back(std::unique_ptr<PerArm>(new PerArm{
        {node, arm.name + "/robot_state", Qos::reliable(), rates.robot_state, period,
         "Everything that is known of the arm."},
        {node, arm.name + "/model", Qos::reliable(), rates.model, period,
         "Its rigid-body model at the measured state: M, C dq, g, Jacobian, poses."},
        {node, arm.name + "/wrench", Qos::reliable(), rates.wrench, period,
         "Estimated wrench that the arm exerts on its environment, about the origin of `<arm>_k`, in axes of "
         "`world` [N, N m]."}}));
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
                       Doc{"once", "One URDF of all arms on the link `world`."});
  std_msgs::msg::String urdf;
  urdf.data = scene_urdf(*world.scene);
  description_->publish(urdf);
}

void ArmTopics::take(const Event& event) { view_.take(event); }

void ArmTopics::take(const CycleRecord& record) {
  view_.take(record);
  const auto stamp = to_time(world_.stamps.of(record));
  if (joint_states_.due(record.cycle)) {
    joint_states_.message.header.stamp = stamp;
    fill(view_.arms(), record, joint_states_.message);
    joint_states_.publish();
  }
  const ArmSet stopped = world_.modes->stopped();
  for (std::size_t i = 0; i < arms_.size(); ++i) {
    PerArm& topics = *arms_[i];
    const ArmSample& sample = record.arms[i];
    if (topics.state.due(record.cycle)) {
      auto& message = topics.state.message;
      message.header.stamp = stamp;
      message.cycle = record.cycle;
      message.owner =
          sample.owner < world_.layout->instances.size() ? world_.layout->instances[sample.owner].name : "";
      message.stopped = stopped.contains(static_cast<ArmIndex>(i));
      fill(view_.arms()[i], sample, view_.terms(i), message);
      topics.state.publish();
    }
    if (topics.model.due(record.cycle)) {
      topics.model.message.header.stamp = stamp;
      topics.model.message.cycle = record.cycle;
      fill(view_.arms()[i], view_.terms(i), topics.model.message);
      topics.model.publish();
    }
    if (sample.has_wrench_estimate && topics.wrench.due(record.cycle)) {
      topics.wrench.message.header.stamp = stamp;
      set_wrench(topics.wrench.message.wrench, sample.F_K_W_est);
      topics.wrench.publish();
    }
  }
  transforms_.take(record, stamp, view_);
}

}  // namespace multipanda::ros
