#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "core/controllets/builtins.hpp"
#include "core/controllets/cooperative_frame.hpp"
#include "core/controllets/coupled_ufic_descriptor.hpp"
#include "core/controllets/damping_design.hpp"
#include "core/controllets/energy_balance.hpp"
#include "core/controllets/felt_wrench.hpp"
#include "core/controllets/raised_spring.hpp"

namespace multipanda::coupled_ufic {
namespace {

using Vector12 = Eigen::Matrix<double, 12, 1>;
using Phase = GraspSequence::Phase;

constexpr double kGravity = 9.81;  // [m/s^2]

// The springs of the cooperative coordinates in one tick; the tank supplies their energy when set-points
// move. Along n, the relative spring has its own share, which a grasp removes.
struct Springs {
  TaskStiffness absolute{Matrix3::Zero(), Matrix3::Zero()};
  Matrix3 across = Matrix3::Zero();         // relative, without its part along n [N/m]
  Matrix3 relative_turn = Matrix3::Zero();  // [N m/rad]
  double along = 0;                         // relative, along n, scaled by its share [N/m]
  Pose X_d;                                 // of A
  Vector3 p_r_d = Vector3::Zero();          // p_2 - p_1
  Vector3 phi_d = Vector3::Zero();          // of a stiffness that was raised
  Vector3 n = Vector3::UnitY();
  double scale = 1;   // s
  double energy = 0;  // V at the tick's pose, unscaled [J]

  double energy_at(const CooperativeFrame& frame) const {
    const Vector3 e = p_r_d - frame.relative.head<3>();
    const Vector3 phi = FadedRotation(frame.relative.tail<3>() - phi_d).value;
    const double e_n = n.dot(e);
    return spring_energy(absolute, pose_error(X_d, frame.X_WA)) +
           0.5 * (e.dot(across * e) + along * e_n * e_n + phi.dot(relative_turn * phi));
  }
  // Conjugate to [V_a; V_r]: minus the gradient of the energy.
  Vector12 wrench(const CooperativeFrame& frame) const {
    const Vector3 e = p_r_d - frame.relative.head<3>();
    const FadedRotation phi(frame.relative.tail<3>() - phi_d);
    Vector12 F;
    F.head<6>() = spring_wrench(absolute, pose_error(X_d, frame.X_WA));
    F.segment<3>(6) = across * e + along * n.dot(e) * n;
    F.tail<3>() = -(phi.dvalue_dr * (relative_turn * phi.value));
    return F;
  }
};

// Unified force-impedance control of two hands that hold one object: the squeeze is force-controlled and the
// motion of the object an impedance. Both use the cooperative coordinates of
// core/controllets/cooperative_frame.hpp, with the estimates of A at the hands themselves (X_EiA is a
// rotation): each hand then carries half of a force on A without a moment, which would tip a pad over.
//   [F_1; F_2] = L^T ([s K_a x~_a; s K_r x~_r] + D (s [V_a; V_r]_d - [V_a; V_r]) + s [F_ff; 0]
//                     - [0; n] (F_f' + D_z (v_n - s v_d,n)))
//   tau_i = J_i^T F_i + N_i (s K_N (q_N - q) - D_N N_i^T dq) + C_i dq_i,      s = 1 + alpha_i
// n: unit vector from the first hand to the second, turning with the set-point. F_f' acts on the mean squeeze
// f^ = (n^T F^_1 - n^T F^_2) / 2. At rest in a grasp, a force F on the object moves it by K_a^-1 F and f^ =
// F_d. Phases, valves and energy balance: docs/controllets/ufic.md.
class CoupledUfic final : public Controllet {
 public:
  static ControlletDescriptor descriptor() { return coupled_ufic::descriptor(); }

  explicit CoupledUfic(ArmModels arms) {
    for (const auto& arm : arms)
      bearable_ += arm->largest_load().value_or(std::numeric_limits<double>::infinity());
  }

  void bound_parameters(ParameterSet& parameters) const override {
    parameters.lower_max(kObjectMass, std::array{bearable_},
                         "the arms can carry no more besides hands and tools");
  }

