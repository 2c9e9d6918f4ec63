#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "core/controllets/builtins.hpp"
#include "core/controllets/following.hpp"
#include "core/controllets/raised_spring.hpp"
#include "core/types/carriage_speed.hpp"

namespace multipanda {
namespace {

// One arm follows the joints of another, which it observes and does not own. Law, alignment, clutch and
// parameters: docs/controllets/teleoperation.md.
class JointFollower final : public Controllet {
 public:
  explicit JointFollower(ArmModels arms) {
    if (arms[0]->joint_count() == arms[1]->joint_count()) {
      for (std::size_t i = 0; i < arms[0]->joint_count(); ++i) {
        if (arms[0]->is_prismatic(i) == arms[1]->is_prismatic(i)) continue;
        throw std::invalid_argument("joint_follower: joint " + std::to_string(i + 1) + " of '" +
                                    arms[0]->name() + "' and of its leader '" + arms[1]->name() +
                                    "' are not of the same type, revolute or prismatic; use pose_follower");
      }
      return;
    }
    throw std::invalid_argument("joint_follower: '" + arms[0]->name() + "' has " +
                                std::to_string(arms[0]->joint_count()) + " joints, its leader '" +
                                arms[1]->name() + "' " + std::to_string(arms[1]->joint_count()) +
                                "; expected the same number, use pose_follower");
  }

  static ControlletDescriptor descriptor() {
    return {.type = "joint_follower",
            .doc = "The joints follow those of another arm, the leader, which it observes and does not own.",
            .observes = 1,
            .parameters = spec_table<kParameterCount>(
                parameter_at<kStiffness>(joint_stiffness_parameter()),
                parameter_at<kDampingRatio>(joint_damping_ratio_parameter()),
                parameter_at<kClutch>(clutch_parameter()), parameter_at<kAlignment>(alignment_parameter()),
                parameter_at<kScale>({.name = "joint_scale",
                                      .size = ParameterSpec::kPerJoint,
                                      .initial = {1},
                                      .min = -2,
                                      .max = 2,
                                      .doc = "Motion of each joint per motion of the leader's; -1 mirrors. "
                                             "With 'match' only its sign counts."})),
            .outputs = spec_table<kOutputCount>(
                output_at<kLargestError>("largest_error_rad", "Largest |q_d - q| of all joints."),
                output_at<kLargestLag>("largest_lag_rad",
                                       "Largest distance of a joint's set-point from the leader's goal."),
                output_at<kSlipped>("slipped", kSlippedDoc),
                output_at<kStiffnessShare>("stiffness_share", kStiffnessShareDoc))};
  }

  LawResult start(ControlContext& context) override {
    const JointVector& q = context.arms[0].q();
    q_led_ = q_d_ = q_begin_ = q;
    yields_ = false;
    raised_ = {};
    strain_ = 0;
    clutch_.start();
    q_leader_ = context.observed[0].q();
    jumps_.start(context.observed[0]);
    motion_.start(q.size());
    resistance_.start(q.size(), Resistance::Waits::all);
    return LawResult::ok;
  }

  LawResult update(ControlContext& context) override {
    if (jumps_.jumped(context.observed[0])) return LawResult::fault;
    OwnedArm& arm = context.arms[0];
    const ParameterSet& parameters = *context.parameters;
    const Elbow elbow(*arm.terms);
    const JointVector dq_led = lead(context);
    if (clutch_.turn(parameters.flag(kClutch), left_behind(context), strain_, context.dt)) {
      yields_ = false;
      follow(q_goal_, dq_led, elbow, context);
    } else {
      brake(elbow, context);
    }
    JointGains gains{.stiffness = parameters.joints(kStiffness),
                     .damping_ratio = parameters.number(kDampingRatio),
                     .elbow = &elbow};
    const JointTarget target{q_d_, motion_.velocity(), motion_.acceleration()};
    JointPull pull;
    const LawResult result =
        joint_impedance_law(gains, target, arm.dq(), context.contact, arm, context.dt, raised_, pull);
    resistance_.update(pull.torque, pull.share, context.dt);
    strain_ = pull.strain;
    context.outputs[kLargestError] = (q_d_ - arm.q()).lpNorm<Eigen::Infinity>();
    context.outputs[kLargestLag] = (q_goal_ - q_d_).lpNorm<Eigen::Infinity>();
    context.outputs[kSlipped] = clutch_.slipped() ? 1 : 0;
    context.outputs[kStiffnessShare] = pull.stiffness_share;
    return result;
  }

