#include "free_arms.hpp"

#include <Eigen/Cholesky>

using namespace multipanda;

FreeArms::FreeArms(const BackendSetup& setup) : paced_(setup.paced) {
  for (const auto& arm : setup.arms) {
    const JointVector zero = JointVector::Zero(arm.q_start.size());
    arms_.push_back({arm, ModelTerms(arm.model), arm.q_start, zero, zero});
    arms_.back().terms.set_config(arm.frames, arm.tool, arm.load);
  }
}

// Semi-implicit Euler: the new velocity moves the arm.
ArmSet FreeArms::wait() {
  if (commanded_) {
    for (Arm& arm : arms_) {
      arm.terms.update(arm.q, arm.dq);
      const JointVector rest = arm.tau - arm.terms.c();
      arm.dq += kArmPeriod * Eigen::LLT<JointMatrix>(arm.terms.M()).solve(rest);
      arm.q += kArmPeriod * arm.dq;
    }
    ++periods_;
    commanded_ = false;
  }
  if (paced_) pacer_.wait();
  return ArmSet::all(arms_.size());
}

void FreeArms::read(ArmSet due, std::span<ArmState> states) {
  for (ArmIndex i = 0; i < arms_.size(); ++i) {
    if (!due.contains(i)) continue;
    Arm& arm = arms_[i];
    ArmState& state = states[i];
    arm.terms.update(arm.q, arm.dq);
    state.sequence = static_cast<std::uint64_t>(periods_) + 1;
    state.t_robot = {now().ns};
    state.t_host = host_now();
    state.q = arm.q;
    state.dq = arm.dq;
    state.tau_J = arm.tau + arm.terms.g();
    state.tau_J_d = arm.tau;
    state.frames = arm.setup.frames;
    state.tool = arm.setup.tool;
    state.load = arm.setup.load;
    state.mode = ArmMode::move;
  }
}

void FreeArms::write(ArmSet due, std::span<const ArmCommand> commands) {
  for (ArmIndex i = 0; i < arms_.size(); ++i) {
    if (due.contains(i)) arms_[i].tau = commands[i].tau_cmd;
  }
  commanded_ = true;
}
