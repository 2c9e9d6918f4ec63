#pragma once

#include <memory>
#include <vector>

#include "core/controllets/controllet.hpp"
#include "core/model/model_terms.hpp"

namespace multipanda::fci {

// An arm's hold, as in the multimode controller, while a torque motion runs but no control loop: while other
// arms still begin, until a motion has ended, and while a program on another clock is silent. Without torque
// an arm would float, and a repeated torque would push it away.
class PostureHold {
 public:
  PostureHold(const std::shared_ptr<const ArmModel>& model, const ArmFrames& frames, const Load& tool,
              const Load& load);
  // The states' frames and loads; an arm held beyond the end of a range stays there.
  explicit PostureHold(const std::shared_ptr<const ArmModel>& model);
  // The next torque holds the arm at its position of that time.
  void release() noexcept { holds_ = false; }
  // [N m] (n x 1), without gravity. No allocation.
  const JointVector& torque(const JointVector& q, const JointVector& dq) noexcept;
  const JointVector& torque(const ArmState& state) noexcept;

 private:
  const JointVector& torque() noexcept;
  ControlContext context();

  ModelTerms terms_;
  ArmState state_;
  JointVector tau_;
  ControlletType type_;
  ParameterSet parameters_;
  std::unique_ptr<Controllet> law_;
  std::vector<OwnedArm> arm_;
  bool holds_ = false;
  bool stays_ = false;  // beyond the end of a range
};

}  // namespace multipanda::fci
