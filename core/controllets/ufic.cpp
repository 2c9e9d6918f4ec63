#include "core/controllets/ufic.hpp"

#include <algorithm>

#include "core/controllets/cartesian_law.hpp"
#include "core/controllets/damping_design.hpp"
#include "core/controllets/energy_balance.hpp"
#include "core/controllets/energy_tank.hpp"
#include "core/controllets/force_law.hpp"

namespace multipanda {
namespace {

// The task spring in one tick; the tank supplies its energy when the set-point moves.
struct SpringState {
  TaskStiffness stiffness{Matrix3::Zero(), Matrix3::Zero()};
  Pose X_d;
  double scale = 1;   // s
  double energy = 0;  // V at the tick's pose, not scaled [J]

  double energy_at(const Pose& X) const { return spring_energy(stiffness, pose_error(X_d, X)); }
};

class Ufic final : public Controllet {
 public:
  static ControlletDescriptor descriptor() {
    CartesianParameters cartesian = cartesian_parameters();
    // Stiff along the ground: joint friction displaces the path by friction over stiffness.
    cartesian[kTranslationalStiffness].initial = {800, 800, 400};
    return {
        .type = "ufic",
        .doc =
            "Unified force-impedance control: follows a pose and presses with a force; two energy tanks "
            "keep it passive.",
        .inputs = spec_table<kInputCount>(
            input_at<kPose>(
                {.name = "pose", .quantity = Quantity::pose, .doc = "Set-point X_WE, in the world frame."}),
            input_at<kWrench>(wrench_input())),
        .parameters = spec_table<kParameterCount>(
            cartesian, group_at<kForceGroup>(force_parameters()),
            parameter_at<kValveLaw>(choice_parameter(
                "valve_law", {"passive", "paper"},
                "How gamma and alpha_f scale the force part; 'paper', as printed, is not passive.")),
            parameter_at<kReach>({.name = "d_max_m",
                                  .unit = "m",
                                  .initial = {0.02},
                                  .min = 0.001,
                                  .max = 1,
                                  .doc = "Width of gamma: the force fades away from the last contact."}),
            parameter_at<kTankStart>(
                {.name = "tank_start_j",
                 .unit = "J",
                 .initial = {100},
                 .max = 1000,
                 .doc =
                     "Initial energy of both tanks, clamped to their limits. The paper's K_p |F_d|^2 / 2 is "
                     "above 100 J for any force above 1 N."}),
            parameter_at<kTankMin>({.name = "tank_min_j",
                                    .unit = "J",
                                    .initial = {0},
                                    .max = 1000,
                                    .doc = "Minimum energy E_min."}),
            parameter_at<kTankMax>({.name = "tank_max_j",
                                    .unit = "J",
                                    .initial = {100},
                                    .max = 1000,
                                    .doc = "Maximum energy E_max; energy returned above it is lost."}),
            parameter_at<kTankClosing>({.name = "tank_closing_j",
                                        .unit = "J",
                                        .initial = {0.1},
                                        .min = 0.01,
                                        .max = 10,
                                        .doc = "Range above E_min over which the valves close."}),
            parameter_at<kPressDirection>(press_direction_parameter()),
            parameter_at<kFeedback>(choice_parameter(
                "force_feedback", {"in_contact", "always"},
                "When the feedback of the force acts: faded in at contact, or always as the paper prints it, "
                "which pushes in free air, too."))),
        .outputs = spec_table<kOutputCount>(
            output_at<kDesired>("force_desired_n", "F_d along n."),
            output_at<kEstimated>("force_estimated_n", "F_hat along n."),
            output_at<kCommand>("force_command_n", "F_f' along n."),
            output_at<kInContact>("in_contact", "1 while contact is detected, otherwise 0."),
            output_at<kGamma>("gamma_f", "gamma about the last contact."),
            output_at<kAlphaForce>("alpha_f", "Valve of the force tank."),
            output_at<kAlphaImpedance>("alpha_i",
                                       "Valve of the impedance tank: 0 keeps the spring, -1 removes it."),
            output_at<kForceTank>("force_tank_j", "Energy of the force tank."),
            output_at<kImpedanceTank>("impedance_tank_j", "Energy of the impedance tank."),
            output_at<kStored>("stored_energy_j", "Kinetic energy + spring + both tanks."),
            output_at<kSpringPower>("power_task_spring_w",
                                    "Power of the spring into the arm, mean of the last period."),
            output_at<kDampingPower>("power_task_damping_w", "The same for -D_c V."),
            output_at<kFeedforwardPower>("power_feedforward_w",
                                         "The same for the set-point's part, (D_c + D_z) V_d + Lambda A_d."),
            output_at<kNullSpacePower>("power_nullspace_w", "The same for the null space."),
            output_at<kCoriolisPower>("power_coriolis_w", "The same for C dq."),
            output_at<kForcePower>("power_force_w", "The same for F_f'."),
            output_at<kForceDampingPower>("power_force_damping_w", "The same for D_z."),
            output_at<kSetPointPower>("power_set_point_w",
                                      "Power into the spring by changes of set-point, stiffness and valve."),
            output_at<kOtherPower>("power_other_w", "Power into the arm by features and limits."),
            output_at<kCreated>("energy_made_up_j", "Valve law 'paper': energy that empty tanks supplied."),
            output_at<kAcross, 3>("tangential_force_n", "Part of F_f' across n, world axes."),
            output_at<kError, 3>("position_error_m", "p_d - p, world axes."),
            output_at<kError + 3, 3>("orientation_error_rad", "log(R_d R^T), world axes.")),
        .presets = {paper_preset({{"force_proportional", {1}},
                                  {"force_derivative_s", {0.05}},
                                  {"force_integral_per_s", {0.25}},
                                  {"force_feedforward", {0}},
                                  {"force_may_pull", {1}},
                                  {"force_feedback", {1}},
                                  {"valve_law", {1}},
                                  {"d_max_m", {0.05}},
                                  {"force_damping_n_s_per_m", {0}},
                                  {"tangential_gain", {0}}})}};
  }

