#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "core/controllets/axis_force.hpp"
#include "core/controllets/builtins.hpp"
#include "core/controllets/felt_wrench.hpp"
#include "core/controllets/raised_spring.hpp"

namespace multipanda {
namespace {

constexpr std::size_t kAxes = 6;

// Axes of the force frame, in world axes, and a weight for each.
struct WeightedAxes {
  Matrix3 R = Matrix3::Identity();
  Vector6 weight = Vector6::Zero();

  Vector6 in_frame(const Vector6& x) const {
    Vector6 y;
    y << R.transpose() * x.head<3>(), R.transpose() * x.tail<3>();
    return y;
  }
  Vector6 in_world(const Vector6& y) const {
    Vector6 x;
    x << R * y.head<3>(), R * y.tail<3>();
    return x;
  }
  bool any() const { return (weight.array() > 0).any(); }
  // sqrt(n), by which the common bound of n perpendicular axes is divided. `kind`: 0 forces, 1 moments.
  double parts(std::size_t kind) const {
    return std::sqrt(std::max(1.0, weight.segment<3>(static_cast<Eigen::Index>(3 * kind)).sum()));
  }
  // (I - W) x. Forces and moments have separate projectors, so that no unit is mixed with another.
  Vector6 rest(const Vector6& x) const {
    return in_world(in_frame(x).cwiseProduct(Vector6::Ones() - weight));
  }
};

ParameterSpec number(std::string name, std::string unit, double initial, double min, double max,
                     std::string doc) {
  return {.name = std::move(name),
          .unit = std::move(unit),
          .initial = {initial},
          .min = min,
          .max = max,
          .doc = std::move(doc)};
}

// Force control of one arm along any subset of six axes, moments included, with an impedance along the others
// (Raibert and Craig 1981, with compliance in place of position control).
//   tau = J^T ((I - W) P - D_c V + f - W D_W V) + tau_null + C dq
//   P   = K_c (I - W) x~ + D_c (I - W) V_d + Lambda (I - W) A_d
// W projects on the selected axes of the force frame, translations and rotations each by themselves, and
// fades with the selection; f has a force or moment per selected axis (axis_force.hpp). Along a selected axis
// the set-point follows the arm. World axes, linear first; wrenches [N, N m] are those that the arm exerts,
// at E. Without a selected axis it is `cartesian_impedance`. docs/controllets/force.md.
class HybridForce final : public Controllet {
 public:
  static ControlletDescriptor descriptor() {
    ForceParameters force = force_parameters();
    return {
        .type = "hybrid_force",
        .doc =
            "Controls forces and moments along any subset of six axes; along the others the end effector is "
            "a "
            "spring and damper about its set-point.",
        .inputs = spec_table<kInputCount>(
            input_at<kPose>({.name = "pose",
                             .quantity = Quantity::pose,
                             .doc = "Set-point X_WE, in the world frame; ignored along selected axes."}),
            input_at<kWrench>({.name = "wrench",
                               .quantity = Quantity::wrench,
                               .doc =
                                   "F_d, desired wrench that the arm exerts at E, world axes; its part along "
                                   "selected axes counts.",
                               .max_speed = 60})),
        .parameters = spec_table<kParameterCount>(
            cartesian_parameters(), group_at<kFirstAxis>(axis_selection_parameters()),
            parameter_at<kProportional>(force[kForceProportional]),
            parameter_at<kIntegral>(force[kForceIntegral]),
            parameter_at<kMomentIntegral>(number("moment_integral_per_s", "1/s", 2, 0, 50,
                                                 "Gain I of moments; lower, since rotations are softer.")),
            parameter_at<kCutoff>(force[kErrorCutoff]), parameter_at<kForceLimit>(force[kIntegralLimit]),
            parameter_at<kMomentLimit>(number("moment_integral_limit_nm", "N m", 3, 0, 20,
                                              "Limit of the integral part of a moment.")),
            parameter_at<kForceThreshold>(force[kContactThreshold]),
            parameter_at<kMomentThreshold>(
                number("moment_threshold_nm", "N m", kMomentThresholdNm, 0.1, 10, kMomentThresholdDoc)),
            parameter_at<kLinearDamping>(number("force_damping_n_s_per_m", "N s/m", 100, 0, 300,
                                                "Damping along axes with a force, in addition to that of the "
                                                "impedance; limited by the inertia.")),
            parameter_at<kAngularDamping>(number("moment_damping_nm_s_per_rad", "N m s/rad", 2, 0, 20,
                                                 "The same about axes with a moment.")),
            parameter_at<kApproachSpeed>(
                number("approach_speed_m_per_s", "m/s", 0.02, 0, 0.2,
                       "Speed along an axis with a desired force that touches nothing.")),
            parameter_at<kTurningSpeed>(number("turning_speed_rad_per_s", "rad/s", 0.1, 0, 0.5,
                                               "The same about an axis with a desired moment.")),
            parameter_at<kReach>(number("d_max_m", "m", 0.02, 0.001, 1,
                                        "Width of gamma, which fades a force beyond the last contact.")),
            parameter_at<kAngularReach>(number("phi_max_rad", "rad", 0.1, 0.01, 1, "The same for a moment.")),
            parameter_at<kHybridMotionShare>(motion_share_parameter())),
        .outputs = spec_table<kOutputCount>(
            output_at<kDesired, 3>("desired_force_n", "F_d, axes of the force frame."),
            output_at<kDesired + 3, 3>("desired_moment_nm", "Its moment."),
            output_at<kEstimated, 3>("estimated_force_n", "F_hat at E, axes of the force frame."),
            output_at<kEstimated + 3, 3>("estimated_moment_nm", "Its moment."),
            output_at<kCommand, 3>("commanded_force_n", "f, axes of the force frame."),
            output_at<kCommand + 3, 3>("commanded_moment_nm", "Its moment."),
            output_at<kContact, 6>("in_contact", "1 for each axis along which contact is detected."),
            output_at<kWeight, 6>(
                "axis_weight",
                "Per axis: 1 under force control, 0 under impedance, in between while it fades."),
            output_at<kError, 3>("position_error_m", "p_d - p along axes of the impedance, world axes."),
            output_at<kError + 3, 3>("orientation_error_rad", "log(R_d R^T), the same."),
            output_at<kStiffnessShare>("stiffness_share", kStiffnessShareDoc),
            output_at<kTare>("tare", FeltWrench::kTareDoc)),
        .presets = {}};
  }