  // A begins midway between the hands, with the axes of the world.
  void start_references(ControlContext& context) override {
    const Pose& X_WE1 = context.arms[0].terms->X_WE();
    const Pose& X_WE2 = context.arms[1].terms->X_WE();
    X_EA_[0] = {X_WE1.rotation.transpose(), Vector3::Zero()};
    X_EA_[1] = {X_WE2.rotation.transpose(), Vector3::Zero()};
    context.inputs[kPose].start(Pose{Matrix3::Identity(), 0.5 * (X_WE1.position + X_WE2.position)});
    context.inputs[kSqueeze].start_constant(0);
  }

  LawResult start(ControlContext& context) override {
    for (const OwnedArm& arm : context.arms) {
      if (!arm.state->has_wrench_estimate)
        return LawResult::fault;  // without an estimate the squeeze has no feedback
    }
    // Axes of A.
    p_r_start_ = context.arms[1].terms->X_WE().position - context.arms[0].terms->X_WE().position;
    const Vector3 given = context.parameters->vector3(kSqueezeDirection);
    const Vector3 line = given.norm() > 1e-6 ? given : p_r_start_;
    if (!(line.norm() > 1e-6))
      return LawResult::fault;  // the hands coincide, so the line between them is undefined
    n_A_ = line.normalized();
    grasp_.start(n_A_.dot(p_r_start_));
    loop_.start();
    touched_ = false;
    gamma_ = touch_distance_ = shift_ = shift_from_ = shift_to_ = integral_ = 0;
    shift_fade_.reset(true);
    affordable_ = 1;
    absolute_ = relative_ = {};
    object_mass_ = context.parameters->number(kObjectMass);
    Settings settings(*context.parameters, context.contact);
    const CooperativeFrame frame = frame_of(context);
    soften(settings, context, frame, inertia(context, frame));
    balance_.start(context.arms, settings.tanks.start_j, settings.tanks.limits);
    alpha_f_ = balance_.force.valve(settings.tanks.limits);
    for (std::size_t i = 0; i < 2; ++i) {
      q_N_[i] = context.arms[i].q();
      felt_[i].start(context.arms[i]);
    }
    const CartesianTarget target = CartesianTarget::of(context.inputs[kPose]);
    springs_ = springs_now(settings, target, target);
    springs_.scale = balance_.impedance.valve(settings.tanks.limits);
    springs_.energy = springs_.energy_at(frame);
    return LawResult::ok;
  }

