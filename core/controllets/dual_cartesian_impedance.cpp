#include "core/controllets/dual_cartesian_impedance.hpp"

#include <array>

#include "core/controllets/set_point_blend.hpp"

namespace multipanda {
namespace {

enum Input : std::size_t { kCommonPose, kFirstPose, kSecondPose };
enum Parameter : std::size_t { kGoals = kCartesianParameterCount, kOffset };
enum Goals : std::size_t { kCommon, kSeparate };

class DualCartesianImpedance final : public Controllet {
 public:
  // The common pose begins midway between the hands.
  void start_references(ControlContext& context) override {
    Controllet::start_references(context);
    const Pose& X_WE1 = context.arms[0].terms->X_WE();
    const Pose& X_WE2 = context.arms[1].terms->X_WE();
    const Vector3 half_way = 0.5 * log_rotation(X_WE2.rotation * X_WE1.rotation.transpose());
    context.inputs[kCommonPose].start(
        Pose{exp_rotation(half_way) * X_WE1.rotation, 0.5 * (X_WE1.position + X_WE2.position)});
  }

  LawResult start(ControlContext& context) override {
    goals_ = context.parameters->choice(kGoals);
    for (std::size_t i = 0; i < 2; ++i) {
      q_N_[i] = context.arms[i].q();
      X_W_d_[i] = context.arms[i].terms->X_WE();
      blend_[i].capture(X_W_d_[i], rule(context, i).X_W_d);
    }
    return LawResult::ok;
  }

  LawResult update(ControlContext& context) override {
    const ParameterSet& parameters = *context.parameters;
    const ImpedanceGains gains = impedance_gains(parameters);
    const NullSpaceGains null_space = null_space_gains(parameters);
    const bool other_goals = parameters.choice(kGoals) != goals_;
    goals_ = parameters.choice(kGoals);
    for (std::size_t i = 0; i < 2; ++i) {
      const CartesianTarget wanted = rule(context, i);
      if (other_goals) blend_[i].capture(X_W_d_[i], wanted.X_W_d);
      const CartesianTarget target = blend_[i].advance(wanted, context.dt);
      X_W_d_[i] = target.X_W_d;
      TaskForce force;
      if (cartesian_impedance_law(gains, null_space, target, context.arms[i], q_N_[i], force) !=
          LawResult::ok) {
        return LawResult::fault;
      }
      show(force, context.outputs.subspan(i * kCartesianOutputSize));
    }
    return LawResult::ok;
  }

 private:
  CartesianTarget rule(const ControlContext& context, std::size_t arm) const {
    if (goals_ == kSeparate) return CartesianTarget::of(context.inputs[arm == 0 ? kFirstPose : kSecondPose]);
    CartesianTarget target = CartesianTarget::of(context.inputs[kCommonPose]);
    const Vector3 offset = context.parameters->vector3(kOffset);
    target.X_W_d.position += arm == 0 ? offset : Vector3(-offset);
    return target;
  }

  std::size_t goals_ = kCommon;
  std::array<JointVector, 2> q_N_;
  std::array<Pose, 2> X_W_d_;  // set-points in force
  std::array<SetPointBlend, 2> blend_;
};

std::vector<ParameterSpec> parameters() {
  auto specs = cartesian_parameters();
  specs.push_back({"goals",
                   "",
                   1,
                   {0},
                   0,
                   1,
                   "Set-points from common_pose, or from first_pose and second_pose.",
                   {"common", "separate"}});
  specs.push_back(
      {"offset_m",
       "m",
       3,
       {0, 0.15, 0},
       -1,
       1,
       "Added to the common position for the first arm, taken from it for the second; world axes."});
  return specs;
}

std::vector<OutputSpec> outputs() {
  auto specs = cartesian_outputs("first_");
  for (auto& output : cartesian_outputs("second_")) specs.push_back(std::move(output));
  return specs;
}

}  // namespace

ControlletType dual_cartesian_impedance_controllet() {
  return {
      {.type = "dual_cartesian_impedance",
       .doc = "DC: two arms, two independent Cartesian impedances, one common set-point or one each.",
       .arms = 2,
       .inputs =
           {{.name = "common_pose",
             .quantity = Quantity::pose,
             .arm = 0,
             .doc = "Set-point of both hands, each shifted by offset_m; world. Ignored with separate goals."},
            {.name = "first_pose",
             .quantity = Quantity::pose,
             .arm = 0,
             .doc = "X_WE set-point of the first arm, world. Ignored with common goals."},
            {.name = "second_pose",
             .quantity = Quantity::pose,
             .arm = 1,
             .doc = "X_WE set-point of the second arm, world. Ignored with common goals."}},
       .parameters = parameters(),
       .outputs = outputs()},
      [](ArmModels) -> std::unique_ptr<Controllet> { return std::make_unique<DualCartesianImpedance>(); }};
}

}  // namespace multipanda
