#include "ros/adapter/state/arm_messages.hpp"

#include "core/cycle/sample_state.hpp"
#include "device/arm_error.hpp"
#include "logs/arm_state_fields.hpp"
#include "ros/adapter/state/messages.hpp"

namespace multipanda::ros {
namespace {

void set_load(multipanda_msgs::msg::ArmLoad& out, const Load& load) {
  out.mass = load.mass;
  set_vector(out.center, load.p_FC);
  const Matrix3& I = load.inertia_C;
  out.inertia = {I(0, 0), I(0, 1), I(0, 2), I(1, 1), I(1, 2), I(2, 2)};
}

Pose pose_of(const std::array<double, 12>& values) {
  Pose X;
  X.position = Eigen::Map<const Vector3>(values.data());
  X.rotation = Eigen::Map<const Matrix3>(values.data() + 3);
  return X;
}

void set_flags(auto& out, unsigned bits) {
  for (std::size_t i = 0; i < out.size(); ++i) out[i] = (bits >> i & 1u) != 0;
}

void set_report(multipanda_msgs::msg::RobotState& out, const ArmSample& sample, const Pose& X_WB,
                std::size_t joint_count) {
  const std::size_t n = sample.has_report ? joint_count : 0;
  out.has_report = sample.has_report;
  set_joints(out.q_d, sample.q_d, n);
  set_joints(out.dq_d, sample.dq_d, n);
  set_joints(out.theta, sample.theta, n);
  out.joint_contact.resize(n);
  out.joint_collision.resize(n);
  set_flags(out.joint_contact, sample.joint_contact);
  set_flags(out.joint_collision, sample.joint_collision);
  set_flags(out.cartesian_contact, sample.cartesian_contact);
  set_flags(out.cartesian_collision, sample.cartesian_collision);
  out.elbow = sample.elbow;
  if (out.last_motion_errors != sample.last_motion_errors)
    out.last_motion_error_names = error_list(sample.last_motion_errors);
  out.last_motion_errors = sample.last_motion_errors;
  if (!sample.has_report) return;
  set_pose(out.pose_desired, X_WB * pose_of(sample.X_BE_d));
  set_pose(out.pose_commanded, X_WB * pose_of(sample.X_BE_c));
}

}  // namespace

void fill_state(const ArmSample& sample, const ArmFrames& frames, const Load& tool, const Load& load,
                ModelTerms& terms, multipanda_msgs::msg::RobotState& out) {
  if (out.errors != sample.errors) out.error_names = error_list(sample.errors);
  set_arm_state(out, sample, terms.joint_count());
  set_report(out, sample, terms.model().X_WB(), terms.joint_count());

  set_pose(out.pose, terms.X_WE());
  set_vector(out.twist.linear, Vector3(terms.V_WE().linear()));
  set_vector(out.twist.angular, Vector3(terms.V_WE().angular()));
  out.has_wrench = sample.has_wrench_estimate;
  set_wrench(out.wrench, sample.F_K_W_est);
  out.has_contact = sample.has_contact_truth;
  set_wrench(out.contact, sample.F_K_W_true);

  set_pose(out.end_effector, frames.X_FE);
  set_pose(out.stiffness, frames.X_EK);
  set_load(out.tool, tool);
  set_load(out.load, load);
}

void fill_state(const ArmState& state, ModelTerms& terms, multipanda_msgs::msg::RobotState& out) {
  ArmSample sample;
  set_state(sample, state);
  fill_state(sample, state.frames, state.tool, state.load, terms, out);
}

void fill_model(ModelTerms& terms, multipanda_msgs::msg::RobotModel& out) {
  set_matrix(out.mass, terms.M());
  set_matrix(out.coriolis, terms.c());
  set_matrix(out.gravity, terms.g());
  set_matrix(out.jacobian, terms.J_V_WE());
  set_pose(out.flange, terms.X_WF());
  set_pose(out.pose, terms.X_WE());
  set_pose(out.stiffness, terms.X_WK());
  out.manipulability = terms.manipulability();
}

}  // namespace multipanda::ros
