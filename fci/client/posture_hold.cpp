#include "fci/client/posture_hold.hpp"

#include <array>

#include "core/controllets/builtins.hpp"

namespace multipanda::fci {

PostureHold::PostureHold(const std::shared_ptr<const ArmModel>& model, const ArmFrames& frames,
                         const Load& tool, const Load& load)
    : terms_(model),
      tau_(JointVector::Zero(static_cast<Eigen::Index>(model->joint_count()))),
      type_(hold_controllet()),
      parameters_(type_.descriptor.parameters, model->joint_count()),
      law_(type_.create(std::array{model})) {
  terms_.set_config(frames, tool, load);
  state_.q = model->q_home();
  state_.dq = tau_;
  arm_.push_back({&state_, &terms_, &tau_});
}

PostureHold::PostureHold(const std::shared_ptr<const ArmModel>& model) : PostureHold(model, {}, {}, {}) {
  stays_ = true;
}

ControlContext PostureHold::context() {
  ControlContext context{kArmPeriod, 0.0, arm_, {}, &parameters_, {}, arm_};
  context.stopped = stays_;
  return context;
}

const JointVector& PostureHold::torque(const JointVector& q, const JointVector& dq) noexcept {
  state_.q = q;
  state_.dq = dq;
  terms_.update(q, dq);
  return torque();
}

const JointVector& PostureHold::torque(const ArmState& state) noexcept {
  state_.q = state.q;
  state_.dq = state.dq;
  terms_.update(state);
  return torque();
}

const JointVector& PostureHold::torque() noexcept {
  tau_.setZero();
  ControlContext of_arm = context();
  if (!holds_) holds_ = law_->start(of_arm) == LawResult::ok;
  if (law_->update(of_arm) != LawResult::ok || !tau_.allFinite()) tau_.setZero();
  return tau_;
}

}  // namespace multipanda::fci