  LawResult start(ControlContext& context) override {
    const OwnedArm& arm = context.arms[0];
    if (!arm.state->has_wrench_estimate)
      return LawResult::fault;  // without an estimate the force has no feedback
    q_N_ = arm.q();
    raised_ = {};
    felt_.start(arm);
    for (AxisForce& axis : axis_) axis.start();
    for (ForceRoom& room : room_) room.start();
    frame_ = context.parameters->choice(kFrame);
    R_EF_.setIdentity();
    offset_ = {};
    displaced_ = false;
    waits_ = false;
    bridge_.setZero();
    commanded_.setZero();
    bridging_.reset(false);
    redefined_ = false;
    context.inputs[kPose].bound_hand_speed(std::numeric_limits<double>::infinity(), 0);
    planned_.fill(context.inputs[kPose].planned());
    return LawResult::ok;
  }

  LawResult update(ControlContext& context) override {
    OwnedArm& arm = context.arms[0];
    ModelTerms& terms = *arm.terms;
    const ParameterSet& parameters = *context.parameters;
    felt_.update(arm,
                 std::any_of(axis_.begin(), axis_.end(), [](const AxisForce& a) { return a.pressing(); }),
                 context.dt);
    Vector6 F_d = context.inputs[kWrench].vector();
    const Vector6& F_hat = felt_.at_E();
    if (!F_d.allFinite() || !F_hat.allFinite())
      return LawResult::fault;  // clamping would hide an invalid value
    if (felt_.waits()) F_d.setZero();

    const WeightedAxes axes = select(parameters, context);
    const CartesianTarget target = follow(axes, context);
    ImpedanceGains gains = impedance_gains(parameters, context.contact);
    const double stiffness_share = gains.soften(target.X_W_d.rotation, terms);
    TaskForce force =
        impedance_force(impedance_gains(parameters, context.contact), target, terms, context.dt, raised_);
    waits_ = std::max(force.bounded.force_share, force.bounded.moment_share) > kWaitsFrom;
    Vector6 command = Vector6::Zero();  // f, force frame
    if (axes.any()) {
      const Vector6 pull = project(axes, context.contact, terms.V_WE().vector, force);
      const Vector6 inertia = borne(axes, terms);
      command = axis_forces(axes, gains.stiffness(target.X_W_d.rotation), F_d, F_hat, pull,
                            target.V_d.linear(), inertia, terms, context);
      force.total = pull - force.damping - axes.in_world(damping(axes, parameters, inertia, terms));
    } else {
      watch(axes, F_d, F_hat, terms, context);
    }
    if (redefined_ || bridging_.value() > 0)
      command += bridged(axes, command, terms.V_WE().vector, context.contact.hand_speed, context.dt);
    commanded_ = axes.in_world(command);
    if (!command.isZero(0)) force.total += commanded_;

    *arm.tau = terms.c() + null_space_torque(null_space_gains(parameters, context.contact), arm, q_N_);
    *arm.tau += terms.J_V_WE().transpose().lazyProduct(force.total);
    force.report(context.inputs[kPose]);

    const auto out = context.outputs;
    const Vector6 desired = axes.in_frame(F_d), estimated = axes.in_frame(F_hat);
    std::copy_n(desired.data(), kAxes, out.begin() + kDesired);
    std::copy_n(estimated.data(), kAxes, out.begin() + kEstimated);
    std::copy_n(command.data(), kAxes, out.begin() + kCommand);
    for (std::size_t i = 0; i < kAxes; ++i) out[kContact + i] = axis_[i].in_contact();
    std::copy_n(axes.weight.data(), kAxes, out.begin() + kWeight);
    std::copy_n(force.error.data(), kAxes, out.begin() + kError);
    out[kStiffnessShare] = stiffness_share;
    out[kTare] = static_cast<double>(felt_.tare());
    return arm.tau->allFinite() ? LawResult::ok : LawResult::fault;
  }