  LawResult update(ControlContext& context) override {
    OwnedArm& first = context.arms[0];
    OwnedArm& second = context.arms[1];
    const CooperativeFrame frame = frame_of(context);
    if (!frame.holds_together()) return LawResult::fault;
    Settings settings(*context.parameters, context.contact);
    const Matrix12 Lambda = inertia(context, frame);
    Settings was = settings;
    const auto before = absolute_.changed(settings.absolute);
    const auto relative_before = relative_.changed(settings.relative);
    was.absolute = before.value_or(was.absolute);
    was.relative = relative_before.value_or(was.relative);
    context.outputs[kStiffnessShare] = soften(settings, context, frame, Lambda);
    const CartesianTarget rule = CartesianTarget::of(context.inputs[kPose]);
    const CartesianTarget target = settings.absolute.led(rule, rule.X_W_d.rotation);
    CartesianTarget seen = come_back(absolute_, relative_, rule, context);
    const bool changed = before || relative_before;
    if (changed) {
      soften(was, context, frame, Lambda);
      absolute_.raise(was.absolute, settings.absolute, rule, frame.X_WA, seen);
    }
    seen = settings.absolute.led(seen, rule.X_W_d.rotation);
    const double dt = context.dt;

    update_energy_balance(context, frame, settings);
    if (!follow_grasp(context, frame, settings, target)) return LawResult::fault;
    Vector12 V, V_d;
    V << frame.absolute_velocity(first.terms->V_WE().vector, second.terms->V_WE().vector),
        frame.relative_velocity(first.terms->V_WE().vector, second.terms->V_WE().vector);
    const Matrix3& R_d = target.X_W_d.rotation;
    Matrix12 D = settings.absolute.damping_given
                     ? given_damping(frame, first, second, settings.absolute.given_damping(R_d),
                                     settings.relative.given_damping(R_d))
                     : coupled_damping(Lambda, stiffness(settings, target), settings.absolute.damping_ratio);
    if (states_motors(first.model()) || states_motors(second.model()))
      raise_modes(Lambda, Matrix12(kLeastDampingTime * stiffness(settings, target)), D);
    brake(R_d, settings.absolute, settings.relative, Lambda, D);
    Springs next = springs_now(settings, target, seen);
    if (changed) {
      Vector6 error;
      error << next.p_r_d - frame.relative.head<3>(), next.phi_d - frame.relative.tail<3>();
      const Vector6 kept = relative_.raise(was.relative, settings.relative, R_d, error);
      next.p_r_d += kept.head<3>() - error.head<3>();
      next.phi_d += kept.tail<3>() - error.tail<3>();
    }
    const double set_point_work = move_springs(next, frame, D * V, settings, context, dt);
    wait_for_hands(context, frame);
    const double s = springs_.scale;
    const Vector3& n = springs_.n;

    V_d << seen.V_d.vector, relative_.velocity();
    V_d.segment<3>(6) += target.V_d.angular().cross(springs_.p_r_d) + grasp_.distance_rate_d() * n;

    const bool of_error = settings.absolute.damping_of == DampingOf::error;
    Vector12 feedforward = of_error ? Vector12(D * V_d) : Vector12(Vector12::Zero());
    if (settings.absolute.coriolis_feedforward) {
      feedforward += frame.task_coriolis(*first.terms, *second.terms, seen.V_d.vector);
    }
    if (settings.absolute.acceleration_feedforward) {
      feedforward += Lambda.leftCols<6>() * seen.A_d.vector;
    }
    feedforward.head<3>() += carried(settings, seen, frame, dt);
    // D_z dissipates against the velocity; with the velocity of the set-point it may supply energy.
    if (of_error) {
      feedforward.segment<3>(6) += settings.squeeze_damping * n.dot(Vector3(V_d.segment<3>(6))) * n;
    }
    feedforward *= s;
    if (std::isfinite(context.contact.spring_force + context.contact.spring_moment)) {
      feedforward *= feedforward_share(context, frame, s * springs_.wrench(frame), feedforward, D * V);
    }
    // No more power than would empty the tank within kEmptying: a fast set-point cannot overdraw it before
    // its valve has closed.
    constexpr double kEmptying = 0.05;  // time constant [s]
    affordable_ =
        balance_.impedance.affordable(feedforward.dot(V) * dt, dt / kEmptying, settings.tanks.limits);
    feedforward *= affordable_;

    const double v_n = n.dot(Vector3(V.segment<3>(6)));
    const Matrix3 D_r = D.block<3, 3>(6, 6);
    // Hands that part because their estimates are wrong open no faster than set-points would move them.
    const double least = -force_at_speed(context.contact, 0.5 * v_n);
    const double command =
        std::clamp(squeeze(settings, v_n, n.dot(D_r * n), -least, context.contact.spring_force, dt), least,
                   context.contact.spring_force);
    Vector12 force = Vector12::Zero(), force_damping = Vector12::Zero();
    force.segment<3>(6) = -command * n;
    force_damping.segment<3>(6) = -settings.squeeze_damping * v_n * n;

    const Vector12 spring = s * springs_.wrench(frame);
    const Vector12 damping = -(D * V);
    for (std::size_t i = 0; i < 2; ++i) {
      OwnedArm& arm = context.arms[i];
      const Jacobian& J = arm.terms->J_V_WE();
      const auto joints = [&](const Vector12& F) -> JointVector {
        return J.transpose().lazyProduct(wrench_at(frame, F, i));
      };
      EnergyBalance& balance = balance_.arm(i);
      balance.open(kSpringPart, joints(spring));
      balance.open(kDampingPart, joints(damping));
      balance.open(kFeedforwardPart, joints(feedforward));
      balance.open(kNullSpacePart, null_space_torque(settings.null_space, arm, q_N_[i], s));
      balance.open(kCoriolisPart, arm.terms->c());
      balance.open(kForcePart, joints(force));
      balance.open(kForceDampingPart, joints(force_damping));
      *arm.tau = balance.sum();
      if (!arm.tau->allFinite()) return LawResult::fault;
    }
    show(context, frame, command, set_point_work);
    return LawResult::ok;
  }

