#include <algorithm>
#include <array>

#include "core/cycle/control_cycle.hpp"
#include "core/cycle/sample_state.hpp"

namespace multipanda {
namespace {

void copy_joints(const JointVector& from, JointArray& to) {
  std::copy_n(from.data(), from.size(), to.begin());
}

void copy_wrench(const Wrench& from, std::array<double, 6>& to) {
  std::copy_n(from.vector.data(), from.vector.size(), to.begin());
}

void copy_pose(const Pose& from, std::array<double, 12>& to) {
  std::copy_n(from.position.data(), 3, to.begin());
  std::copy_n(from.rotation.data(), 9, to.begin() + 3);
}

void set_report(ArmSample& sample, const InterfaceReport& report) {
  sample.has_report = report.present;
  copy_joints(report.q_d, sample.q_d);
  copy_joints(report.dq_d, sample.dq_d);
  copy_joints(report.theta, sample.theta);
  copy_pose(report.X_BE_d, sample.X_BE_d);
  copy_pose(report.X_BE_c, sample.X_BE_c);
  sample.elbow = report.elbow;
  sample.joint_contact = report.joint_contact;
  sample.joint_collision = report.joint_collision;
  sample.cartesian_contact = report.cartesian_contact;
  sample.cartesian_collision = report.cartesian_collision;
  sample.last_motion_errors = report.last_motion_errors;
}

}  // namespace

void set_state(ArmSample& sample, const ArmState& state) {
  sample.sequence = state.sequence;
  sample.t_robot_ns = state.t_robot.ns;
  sample.age_s = state.age_s;
  sample.mode = static_cast<std::uint8_t>(state.mode);
  sample.errors = state.errors;
  sample.config_version = state.config_version;
  sample.has_tau_ext = state.tau_ext_hat.size() > 0;
  sample.has_wrench_estimate = state.has_wrench_estimate;
  sample.has_contact_truth = state.has_contact_truth;
  sample.command_success_rate = state.command_success_rate;
  sample.has_gripper = state.gripper.present;
  sample.gripper_grasped = state.gripper.grasped;
  sample.gripper_moving = state.gripper.moving;
  sample.gripper_width = state.gripper.width;
  sample.gripper_max_width = state.gripper.max_width;
  copy_joints(state.q, sample.q);
  copy_joints(state.dq, sample.dq);
  copy_joints(state.tau_J, sample.tau_J);
  copy_joints(state.tau_J_d, sample.tau_J_d);
  copy_joints(state.tau_ext_hat, sample.tau_ext);
  copy_wrench(state.F_K_W_est, sample.F_K_W_est);
  copy_wrench(state.F_K_W_true, sample.F_K_W_true);
  set_report(sample, state.report);
}

void ControlCycle::take_sample(ArmIndex arm, ArmSample& sample) const {
  set_state(sample, data_.state[arm]);
  sample.owner = modes_->owner(arm);
  sample.interventions = safety_.counted(arm);
  sample.due = data_.tick.due.contains(arm);
  copy_joints(data_.tau_controllet[arm], sample.tau_controllet);
  copy_joints(data_.tau_feature[arm], sample.tau_feature);
  copy_joints(data_.tau_cmd[arm], sample.tau_cmd);
}

// Copies the step's measurements, decisions and commands into a slot of the ring. A full ring counts as a
// lost record.
void ControlCycle::record_cycle() {
  if (record_ == nullptr) return;
  CycleRecord* record = record_->ring.back();
  if (record == nullptr) {
    record_->dropped_records.fetch_add(1, std::memory_order_relaxed);
    return;
  }
  record->cycle = data_.tick.cycle;
  record->t = data_.tick.t;
  record->start = data_.tick.start;
  record->period_s = data_.tick.dt;
  record->overruns = backend_.overruns();
  record->stages = data_.stages;
  for (ArmIndex arm = 0; arm < data_.state.size(); ++arm) take_sample(arm, record->arms[arm]);
  modes_->record_cycle(*record);
  record_->ring.push();
}

}  // namespace multipanda