  LawResult start(ControlContext& context) override {
    OwnedArm& arm = context.arms[0];
    if (!arm.state->has_wrench_estimate)
      return LawResult::fault;  // without an estimate the force has no feedback
    const ParameterSet& parameters = *context.parameters;
    q_N_ = arm.q();
    p_c_ = arm.terms->X_WE().position;
    touched_ = false;
    gamma_ = 0;
    direction_.start(parameters.vector3(kPressDirection));
    detector_.start();
    loop_.start();
    room_.start();
    fade_.reset(false);
    across_.reset(Vector3::Zero());
    limits_ = tank_limits(parameters);
    balance_.start(context.arms, parameters.number(kTankStart), limits_);
    alpha_f_ = balance_.force.valve(limits_);
    const CartesianTarget target = CartesianTarget::of(context.inputs[kPose]);
    const ImpedanceGains gains = impedance_gains(parameters);
    spring_ = {gains.stiffness(target.X_W_d.rotation), target.X_W_d, balance_.impedance.valve(limits_), 0};
    spring_.energy = spring_.energy_at(arm.terms->X_WE());
    return LawResult::ok;
  }

  LawResult update(ControlContext& context) override {
    OwnedArm& arm = context.arms[0];
    ModelTerms& terms = *arm.terms;
    const ParameterSet& parameters = *context.parameters;
    limits_ = tank_limits(parameters);
    const ValveLaw law = static_cast<ValveLaw>(parameters.choice(kValveLaw));
    const CartesianTarget target = CartesianTarget::of(context.inputs[kPose]);
    const ImpedanceGains gains = impedance_gains(parameters);

    update_energy_balance(context.arms, law);
    // Impedance part
    const Vector6 V = terms.V_WE().vector;
    const Matrix6& Lambda = terms.task().Lambda;
    const Matrix6 K = gains.stiffness(target.X_W_d.rotation).matrix();
    const Matrix6 D = gains.damping(target.X_W_d.rotation, K, terms);
    const double set_point_work = move_spring(target, gains, terms.X_WE(), V, D * V, context);
    const double s = spring_.scale;
    const Vector6 error = pose_error(target.X_W_d, terms.X_WE());
    const Vector6 spring = s * spring_wrench(spring_.stiffness, error);
    const bool of_error = gains.damping_of == DampingOf::error;
    Vector6 feedforward = of_error ? Vector6(s * (D * target.V_d.vector)) : Vector6(Vector6::Zero());
    if (gains.acceleration_feedforward) feedforward.noalias() += s * (Lambda * target.A_d.vector);
    if (gains.coriolis_feedforward) feedforward += s * terms.task_coriolis(target.V_d.vector);
    Vector6 opposing = D * V;
    // D_z dissipates against the velocity; with the velocity of the set-point it may supply energy.
    const ForceSettings settings = force_settings(parameters, kForceGroup);
    const Vector3 F_d = context.inputs[kWrench].vector().head<3>();
    const Vector3 F_hat = arm.state->F_K_W_est.force(), v = V.head<3>();
    if (!F_d.allFinite() || !F_hat.allFinite())
      return LawResult::fault;  // a clamp would hide a value that is not finite
    const Vector3 n = direction_.update(F_d, context.dt);
    if (of_error) feedforward.head<3>() += s * settings.damping * n.dot(Vector3(target.V_d.linear())) * n;
    opposing.head<3>() += settings.damping * n.dot(v) * n;
    const BoundedPull requested = bound_pull(context.contact, spring + feedforward, opposing, v);
    bound_feedforward(requested, spring, feedforward);
    context.inputs[kPose].resist(spring + feedforward, std::max(spring_share_, requested.force_share),
                                 std::max(spring_share_, requested.moment_share));
    const JointVector tau_null =
        null_space_torque(null_space_gains(parameters, context.contact), arm, q_N_, s);

    // Force part
    const Matrix3 D_t = D.topLeftCorner<3, 3>();
    const ForcePart force = force_part(settings, law, parameters.choice(kFeedback) != 0,
                                       parameters.number(kReach), F_d, F_hat, terms.X_WE().position, v, D_t,
                                       (spring + feedforward).head<3>(), context.contact, context.dt);
    // At most a tenth of the tank per tick: a fast set-point cannot overdraw it before its valve has closed.
    feedforward *= balance_.impedance.affordable(feedforward.dot(V) * context.dt, 0.1, limits_);

    const Jacobian& J = terms.J_V_WE();
    const auto joints = [&](const Vector6& F) -> JointVector { return J.transpose().lazyProduct(F); };
    const auto along = [](const Vector3& f) {
      Vector6 F = Vector6::Zero();
      F.head<3>() = f;
      return F;
    };
    EnergyBalance& balance = balance_.arm(0);
    balance.open(kSpringPart, joints(spring));
    balance.open(kDampingPart, joints(-(D * V)));
    balance.open(kFeedforwardPart, joints(feedforward));
    balance.open(kNullSpacePart, tau_null);
    balance.open(kCoriolisPart, terms.c());
    balance.open(kForcePart, joints(along(force.F)));
    balance.open(kForceDampingPart, joints(along(-settings.damping * n.dot(v) * n)));
    *arm.tau = balance.sum();

    show(context, force, error, set_point_work, arm);
    return arm.tau->allFinite() ? LawResult::ok : LawResult::fault;
  }

