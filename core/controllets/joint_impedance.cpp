#include "core/controllets/joint_impedance.hpp"

#include "core/controllets/damping_design.hpp"

namespace multipanda {
namespace {

enum Input : std::size_t { kJoints };
enum Parameter : std::size_t { kStiffness, kDampingRatio, kDampingDesign, kFeedforward, kDamping };
enum DampingDesign : std::size_t { kCoupled, kDiagonal, kGiven };
enum Output : std::size_t { kLargestError, kLargestTorque };

class JointImpedance final : public Controllet {
 public:
  LawResult start(ControlContext&) override { return LawResult::ok; }

  LawResult update(ControlContext& context) override {
    OwnedArm& arm = context.arms[0];
    const ParameterSet& parameters = *context.parameters;
    const Reference& reference = context.inputs[kJoints];
    const JointVector K = parameters.joints(kStiffness);
    const double zeta = parameters.number(kDampingRatio);
    const JointMatrix& M = arm.terms->M();

    const JointVector error = reference.joints() - arm.q();
    const JointVector velocity_error = reference.joint_velocity() - arm.dq();
    JointVector tau = K.cwiseProduct(error) + arm.terms->c();
    switch (parameters.choice(kDampingDesign)) {
      case kCoupled:
        tau += joint_damping(M, K, zeta).lazyProduct(velocity_error);
        break;
      case kDiagonal:
        tau += diagonal_damping(M, K, zeta).cwiseProduct(velocity_error);
        break;
      default:
        tau += parameters.joints(kDamping).cwiseProduct(velocity_error);
    }
    if (parameters.flag(kFeedforward)) tau += M.lazyProduct(reference.joint_acceleration());
    if (!tau.allFinite()) return LawResult::fault;

    *arm.tau = tau;
    context.outputs[kLargestError] = error.lpNorm<Eigen::Infinity>();
    context.outputs[kLargestTorque] = tau.lpNorm<Eigen::Infinity>();
    return LawResult::ok;
  }
};

}  // namespace

ControlletType joint_impedance_controllet() {
  return {{.type = "joint_impedance",
           .doc = "Every joint a spring and a damper towards its set-point.",
           .inputs = {{.name = "joints", .quantity = Quantity::joints, .doc = "q_d [rad]."}},
           .parameters = {{"stiffness_nm_per_rad",
                           "N m/rad",
                           ParameterSpec::kPerJoint,
                           {600, 600, 600, 600, 250, 150, 50, 50, 50, 50, 50, 50, 50, 50, 50, 50},
                           0,
                           1000,
                           "K, per joint."},
                          {"damping_ratio", "", 1, {1.0}, 0.1, 2, "zeta of every mode."},
                          {"damping_design",
                           "",
                           1,
                           {0},
                           0,
                           2,
                           "D from the full M and K, from each joint's own M_ii and K_i, or given.",
                           {"coupled", "diagonal", "given"}},
                          switch_parameter("acceleration_feedforward", true, "Adds M ddq_d."),
                          {"damping_nms_per_rad",
                           "N m s/rad",
                           ParameterSpec::kPerJoint,
                           {2, 2, 2, 1, 1, 1, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5},
                           0,
                           50,
                           "D, per joint, where damping_design is 'given'."}},
           .outputs = {{"largest_error_rad", 1, "Largest |q_d - q| of the joints."},
                       {"largest_torque_nm", 1, "Largest |tau| of the joints."}}},
          [](ArmModels) -> std::unique_ptr<Controllet> { return std::make_unique<JointImpedance>(); }};
}

}  // namespace multipanda