  // A stays in place, at another pose in the hand.
  void end_effector_moved(ControlContext& /*context*/, std::size_t arm, const Pose& X) override {
    X_EA_[arm] = X.inverse() * X_EA_[arm];
  }

 private:
  CooperativeFrame frame_of(const ControlContext& context) const {
    return {context.arms[0].terms->X_WE(), X_EA_[0], context.arms[1].terms->X_WE(), X_EA_[1]};
  }

  static Matrix12 inertia(const ControlContext& context, const CooperativeFrame& frame) {
    return frame.inertia(context.arms[0].terms->task().Lambda, context.arms[1].terms->task().Lambda);
  }

  static double soften(Settings& settings, const ControlContext& context, const CooperativeFrame& frame,
                       const Matrix12& Lambda) {
    return multipanda::soften(frame, context.arms[0], context.arms[1], context.inputs[kPose].pose().rotation,
                              Lambda, settings.absolute, settings.relative);
  }

  // Full stiffness of all springs, for the damping design, which does not change in a grasp.
  static Matrix12 stiffness(const Settings& settings, const CartesianTarget& target) {
    Matrix12 K = Matrix12::Zero();
    K.topLeftCorner<6, 6>() = settings.absolute.stiffness(target.X_W_d.rotation).matrix();
    K.bottomRightCorner<6, 6>() = settings.relative.stiffness(target.X_W_d.rotation).matrix();
    return K;
  }

  // `seen`: by the spring of A.
  Springs springs_now(const Settings& settings, const CartesianTarget& target,
                      const CartesianTarget& seen) const {
    const Matrix3& R_d = target.X_W_d.rotation;
    const TaskStiffness K_r = settings.relative.stiffness(R_d);
    Springs next;
    next.n = R_d * n_A_;
    const Matrix3 P = Matrix3::Identity() - next.n * next.n.transpose();
    next.absolute = settings.absolute.stiffness(R_d);
    next.across = P * K_r.translation * P;
    next.relative_turn = K_r.rotation;
    next.along = grasp_.spring_share() * next.n.dot(K_r.translation * next.n);
    next.X_d = {seen.X_W_d.rotation, seen.X_W_d.position + shift_ * next.n};
    next.p_r_d = P * (R_d * p_r_start_) + grasp_.distance_d() * next.n + relative_.offset().head<3>();
    next.phi_d = relative_.offset().tail<3>();
    return next;
  }

  // Wrench at hand i from the absolute and the relative task.
  static Vector6 wrench_at(const CooperativeFrame& frame, const Vector12& F, std::size_t i) {
    return i == 0 ? frame.first_wrench(F.head<6>(), F.tail<6>())
                  : frame.second_wrench(F.head<6>(), F.tail<6>());
  }

  void update_energy_balance(const ControlContext& context, const CooperativeFrame& frame,
                             const Settings& settings) {
    const double energy = springs_.energy_at(frame);
    const double stored = springs_.scale * (energy - springs_.energy);
    springs_.energy = energy;
    balance_.close(context.arms, stored, settings.tanks.law, settings.tanks.limits);
  }

