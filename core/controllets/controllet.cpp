#include "core/controllets/controllet.hpp"

namespace multipanda {

void Controllet::start_references(ControlContext& context) {
  for (auto& input : context.inputs) {
    const OwnedArm& arm = context.arms[input.spec().arm];
    switch (input.spec().quantity) {
      case Quantity::pose:
        input.start(arm.terms->X_WE());
        break;
      case Quantity::joints:
        input.start(arm.q());
        break;
      case Quantity::twist:
      case Quantity::wrench:
      case Quantity::scalar:
        input.start_constant(0);
        break;
    }
  }
}

void Controllet::end_effector_moved(ControlContext& context, std::size_t arm, const Pose& X) {
  for (auto& input : context.inputs) {
    if (input.spec().arm == arm) input.carry(X);  // of other quantities than poses, nothing
  }
}

}  // namespace multipanda