  void end_effector_moved(ControlContext& context, std::size_t arm, const Pose& X) override {
    const Pose X_d = set_point(context) * X;
    Controllet::end_effector_moved(context, arm, X);
    offset_.position = X_d.position - context.inputs[kPose].pose().position;
    R_EF_ = X.rotation.transpose() * R_EF_;  // selected axes do not turn with the redefinition
    // The same wrench as before, about the new point.
    const Pose& X_WE = context.arms[arm].terms->X_WE();
    Wrench before;
    before.vector = commanded_;
    commanded_ = shifted(before, (X_WE * X.inverse()).position - X_WE.position).vector;
    redefined_ = true;
  }

 private:
  enum Input : std::size_t { kPose, kWrench, kInputCount };
  enum Parameter : std::size_t {
    kFirstAxis = kCartesianParameterCount,
    kFrame = kFirstAxis + kAxes,
    kProportional,
    kIntegral,
    kMomentIntegral,
    kCutoff,
    kForceLimit,
    kMomentLimit,
    kForceThreshold,
    kMomentThreshold,
    kLinearDamping,
    kAngularDamping,
    kApproachSpeed,
    kTurningSpeed,
    kReach,
    kAngularReach,
    kHybridMotionShare,
    kParameterCount
  };
  enum Output : std::size_t {
    kDesired,
    kEstimated = kDesired + kAxes,
    kCommand = kEstimated + kAxes,
    kContact = kCommand + kAxes,
    kWeight = kContact + kAxes,
    kError = kWeight + kAxes,
    kStiffnessShare = kError + kAxes,
    kTare,
    kOutputCount
  };

  // Moments fall with the speed along them, from half of kTurnLimit on, and end at kTopTurning [rad/s].
  static constexpr double kTurnLimit = 0.5, kTopTurning = 1.5;
  // Largest slope of force and damping of an axis over its speed, divided by its inertia [1/s]: they act some
  // periods late (damping_design.hpp), and several axes may share a mode.
  static constexpr double kSteepest = 200, kDamping = 60;
  // The wrench of the old end effector decays faster by this where the hand moves, since nothing resists
  // it there.
  static constexpr double kYields = 10;
  static constexpr double kReturnTime = 0.3, kReturnSpeed = 0.05, kReturnTurning = 0.2;  // [s, m/s, rad/s]
  static constexpr double kReturnShare = 0.2;  // of the hand's speed
  static constexpr double kWaitsFrom = 0.8;    // share of the allowed pull

  Pose set_point(const ControlContext& context) const {
    const Pose& X = context.inputs[kPose].pose();
    return displaced_ ? Pose{offset_.rotation * X.rotation, X.position + offset_.position} : X;
  }