  // The spring's energy changes a little, because its error is that of another point: the tank supplies it.
  void end_effector_moved(ControlContext& context, std::size_t arm, const Pose& X) override {
    Controllet::end_effector_moved(context, arm, X);
    const Pose& X_WE = context.arms[0].terms->X_WE();
    const Pose X_WE_old = X_WE * X.inverse();
    p_c_ += X_WE.position - X_WE_old.position;
    const double moved = spring_.energy_at(X_WE_old) - spring_.energy;  // stored in the last period
    spring_.X_d = spring_.X_d * X;
    const double energy = spring_.energy_at(X_WE);
    balance_.impedance.give(spring_.scale * (energy - moved - spring_.energy));
    spring_.energy = energy - moved;
  }

 private:
  enum Input : std::size_t { kPose, kWrench, kInputCount };
  static constexpr std::size_t kForceGroup = kCartesianParameterCount;
  enum Parameter : std::size_t {
    kValveLaw = kForceGroup + kForceParameterCount,
    kReach,
    kTankStart,
    kTankMin,
    kTankMax,
    kTankClosing,
    kPressDirection,
    kFeedback,
    kParameterCount
  };
  enum Output : std::size_t {
    kDesired,
    kEstimated,
    kCommand,
    kInContact,
    kGamma,
    kAlphaForce,
    kAlphaImpedance,
    kForceTank,
    kImpedanceTank,
    kStored,
    kSpringPower,
    kDampingPower,
    kFeedforwardPower,
    kNullSpacePower,
    kCoriolisPower,
    kForcePower,
    kForceDampingPower,
    kSetPointPower,
    kOtherPower,
    kCreated,
    kAcross,
    kError = kAcross + 3,
    kOutputCount = kError + 6
  };