 private:
  enum Parameter : std::size_t { kStiffness, kDampingRatio, kClutch, kAlignment, kScale, kParameterCount };
  enum Output : std::size_t { kLargestError, kLargestLag, kSlipped, kStiffnessShare, kOutputCount };

  // Limits of the vector of all joints.
  static constexpr double kSpeed = 1, kAcceleration = 2.5, kJerk = 200;  // [rad/s], [rad/s^2], [rad/s^3]

  // Largest lag of all joints together [rad].
  static constexpr double kLargestLagOfAJoint = 0.6;

  // Moves q_led_ with the leader, and q_goal_, which stays within the arm's own limits or where it began.
  // Returns the goal's velocity.
  JointVector lead(const ControlContext& context) {
    constexpr double kMargin = 0.05;  // to the ends of the range [rad]
    const ParameterSet& parameters = *context.parameters;
    const OwnedArm& leader = context.observed[0];
    const JointVector scale = parameters.joints(kScale);
    const bool match = parameters.choice(kAlignment) == static_cast<std::size_t>(Alignment::match);
    const JointVector sign = scale.unaryExpr([](double s) { return s < 0 ? -1.0 : s > 0 ? 1.0 : 0.0; });
    const JointVector& factor = match ? sign : scale;
    if (match) {
      q_led_ = sign.cwiseProduct(leader.q()).array() + (sign.array() == 0).select(q_begin_.array(), 0.0);
    } else {
      q_led_ += scale.cwiseProduct(leader.q() - q_leader_);
    }
    q_leader_ = leader.q();
    JointVector dq_led = factor.cwiseProduct(leader.dq());
    if (leader.state->age_s > kLeaderFalters) dq_led.setZero();
    const ArmLimits& own = context.arms[0].model().limits();
    const JointVector low = (own.q_min.array() + kMargin).min(q_begin_.array());
    const JointVector high = (own.q_max.array() - kMargin).max(q_begin_.array());
    q_goal_ = q_led_.cwiseMax(low).cwiseMin(high);
    for (Eigen::Index i = 0; i < dq_led.size(); ++i) {
      if (q_goal_[i] != q_led_[i]) dq_led[i] = 0;
    }
    return dq_led;
  }

  bool left_behind(const ControlContext& context) const {
    const JointVector lag = q_goal_ - q_d_;
    const Jacobian& J = context.arms[0].terms->J_V_WE();
    const Vector3 of_hand = J.topRows<3>().lazyProduct(lag);
    return lag.lpNorm<Eigen::Infinity>() > kLargestLagOfAJoint ||
           std::max(of_hand.norm(), carriage_speed(J, lag)) > largest_lag(context.contact);
  }

  void follow(const JointVector& goal, const JointVector& dq_goal, const Elbow& elbow,
              const ControlContext& context) {
    const FollowingLimits limits{
        .first = 0, .count = q_d_.size(), .speed = kSpeed, .acceleration = kAcceleration, .jerk = kJerk};
    JointVector v_w = motion_.desired(goal - q_d_, dq_goal, limits, resistance_, context.dt);
    const Jacobian& J = context.arms[0].terms->J_V_WE();
    const Vector3 hand = J.topRows<3>().lazyProduct(v_w);
    const double fastest = std::max({hand.norm(), elbow.velocity(v_w).norm(), carriage_speed(J, v_w)});
    if (fastest > context.contact.hand_speed) v_w *= context.contact.hand_speed / fastest;
    motion_.advance(v_w, limits, context.dt);
    q_d_ += context.dt * motion_.velocity();
  }

  // Brakes to rest; an arm that is pulled hard yields to its position. Following begins again from here.
  void brake(const Elbow& elbow, const ControlContext& context) {
    if (!yields_ && motion_.rests() && strain_ > kYieldsFrom) {
      yields_ = true;
      q_yields_ = context.arms[0].q();
    }
    const JointVector where_it_would_be = q_d_ + context.dt * motion_.velocity();
    follow(yields_ ? q_yields_ : where_it_would_be, JointVector::Zero(q_d_.size()), elbow, context);
    q_led_ = q_goal_ = q_d_;
  }

  JumpDetector jumps_;
  Clutch clutch_;
  bool yields_ = false;
  double strain_ = 0;  // in the last tick
  JointVector q_led_, q_goal_, q_leader_, q_d_, q_begin_, q_yields_;
  FollowingMotion motion_;
  RaisedJoints raised_;
  Resistance resistance_;
};

}  // namespace

ControlletType joint_follower_controllet() { return controllet_type<JointFollower>(); }

}  // namespace multipanda