  // Advances the selection. Another force frame is taken when no axis has a force any more.
  WeightedAxes select(const ParameterSet& parameters, const ControlContext& context) {
    const bool idle = std::all_of(axis_.begin(), axis_.end(), [](const auto& axis) { return axis.idle(); });
    if (idle) {
      frame_ = parameters.choice(kFrame);
      R_EF_.setIdentity();
    }
    WeightedAxes axes;
    if (frame_ != 0) axes.R = context.arms[0].terms->X_WE().rotation * R_EF_;
    for (std::size_t i = 0; i < kAxes; ++i) {
      axis_[i].select(parameters.flag(kFirstAxis + i) && frame_ == parameters.choice(kFrame), context.dt);
      axes.weight[static_cast<Eigen::Index>(i)] = axis_[i].weight();
    }
    return axes;
  }

  // The set-point, which follows the arm along the axes that the impedance has left, and from there on holds
  // still along an axis that is released, until the next goal of the input.
  CartesianTarget follow(const WeightedAxes& axes, ControlContext& context) {
    Reference& input = context.inputs[kPose];
    const double most = context.contact.hand_speed;
    const double back = displaced_ ? come_back(axes, input, most, context.dt) : 0;
    input.bound_hand_speed(back > 0 ? most - back : std::numeric_limits<double>::infinity(), 0);
    CartesianTarget target = CartesianTarget::of(input);
    target.X_W_d = set_point(context);
    if (displaced_) {
      target.V_d.angular() = offset_.rotation * target.V_d.angular();
      target.A_d.angular() = offset_.rotation * target.A_d.angular();
    }
    if (!axes.any()) return target;
    const Pose& X = context.arms[0].terms->X_WE();
    const Vector6 error = pose_error(target.X_W_d, X);
    Vector6 kept = axes.in_frame(error), raised = axes.in_frame(raised_.offset());
    for (std::size_t i = 0; i < kAxes; ++i) {
      if (axis_[i].full()) kept[static_cast<Eigen::Index>(i)] = raised[static_cast<Eigen::Index>(i)] = 0;
      if (!axis_[i].idle()) planned_[i] = input.planned();
    }
    const Pose X_kept = displaced(X, axes.in_world(kept));
    offset_ = {X_kept.rotation * input.pose().rotation.transpose(), X_kept.position - input.pose().position};
    displaced_ = true;
    // The spring acts from `ahead` of the target; the two together are what the force leaves.
    const Vector6 ahead = axes.in_world(raised);
    if (!raised_.none()) raised_.put(ahead);
    target.X_W_d = displaced(X, axes.rest(error + ahead) - ahead);
    target.V_d.vector = axes.rest(target.V_d.vector);
    target.A_d.vector = axes.rest(target.A_d.vector);
    return target;
  }

  // The pose whose error relative to X is this.
  static Pose displaced(const Pose& X, const Vector6& error) {
    return {exp_rotation(error.tail<3>()) * X.rotation, X.position + error.head<3>()};
  }

  // After the next goal, the set-point comes back to that of the input along released axes, in addition to
  // the input's own motion. Returns its speed [m/s].
  double come_back(const WeightedAxes& axes, const Reference& input, double hand_speed, double dt) {
    Vector6 offset;
    offset << offset_.position, log_rotation(offset_.rotation);
    Vector6 left = axes.in_frame(offset), step = Vector6::Zero();
    for (std::size_t i = 0; i < kAxes; ++i) {
      const auto k = static_cast<Eigen::Index>(i);
      if (!waits_ && axis_[i].idle() && planned_[i] != input.planned()) step[k] = left[k] * dt / kReturnTime;
    }
    const auto clamp = [](auto part, double most) {
      const double size = part.norm();
      if (size > most) part *= most / size;
    };
    clamp(step.head<3>(), std::min(kReturnSpeed, kReturnShare * hand_speed) * dt);
    clamp(step.tail<3>(), kReturnTurning * dt);
    left -= step;
    constexpr double kThere = 1e-7;
    if (!axes.any() && left.norm() < kThere) {
      offset_ = {};
      displaced_ = false;
    } else if (!step.isZero(0)) {
      offset = axes.in_world(left);
      offset_ = {exp_rotation(offset.tail<3>()), offset.head<3>()};
    }
    return step.head<3>().norm() / dt;
  }

