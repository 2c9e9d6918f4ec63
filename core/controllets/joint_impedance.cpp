#include <algorithm>

#include "core/controllets/builtins.hpp"
#include "core/controllets/damping_design.hpp"
#include "core/controllets/raised_spring.hpp"
#include "core/types/time.hpp"

namespace multipanda {
namespace {

// Joint impedance: each joint is a spring and damper about its set-point.
//   tau = K (q_d - q) + D (dq_d - dq) + C dq  (+ M ddq_d)
// Closed loop (exact model, with M ddq_d): M dde + (C + D) de + K e = -tau_ext, e = q_d - q; at rest an
// external torque deflects by K^-1 tau_ext. K [N m/rad]. D [N m s/rad] is designed from the full M and K
// (every mode has damping ratio zeta), for each joint alone, or given; it acts on de or, if chosen, on -dq.
class JointImpedance final : public Controllet {
 public:
  explicit JointImpedance(ArmModels arms) : model_(arms[0]), bearable_(bearable_damping(*model_)) {}

  static ControlletDescriptor descriptor() {
    return {
        .type = "joint_impedance",
        .doc = "Joint impedance: each joint is a spring and damper about its set-point.",
        .moving_base = true,
        .inputs = spec_table<kInputCount>(
            input_at<kJoints>({.name = "joints", .quantity = Quantity::joints, .doc = "q_d [rad]."})),
        .parameters = spec_table<kParameterCount>(
            parameter_at<kStiffness>(joint_stiffness_parameter()),
            parameter_at<kDampingRatio>(joint_damping_ratio_parameter()),
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
                 .doc = "Joint damping D if damping_design is 'given'; limited by the joint's inertia at 1 "
                        "kHz."}),
            parameter_at<kDampingOf>(damping_of_parameter()),
            parameter_at<kVelocityWeight>({.name = "velocity_weight",
                                           .initial = {1.0},
                                           .min = 0.5,
                                           .max = 1,
                                           .doc = "Weight a: D acts on a dq + (1 - a) times the previous dq; "
                                                  "1: dq itself."})),
        .outputs = spec_table<kOutputCount>(
            output_at<kLargestError>("largest_error_rad", "Largest |q_d - q| of all joints."),
            output_at<kLargestTorque>("largest_torque_nm", "Largest |tau| of all joints."),
            output_at<kStiffnessShare>("stiffness_share", kStiffnessShareDoc)),
        .presets = {{"reference",
                     "The manufacturer's joint impedance example: its gains, D on a lightly filtered dq, no "
                     "feed-forward.",
                     {{"stiffness_nm_per_rad", {24, 24, 24, 24, 10, 6, 2}},
                      {"damping_design", {2}},
                      {"damping_nms_per_rad", {2, 2, 2, 1, 1, 1, 0.5}},
                      {"damping_of", {1}},
                      {"velocity_weight", {0.99}},
                      {"acceleration_feedforward", {0}}}}}};
  }

  void bound_parameters(ParameterSet& parameters) const override {
    bound_damping(*model_, kDamping, parameters);
  }

  LawResult start(ControlContext& context) override {
    dq_ = context.arms[0].dq();
    raised_ = {};
    ddq_d_ = JointVector::Zero(dq_.size());
    return LawResult::ok;
  }

  LawResult update(ControlContext& context) override {
    OwnedArm& arm = context.arms[0];
    const ParameterSet& parameters = *context.parameters;
    Reference& reference = context.inputs[kJoints];
    const JointGains gains{.stiffness = parameters.joints(kStiffness),
                           .damping_ratio = parameters.number(kDampingRatio),
                           .design = static_cast<JointGains::Damping>(parameters.choice(kDampingDesign)),
                           .given = parameters.joints(kDamping),
                           .bearable = bearable_,
                           .acceleration_feedforward = parameters.flag(kFeedforward),
                           .damping_of = static_cast<DampingOf>(parameters.choice(kDampingOf))};
    const double weight = parameters.number(kVelocityWeight);
    dq_ = weight < 1 ? JointVector(weight * arm.dq() + (1 - weight) * dq_) : arm.dq();
    follow(reference.joint_acceleration(), context.dt, arm);
    const JointTarget target{reference.joints(), reference.joint_velocity(), ddq_d_};
    JointPull pull;
    if (joint_impedance_law(gains, target, dq_, context.contact, arm, context.dt, raised_, pull) !=
        LawResult::ok)
      return LawResult::fault;
    reference.resist(pull.torque, pull.share);
    reference.slow(raised_.pace());
    context.outputs[kLargestError] = (target.q_d - arm.q()).lpNorm<Eigen::Infinity>();
    context.outputs[kLargestTorque] = arm.tau->lpNorm<Eigen::Infinity>();
    context.outputs[kStiffnessShare] = pull.stiffness_share;
    return LawResult::ok;
  }

 private:
  enum Input : std::size_t { kJoints, kInputCount };
  enum Parameter : std::size_t {
    kStiffness,
    kDampingRatio,
    kDampingDesign,
    kFeedforward,
    kDamping,
    kDampingOf,
    kVelocityWeight,
    kParameterCount
  };
  enum Output : std::size_t { kLargestError, kLargestTorque, kStiffnessShare, kOutputCount };

  // M ddq_d changes by at most this share of the torque rate, along its way. A set-point that catches up with
  // a stream accelerates within milliseconds. Joints that turn about nearly one axis would then need more
  // than the whole rate; cut joint by joint, their torques no longer balance and drive the light mode between
  // them, and while they are cut, its damping comes too late.
  static constexpr double kRateShare = 0.25;

  void follow(const JointVector& ddq_d, double dt, const OwnedArm& arm) {
    const JointVector way = ddq_d - ddq_d_, change = arm.terms->M().lazyProduct(way);
    const JointVector most = kRateShare * std::min(dt, kArmPeriod) * arm.model().limits().tau_rate_max;
    ddq_d_ += std::min(1.0, most.cwiseQuotient(change.cwiseAbs()).minCoeff()) * way;
  }

  std::shared_ptr<const ArmModel> model_;
  JointVector bearable_;  // greatest damping of each joint [N m s/rad] (n x 1)
  JointVector ddq_d_;     // that is fed forward [rad/s^2] (n x 1)
  RaisedJoints raised_;
  JointVector dq_;  // velocity that D sees [rad/s] (n x 1)
};

}  // namespace

ControlletType joint_impedance_controllet() { return controllet_type<JointImpedance>(); }

}  // namespace multipanda
