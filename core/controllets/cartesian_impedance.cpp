#include <algorithm>

#include "core/controllets/builtins.hpp"
#include "core/controllets/raised_spring.hpp"

namespace multipanda {
namespace {

// Cartesian impedance of one arm: the end effector is a spring and damper about its set-point, with a soft
// posture in the null space.
//   tau = J^T (K_c x~ + D_c (V_d - J dq) + Lambda A_d) + N (K_N (q_N - q) - D_N N^T dq) + C dq
// Closed loop (exact model, regular pose, dynamic projector): Lambda ddx~ + D_c dx~ + K_c x~ = -F_ext up to
// Lambda dJ dq, so a force F_ext at rest deflects E by K_c^-1 F_ext. World axes, linear first; K_c [N/m, N
// m/rad], D_c [N s/m, N m s/rad]. Details: core/controllets/cartesian_law.hpp,
// docs/controllets/impedance.md.
class CartesianImpedance final : public Controllet {
 public:
  static ControlletDescriptor descriptor() {
    return {.type = "cartesian_impedance",
            .doc =
                "Cartesian impedance: the end effector is a spring and damper about its set-point, with a "
                "soft posture in the null space.",
            .moving_base = true,
            .wrench_at_hand = true,
            .inputs = spec_table<kInputCount>(input_at<kPose>(
                {.name = "pose", .quantity = Quantity::pose, .doc = "Set-point X_WE, in the world frame."})),
            .parameters = spec_table<kParameterCount>(
                cartesian_parameters(),
                parameter_at<kPosture>(choice_parameter(
                    "nullspace_posture", {"at_start", "home", "given"},
                    "Posture q_N: where the controllet started, the arm's home, or nullspace_posture_rad.")),
                parameter_at<kGivenPosture>(
                    {.name = "nullspace_posture_rad",
                     .unit = "rad",
                     .size = ParameterSpec::kPerJoint,
                     .initial = {0.0},
                     .min = -6.3,
                     .max = 6.3,
                     .doc = "q_N if nullspace_posture is 'given'; approached at 0.5 rad/s."})),
            .outputs = spec_table<kCartesianOutputSize>(cartesian_outputs()),
            .presets = {paper_preset(), reference_preset()}};
  }

  LawResult start(ControlContext& context) override {
    q_start_ = q_N_ = context.arms[0].q();
    raised_ = {};
    return LawResult::ok;
  }

  LawResult update(ControlContext& context) override {
    OwnedArm& arm = context.arms[0];
    const ParameterSet& parameters = *context.parameters;
    const JointVector reach = posture_speed(arm.model(), context.contact) * context.dt;
    q_N_ += (posture(parameters, arm) - q_N_).cwiseMax(-reach).cwiseMin(reach);

    TaskForce force;
    const LawResult result = cartesian_impedance_law(
        impedance_gains(parameters, context.contact), null_space_gains(parameters, context.contact),
        CartesianTarget::of(context.inputs[kPose]), arm, q_N_, context.dt, raised_, force);
    force.report(context.inputs[kPose]);
    show(force, context.outputs);
    return result;
  }

 private:
  enum Input : std::size_t { kPose, kInputCount };
  enum Parameter : std::size_t { kPosture = kCartesianParameterCount, kGivenPosture, kParameterCount };
  enum Posture : std::size_t { kAtStart, kHome, kGiven };

  // Speed limit of the null-space posture, so that a new choice causes no step.
  static constexpr double kPostureSpeed = 0.5;  // [rad/s], [m/s]

  // A carriage may meet a person while the hand rests, so it is limited like a hand.
  static JointVector posture_speed(const ArmModel& model, const ContactBounds& contact) {
    JointVector speed = joint_constant(model.joint_count(), kPostureSpeed);
    for (std::size_t i = 0; i < model.joint_count(); ++i) {
      if (model.is_prismatic(i))
        speed[static_cast<Eigen::Index>(i)] = std::min(kPostureSpeed, contact.hand_speed);
    }
    return speed;
  }

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
  RaisedSpring raised_;
};

}  // namespace

ControlletType cartesian_impedance_controllet() { return controllet_type<CartesianImpedance>(); }

}  // namespace multipanda
