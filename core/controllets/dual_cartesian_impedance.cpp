#include <algorithm>
#include <array>
#include <cmath>

#include "core/controllets/builtins.hpp"
#include "core/controllets/offset_reference.hpp"
#include "core/controllets/raised_spring.hpp"
#include "core/controllets/set_point_blend.hpp"

namespace multipanda {
namespace {

// DC: two arms owned by one controllet, each with its own Cartesian impedance; law and closed loop as in
// cartesian_impedance.cpp. The set-points are one common pose, shifted by +offset for the first arm and
// -offset for the second, or one pose each (world axes).
class DualCartesianImpedance final : public Controllet {
 public:
  static ControlletDescriptor descriptor() {
    return {
        .type = "dual_cartesian_impedance",
        .doc = "DC: two arms with independent Cartesian impedances, and one common set-point or one each.",
        .arms = 2,
        .moving_base = true,
        .wrench_at_hand = true,
        .inputs = spec_table<kInputCount>(
            input_at<kCommonPose>({.name = "common_pose",
                                   .quantity = Quantity::pose,
                                   .arm = 0,
                                   .doc =
                                       "Common set-point of both hands, world frame; each hand is shifted by "
                                       "offset_m. Ignored with separate goals.",
                                   .common = true}),
            input_at<kFirstPose>(
                {.name = "first_pose",
                 .quantity = Quantity::pose,
                 .arm = 0,
                 .doc = "Set-point X_WE of the first arm, world frame. Ignored with common goals."}),
            input_at<kSecondPose>(
                {.name = "second_pose",
                 .quantity = Quantity::pose,
                 .arm = 1,
                 .doc = "Set-point X_WE of the second arm, world frame. Ignored with common goals."})),
        .parameters = spec_table<kParameterCount>(
            cartesian_parameters(),
            parameter_at<kGoals>(
                choice_parameter("goals", {"common", "separate"},
                                 "Set-points from common_pose, or from first_pose and second_pose.")),
            parameter_at<kOffset>({.name = "offset_m",
                                   .unit = "m",
                                   .size = 3,
                                   .initial = {0, 0.15, 0},
                                   .min = -1,
                                   .max = 1,
                                   .doc = "Added to the common position for the first arm and subtracted for "
                                          "the second, world axes; a change is approached at half the speed "
                                          "limit of common_pose."})),
        .outputs = spec_table<2 * kCartesianOutputSize>(
            cartesian_outputs("first_"), group_at<kCartesianOutputSize>(cartesian_outputs("second_"))),
        .presets = {paper_preset()}};
  }

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
    offset_.start(context.parameters->goal_vector3(kOffset));
    for (std::size_t i = 0; i < 2; ++i) {
      q_N_[i] = context.arms[i].q();
      X_W_d_[i] = context.arms[i].terms->X_WE();
      blend_[i].capture(X_W_d_[i], rule(context, i).X_W_d, context.contact.hand_speed);
      shift_[i].clear();
      raised_[i] = {};
    }
    return LawResult::ok;
  }

  LawResult update(ControlContext& context) override {
    const ParameterSet& parameters = *context.parameters;
    const ImpedanceGains gains = impedance_gains(parameters, context.contact);
    const NullSpaceGains null_space = null_space_gains(parameters, context.contact);
    const bool other_goals = parameters.choice(kGoals) != goals_;
    goals_ = parameters.choice(kGoals);
    offset_.advance(parameters.goal_vector3(kOffset), context.inputs[kCommonPose].spec().max_speed,
                    context.dt);
    for (std::size_t i = 0; i < 2; ++i) {
      const CartesianTarget requested = rule(context, i);
      if (other_goals) {
        blend_[i].capture(X_W_d_[i], requested.X_W_d, context.contact.hand_speed);
        shift_[i].clear();
      }
      CartesianTarget target = shift_[i].advance(blend_[i].advance(requested, context.dt), context.dt);
      if (goals_ == kCommon) {  // its motion does not remove a difference from the common set-point
        const double side = i == 0 ? 1 : -1;
        target.V_d.linear() += side * offset_.velocity();
        target.A_d.linear() += side * offset_.acceleration();
      }
      X_W_d_[i] = target.X_W_d;
      TaskForce force;
      if (cartesian_impedance_law(gains, null_space, target, context.arms[i], q_N_[i], context.dt, raised_[i],
                                  force) != LawResult::ok) {
        return LawResult::fault;
      }
      force.report(context.inputs[goals_ == kCommon ? kCommonPose : i == 0 ? kFirstPose : kSecondPose]);
      show(force, context.outputs.subspan(i * kCartesianOutputSize));
    }
    share_hand_speed(context);
    return LawResult::ok;
  }

  // A hand's own set-point moves along. The common one belongs to neither hand, so it stays.
  void end_effector_moved(ControlContext& context, std::size_t arm, const Pose& X) override {
    if (goals_ == kSeparate && blend_[arm].over()) {
      context.inputs[arm == 0 ? kFirstPose : kSecondPose].carry(X);
    } else {
      shift_[arm].add(X, context.contact.hand_speed);
    }
    X_W_d_[arm] = X_W_d_[arm] * X;
  }

 private:
  enum Input : std::size_t { kCommonPose, kFirstPose, kSecondPose, kInputCount };
  enum Parameter : std::size_t { kGoals = kCartesianParameterCount, kOffset, kParameterCount };
  enum Goals : std::size_t { kCommon, kSeparate };

  CartesianTarget rule(const ControlContext& context, std::size_t arm) const {
    if (goals_ == kSeparate) return CartesianTarget::of(context.inputs[arm == 0 ? kFirstPose : kSecondPose]);
    CartesianTarget target = CartesianTarget::of(context.inputs[kCommonPose]);
    const double side = arm == 0 ? 1 : -1;
    target.X_W_d.position += side * offset_.position();
    return target;
  }

  // A hand is moved by its reference, the blend, the shift and the offset at once. The reference gets the
  // remaining share of the hand's speed from the next cycle on; in this one the others have hardly begun to
  // move. Together they take at most seven eighths.
  static_assert(SetPointBlend::kShare + SetPointShift::kShare + OffsetReference::kShare < 1);
  void share_hand_speed(ControlContext& context) const {
    const double most = context.contact.hand_speed;
    if (!std::isfinite(most)) return;
    const auto left = [&](std::size_t i) { return most - blend_[i].top_speed() - shift_[i].top_speed(); };
    if (goals_ == kSeparate) {
      context.inputs[kFirstPose].bound_hand_speed(left(0), shift_[0].lever());
      context.inputs[kSecondPose].bound_hand_speed(left(1), shift_[1].lever());
    } else {
      Reference& pose = context.inputs[kCommonPose];
      pose.bound_hand_speed(std::min(left(0), left(1)) - offset_.top_speed(pose.spec().max_speed),
                            std::max(shift_[0].lever(), shift_[1].lever()));
    }
  }

  std::size_t goals_ = kCommon;
  OffsetReference offset_;
  std::array<JointVector, 2> q_N_;
  std::array<Pose, 2> X_W_d_;  // current set-points
  std::array<SetPointBlend, 2> blend_;
  std::array<SetPointShift, 2> shift_;
  std::array<RaisedSpring, 2> raised_;
};

}  // namespace

ControlletType dual_cartesian_impedance_controllet() { return controllet_type<DualCartesianImpedance>(); }

}  // namespace multipanda
