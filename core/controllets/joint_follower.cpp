#include "core/controllets/joint_follower.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "core/controllets/following.hpp"
#include "core/controllets/joint_law.hpp"

namespace multipanda {
namespace {

class JointFollower final : public Controllet {
 public:
  explicit JointFollower(ArmModels arms) {
    if (arms[0]->joint_count() == arms[1]->joint_count()) return;
    throw std::invalid_argument("joint_follower: '" + arms[0]->name() + "' has " +
                                std::to_string(arms[0]->joint_count()) + " joints, its leader '" +
                                arms[1]->name() + "' " + std::to_string(arms[1]->joint_count()) +
                                "; expected the same number, use pose_follower");
  }

  static ControlletDescriptor descriptor() {
    return {
        .type = "joint_follower",
        .doc = "The joints follow those of another arm, the leader, which it observes and does not own.",
        .observes = 1,
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
            parameter_at<kClutch>(clutch_parameter()), parameter_at<kAlignment>(alignment_parameter()),
            parameter_at<kScale>({.name = "joint_scale",
                                  .size = ParameterSpec::kPerJoint,
                                  .initial = {1},
                                  .min = -2,
                                  .max = 2,
                                  .doc = "Way of each joint for a way of the leader's; -1 mirrors. Beside "
                                         "'match' only its sign counts."})),
        .outputs = spec_table<kOutputCount>(
            output_at<kLargestError>("largest_error_rad", "Largest |q_d - q| of all joints."),
            output_at<kLargestLag>("largest_lag_rad",
                                   "Largest way of a joint from its set-point to where the leader leads."))};
  }

  LawResult start(ControlContext& context) override {
    const JointVector& q = context.arms[0].q();
    q_led_ = q_d_ = q_begin_ = q;
    q_leader_ = context.observed[0].q();
    watch_.start(context.observed[0]);
    motion_.start(q.size());
    resistance_.start(q.size(), Resistance::Waits::all);
    return LawResult::ok;
  }

  LawResult update(ControlContext& context) override {
    if (watch_.jumped(context.observed[0])) return LawResult::fault;
    OwnedArm& arm = context.arms[0];
    const ParameterSet& parameters = *context.parameters;
    const JointVector dq_led = lead(context);
    follow(dq_led, context);
    JointGains gains{.stiffness = parameters.joints(kStiffness),
                     .damping_ratio = parameters.number(kDampingRatio)};
    const JointTarget target{q_d_, motion_.velocity(), motion_.acceleration()};
    JointPull pull;
    const LawResult result = joint_impedance_law(gains, target, context.contact, arm, pull);
    resistance_.update(pull.torque, pull.share, context.dt);
    context.outputs[kLargestError] = (q_d_ - arm.q()).lpNorm<Eigen::Infinity>();
    context.outputs[kLargestLag] = (q_led_ - q_d_).lpNorm<Eigen::Infinity>();
    return result;
  }

 private:
  enum Parameter : std::size_t { kStiffness, kDampingRatio, kClutch, kAlignment, kScale, kParameterCount };
  enum Output : std::size_t { kLargestError, kLargestLag, kOutputCount };

  // They limit the vector of all joints.
  static constexpr double kSpeed = 1, kAcceleration = 2.5, kJerk = 200;  // [rad/s], [rad/s^2], [rad/s^3]

  // Moves q_led_ with the leader; returns its velocity.
  JointVector lead(const ControlContext& context) {
    const ParameterSet& parameters = *context.parameters;
    const OwnedArm& leader = context.observed[0];
    const JointVector scale = parameters.joints(kScale);
    const bool match = parameters.choice(kAlignment) == static_cast<std::size_t>(Alignment::match);
    const JointVector sign = scale.unaryExpr([](double s) { return s < 0 ? -1.0 : 1.0; });
    const JointVector& factor = match ? sign : scale;
    if (!parameters.flag(kClutch)) {
      q_led_ = q_d_ + context.dt * motion_.velocity();  // where it would be: it brakes
    } else if (match) {
      q_led_ = sign.cwiseProduct(leader.q());
    } else {
      q_led_ += scale.cwiseProduct(leader.q() - q_leader_);
    }
    q_leader_ = leader.q();
    if (!parameters.flag(kClutch) || leader.state->age_s > kLeaderFalters) {
      return JointVector::Zero(q_d_.size());
    }
    return factor.cwiseProduct(leader.dq());
  }

  // The set-point stays within the arm's own limits, or where it began.
  void follow(const JointVector& dq_led, const ControlContext& context) {
    const OwnedArm& arm = context.arms[0];
    const ArmLimits& own = arm.model().limits();
    const JointVector low = own.q_min.cwiseMin(q_begin_), high = own.q_max.cwiseMax(q_begin_);
    const JointVector goal = q_led_.cwiseMax(low).cwiseMin(high);
    const FollowingLimits limits{
        .first = 0, .count = q_d_.size(), .speed = kSpeed, .acceleration = kAcceleration, .jerk = kJerk};
    JointVector dq_goal = dq_led;
    for (Eigen::Index i = 0; i < dq_goal.size(); ++i) {
      if (goal[i] != q_led_[i]) dq_goal[i] = 0;
    }
    JointVector v_w = motion_.desired(goal - q_d_, dq_goal, limits, resistance_, context.dt);
    if (std::isfinite(context.contact.hand_speed)) {
      const double hand = arm.terms->J_V_WE().topRows<3>().lazyProduct(v_w).norm();
      if (hand > context.contact.hand_speed) v_w *= context.contact.hand_speed / hand;
    }
    motion_.advance(v_w, limits, context.dt);
    q_d_ += context.dt * motion_.velocity();
  }

  LeaderWatch watch_;
  JointVector q_led_, q_leader_, q_d_, q_begin_;
  FollowingMotion motion_;
  Resistance resistance_;
};

}  // namespace

ControlletType joint_follower_controllet() { return controllet_type<JointFollower>(); }

}  // namespace multipanda
