#include "core/cycle/control_cycle.hpp"

#include <limits>

#include "core/cycle/stage_clock.hpp"

namespace multipanda {
namespace {

// A state without the joints of the model counts as not finite, and the safety stage holds the arm.
void check_size(ArmState& state, std::size_t joint_count) {
  const auto n = static_cast<Eigen::Index>(joint_count);
  if (state.q.size() == n && state.dq.size() == n) return;
  state.q = state.dq = JointVector::Constant(n, std::numeric_limits<double>::quiet_NaN());
}

}  // namespace

void ControlCycle::step(ArmSet due) noexcept {
  StageClock clock(data_.stages);

  read(due);                          // every arm's state; its model is computed on demand
  modes_->take_requests(data_.tick);  // switches, parameters, stops
  modes_->inspect(data_.tick);        // arms outside their limits are held
  clock.lap(&StageTimes::read);

  modes_->run_controllets(data_.tick);  // the torques of each arm's owner
  clock.lap(&StageTimes::controllets);

  modes_->run_features(data_.tick);  // the torques of its features
  clock.lap(&StageTimes::features);

  modes_->limit(data_.tick, data_.tau_cmd);  // last stage before the torques are sent
  clock.lap(&StageTimes::safety);

  write();
  clock.lap(&StageTimes::write);

  modes_->close(data_.tick);  // answers, after the torques are sent
  record_cycle();
}

void ControlCycle::read(ArmSet due) {
  Tick& tick = data_.tick;
  const LoopTime before = tick.t;
  tick.start = host_now();
  tick.t = backend_.now();
  tick.dt = tick.cycle == 0 ? backend_.period() : seconds(tick.t - before);
  tick.due = due;
  ++tick.cycle;
  backend_.read(due, data_.state);
  for (ArmIndex arm = 0; arm < data_.state.size(); ++arm) {
    ArmState& state = data_.state[arm];
    state.fresh = due.contains(arm);
    if (state.fresh) check_size(state, data_.terms[arm].joint_count());
    // In lock-step the age of a state is counted in simulated time.
    state.age_s = state.fresh ? 0.0 : state.age_s + tick.dt;
    if (state.fresh) data_.terms[arm].update(state);
    if (state.fresh && observed_.contains(arm)) estimate_force(arm);
    if (state.fresh) begin_torque(arm);
  }
}

// The rate limit starts at the torque that the arm has in use: at its first state, and when it
// takes commands again.
void ControlCycle::begin_torque(ArmIndex arm) {
  const ArmState& state = data_.state[arm];
  const bool accepts = takes_commands(state.mode);
  if (!accepts || !commanded_.contains(arm)) safety_.set_last_command(arm, state.tau_J_d);
  commanded_ = accepts ? commanded_ | ArmSet::of(arm) : commanded_ - ArmSet::of(arm);
}

// Estimates the external torques if the backend does not deliver them.
void ControlCycle::estimate_force(ArmIndex arm) {
  ModelTerms& terms = data_.terms[arm];
  observers_[arm].update({terms.momentum(), terms.momentum_drift(), terms.J_V_WK()}, data_.state[arm]);
}

void ControlCycle::write() {
  for (ArmIndex arm = 0; arm < data_.command.size(); ++arm) data_.command[arm].tau_cmd = data_.tau_cmd[arm];
  backend_.write(data_.tick.due, data_.command);
}

}  // namespace multipanda