  struct ForcePart {
    Vector3 F;  // F_f'
    double desired = 0, estimated = 0, command = 0;
    Vector3 across;  // tangential part of F_f'
  };

  static TankLimits tank_limits(const ParameterSet& parameters) {
    return {parameters.number(kTankMin), parameters.number(kTankMax), parameters.number(kTankClosing)};
  }

  void update_energy_balance(std::span<const OwnedArm> arms, ValveLaw law) {
    const double energy = spring_.energy_at(arms[0].terms->X_WE());
    const double stored = spring_.scale * (energy - spring_.energy);
    spring_.energy = energy;
    balance_.close(arms, stored, law, limits_);
  }

  // Moves the spring to the new set-point, stiffness and valve. The tank supplies the energy that the spring
  // gains; if it cannot, the spring is scaled down. Returns the supplied work [J].
  // Its bound for contact closes the valve, too, so that the tanks' book stays complete; not because of what
  // the damping takes of the pull anyway: somebody who pushes the hand to its set-point takes nothing away.
  double move_spring(const CartesianTarget& target, const ImpedanceGains& gains, const Pose& X,
                     const Vector6& V, const Vector6& damping, const ControlContext& context) {
    const double before = spring_.scale * spring_.energy;
    SpringState next{gains.stiffness(target.X_W_d.rotation), target.X_W_d, 0, 0};
    next.energy = next.energy_at(X);
    next.scale = std::min(balance_.impedance.valve(limits_), spring_.scale + context.dt / Fade::kDuration);
    const Vector6 full = spring_wrench(next.stiffness, pose_error(target.X_W_d, X));
    const BoundedPull bounded = bound_pull(context.contact, full, damping, V.head<3>());
    spring_share_ = std::max(bounded.force_share, bounded.moment_share);
    next.scale = std::min(next.scale, bounded.factor());
    const double available = std::max(0.0, balance_.impedance.energy() - limits_.min_j);
    if (next.scale * next.energy - before > available) next.scale = (before + available) / next.energy;
    spring_ = next;
    const double work = next.scale * next.energy - before;
    balance_.impedance.give(work);
    return work;
  }

  // Scales the feed-forward so that it and the spring together keep to their bounds.
  static void bound_feedforward(const BoundedPull& requested, const Vector6& spring, Vector6& feedforward) {
    double c = 1;
    if (requested.force_share > 1) {
      const double limit = (spring + feedforward).head<3>().norm() / requested.force_share;
      c = std::min(c, largest_share(spring.head<3>(), feedforward.head<3>(), limit));
    }
    if (requested.moment_share > 1) {
      const double limit = (spring + feedforward).tail<3>().norm() / requested.moment_share;
      c = std::min(c, largest_share(spring.tail<3>(), feedforward.tail<3>(), limit));
    }
    feedforward *= c;
  }