  // Moves the springs to new set-points, stiffness and valve. The tank supplies the energy that they gain and
  // receives the energy that they lose. The valve depends on the energy left after that, so both are solved
  // together: s = valve(T + s_before V_before - s V); one after the other they would oscillate.
  // The bounds for contact close the valve, too, so that the tanks' balance stays complete. The part of a
  // pull that the damping takes does not count: a push towards the set-point must not drop a carried object.
  double move_springs(Springs next, const CooperativeFrame& frame, const Vector12& damping,
                      const Settings& settings, const ControlContext& context, double dt) {
    const double before = springs_.scale * springs_.energy;
    next.energy = next.energy_at(frame);
    const auto valve_after = [&](double s) {
      EnergyTank after = balance_.impedance;
      after.give(s * next.energy - before);
      return after.valve(settings.tanks.limits);
    };
    const Vector12 full = next.wrench(frame);
    const auto at = [&](const Vector12& F, std::size_t i) { return wrench_at(frame, F, i); };
    const auto bounded = [&](std::size_t i) {
      return bound_pull(context.contact, at(full, i), at(damping, i), context.arms[i].terms->V_WE().linear());
    };
    const BoundedPull first = bounded(0), second = bounded(1);
    spring_share_ =
        std::max({first.force_share, first.moment_share, second.force_share, second.moment_share});
    double high = std::min(1.0, springs_.scale + dt / Fade::kDuration), low = 0;
    high = std::min(high, 1.0 / std::max(1.0, spring_share_));
    if (valve_after(high) < high) {
      for (int i = 0; i < 40; ++i) {
        const double middle = 0.5 * (low + high);
        (valve_after(middle) < middle ? high : low) = middle;
      }
      high = low;
    }
    next.scale = high;
    springs_ = next;
    const double work = next.scale * next.energy - before;
    balance_.impedance.give(work);
    return work;
  }

  // The set-point of A waits while the spring of a hand is bounded and A's spring pulls along its motion.
  void wait_for_hands(ControlContext& context, const CooperativeFrame& frame) {
    if (!std::isfinite(context.contact.hand_speed + context.contact.spring_force)) return;
    Reference& pose = context.inputs[kPose];
    pose.resist(spring_wrench(springs_.absolute, pose_error(springs_.X_d, frame.X_WA)), spring_share_,
                spring_share_);
    absolute_.resist(springs_.wrench(frame).head<6>(), spring_share_, spring_share_, context.dt);
    relative_.resist(springs_.wrench(frame).tail<6>(), spring_share_, spring_share_, context.dt);
    pose.slow(std::min(absolute_.pace(), relative_.pace()));
    double lever = 0;
    for (const OwnedArm& arm : context.arms) {
      lever = std::max(lever, (arm.terms->X_WE().position - springs_.X_d.position).norm());
    }
    // Hands that close or open move in addition to A. Counted from the start on, since the pace reacts faster
    // than their speed.
    const double closing = grasp_.distance_rate_d() != 0 ? 0.5 * closing_speed_ : 0;
    pose.bound_hand_speed(context.contact.hand_speed - closing, lever);
  }

  // The feed-forward at a hand, with its spring within the bounds for contact.
  double feedforward_share(const ControlContext& context, const CooperativeFrame& frame,
                           const Vector12& spring, const Vector12& feedforward,
                           const Vector12& damping) const {
    const auto at = [&](const Vector12& F, std::size_t i) { return wrench_at(frame, F, i); };
    double c = 1;
    for (std::size_t i = 0; i < 2; ++i) {
      const Vector6 base = at(spring, i), extra = at(feedforward, i), both = base + extra;
      const BoundedPull requested =
          bound_pull(context.contact, both, at(damping, i), context.arms[i].terms->V_WE().linear());
      if (requested.force_share > 1) {
        c = std::min(
            c, largest_share(base.head<3>(), extra.head<3>(), both.head<3>().norm() / requested.force_share));
      }
      if (requested.moment_share > 1) {
        c = std::min(c, largest_share(base.tail<3>(), extra.tail<3>(),
                                      both.tail<3>().norm() / requested.moment_share));
      }
    }
    return c;
  }