  // The pull that the projection leaves, damping aside. It may point elsewhere than before, along a faster
  // motion, so it is bounded again.
  static Vector6 project(const WeightedAxes& axes, const ContactBounds& contact, const Vector6& V,
                         TaskForce& force) {
    const Vector6 pull = axes.rest(force.total + force.damping);
    force.pull = axes.rest(force.pull);
    const BoundedPull again = bound_pull(contact, pull, force.damping, V.head<3>());
    force.bounded.force_share = std::max(force.bounded.force_share, again.force_share);
    force.bounded.moment_share = std::max(force.bounded.moment_share, again.moment_share);
    return again.remaining(pull);
  }

  // Another end effector means other moments and another point for the forces: fades from the old wrench to
  // the new one. Returns the part to add, force frame.
  Vector6 bridged(const WeightedAxes& axes, const Vector6& command, const Vector6& V, double hand_speed,
                  double dt) {
    if (redefined_) {
      bridge_ = commanded_ - axes.in_world(command);
      bridging_.reset(true);
      redefined_ = false;
    }
    const Vector6 left = axes.in_frame(bridge_) * bridging_.value();
    const bool moves = V.head<3>().norm() > 0.5 * hand_speed || V.tail<3>().norm() > 0.5 * kTurnLimit;
    bridging_.towards(false, moves ? kYields * dt : dt);
    return left;
  }

  // Contact is also shown for axes that are not selected.
  void watch(const WeightedAxes& axes, const Vector6& F_d, const Vector6& F_hat, ModelTerms& terms,
             const ControlContext& context) {
    const Vector6 desired = axes.in_frame(F_d), estimated = axes.in_frame(F_hat);
    const Vector6 V = axes.in_frame(terms.V_WE().vector);
    const AxisSettings settings[] = {force_axis(axes, context, Vector3::Zero()), moment_axis(axes, context)};
    for (std::size_t i = 0; i < kAxes; ++i) {
      const auto k = static_cast<Eigen::Index>(i);
      axis_[i].update(settings[i / 3], {.desired = desired[k], .estimated = estimated[k], .speed = V[k]},
                      context.dt);
    }
  }

  Vector6 axis_forces(const WeightedAxes& axes, const TaskStiffness& K, const Vector6& F_d,
                      const Vector6& F_hat, const Vector6& pull, const Vector3& goal_speed,
                      const Vector6& inertia, ModelTerms& terms, ControlContext& context) {
    const ContactBounds& contact = context.contact;
    const Vector6 desired = axes.in_frame(F_d), estimated = axes.in_frame(F_hat);
    const Vector6 V = axes.in_frame(terms.V_WE().vector), pulled = axes.in_frame(pull);
    Vector6 stiffness, command;
    stiffness << (axes.R.transpose() * K.translation * axes.R).diagonal(),
        (axes.R.transpose() * K.rotation * axes.R).diagonal();
    const double room[] = {room_for(0, axes, pulled.head<3>(), contact.spring_force, context.dt),
                           room_for(1, axes, pulled.tail<3>(), contact.spring_moment, context.dt)};
    const AxisSettings settings[] = {force_axis(axes, context, goal_speed), moment_axis(axes, context)};
    // All axes of a kind together respect the bound.
    const double limit[] = {contact.hand_speed / axes.parts(0), turn_limit(axes, contact)};
    // The force allowed without reaction ends at 1.5 times the limit, or at kTopTurning, but never falls more
    // steeply than the axis is stable with.
    const double falls[] = {limit[0], (kTopTurning / kTurnLimit - 0.5) * limit[1]};
    for (std::size_t i = 0; i < kAxes; ++i) {
      const auto k = static_cast<Eigen::Index>(i);
      const std::size_t kind = i / 3;
      const double steepest = kSteepest * inertia[k];
      const AxisState now{.desired = desired[k],
                          .estimated = estimated[k],
                          .speed = V[k],
                          .stiffness = stiffness[k],
                          .room = room[kind],
                          .pull = pulled[k],
                          .unfelt = steepest * falls[kind],
                          .slow = 0.5 * limit[kind]};
      const double f = axis_[i].update(settings[kind], now, context.dt);
      command[k] = f * share_at_axis_speed(f, f < 0 ? -V[k] : V[k], limit[kind], steepest);
    }
    // While axes fade, the pull along them is not perpendicular to their forces.
    command.head<3>() *= largest_share(pulled.head<3>(), command.head<3>(), contact.spring_force);
    command.tail<3>() *= largest_share(pulled.tail<3>(), command.tail<3>(), contact.spring_moment);
    return command;
  }

