#include <algorithm>
#include <cmath>

#include "core/controllets/axis_force.hpp"
#include "core/controllets/builtins.hpp"
#include "core/controllets/damping_design.hpp"
#include "core/controllets/energy_balance.hpp"
#include "core/controllets/energy_tank.hpp"
#include "core/controllets/felt_wrench.hpp"
#include "core/controllets/force_law.hpp"
#include "core/controllets/raised_spring.hpp"
#include "core/controllets/ufic_axes.hpp"

namespace multipanda {
namespace {

// The task spring in one tick; the tank supplies its energy when the set-point moves.
struct SpringState {
  TaskStiffness stiffness{Matrix3::Zero(), Matrix3::Zero()};
  Pose X_d;
  double scale = 1;   // s
  double energy = 0;  // V at the tick's pose, unscaled [J]

  double energy_at(const Pose& X) const { return spring_energy(stiffness, pose_error(X_d, X)); }
};

// Unified force-impedance control (UFIC) of one arm with two energy tanks, after Schindlbeck and Haddadin
// (ICRA 2015) and Haddadin and Shahriari (IJRR 2024). Valves and energy balance: docs/controllets/ufic.md.
//   tau  = J^T (s K_c x~ + D_c (s V_d - V) + s Lambda A_d + n D_z (s v_d,n - v_n) + F_f')
//          + N (s K_N (q_N - q) - D_N N^T dq) + C dq,          s = 1 + alpha_i
//   F_f' = rho(f) n f + rho(F_t) F_t,   rho: force_share() in energy_tank.hpp. World axes; forces [N] are
//   those that the arm exerts. Passive: kinetic energy + springs + tanks never grow by more than the work of
//   the contacts.
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
            input_at<kWrench>(
                {.name = "wrench",
                 .quantity = Quantity::wrench,
                 .doc = "F_d, desired wrench that the arm exerts at E, world axes. With selected axes only "
                        "its part along these counts, otherwise only its force.",
                 .max_speed = 60})),
        .parameters = spec_table<kParameterCount>(
            cartesian, group_at<kForceGroup>(force_parameters()), group_at<kTanks>(tank_parameters()),
            parameter_at<kPressDirection>(press_direction_parameter()),
            parameter_at<kFeedback>(choice_parameter(
                "force_feedback", {"in_contact", "always"},
                "When the feedback of the force acts: faded in at contact, or always as the paper prints it, "
                "which also pushes without contact; along selected axes at contact.")),
            group_at<kAxesGroup>(ufic_axes_parameters())),
        .outputs = spec_table<kOutputCount>(
            output_at<kDesired>("force_desired_n", "F_d along n."),
            output_at<kEstimated>("force_estimated_n", "F_hat along n."),
            output_at<kCommand>("force_command_n", "F_f' along n."),
            output_at<kInContact>("in_contact", "1 while contact is detected, otherwise 0."),
            group_at<kTankOutputs>(tank_outputs()),
            output_at<kAcross, 3>("tangential_force_n", "Part of F_f' across n, world axes."),
            output_at<kError, 3>("position_error_m", "p_d - p, world axes."),
            output_at<kError + 3, 3>("orientation_error_rad", "log(R_d R^T), world axes."),
            output_at<kAxesForce, 3>("axes_force_n", "F_f' along selected axes, axes of the force frame."),
            output_at<kAxesForce + 3, 3>("axes_moment_nm", "Its moment."),
            output_at<kAxesContact, 6>("axes_in_contact",
                                       "1 for each selected axis along which contact is detected."),
            output_at<kStiffnessShare>("stiffness_share", kStiffnessShareDoc),
            output_at<kTare>("tare", FeltWrench::kTareDoc)),
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
    raised_ = {};
    felt_.start(arm);
    p_c_ = arm.terms->X_WE().position;
    direction_.start(parameters.vector3(kPressDirection));
    start_direction();
    axes_.start();
    F_f_.setZero();
    bridge_.setZero();
    F_f_alpha_ = bridge_alpha_ = 1;
    redefined_ = false;
    tanks_ = tank_settings(parameters, kTanks);
    balance_.start(context.arms, tanks_.start_j, tanks_.limits);
    alpha_f_ = balance_.force.valve(tanks_.limits);
    const CartesianTarget target = CartesianTarget::of(context.inputs[kPose]);
    ImpedanceGains gains = impedance_gains(parameters);
    gains.soften(target.X_W_d.rotation, *arm.terms);
    spring_ = {gains.stiffness(target.X_W_d.rotation), target.X_W_d, balance_.impedance.valve(tanks_.limits),
               0};
    spring_.energy = spring_.energy_at(arm.terms->X_WE());
    return LawResult::ok;
  }

  LawResult update(ControlContext& context) override {
    OwnedArm& arm = context.arms[0];
    ModelTerms& terms = *arm.terms;
    const ParameterSet& parameters = *context.parameters;
    tanks_ = tank_settings(parameters, kTanks);
    const ImpedanceGains asked = impedance_gains(parameters, context.contact);
    const CartesianTarget rule = CartesianTarget::of(context.inputs[kPose]);
    const CartesianTarget seen = raised_.follow(asked, rule, terms, context.dt);
    ImpedanceGains gains = asked;
    const Matrix3& R_d = rule.X_W_d.rotation;
    context.outputs[kStiffnessShare] = gains.soften(R_d, terms);
    const CartesianTarget target = gains.led(seen, R_d);

    update_energy_balance(context.arms);
    // Impedance part
    const Vector6 V = terms.V_WE().vector;
    const Matrix6& Lambda = terms.task().Lambda;
    const Matrix6 K = gains.stiffness(R_d).matrix();
    const Matrix6 D = gains.damping(R_d, K, terms);
    const double set_point_work = move_spring(target, gains.stiffness(R_d), terms.X_WE(), V, D * V, context);
    const double s = spring_.scale;
    const Vector6 error = pose_error(target.X_W_d, terms.X_WE());
    const Vector6 spring = s * spring_wrench(spring_.stiffness, error);
    const bool of_error = gains.damping_of == DampingOf::error;
    Vector6 feedforward = of_error ? Vector6(s * (D * target.V_d.vector)) : Vector6(Vector6::Zero());
    if (gains.acceleration_feedforward) feedforward.noalias() += s * (Lambda * target.A_d.vector);
    if (gains.coriolis_feedforward) feedforward += s * terms.task_coriolis(target.V_d.vector);
    Vector6 opposing = D * V;
    // D_z dissipates against the velocity; with the velocity of the set-point it may supply energy.
    Vector6 F_d6 = context.inputs[kWrench].vector();
    felt_.update(arm, !F_d6.isZero(kMomentAxis.least) && touches(), context.dt);
    ForceSettings settings = force_settings(parameters, kForceGroup);
    settings.contact_threshold += felt_.motion(settings.motion_share);
    settings.contact_doubt = felt_.doubt(settings.motion_share);
    if (felt_.waits()) F_d6 *= 0;  // keeps NaN
    const Vector6& F_hat6 = felt_.at_E();
    const Vector3 F_d = F_d6.head<3>(), F_hat = F_hat6.head<3>(), v = V.head<3>();
    if (!F_d6.allFinite() || !F_hat6.allFinite())
      return LawResult::fault;  // clamping would hide an invalid value
    axes_.select(parameters, kAxesGroup, terms.X_WE().rotation, context.dt);
    axes_.bear(terms.task().mobility);
    const double of_n = 1 - axes_.weight();  // the share of the law along one direction
    const Vector3 n = direction_.update(F_d, context.dt);
    const auto damped = [&](const Vector3& speed, double scale) -> Vector3 {  // scale D_z speed
      return scale * of_n * settings.damping * n.dot(speed) * n +
             scale * axes_.damped(speed, settings.damping);
    };
    if (of_error) feedforward.head<3>() += damped(target.V_d.linear(), s);
    opposing.head<3>() += damped(v, 1);
    const BoundedPull requested = bound_pull(context.contact, spring + feedforward, opposing, v);
    bound_feedforward(requested, spring, feedforward);
    const double force_share = std::max(spring_share_, requested.force_share);
    const double moment_share = std::max(spring_share_, requested.moment_share);
    context.inputs[kPose].resist(spring + feedforward, force_share, moment_share);
    raised_.resist(spring + feedforward, force_share, moment_share, context.dt);
    context.inputs[kPose].slow(raised_.pace());
    const JointVector tau_null =
        null_space_torque(null_space_gains(parameters, context.contact), arm, q_N_, s);

    // Force part
    const Matrix3 D_t = D.topLeftCorner<3, 3>();
    const Vector6 pull = spring + feedforward;
    ForcePart force = force_part(settings, parameters.choice(kFeedback) != 0, F_d, F_hat,
                                 terms.X_WE().position, v, D_t, pull.head<3>(), context.contact, context.dt);
    Vector6 F_f = axes_.update(settings, tanks_.law, tanks_.reach, parameters, kAxesGroup,
                               {.F_d = F_d6,
                                .F_hat = F_hat6,
                                .V = V,
                                .pull = pull,
                                .D = D,
                                .X_WE = terms.X_WE(),
                                .alpha_f = alpha_f_,
                                .bounds = context.contact,
                                .turning = felt_.turning(settings.motion_share),
                                .turning_doubt = felt_.turning_doubt(settings.motion_share)},
                               context.dt);
    if (axes_.weight() >= 1) start_direction();  // restarts when no axis is selected any more
    force.scale(of_n);
    F_f.head<3>() += force.F;
    const bool bridges = redefined_ || !bridge_.isZero(0);
    if (bridges) F_f += bridged(F_f, V, context);
    if (axes_.any() || bridges) {
      F_f.head<3>() *= largest_share(pull.head<3>(), F_f.head<3>(), context.contact.spring_force);
      F_f.tail<3>() *= largest_share(pull.tail<3>(), F_f.tail<3>(), context.contact.spring_moment);
    }
    F_f_ = F_f;
    F_f_alpha_ = alpha_f_;
    // At most a tenth of the tank per tick: a fast set-point cannot overdraw it before its valve has closed.
    feedforward *= balance_.impedance.affordable(feedforward.dot(V) * context.dt, 0.1, tanks_.limits);

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
    balance.open(kForcePart, joints(F_f));
    balance.open(kForceDampingPart, joints(along(damped(v, -1))));
    *arm.tau = balance.sum();

    show(context, force, pose_error(rule.X_W_d, terms.X_WE()), set_point_work);
    return arm.tau->allFinite() ? LawResult::ok : LawResult::fault;
  }

  // The spring's energy changes a little, because its error is that of another point: the tank supplies it.
  void end_effector_moved(ControlContext& context, std::size_t arm, const Pose& X) override {
    Controllet::end_effector_moved(context, arm, X);
    const Pose& X_WE = context.arms[0].terms->X_WE();
    const Pose X_WE_old = X_WE * X.inverse();
    p_c_ += X_WE.position - X_WE_old.position;
    axes_.end_effector_moved(X);
    // The same wrench as before, about the new point.
    Wrench before;
    before.vector = F_f_;
    F_f_ = shifted(before, X_WE_old.position - X_WE.position).vector;
    redefined_ = axes_.any() || !bridge_.isZero(0);
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
    kTanks = kForceGroup + kForceParameterCount,
    kPressDirection = kTanks + kTankParameterCount,
    kFeedback,
    kAxesGroup,
    kParameterCount = kAxesGroup + kUficAxesParameterCount
  };
  enum Output : std::size_t {
    kDesired,
    kEstimated,
    kCommand,
    kInContact,
    kTankOutputs,
    kAcross = kTankOutputs + kTankOutputCount,
    kError = kAcross + 3,
    kAxesForce = kError + 6,
    kAxesContact = kAxesForce + 6,
    kStiffnessShare = kAxesContact + 6,
    kTare,
    kOutputCount
  };

  struct ForcePart {
    Vector3 F;  // F_f'
    double desired = 0, estimated = 0, command = 0;
    Vector3 across;  // tangential part of F_f'

    void scale(double share) {
      F *= share;
      command *= share;
      across *= share;
    }
  };

  // Another end effector means other moments and another point for the forces: the excess of the old wrench
  // over the new one decays, faster where it moves the hand, since nothing resists it there. It keeps nothing
  // of an earlier redefinition, so that a stream of them holds no force. Returns the part to add.
  Vector6 bridged(const Vector6& F_f, const Vector6& V, const ControlContext& context) {
    constexpr double kDecay = 0.06, kMovedOn = 0.002, kClosing = 0.1;  // [s], [s], of alpha_f
    if (redefined_) {
      bridge_ = F_f_ - F_f;
      bridge_alpha_ = std::max(kClosing, F_f_alpha_);
      redefined_ = false;
    }
    const auto along = [](const Vector3& f, const Vector3& v) {
      const double size = f.norm();
      return size > 1e-9 ? f.dot(v) / size : 0.0;
    };
    const double speed = along(bridge_.head<3>(), V.head<3>()) / std::max(1e-3, context.contact.hand_speed);
    const double turning = along(bridge_.tail<3>(), V.tail<3>()) / UficAxes::kTurnLimit;
    const double beyond = std::max(0.0, std::max(speed, turning) - 0.5);
    bridge_ *= std::exp(-context.dt * (1 / kDecay + beyond / kMovedOn));
    if (bridge_.squaredNorm() < 1e-6) bridge_.setZero();
    return std::min(1.0, alpha_f_ / bridge_alpha_) * bridge_;
  }

  // Without contact, near its last point, the desired force still acts.
  bool touches() const { return gamma_ > 0.5 || axes_.touches(); }

  // The law along one direction, as without contact.
  void start_direction() {
    touched_ = false;
    gamma_ = 0;
    detector_.start();
    loop_.start();
    room_.start();
    fade_.reset(false);
    across_.reset(Vector3::Zero());
  }

  void update_energy_balance(std::span<const OwnedArm> arms) {
    const double energy = spring_.energy_at(arms[0].terms->X_WE());
    const double stored = spring_.scale * (energy - spring_.energy);
    spring_.energy = energy;
    balance_.close(arms, stored, tanks_.law, tanks_.limits);
  }

  // Moves the spring to the new set-point, stiffness and valve. The tank supplies the energy that the spring
  // gains; if it cannot, the spring is scaled down. Returns the supplied work [J].
  // Its bound for contact closes the valve, too, so that the tanks' balance stays complete; not because of
  // the part of the pull that damping compensates anyway: a person who pushes the hand to its set-point takes
  // no energy.
  double move_spring(const CartesianTarget& target, const TaskStiffness& K, const Pose& X, const Vector6& V,
                     const Vector6& damping, const ControlContext& context) {
    const double before = spring_.scale * spring_.energy;
    SpringState next{K, target.X_W_d, 0, 0};
    next.energy = next.energy_at(X);
    next.scale =
        std::min(balance_.impedance.valve(tanks_.limits), spring_.scale + context.dt / Fade::kDuration);
    const Vector6 full = spring_wrench(next.stiffness, pose_error(target.X_W_d, X));
    const BoundedPull bounded = bound_pull(context.contact, full, damping, V.head<3>());
    spring_share_ = std::max(bounded.force_share, bounded.moment_share);
    next.scale = std::min(next.scale, bounded.factor());
    const double available = std::max(0.0, balance_.impedance.energy() - tanks_.limits.min_j);
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

  ForcePart force_part(const ForceSettings& settings, bool always, const Vector3& F_d, const Vector3& F_hat,
                       const Vector3& p, const Vector3& v, const Matrix3& D_t, const Vector3& pull,
                       const ContactBounds& contact, double dt) {
    ForcePart part;
    const Vector3& n = direction_.n();
    part.desired = std::max(0.0, n.dot(F_d));
    part.estimated = n.dot(F_hat);
    if (detector_.update(part.estimated, settings.contact_threshold, dt, settings.contact_doubt)) {
      touched_ = true;
      p_c_ = p;
    }
    // Decreases at once, increases at the rate of a fade.
    const double shape = touched_ ? contact_shape((p - p_c_).norm(), tanks_.reach) : 0.0;
    gamma_ = std::min(shape, gamma_ + dt / Fade::kDuration);
    alpha_f_ = std::min(balance_.force.valve(tanks_.limits), alpha_f_ + dt / Fade::kDuration);
    const double w = fade_.towards(always || detector_.in_contact(), dt);
    Vector3 F_t = settings.tangential_gain * w *
                  direction_.across(across_.update(F_hat, settings.tangential_cutoff, dt));
    // A hand in the way acts like friction and would be pushed harder and harder.
    const Vector3 pull_across = direction_.across(pull);
    F_t *= largest_share(pull_across, F_t, contact.spring_force);
    const double size = F_t.norm();
    // Together with the forces along n and across it, the force respects the bound.
    const double left = left_beside(pull_across + F_t, contact.spring_force) - std::max(0.0, n.dot(pull));
    const double room = room_.update(left, contact.spring_force, dt);
    const double deepest = left_beside(pull_across + F_t, contact.spring_force) - std::max(0.0, -n.dot(pull));
    // The force drives the hand no faster than a set-point would, neither backwards nor, without
    // contact, forwards.
    const double v_n = n.dot(v);
    const double forth = always ? std::min(room, force_at_speed(contact, v_n)) : room;
    const double back = std::clamp(deepest, 0.0, force_at_speed(contact, -v_n));
    const double f = loop_.update(settings.gains, part.desired, part.estimated, w, dt, forth, back);
    // The valve never damps more than the impedance itself does along the force.
    const auto share = [&](const Vector3& direction, double force) {
      const double damping = direction.dot(D_t * direction);
      return force_share(tanks_.law, gamma_, alpha_f_, direction.dot(v),
                         incoming_speed_for(force, gamma_, alpha_f_, damping));
    };
    part.command = (f < 0 ? share(-n, f) : share(n, f)) * f;
    part.across = size > 1e-9 ? Vector3(share(F_t / size, size) * F_t) : Vector3(Vector3::Zero());
    // The felt force across n may differ in direction from the pull: the sum also respects the bound.
    const double whole = largest_share(pull, n * part.command + part.across, contact.spring_force);
    part.command *= whole;
    part.across *= whole;
    part.F = n * part.command + part.across;
    return part;
  }

  void show(ControlContext& context, const ForcePart& force, const Vector6& error, double set_point_work) {
    const auto out = context.outputs;
    out[kDesired] = force.desired;
    out[kEstimated] = force.estimated;
    out[kCommand] = force.command;
    out[kInContact] = detector_.in_contact();
    out[kTare] = static_cast<double>(felt_.tare());
    balance_.show(out.subspan(kTankOutputs), context.arms,
                  {gamma_, alpha_f_, spring_.scale, spring_.energy, set_point_work}, context.dt);
    std::copy_n(force.across.data(), 3, out.begin() + kAcross);
    std::copy_n(error.data(), 6, out.begin() + kError);
    std::copy_n(axes_.force().data(), 6, out.begin() + kAxesForce);
    for (std::size_t i = 0; i < 6; ++i) out[kAxesContact + i] = axes_.in_contact(i);
  }

  JointVector q_N_;
  RaisedSpring raised_;
  Vector3 p_c_ = Vector3::Zero();  // x_c: last point of contact of the tool
  bool touched_ = false;
  double gamma_ = 0, alpha_f_ = 0;
  FeltWrench felt_;
  ForceDirection direction_;
  ContactDetector detector_;
  ForceLoop loop_;
  ForceRoom room_;
  Fade fade_;
  LowPass<Vector3> across_;
  UficAxes axes_;
  // F_f' of the last tick, about E as it is now, and what is left of it after E was redefined. World axes.
  Vector6 F_f_ = Vector6::Zero(), bridge_ = Vector6::Zero();
  double F_f_alpha_ = 1, bridge_alpha_ = 1;  // valves of those two
  bool redefined_ = false;
  TankSettings tanks_;
  TankBalance balance_{1};
  SpringState spring_;
  double spring_share_ = 0;  // of the whole spring, in its bounds for contact
};

}  // namespace

ControlletType ufic_controllet() { return controllet_type<Ufic>(); }

}  // namespace multipanda
