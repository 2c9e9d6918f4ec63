#include "core/cycle/control_cycle.hpp"

#include "core/cycle/stage_clock.hpp"

namespace multipanda {

void ControlCycle::step(ArmSet due) noexcept {
  StageClock clock(data_.stages);

  read(due);                          // every arm's state; its model is computed on demand
  modes_->take_requests(data_.tick);  // switches, parameters, stops: at the boundary only
  modes_->inspect(data_.tick);        // arms that left their limits go to hold
  clock.lap(&StageTimes::read);

  modes_->run_controllets(data_.tick);  // torques of each arm's owner
  clock.lap(&StageTimes::controllets);

  modes_->run_features(data_.tick);  // what its features add
  clock.lap(&StageTimes::features);

  modes_->limit(data_.tick, data_.tau_cmd);  // safety has the last word
  clock.lap(&StageTimes::safety);

  write();
  clock.lap(&StageTimes::write);

  modes_->close(data_.tick);  // answers, now that the torque is out
  leave_record();
}

void ControlCycle::read(ArmSet due) {
  Tick& tick = data_.tick;
  const LoopTime before = tick.t;
  tick.start = host_now();
  tick.t = backend_.now();
  tick.dt = tick.cycle == 0 ? backend_.capabilities(0).period_s : seconds(tick.t - before);
  tick.due = due;
  ++tick.cycle;
  backend_.read(due, data_.state);
  for (ArmIndex arm = 0; arm < data_.state.size(); ++arm) {
    ArmState& state = data_.state[arm];
    state.fresh = due.contains(arm);
    // In lock-step a state is as old as the simulated time says: the world waited for us.
    state.age_s = state.fresh ? 0.0 : state.age_s + tick.dt;
    if (state.fresh) data_.terms[arm].update(state);
    if (state.fresh && observed_.contains(arm)) estimate_force(arm);
    if (state.fresh) begin_torque(arm);
  }
}

// The rate limit begins at what the arm has in use: at its first state, and when it takes commands again.
void ControlCycle::begin_torque(ArmIndex arm) {
  const ArmState& state = data_.state[arm];
  const bool takes_commands = state.mode == ArmMode::idle || state.mode == ArmMode::move;
  if (!takes_commands || !commanded_.contains(arm)) safety_.set_last_command(arm, state.tau_J_d);
  commanded_ = takes_commands ? commanded_ | ArmSet::of(arm) : commanded_ - ArmSet::of(arm);
}

// What the arm exerts on its environment, where its backend does not say it.
void ControlCycle::estimate_force(ArmIndex arm) {
  ModelTerms& terms = data_.terms[arm];
  observers_[arm].update({terms.momentum(), terms.momentum_drift(), terms.J_V_WK()}, data_.state[arm]);
}

void ControlCycle::write() {
  for (ArmIndex arm = 0; arm < data_.command.size(); ++arm) data_.command[arm].tau_cmd = data_.tau_cmd[arm];
  backend_.write(data_.tick.due, data_.command);
}

}  // namespace multipanda
