#include <algorithm>

#include "core/controllets/builtins.hpp"
#include "core/controllets/energy_tank.hpp"
#include "core/controllets/felt_wrench.hpp"
#include "core/controllets/force_law.hpp"
#include "core/controllets/raised_spring.hpp"

namespace multipanda {
namespace {

// Force control of one arm along one direction, with an impedance in all others. Approach and loss of
// contact: docs/controllets/force.md.
//   tau = J^T (F_i - w n n^T F_s + n (w gamma f - D_z v_n) + g_t w F_t) + tau_null + C dq
// F_i the impedance, F_s its spring, n the pressing direction, w from 0 to 1 with the first contact. At rest
// in contact the arm exerts f = F_d along n, by the integral part. World axes; forces [N] are those that the
// arm exerts.
class Force final : public Controllet {
 public:
  static ControlletDescriptor descriptor() {
    ForceParameters force = force_parameters();
    force[kTangentialGain].initial = {0};  // the tool does not slide; see the page of `force`
    return {
        .type = "force",
        .doc =
            "Approaches a surface slowly, then presses on it with a desired force; holds its pose across "
            "the pressing direction.",
        .inputs = spec_table<kInputCount>(input_at<kWrench>(wrench_input())),
        .parameters = spec_table<kParameterCount>(
            cartesian_parameters(), group_at<kForceGroup>(force),
            parameter_at<kApproachSpeed>(
                {.name = "approach_speed_m_per_s",
                 .unit = "m/s",
                 .initial = {0.02},
                 .max = 0.2,
                 .doc = "Speed of the set-point towards a surface. The impact force grows with it: "
                        "v sqrt(stiffness x mass)."}),
            parameter_at<kPressDirection>(press_direction_parameter()),
            parameter_at<kReach>({.name = "d_max_m",
                                  .unit = "m",
                                  .initial = {0.02},
                                  .min = 0.001,
                                  .max = 1,
                                  .doc = "Width of gamma, which fades the force beyond the last contact."})),
        .outputs = spec_table<kOutputCount>(
            output_at<kDesired>("force_desired_n", "F_d along n."),
            output_at<kEstimated>("force_estimated_n", "F_hat along n."),
            output_at<kCommand>("force_command_n", "w gamma f: commanded force along n."),
            output_at<kInContact>("in_contact", "1 while contact is detected, otherwise 0."),
            output_at<kGamma>("gamma_f", "Fading factor beyond the last contact."),
            output_at<kApproaching>("approaching", "1 while approaching a surface, otherwise 0."),
            output_at<kError, 3>("position_error_m", "Deviation from the held pose, world axes."),
            output_at<kError + 3, 3>("orientation_error_rad", "Deviation from the held pose, world axes."),
            output_at<kStiffnessShare>("stiffness_share", kStiffnessShareDoc),
            output_at<kTare>("tare", FeltWrench::kTareDoc)),
        .presets = {paper_preset({{"force_proportional", {1}},
                                  {"force_derivative_s", {0}},
                                  {"force_integral_per_s", {2}},
                                  {"force_may_pull", {1}},
                                  {"force_damping_n_s_per_m", {0}}})}};
  }

  LawResult start(ControlContext& context) override {
    const OwnedArm& arm = context.arms[0];
    if (!arm.state->has_wrench_estimate)
      return LawResult::fault;  // without an estimate the force has no feedback
    q_N_ = arm.q();
    raised_ = {};
    X_hold_ = arm.terms->X_WE();
    p_c_ = X_hold_.position;
    direction_.start(context.parameters->vector3(kPressDirection));
    felt_.start(arm);
    detector_.start();
    loop_.start();
    room_.start();
    across_.reset(Vector3::Zero());
    pressing_fade_.reset(false);
    approach_fade_.reset(false);
    travel_ = pull_share_ = 0;
    pressing_ = false;
    return LawResult::ok;
  }

