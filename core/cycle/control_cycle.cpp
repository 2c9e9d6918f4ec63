#include "core/cycle/control_cycle.hpp"

#include <algorithm>
#include <limits>
#include <stdexcept>

namespace multipanda {
namespace {

// Times the stages of one step.
class StageClock {
 public:
  explicit StageClock(StageTimes& times) : times_(times), start_(host_now()), last_(start_) {}
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

std::vector<std::shared_ptr<const ArmModel>> models_of(const CycleConfig& config) {
  std::vector<std::shared_ptr<const ArmModel>> models;
  for (const auto& arm : config.arms) models.push_back(arm.model);
  return models;
}

std::vector<SafetyLimits> limits_of(const CycleConfig& config) {
  std::vector<SafetyLimits> limits;
  for (const auto& arm : config.arms) limits.push_back(arm.safety);
  return limits;
}

std::vector<std::string> names_of(const CycleConfig& config) {
  std::vector<std::string> names;
  for (const auto& arm : config.arms) names.push_back(arm.name);
  return names;
}

void copy_joints(const JointVector& from, JointArray& to) {
  std::copy_n(from.data(), from.size(), to.begin());
}

}  // namespace

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
    if (state.fresh && !seen_.contains(arm)) {  // the rate limit begins at what the arm has in use
      seen_ |= ArmSet::of(arm);
      safety_.set_last_command(arm, state.tau_J_d);
    }
  }
}

void ControlCycle::write() {
  for (ArmIndex arm = 0; arm < data_.command.size(); ++arm) data_.command[arm].tau_cmd = data_.tau_cmd[arm];
  backend_.write(data_.tick.due, data_.command);
}

void ControlCycle::leave_record() {
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
  for (ArmIndex arm = 0; arm < data_.state.size(); ++arm) {
    const ArmState& state = data_.state[arm];
    ArmSample& sample = record->arms[arm];
    sample.sequence = state.sequence;
    sample.t_robot_ns = state.t_robot.ns;
    sample.age_s = state.age_s;
    sample.mode = static_cast<std::uint8_t>(state.mode);
    sample.errors = state.errors;
    sample.owner = modes_->owner(arm);
    sample.config_version = state.config_version;
    sample.interventions = safety_.counted(arm);
    sample.due = data_.tick.due.contains(arm);
    sample.has_tau_ext = state.tau_ext_hat.size() > 0;
    sample.has_wrench_estimate = state.has_wrench_estimate;
    sample.has_contact_truth = state.has_contact_truth;
    copy_joints(state.q, sample.q);
    copy_joints(state.dq, sample.dq);
    copy_joints(state.tau_J, sample.tau_J);
    copy_joints(state.tau_J_d, sample.tau_J_d);
    copy_joints(state.tau_ext_hat, sample.tau_ext);
    copy_joints(data_.tau_controllet[arm], sample.tau_controllet);
    copy_joints(data_.tau_feature[arm], sample.tau_feature);
    copy_joints(data_.tau_cmd[arm], sample.tau_cmd);
    std::copy_n(state.F_K_W_est.vector.data(), 6, sample.F_K_W_est.begin());
    std::copy_n(state.F_K_W_true.vector.data(), 6, sample.F_K_W_true.begin());
  }
  modes_->leave_record(*record);
  record_->ring.push();
}

ControlCycle::ControlCycle(CycleConfig config, const Registry& registry, Backend& backend)
    : backend_(backend), data_(models_of(config)), safety_(limits_of(config)) {
  if (config.arms.empty() || config.arms.size() > kMaxArms) {
    throw std::invalid_argument("1 to " + std::to_string(kMaxArms) + " arms are supported, not " +
                                std::to_string(config.arms.size()));
  }
  if (config.arms.size() != backend.arm_count()) {
    throw std::invalid_argument("the backend has " + std::to_string(backend.arm_count()) + " arms, " +
                                std::to_string(config.arms.size()) + " are configured");
  }
  const ArmBlocks blocks{data_.state, data_.terms, data_.tau_controllet, data_.tau_feature};
  modes_ =
      std::make_unique<MultimodeController>(names_of(config), config.controllets, registry, blocks, safety_);
  layout_ = modes_->layout();
  if (config.record_capacity > 0) {
    record_ = std::make_unique<RecordRing>(layout_, config.record_capacity);
    modes_->record_to(record_.get());
  }
}

}  // namespace multipanda