  // Updates the phase of the grasp, gamma, and the position of A along n. Returns false if a force
  // is not finite.
  bool follow_grasp(const ControlContext& context, const CooperativeFrame& frame, Settings settings,
                    const CartesianTarget& target) {
    const Vector3 n = target.X_W_d.rotation * n_A_;
    const Matrix3& R_d = target.X_W_d.rotation;
    settings.grasp.closing_speed = closing_speed_ =
        std::min(settings.grasp.closing_speed, context.contact.hand_speed);  // half of it by each hand
    settings.grasp.closing_stiffness = n.dot(settings.relative.stiffness(R_d).translation * n);
    const bool grasps = grasp_.phase() == GraspSequence::Phase::grasp;
    for (std::size_t i = 0; i < 2; ++i)
      felt_[i].update(context.arms[i], grasp_.phase() != GraspSequence::Phase::rest, context.dt);
    // A grasp is lost below half of the threshold. Only closing raises it, which hands do once their object
    // has gone: hands that move together, are bumped or carry a load must not drop what they hold.
    const bool waits = felt_[0].waits() || felt_[1].waits();
    if (grasps) {
      const auto v = [&](std::size_t i) { return Vector3(context.arms[i].terms->V_WE().linear()); };
      const double closing = n.dot(v(0) - v(1));
      settings.grasp.contact_threshold_n +=
          settings.motion_share * FeltWrench::motion_of(0.5 * closing, 0.5 * n.dot(felt_[0].acceleration() -
                                                                                   felt_[1].acceleration()));
    } else {
      settings.grasp.contact_threshold_n +=
          std::max(felt_[0].motion(settings.motion_share), felt_[1].motion(settings.motion_share));
    }
    measured_ = {.requested_n = waits ? 0.0 : context.inputs[kSqueeze].scalar(),
                 .first_n = n.dot(Vector3(felt_[0].at_E().head<3>())),
                 .second_n = -n.dot(Vector3(felt_[1].at_E().head<3>())),
                 .distance_m = n.dot(Vector3(frame.relative.head<3>())),
                 .first_doubt_n = grasps ? 0.0 : felt_[0].doubt(settings.motion_share),
                 .second_doubt_n = grasps ? 0.0 : felt_[1].doubt(settings.motion_share)};
    if (!std::isfinite(measured_.requested_n + measured_.first_n + measured_.second_n)) return false;
    grasp_.update(measured_, settings.grasp, context.dt);
    if (grasp_.touched_now()) {
      // Holds the object along n where it is. Pulling it to the set-point would load one hand more than
      // the other.
      shift_from_ = shift_;
      shift_to_ = n.dot(frame.X_WA.position - target.X_W_d.position);
      shift_fade_.reset(false);
    }
    shift_ = shift_from_ + shift_fade_.towards(true, context.dt) * (shift_to_ - shift_from_);
    if (grasp_.both_touch()) {
      touched_ = true;
      touch_distance_ = measured_.distance_m;
    }
    // Decreases at once, increases at the rate of a fade.
    const double rise = context.dt / Fade::kDuration;
    const double shape =
        touched_ ? contact_shape(measured_.distance_m - touch_distance_, settings.tanks.reach) : 0.0;
    gamma_ = std::min(shape, gamma_ + rise);
    alpha_f_ = std::min(balance_.force.valve(settings.tanks.limits), alpha_f_ + rise);
    return true;
  }

  // F_f' along -n of the relative motion: the force of each hand. The valve never damps more than `damping`,
  // what the impedance itself does along n.
  double squeeze(const Settings& settings, double v_n, double damping, double deepest, double most,
                 double dt) {
    const double estimated = 0.5 * (measured_.first_n + measured_.second_n);
    const double w = grasp_.force_share();
    // The integral must not grow from a force that the share w removes afterwards.
    const double f = w * loop_.update(settings.force, grasp_.desired_n(), estimated, w, dt, most, deepest);
    return multipanda::force_share(settings.tanks.law, gamma_, alpha_f_, f < 0 ? v_n : -v_n,
                                   incoming_speed_for(f, gamma_, alpha_f_, damping)) *
           f;
  }