  ForcePart force_part(const ForceSettings& settings, ValveLaw law, bool always, double reach,
                       const Vector3& F_d, const Vector3& F_hat, const Vector3& p, const Vector3& v,
                       const Matrix3& D_t, const Vector3& pull, const ContactBounds& contact, double dt) {
    ForcePart part;
    const Vector3& n = direction_.n();
    part.desired = std::max(0.0, n.dot(F_d));
    part.estimated = n.dot(F_hat);
    if (detector_.update(part.estimated, settings.contact_threshold, dt)) {
      touched_ = true;
      p_c_ = p;
    }
    // Decreases at once, increases no faster than a fade.
    const double shape = touched_ ? contact_shape((p - p_c_).norm(), reach) : 0.0;
    gamma_ = std::min(shape, gamma_ + dt / Fade::kDuration);
    alpha_f_ = std::min(balance_.force.valve(limits_), alpha_f_ + dt / Fade::kDuration);
    const double w = fade_.towards(always || detector_.in_contact(), dt);
    Vector3 F_t = settings.tangential_gain * w *
                  direction_.across(across_.update(F_hat, settings.tangential_cutoff, dt));
    // A hand in the way is felt like friction, and would be pushed harder and harder.
    const Vector3 pull_across = direction_.across(pull);
    F_t *= largest_share(pull_across, F_t, contact.spring_force);
    const double size = F_t.norm();
    // With what presses along n and across it already, the force keeps to the bound.
    const double left = left_beside(pull_across + F_t, contact.spring_force) - std::max(0.0, n.dot(pull));
    const double room = room_.update(left, contact.spring_force, dt);
    const double deepest = left_beside(pull_across + F_t, contact.spring_force) - std::max(0.0, -n.dot(pull));
    // Neither back nor, without contact, forth does the force drive the hand faster than a set-point would.
    const double v_n = n.dot(v);
    const double forth = always ? std::min(room, force_at_speed(contact, v_n)) : room;
    const double back = std::clamp(deepest, 0.0, force_at_speed(contact, -v_n));
    const double f = loop_.update(settings.gains, part.desired, part.estimated, w, dt, forth, back);
    // The valve never damps more than the impedance itself does along the force.
    const auto share = [&](const Vector3& direction, double force) {
      const double damping = direction.dot(D_t * direction);
      return force_share(law, gamma_, alpha_f_, direction.dot(v),
                         incoming_speed_for(force, gamma_, alpha_f_, damping));
    };
    part.command = (f < 0 ? share(-n, f) : share(n, f)) * f;
    part.across = size > 1e-9 ? Vector3(share(F_t / size, size) * F_t) : Vector3(Vector3::Zero());
    // What is felt across n may point elsewhere than the pull along it: the sum keeps to the bound, too.
    const double whole = largest_share(pull, n * part.command + part.across, contact.spring_force);
    part.command *= whole;
    part.across *= whole;
    part.F = n * part.command + part.across;
    return part;
  }

  void show(ControlContext& context, const ForcePart& force, const Vector6& error, double set_point_work,
            OwnedArm& arm) {
    const auto out = context.outputs;
    const double per_s = 1.0 / context.dt;
    out[kDesired] = force.desired;
    out[kEstimated] = force.estimated;
    out[kCommand] = force.command;
    out[kInContact] = detector_.in_contact();
    out[kGamma] = gamma_;
    out[kAlphaForce] = alpha_f_;
    out[kAlphaImpedance] = spring_.scale - 1;
    out[kForceTank] = balance_.force.energy();
    out[kImpedanceTank] = balance_.impedance.energy();
    const double kinetic = 0.5 * arm.dq().dot(arm.terms->momentum());
    out[kStored] =
        kinetic + spring_.scale * spring_.energy + balance_.force.energy() + balance_.impedance.energy();
    static_assert(kSetPointPower - kSpringPower == kTorqueParts);
    balance_.show_powers(out.subspan(kSpringPower), context.dt);
    out[kSetPointPower] = set_point_work * per_s;
    out[kOtherPower] = balance_.work_of_others() * per_s;
    out[kCreated] = balance_.created();
    std::copy_n(force.across.data(), 3, out.begin() + kAcross);
    std::copy_n(error.data(), 6, out.begin() + kError);
  }

  JointVector q_N_;
  Vector3 p_c_ = Vector3::Zero();  // x_c: where the tool last touched
  bool touched_ = false;
  double gamma_ = 0, alpha_f_ = 0;
  ForceDirection direction_;
  ContactDetector detector_;
  ForceLoop loop_;
  ForceRoom room_;
  Fade fade_;
  LowPass<Vector3> across_;
  TankLimits limits_;
  TankBalance balance_{1};
  SpringState spring_;
  double spring_share_ = 0;  // of the whole spring, in its bounds for contact
};

}  // namespace

ControlletType ufic_controllet() { return controllet_type<Ufic>(); }

}  // namespace multipanda
