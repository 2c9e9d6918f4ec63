#include "benchmarks/smooth_motion.hpp"

#include <cmath>
#include <numbers>

namespace multipanda::bench {

SmoothMotion::SmoothMotion(const std::vector<std::shared_ptr<const ArmModel>>& models,
                           const std::vector<ArmConfig>& configs, Pace pace)
    : pace_(pace) {
  for (std::size_t i = 0; i < models.size(); ++i) {
    arms_.push_back({models[i]->q_home(), joint_constant(models[i]->joint_count(), 0), configs[i]});
  }
  constexpr double kOmega = 2 * std::numbers::pi / (1e-3 * kPeriods);
  for (std::size_t k = 0; k < kPeriods; ++k) {
    for (std::size_t j = 0; j < kMaxJoints; ++j) {
      const double phase = kOmega * 1e-3 * static_cast<double>(k) + static_cast<double>(j);
      swing_[k].q[j] = kAmplitude * std::sin(phase);
      swing_[k].dq[j] = kAmplitude * kOmega * std::cos(phase);
    }
  }
}

ArmSet SmoothMotion::wait() {
  if (pace_ == Pace::realtime) pacer_.wait();
  ++step_;
  now_ = {static_cast<std::int64_t>(step_) * 1'000'000};
  return ArmSet::all(arms_.size());
}

void SmoothMotion::read(ArmSet due, std::span<ArmState> states) {
  for (ArmIndex i = 0; i < arms_.size(); ++i) {
    if (!due.contains(i)) continue;
    const Arm& arm = arms_[i];
    const Offset& offset = swing_[(step_ + 37 * i) % kPeriods];
    ArmState& state = states[i];
    if (state.sequence == 0) {
      state.mode = ArmMode::move;
      state.config_version = 1;
      state.frames = arm.config.frames;
      state.tool = arm.config.tool;
      state.load = arm.config.load;
    }
    state.sequence = step_;
    state.t_robot = {now_.ns};
    const Eigen::Index n = arm.q_home.size();
    state.q = arm.q_home + Eigen::Map<const Eigen::VectorXd>(offset.q.data(), n);
    state.dq = Eigen::Map<const Eigen::VectorXd>(offset.dq.data(), n);
    state.tau_J = state.tau_J_d = arm.tau;
  }
}

void SmoothMotion::write(ArmSet due, std::span<const ArmCommand> commands) {
  for (ArmIndex i = 0; i < arms_.size(); ++i) {
    if (due.contains(i)) arms_[i].tau = commands[i].tau_cmd;
  }
}

std::future<RequestAnswer> SmoothMotion::request(ArmIndex, ArmRequest) {
  return refuse_request("this world only plays back a motion");
}

}  // namespace multipanda::bench