  // Declared weight and acceleration of the object, plus the integral of the vertical error.
  Vector3 carried(const Settings& settings, const CartesianTarget& target, const CooperativeFrame& frame,
                  double dt) {
    const double held = grasp_.ramp();
    if (grasp_.phase() == Phase::grasp) {
      const double e_z = target.X_W_d.position.z() - frame.X_WA.position.z();
      // Scaled by the fraction supplied by the tank, against windup.
      integral_ += settings.vertical_integral * held * springs_.scale * affordable_ * e_z * dt;
      integral_ = std::clamp(integral_, -settings.vertical_integral_limit, settings.vertical_integral_limit);
    } else {
      integral_ *= std::exp(-dt / Fade::kDuration);
    }
    const Vector3 A_d =
        settings.absolute.acceleration_feedforward ? Vector3(target.A_d.linear()) : Vector3(Vector3::Zero());
    // A new mass is faded in slowly: a declared but missing mass lifts the hands.
    const double step = kMassRate * dt;
    object_mass_ += std::clamp(settings.object_mass - object_mass_, -step, step);
    Vector3 f = held * object_mass_ * (A_d + kGravity * Vector3::UnitZ());
    f.z() += integral_;
    vertical_ = f.z();
    return f;
  }

  void show(ControlContext& context, const CooperativeFrame& frame, double command, double set_point_work) {
    const auto out = context.outputs;
    out[kDesired] = grasp_.phase() == Phase::grasp ? grasp_.desired_n() : 0.0;
    out[kFirstEstimated] = measured_.first_n;
    out[kSecondEstimated] = measured_.second_n;
    out[kEstimated] = 0.5 * (measured_.first_n + measured_.second_n);
    out[kCommand] = command;
    out[kInContact] = grasp_.both_touch();
    out[kPhase] = static_cast<double>(grasp_.phase());
    balance_.show(out.subspan(kTankOutputs), context.arms,
                  {gamma_, alpha_f_, springs_.scale, springs_.energy, set_point_work}, context.dt);
    out[kDistance] = measured_.distance_m;
    out[kDistanceSet] = grasp_.distance_d();
    out[kVerticalForce] = vertical_;
    const Vector6 absolute = pose_error(springs_.X_d, frame.X_WA);
    std::copy_n(absolute.data(), 6, out.begin() + kAbsoluteError);
    Vector6 relative;
    relative << springs_.p_r_d - frame.relative.head<3>(), -frame.relative.tail<3>();
    if (grasp_.phase() == Phase::grasp) {
      relative.head<3>() -= springs_.n.dot(Vector3(relative.head<3>())) * springs_.n;
    }
    std::copy_n(relative.data(), 6, out.begin() + kRelativeError);
    for (std::size_t i = 0; i < 2; ++i) out[kTare + i] = static_cast<double>(felt_[i].tare());
  }

  std::array<Pose, 2> X_EA_;
  std::array<FeltWrench, 2> felt_;
  std::array<JointVector, 2> q_N_;
  TankBalance balance_{2};
  Vector3 p_r_start_ = Vector3::Zero(), n_A_ = Vector3::UnitY();
  RaisedSpring absolute_, relative_;
  GraspSequence grasp_;
  GraspSequence::Measured measured_;
  ForceLoop loop_;
  Fade shift_fade_;
  double shift_ = 0, shift_from_ = 0, shift_to_ = 0;  // of A's set-point along n [m]
  static constexpr double kMassRate = 2;              // [kg/s]: lifts hands on 100 N/m with 0.2 m/s
  double bearable_ = 0, object_mass_ = 0;  // largest mass the arms can carry, and the active mass [kg]
  double integral_ = 0, vertical_ = 0;     // [N]
  double affordable_ = 1;                  // factor on the feed-forward in the last tick
  bool touched_ = false;
  double touch_distance_ = 0, gamma_ = 0, alpha_f_ = 0;
  Springs springs_;
  double closing_speed_ = 0;  // closing speed of the hands [m/s]
  double spring_share_ = 0;   // of the whole springs at the more loaded hand, in their bounds for contact
};

}  // namespace
}  // namespace multipanda::coupled_ufic

namespace multipanda {

ControlletType coupled_ufic_controllet() { return controllet_type<coupled_ufic::CoupledUfic>(); }

}  // namespace multipanda