  LawResult update(ControlContext& context) override {
    OwnedArm& arm = context.arms[0];
    ModelTerms& terms = *arm.terms;
    const ParameterSet& parameters = *context.parameters;
    ForceSettings settings = force_settings(parameters, kForceGroup);
    const double dt = context.dt;

    const Vector3 F_d = context.inputs[kWrench].vector().head<3>();
    const Vector3 n = direction_.update(F_d, dt);
    const double asked = std::max(0.0, n.dot(F_d));
    felt_.update(arm, pressing_ && asked > ForceDirection::kLeastForce, dt);
    settings.contact_threshold += felt_.motion(settings.motion_share);
    settings.contact_doubt = felt_.doubt(settings.motion_share);
    const double desired = felt_.waits() ? 0.0 : asked;
    const Vector3 F_hat = felt_.at_E().head<3>();
    if (!F_d.allFinite() || !F_hat.allFinite())
      return LawResult::fault;  // clamping would hide an invalid value
    const double estimated = n.dot(F_hat);
    const Vector3 p = terms.X_WE().position;
    watch_contact(estimated, settings, p, n, dt);

    const double w = pressing_fade_.towards(pressing_, dt);
    const double beyond = std::max(0.0, n.dot(p - p_c_));
    const double gamma = contact_shape(beyond, parameters.number(kReach));

    // Without contact, the set-point advances along n.
    const bool approaching = !pressing_ && desired > ForceDirection::kLeastForce;
    const double speed =
        std::min(parameters.number(kApproachSpeed), context.contact.hand_speed) *
        approach_fade_.towards(approaching && pull_share_ < 1, dt);  // waits for a hand that cannot follow
    travel_ += speed * dt;
    CartesianTarget target{X_hold_, {}, {}};
    target.X_W_d.position += n * travel_;
    target.V_d.linear() = n * speed;

    const ImpedanceGains gains = impedance_gains(parameters, context.contact);
    TaskForce force = impedance_force(gains, target, terms, dt, raised_);
    const Vector3 spring = force.spring.head<3>();
    pull_share_ = n.dot(spring) > 0 ? force.bounded.force_share : 0;
    const double v_n = n.dot(Vector3(terms.V_WE().linear()));
    const Vector3 pull = force.bounded.remaining(force.pull).head<3>();
    const double most = context.contact.spring_force;
    const Vector3 F_t = settings.tangential_gain * w *
                        direction_.across(across_.update(F_hat, settings.tangential_cutoff, dt));
    // A hand in the way acts like friction and would be pushed ever harder.
    const Vector3 pull_across = direction_.across(pull);
    const Vector3 along_surface = largest_share(pull_across, F_t, most) * F_t;
    // The force along n and the force across it together respect the bound.
    const double spring_n = w * n.dot(spring);
    const double left = left_beside(pull_across + along_surface, most) - n.dot(pull) + spring_n;
    const double room = room_.update(std::min(left, most), most, dt);
    const double deepest =
        std::max(0.0, left_beside(pull_across + along_surface, most) + n.dot(pull) - spring_n);
    // Nothing stops a hand that retreats because its estimate is wrong: there is no spring along n.
    const double retreat = std::min(deepest, force_at_speed(context.contact, -v_n));
    const double command =
        w * gamma * loop_.update(settings.gains, desired, estimated, gamma * w, dt, room, retreat);
    // With the set-point's velocity, D_z also pulls.
    const double approach =
        gains.damping_of == DampingOf::velocity
            ? 0.0
            : std::min(settings.damping * speed,
                       std::max(0.0, most - n.dot(pull)) + settings.damping * std::max(0.0, v_n));
    force.total.head<3>() += n * (command - spring_n - settings.damping * v_n + approach) + along_surface;

    *arm.tau = terms.c() + null_space_torque(null_space_gains(parameters, context.contact), arm, q_N_);
    *arm.tau += terms.J_V_WE().transpose().lazyProduct(force.total);

    const auto out = context.outputs;
    out[kDesired] = desired;
    out[kEstimated] = estimated;
    out[kCommand] = command;
    out[kInContact] = detector_.in_contact();
    out[kGamma] = gamma;
    out[kApproaching] = approaching;
    std::copy_n(pose_error(X_hold_, terms.X_WE()).data(), 6, out.begin() + kError);
    out[kStiffnessShare] = force.stiffness_share;
    out[kTare] = static_cast<double>(felt_.tare());
    return arm.tau->allFinite() ? LawResult::ok : LawResult::fault;
  }

  void end_effector_moved(ControlContext& context, std::size_t /*arm*/, const Pose& X) override {
    const Pose& X_WE = context.arms[0].terms->X_WE();
    p_c_ += X_WE.position - (X_WE * X.inverse()).position;
    X_hold_ = X_hold_ * X;
  }

 private:
  enum Input : std::size_t { kWrench, kInputCount };
  static constexpr std::size_t kForceGroup = kCartesianParameterCount;
  enum Parameter : std::size_t {
    kApproachSpeed = kForceGroup + kForceParameterCount,
    kPressDirection,
    kReach,
    kParameterCount
  };
  enum Output : std::size_t {
    kDesired,
    kEstimated,
    kCommand,
    kInContact,
    kGamma,
    kApproaching,
    kError,
    kStiffnessShare = kError + 6,
    kTare,
    kOutputCount
  };

  // Pressing begins with the first contact. It ends when the tool has advanced by kLossDistance without
  // contact, so that a bounce or a small desired force does not end it.
  void watch_contact(double estimated, const ForceSettings& settings, const Vector3& p, const Vector3& n,
                     double dt) {
    static constexpr double kLossDistance = 0.005;  // [m]
    const bool contact = detector_.update(estimated, settings.contact_threshold, dt, settings.contact_doubt);
    if (contact) {
      pressing_ = true;
      p_c_ = p;
    } else if (pressing_ && n.dot(p - p_c_) > kLossDistance) {
      pressing_ = false;
    }
    // If pressing ends, the approach continues from the current position of the tool.
    if (pressing_) travel_ += pressing_fade_.value() * (n.dot(p - X_hold_.position) - travel_);
  }

  JointVector q_N_;
  RaisedSpring raised_;
  Pose X_hold_;
  Vector3 p_c_ = Vector3::Zero();  // last point of contact of the tool
  FeltWrench felt_;
  ForceDirection direction_;
  ContactDetector detector_;
  ForceLoop loop_;
  ForceRoom room_;
  LowPass<Vector3> across_;
  Fade pressing_fade_, approach_fade_;
  double travel_ = 0;      // of the set-point along n from X_hold [m]
  double pull_share_ = 0;  // of the allowed pull, in the last tick
  bool pressing_ = false;
};

}  // namespace

ControlletType force_controllet() { return controllet_type<Force>(); }

}  // namespace multipanda
