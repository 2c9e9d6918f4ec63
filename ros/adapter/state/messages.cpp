#include "ros/adapter/state/messages.hpp"

#include "arm_interface/arm_error.hpp"
#include "core/cycle/sample_state.hpp"
#include "logs/arm_state_fields.hpp"

namespace multipanda::ros {
namespace {

void set_load(multipanda_msgs::msg::ArmLoad& out, const Load& load) {
  out.mass = load.mass;
  set_vector(out.center, load.p_FC);
  const Matrix3& I = load.inertia_C;
  out.inertia = {I(0, 0), I(0, 1), I(0, 2), I(1, 1), I(1, 2), I(2, 2)};
}

}  // namespace

void fill_state(const ArmSample& sample, const ArmFrames& frames, const Load& tool, const Load& load,
                ModelTerms& terms, multipanda_msgs::msg::RobotState& out) {
  if (out.errors != sample.errors) out.error_names = error_list(sample.errors);
  if (out.last_motion_errors != sample.last_motion_errors)
    out.last_motion_error_names = error_list(sample.last_motion_errors);
  set_measured(out, sample, terms.joint_count());

  set_pose(out.pose, terms.X_WE());
  if (sample.has_report) {
    const Pose& X_WB = terms.model().X_WB();
    set_pose(out.pose_desired, X_WB * pose_of(sample.X_BE_d));
    set_pose(out.pose_commanded, X_WB * pose_of(sample.X_BE_c));
  }
  set_vector(out.twist.linear, Vector3(terms.V_WE().linear()));
  set_vector(out.twist.angular, Vector3(terms.V_WE().angular()));
  out.has_wrench = sample.has_wrench_estimate;
  out.has_contact = sample.has_contact_truth;

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
