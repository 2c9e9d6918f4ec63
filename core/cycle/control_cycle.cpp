#include "core/cycle/control_cycle.hpp"

#include <limits>

namespace multipanda {
namespace {

// Times the stages of one step that began at `start`: from the tick's own time, so that they add up to no
// more than the step.
class StageClock {
 public:
  StageClock(StageTimes& times, HostTime start) : times_(times), start_(start), last_(start) {}
  void lap(std::int32_t StageTimes::*stage) {
    const HostTime now = host_now();
    times_.*stage = static_cast<std::int32_t>((now - last_).count());
    times_.total = static_cast<std::int32_t>((now - start_).count());
    last_ = now;
  }

 private:
  StageTimes& times_;
  HostTime start_, last_;
};

// A state without the joints of the model counts as not finite, and the safety stage holds the arm.
void check_size(ArmState& state, std::size_t joint_count) {
  const auto n = static_cast<Eigen::Index>(joint_count);
  if (state.q.size() == n && state.dq.size() == n) return;
  state.q = state.dq = JointVector::Constant(n, std::numeric_limits<double>::quiet_NaN());
}

}  // namespace

void ControlCycle::step(ArmSet due) noexcept {
  data_.tick.start = host_now();
  StageClock clock(data_.stages, data_.tick.start);

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
  tick.t = backend_.now();
  tick.dt = tick.cycle == 0 ? backend_.period() : seconds(tick.t - before);
  tick.period = backend_.period();
  tick.due = due;
  ++tick.cycle;
  backend_.read(due, data_.state);
  for (ArmIndex arm = 0; arm < data_.state.size(); ++arm) {
    ArmState& state = data_.state[arm];
    state.fresh = due.contains(arm);
    if (state.fresh) check_size(state, data_.terms[arm].joint_count());
    // In lock-step the age of a state is counted in simulated time.
    ArmCondition& condition = data_.condition[arm];
    condition.update(state, tick.dt, safety_.limits(arm).longest_gap_s());
    state.age_s = condition.age_s;
    if (state.fresh) data_.terms[arm].update(state);
  }
  place_bases();
  for (ArmIndex arm = 0; arm < data_.state.size(); ++arm) {
    if (!data_.state[arm].fresh) continue;
    if (observed_.contains(arm)) estimate_force(arm);
    if (sensed_[arm]) feel(arm);
    count_torque(arm);
  }
  read_obstacles();
}

// Arms that stand on another one are where it moved them. The observer of each counts the momentum of the
// other. A load that was declared, or a state that was missing, changes it without a force: both start again.
void ControlCycle::place_bases() {
  for (ArmIndex arm = 0; arm < mounts_.size(); ++arm) {
    if (!mounts_[arm]) continue;
    const ArmIndex carrier = mounts_[arm]->carrier;
    data_.terms[arm].stand_on(data_.terms[carrier], *mounts_[arm]);
    bool begins = false;
    for (const ArmIndex of : {arm, carrier}) {
      const ArmState& state = data_.state[of];
      begins = begins || state.config_version != seen_config_[of] || data_.condition[of].returned ||
               !state.q.allFinite() || !state.dq.allFinite();
      seen_config_[of] = state.config_version;
    }
    if (!begins) continue;
    observers_[arm].reset();
    observers_[carrier].reset();
  }
}

void ControlCycle::read_obstacles() {
  for (const std::size_t i : placed_) {
    Obstacle& obstacle = data_.obstacles[i];
    if (const auto X_WO = backend_.object_pose(obstacle.name)) obstacle.X_WO = *X_WO;
  }
}

// The rate limit counts from the torque that the arm has in use. Where every command arrives, that is the
// last one; a simulated motor may show it later. After a gap of the states, however long, the last command
// may only be late: it counts as well.
void ControlCycle::count_torque(ArmIndex arm) {
  const ArmCondition& condition = data_.condition[arm];
  if (!condition.usable || condition.began) {
    every_command_arrives_ = backend_.capabilities(arm).every_command_arrives
                                 ? every_command_arrives_ | ArmSet::of(arm)
                                 : every_command_arrives_ - ArmSet::of(arm);
    safety_.set_last_command(arm, condition.torque_in_use);
  } else if (!every_command_arrives_.contains(arm)) {
    safety_.observe(arm, condition.torque_in_use);
  }
}

// Estimates the external torques if the backend does not deliver them.
void ControlCycle::estimate_force(ArmIndex arm) {
  ModelTerms& terms = data_.terms[arm];
  observers_[arm].update({terms.momentum(), terms.momentum_drift(), terms.J_V_WK()}, data_.state[arm]);
}

// The sensor's wrench in place of an estimate.
void ControlCycle::feel(ArmIndex arm) {
  ModelTerms& terms = data_.terms[arm];
  ArmState& state = data_.state[arm];
  const SensedForce::Place place{
      .X_WF = terms.X_WF(), .p_WK = terms.X_WK().position, .J_V_WK = terms.J_V_WK()};
  data_.condition[arm].sensor =
      sensed_[arm]->update(*backend_.force_reading(arm), place, data_.tick.dt, state);
}

void ControlCycle::write() {
  for (ArmIndex arm = 0; arm < data_.command.size(); ++arm) {
    data_.command[arm].tau_cmd = data_.tau_cmd[arm];
    data_.command[arm].usable = data_.condition[arm].usable;
  }
  backend_.write(data_.tick.due, data_.command);
}

}  // namespace multipanda