  // Bound of each selected axis: all of them, with the pull across them, respect the total.
  double room_for(std::size_t kind, const WeightedAxes& axes, const Vector3& pulled, double most, double dt) {
    const Vector3 weight = axes.weight.segment<3>(static_cast<Eigen::Index>(3 * kind));
    const Vector3 across = (weight.array() > 0).select(0.0, pulled);
    return room_[kind].update(left_beside(across, most), most, dt) / axes.parts(kind);
  }

  // The limit of each moment's speed; infinite where speeds are not bounded [rad/s].
  static double turn_limit(const WeightedAxes& axes, const ContactBounds& contact) {
    return std::isfinite(contact.hand_speed) ? kTurnLimit / axes.parts(1) : contact.hand_speed;
  }

  static Vector6 borne(const WeightedAxes& axes, ModelTerms& terms) {
    Matrix6 turn = Matrix6::Zero();
    turn.topLeftCorner<3, 3>() = turn.bottomRightCorner<3, 3>() = axes.R;
    return borne_inertias(turn.transpose() * terms.task().mobility * turn, axes.weight);
  }

  // W D_W V, force frame.
  static Vector6 damping(const WeightedAxes& axes, const ParameterSet& parameters, const Vector6& inertia,
                         ModelTerms& terms) {
    Vector6 d;
    d << Vector3::Constant(parameters.number(kLinearDamping)),
        Vector3::Constant(parameters.number(kAngularDamping));
    d = d.cwiseMin(kDamping * inertia);
    return axes.weight.cwiseProduct(d).cwiseProduct(axes.in_frame(terms.V_WE().vector));
  }

  // v_a uses the part of the hand's speed left by the set-point's motion across the selected axes.
  AxisSettings force_axis(const WeightedAxes& axes, const ControlContext& context,
                          const Vector3& goal_speed) const {
    const ParameterSet& parameters = *context.parameters;
    const double left = left_beside(goal_speed, context.contact.hand_speed) / axes.parts(0);
    return {kForceAxis,
            gains(parameters, kIntegral, kForceLimit),
            parameters.number(kForceThreshold) + felt_.motion(parameters.number(kHybridMotionShare)),
            std::min(parameters.number(kApproachSpeed), left),
            parameters.number(kReach),
            felt_.doubt(parameters.number(kHybridMotionShare))};
  }
  AxisSettings moment_axis(const WeightedAxes& axes, const ControlContext& context) const {
    const ParameterSet& parameters = *context.parameters;
    return {kMomentAxis,
            gains(parameters, kMomentIntegral, kMomentLimit),
            parameters.number(kMomentThreshold) + felt_.turning(parameters.number(kHybridMotionShare)),
            std::min(parameters.number(kTurningSpeed), turn_limit(axes, context.contact)),
            parameters.number(kAngularReach),
            felt_.turning_doubt(parameters.number(kHybridMotionShare))};
  }
  static ForceGains gains(const ParameterSet& parameters, std::size_t integral, std::size_t limit) {
    return {.proportional = parameters.number(kProportional),
            .integral_per_s = parameters.number(integral),
            .error_cutoff_hz = parameters.number(kCutoff),
            .integral_limit_n = parameters.number(limit)};
  }

  JointVector q_N_;
  RaisedSpring raised_;
  FeltWrench felt_;
  std::array<AxisForce, kAxes> axis_;
  std::array<ForceRoom, 2> room_;       // of forces and of moments
  std::size_t frame_ = 0;               // of the axes that are selected now
  Matrix3 R_EF_ = Matrix3::Identity();  // the force frame in E, if it moves with E
  Pose offset_;                         // of the set-point relative to the input: R_d = R_o R, p_d = p + p_o
  bool displaced_ = false, waits_ = false;
  std::array<std::uint64_t, kAxes> planned_{};  // goals of the input while the axis had a force
  // The wrench of the axes in the last tick, about E as it is now, and what is left of it after E was
  // redefined. World axes [N, N m].
  Vector6 commanded_ = Vector6::Zero(), bridge_ = Vector6::Zero();
  Fade bridging_;
  bool redefined_ = false;
};

}  // namespace

ControlletType hybrid_force_controllet() { return controllet_type<HybridForce>(); }

}  // namespace multipanda
