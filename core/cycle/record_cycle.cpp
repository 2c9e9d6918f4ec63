#include <algorithm>
#include <array>

#include "core/cycle/control_cycle.hpp"
#include "core/cycle/sample_state.hpp"

namespace multipanda {
namespace {

void copy(const JointVector& from, JointArray& to) { std::copy_n(from.data(), from.size(), to.begin()); }

void copy(const Wrench& from, WrenchArray& to) { std::copy_n(from.vector.data(), to.size(), to.begin()); }

void copy(const Pose& from, PoseArray& to) {
  std::copy_n(from.position.data(), 3, to.begin());
  std::copy_n(from.rotation.data(), 9, to.begin() + 3);
}

template <class T>
void copy(const T& from, T& to) {
  to = from;
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
  copy(state.q, sample.q);
  copy(state.dq, sample.dq);
  copy(state.tau_J, sample.tau_J);
  copy(state.tau_J_d, sample.tau_J_d);
  copy(state.tau_ext_hat, sample.tau_ext);
  copy(state.F_K_W_est, sample.F_K_W_est);
  copy(state.F_K_W_true, sample.F_K_W_true);
  sample.has_report = state.report.present;
#define MULTIPANDA_COPY(type, member, name, message, known, doc) copy(state.report.member, sample.member);
  MULTIPANDA_REPORTED_FIELDS(MULTIPANDA_COPY)
#undef MULTIPANDA_COPY
}

void ControlCycle::take_sample(ArmIndex arm, ArmSample& sample) const {
  set_state(sample, data_.state[arm]);
  sample.owner = modes_->owner(arm);
  sample.interventions = safety_.counted(arm);
  sample.due = data_.tick.due.contains(arm);
  copy(data_.tau_controllet[arm], sample.tau_controllet);
  copy(data_.tau_feature[arm], sample.tau_feature);
  copy(data_.tau_cmd[arm], sample.tau_cmd);
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
