#include "core/controllets/cartesian_impedance.hpp"

#include "core/controllets/cartesian_law.hpp"

namespace multipanda {
namespace {

enum Input : std::size_t { kPose };
enum Parameter : std::size_t { kPosture = kCartesianParameterCount, kGivenPosture };
enum Posture : std::size_t { kAtStart, kHome, kGiven };

// The null-space posture follows its choice no faster than this, so that choosing one makes no step.
constexpr double kPostureSpeed = 0.5;  // [rad/s]

class CartesianImpedance final : public Controllet {
 public:
  LawResult start(ControlContext& context) override {
    q_start_ = q_N_ = context.arms[0].q();
    return LawResult::ok;
  }

  LawResult update(ControlContext& context) override {
    OwnedArm& arm = context.arms[0];
    const ParameterSet& parameters = *context.parameters;
    const double reach = kPostureSpeed * context.dt;
    q_N_ += (posture(parameters, arm) - q_N_).cwiseMax(-reach).cwiseMin(reach);

    TaskForce force;
    const LawResult result =
        cartesian_impedance_law(impedance_gains(parameters), null_space_gains(parameters),
                                CartesianTarget::of(context.inputs[kPose]), arm, q_N_, force);
    show(force, context.outputs);
    return result;
  }

 private:
  JointVector posture(const ParameterSet& parameters, const OwnedArm& arm) const {
    switch (parameters.choice(kPosture)) {
      case kHome:
        return arm.model().q_home();
      case kGiven:
        return parameters.joints(kGivenPosture);
      default:
        return q_start_;
    }
  }

  JointVector q_start_, q_N_;
};

std::vector<ParameterSpec> parameters() {
  auto specs = cartesian_parameters();
  specs.push_back({"nullspace_posture",
                   "",
                   1,
                   {0},
                   0,
                   2,
                   "q_N: where the controllet started, the arm's home, or nullspace_posture_rad.",
                   {"at_start", "home", "given"}});
  specs.push_back({"nullspace_posture_rad",
                   "rad",
                   ParameterSpec::kPerJoint,
                   {0.0},
                   -6.3,
                   6.3,
                   "q_N where nullspace_posture is 'given'; approached at 0.5 rad/s."});
  return specs;
}

}  // namespace

ControlletType cartesian_impedance_controllet() {
  return {
      {.type = "cartesian_impedance",
       .doc = "The end effector a spring and a damper towards its set-point; soft posture in the null space.",
       .inputs = {{.name = "pose", .quantity = Quantity::pose, .doc = "X_WE set-point, in the world."}},
       .parameters = parameters(),
       .outputs = cartesian_outputs()},
      [](ArmModels) -> std::unique_ptr<Controllet> { return std::make_unique<CartesianImpedance>(); }};
}

}  // namespace multipanda
