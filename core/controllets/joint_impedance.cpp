#include "core/controllets/joint_impedance.hpp"

#include <algorithm>
#include <cmath>

#include "core/controllets/bearable_damping.hpp"
#include "core/controllets/damping_design.hpp"

namespace multipanda {
namespace {

class JointImpedance final : public Controllet {
 public:
  explicit JointImpedance(ArmModels arms) : model_(arms[0]), bearable_(bearable_damping(*model_)) {}

  static ControlletDescriptor descriptor() {
    return {
        .type = "joint_impedance",
        .doc = "Joint impedance: each joint is a spring and damper about its set-point.",
        .inputs = spec_table<kInputCount>(
            input_at<kJoints>({.name = "joints", .quantity = Quantity::joints, .doc = "q_d [rad]."})),
        .parameters = spec_table<kParameterCount>(
            parameter_at<kStiffness>(
                {.name = "stiffness_nm_per_rad",
                 .unit = "N m/rad",
                 .size = ParameterSpec::kPerJoint,
                 .initial = {600, 600, 600, 600, 250, 150, 50, 50, 50, 50, 50, 50, 50, 50, 50, 50},
                 .max = 1000,
                 .doc = "Joint stiffness K."}),
            parameter_at<kDampingRatio>({.name = "damping_ratio",
                                         .initial = {1.0},
                                         .min = 0.1,
                                         .max = 2,
                                         .doc = "Damping ratio zeta of every mode."}),
            parameter_at<kDampingDesign>(choice_parameter("damping_design", {"coupled", "diagonal", "given"},
                                                          "D from the full M and K, from the M_ii and K_i of "
                                                          "each joint, or from damping_nms_per_rad.")),
            parameter_at<kFeedforward>(switch_parameter("acceleration_feedforward", true, "Adds M ddq_d.")),
            parameter_at<kDamping>(
                {.name = "damping_nms_per_rad",
                 .unit = "N m s/rad",
                 .size = ParameterSpec::kPerJoint,
                 .initial = {2, 2, 2, 1, 1, 1, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5},
                 .max = 50,
                 .doc = "Joint damping D if damping_design is 'given'; at most what the inertia of the "
                        "joint bears at 1 kHz."})),
        .outputs = spec_table<kOutputCount>(
            output_at<kLargestError>("largest_error_rad", "Largest |q_d - q| of all joints."),
            output_at<kLargestTorque>("largest_torque_nm", "Largest |tau| of all joints."))};
  }

  void bound_parameters(ParameterSet& parameters) const override {
    bound_damping(*model_, kDamping, parameters);
  }

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
    JointVector damping;  // D dq
    switch (parameters.choice(kDampingDesign)) {
      case kCoupled: {
        const JointMatrix D = joint_damping(M, K, zeta);
        tau += D.lazyProduct(velocity_error);
        damping = D.lazyProduct(arm.dq());
        break;
      }
      case kDiagonal: {  // of each joint while all others stand still, so perhaps more than it bears
        const JointVector D = diagonal_damping(M, K, zeta).cwiseMin(bearable_);
        tau += D.cwiseProduct(velocity_error);
        damping = D.cwiseProduct(arm.dq());
        break;
      }
      default: {
        const JointVector D = parameters.joints(kDamping);
        tau += D.cwiseProduct(velocity_error);
        damping = D.cwiseProduct(arm.dq());
      }
    }
    if (parameters.flag(kFeedforward)) tau += M.lazyProduct(reference.joint_acceleration());
    if (std::isfinite(context.contact.spring_force + context.contact.spring_moment)) {
      bound(context, tau, damping);
    }
    if (!tau.allFinite()) return LawResult::fault;

    *arm.tau = tau;
    context.outputs[kLargestError] = error.lpNorm<Eigen::Infinity>();
    context.outputs[kLargestTorque] = tau.lpNorm<Eigen::Infinity>();
    return LawResult::ok;
  }

 private:
  // The pull of all joints acts at the hand like the wrench J_bar^T tau, J_bar = M^-1 J^T Lambda (Khatib
  // 1987), more near a singular pose (TaskSpace::press): the force that keeps the hand where it is. The whole
  // pull is scaled until that keeps to its bounds.
  static void bound(ControlContext& context, JointVector& tau, const JointVector& damping) {
    OwnedArm& arm = context.arms[0];
    const TaskSpace& task = arm.terms->task();
    const Matrix6 press = task.press();
    const auto at_hand = [&](const JointVector& x) {
      return Vector6(press * Vector6(task.J_bar.transpose().lazyProduct(x)));
    };
    const JointVector pull = tau - arm.terms->c() + damping;
    const BoundedPull bounded =
        bound_pull(context.contact, at_hand(pull), at_hand(damping), arm.terms->V_WE().linear());
    context.inputs[kJoints].resist(pull, std::max(bounded.force_share, bounded.moment_share));
    if (bounded.factor() < 1) tau -= (1 - bounded.factor()) * pull;
  }

  enum Input : std::size_t { kJoints, kInputCount };
  enum Parameter : std::size_t {
    kStiffness,
    kDampingRatio,
    kDampingDesign,
    kFeedforward,
    kDamping,
    kParameterCount
  };
  enum Output : std::size_t { kLargestError, kLargestTorque, kOutputCount };
  enum DampingDesign : std::size_t { kCoupled, kDiagonal };  // otherwise given

  std::shared_ptr<const ArmModel> model_;
  JointVector bearable_;  // greatest damping of each joint [N m s/rad] (n x 1)
};

}  // namespace

ControlletType joint_impedance_controllet() { return controllet_type<JointImpedance>(); }

}  // namespace multipanda
