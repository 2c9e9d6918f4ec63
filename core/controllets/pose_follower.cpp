#include "core/controllets/builtins.hpp"
#include "core/controllets/following.hpp"
#include "core/controllets/raised_spring.hpp"

namespace multipanda {
namespace {

// One arm follows the hand of another, which it observes and does not own. Law, alignment, clutch and
// parameters: docs/controllets/teleoperation.md.
class PoseFollower final : public Controllet {
 public:
  static ControlletDescriptor descriptor() {
    return {.type = "pose_follower",
            .doc = "The hand follows that of another arm, the leader, which it observes and does not own.",
            .observes = 1,
            .parameters =
                spec_table<kParameterCount>(cartesian_parameters(), parameter_at<kClutch>(clutch_parameter()),
                                            parameter_at<kAlignment>(alignment_parameter()),
                                            parameter_at<kAxes>(leading_axes_parameter()),
                                            parameter_at<kScale>(leading_scale_parameter())),
            .outputs = spec_table<kOutputCount>(
                cartesian_outputs(),
                output_at<kLag, 3>("lag_m", "Distance from the set-point to the leader's goal, world axes."),
                output_at<kSlipped>("slipped", kSlippedDoc))};
  }

  LawResult start(ControlContext& context) override {
    OwnedArm& arm = context.arms[0];
    q_N_ = arm.q();
    raised_ = {};
    jumps_.start(context.observed[0]);
    clutch_.start();
    led_.start(context.observed[0], arm.terms->X_WE());
    follows_.start(arm.terms->X_WE());
    return LawResult::ok;
  }

  LawResult update(ControlContext& context) override {
    if (jumps_.jumped(context.observed[0])) return LawResult::fault;
    OwnedArm& arm = context.arms[0];
    const ParameterSet& parameters = *context.parameters;
    lead(context);
    const ImpedanceGains gains = impedance_gains(parameters, context.contact);
    const bool left_behind = follows_.left_behind(led_.X(), context.contact);
    const double strain = follows_.strain(arm.terms->X_WE(), gains);
    if (clutch_.turn(parameters.flag(kClutch), left_behind, strain, context.dt)) {
      follows_.advance(led_.X(), led_.V(), context.contact, context.dt);
    } else {
      follows_.brake(arm.terms->X_WE(), strain, context.contact, context.dt);
      led_.place(follows_.X());
    }
    TaskForce force;
    const LawResult result =
        cartesian_impedance_law(gains, null_space_gains(parameters, context.contact), follows_.target(), arm,
                                q_N_, context.dt, raised_, force);
    follows_.resist(force.pull, force.bounded.force_share, force.bounded.moment_share, context.dt);
    show(force, context.outputs);
    const Vector3 lag = led_.X().position - follows_.X().position;
    std::copy_n(lag.data(), 3, context.outputs.begin() + kLag);
    context.outputs[kSlipped] = clutch_.slipped() ? 1 : 0;
    return result;
  }

  void end_effector_moved(ControlContext& /*context*/, std::size_t /*arm*/, const Pose& X) override {
    follows_.carry(X);
    led_.carry(X);
  }

 private:
  enum Parameter : std::size_t {
    kClutch = kCartesianParameterCount,
    kAlignment,
    kAxes,
    kScale,
    kParameterCount
  };
  enum Output : std::size_t { kLag = kCartesianOutputSize, kSlipped = kLag + 3, kOutputCount };

  // The leader's goal in this tick.
  void lead(const ControlContext& context) {
    const ParameterSet& parameters = *context.parameters;
    const OwnedArm& leader = context.observed[0];
    const ArmModel& own = context.arms[0].model();
    const Matrix3 R_map =
        leading_rotation(static_cast<LeadingAxes>(parameters.choice(kAxes)), leader.model(), own);
    const bool match = parameters.choice(kAlignment) == static_cast<std::size_t>(Alignment::match);
    led_.advance(leader, R_map, match ? 1.0 : parameters.number(kScale));
    if (match) {
      const Pose& X_l = leader.terms->X_WE();
      led_.place({R_map * X_l.rotation,
                  own.X_WB().position + R_map * (X_l.position - leader.model().X_WB().position)});
    }
    if (leader.state->age_s > kLeaderFalters) led_.stand();
  }

  JumpDetector jumps_;
  Clutch clutch_;
  JointVector q_N_;
  LedPose led_;
  FollowingPose follows_;
  RaisedSpring raised_;
};

}  // namespace

ControlletType pose_follower_controllet() { return controllet_type<PoseFollower>(); }

}  // namespace multipanda
