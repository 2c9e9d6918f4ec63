#include "core/controllets/ufic.hpp"

#include <algorithm>

#include "core/controllets/cartesian_law.hpp"
#include "core/controllets/damping_design.hpp"
#include "core/controllets/energy_book.hpp"
#include "core/controllets/energy_tank.hpp"
#include "core/controllets/force_law.hpp"

namespace multipanda {
namespace {

enum Input : std::size_t { kPose, kWrench };
constexpr std::size_t kForceGroup = kCartesianParameterCount;
enum Parameter : std::size_t {
  kValveLaw = kForceGroup + kForceParameterCount,
  kReach,
  kTankStart,
  kTankMin,
  kTankMax,
  kTankClosing,
  kPressDirection
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
  kMadeUp,
  kAcross,
  kError = kAcross + 3
};

// The spring of the task as it stood in a tick: its energy is what a moving set-point pays for.
struct SpringState {
  TaskStiffness stiffness{Matrix3::Zero(), Matrix3::Zero()};
  Pose X_d;
  double scale = 1;   // s
  double energy = 0;  // V at the tick's pose, not scaled [J]

  double energy_at(const Pose& X) const { return spring_energy(stiffness, pose_error(X_d, X)); }
};

class Ufic final : public Controllet {
 public:
  LawResult start(ControlContext& context) override {
    OwnedArm& arm = context.arms[0];
    if (!arm.state->has_wrench_estimate) return LawResult::fault;  // blind: it would press without end
    const ParameterSet& parameters = *context.parameters;
    q_N_ = arm.q();
    p_c_ = arm.terms->X_WE().position;
    touched_ = false;
    gamma_ = 0;
    direction_.start(parameters.vector3(kPressDirection));
    detector_.start();
    loop_.start();
    fade_.reset(false);
    across_.reset(Vector3::Zero());
    limits_ = tank_limits(parameters);
    force_tank_.start(parameters.number(kTankStart), limits_);
    impedance_tank_.start(parameters.number(kTankStart), limits_);
    alpha_f_ = force_tank_.valve(limits_);
    book_.start(arm.q());
    made_up_ = 0;
    const CartesianTarget target = CartesianTarget::of(context.inputs[kPose]);
    const ImpedanceGains gains = impedance_gains(parameters);
    spring_ = {gains.stiffness(target.X_W_d.rotation), target.X_W_d, impedance_tank_.valve(limits_), 0};
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

    settle_accounts(arm, law);
    const double set_point_work = move_spring(target, gains, terms.X_WE(), context.dt);
    const double s = spring_.scale;

    // Impedance part
    const Vector6 V = terms.V_WE().vector;
    const Matrix6& Lambda = terms.task().Lambda;
    const Vector6 error = pose_error(target.X_W_d, terms.X_WE());
    const Matrix6 D = task_damping(Lambda, spring_.stiffness.matrix(), gains.damping_ratio);
    const Vector6 spring = s * spring_wrench(spring_.stiffness, error);
    Vector6 feedforward = s * (D * target.V_d.vector);
    if (gains.acceleration_feedforward) feedforward.noalias() += s * (Lambda * target.A_d.vector);
    const JointVector tau_null = null_space_torque(null_space_gains(parameters), arm, q_N_, s);

    // Force part
    const ForceSettings settings = force_settings(parameters, kForceGroup);
    const Vector3 F_d = context.inputs[kWrench].vector().head<3>();
    const Vector3 F_hat = arm.state->F_K_W_est.force(), v = V.head<3>();
    if (!F_d.allFinite() || !F_hat.allFinite()) return LawResult::fault;  // a clamp would hide it
    const ForcePart force = force_part(settings, law, parameters.number(kReach), F_d, F_hat,
                                       terms.X_WE().position, v, context.dt);
    const Vector3 n = direction_.n();
    // D_z against the velocity takes energy; with the set-point's velocity it may give some.
    feedforward.head<3>() += s * settings.damping * n.dot(Vector3(target.V_d.linear())) * n;
    feedforward *= affordable(feedforward.dot(V) * context.dt);

    const Jacobian& J = terms.J_V_WE();
    const auto joints = [&](const Vector6& F) -> JointVector { return J.transpose().lazyProduct(F); };
    const auto along = [](const Vector3& f) {
      Vector6 F = Vector6::Zero();
      F.head<3>() = f;
      return F;
    };
    book_.open(kSpringPart, joints(spring));
    book_.open(kDampingPart, joints(-(D * V)));
    book_.open(kFeedforwardPart, joints(feedforward));
    book_.open(kNullSpacePart, tau_null);
    book_.open(kCoriolisPart, terms.c());
    book_.open(kForcePart, joints(along(force.F)));
    book_.open(kForceDampingPart, joints(along(-settings.damping * n.dot(v) * n)));
    *arm.tau = book_.sum();

    show(context, force, error, set_point_work, arm);
    return arm.tau->allFinite() ? LawResult::ok : LawResult::fault;
  }

 private:
  struct ForcePart {
    Vector3 F;  // F_f'
    double desired = 0, estimated = 0, command = 0;
    Vector3 across;  // let through
  };

  static TankLimits tank_limits(const ParameterSet& parameters) {
    return {parameters.number(kTankMin), parameters.number(kTankMax), parameters.number(kTankClosing)};
  }

  // Work of the period just gone. What the impedance part gave, less what its spring lost, is energy out of
  // nowhere (or into nowhere): the impedance tank's. Work of others (features, limits) is put there, too.
  void settle_accounts(const OwnedArm& arm, ValveLaw law) {
    book_.close(arm.q(), arm.state->tau_J_d);
    const double spring_now = spring_.energy_at(arm.terms->X_WE());
    const double stored = spring_.scale * (spring_now - spring_.energy);
    spring_.energy = spring_now;
    impedance_tank_.give(book_.work(kSpringPart) + stored + book_.work(kDampingPart) +
                         book_.work(kFeedforwardPart) + book_.work(kNullSpacePart) +
                         book_.work(kCoriolisPart) + book_.work_of_others());
    force_tank_.give(book_.work(kForcePart) + book_.work(kForceDampingPart));
    if (law == ValveLaw::paper) made_up_ += force_tank_.make_up(limits_) + impedance_tank_.make_up(limits_);
  }

  // The spring goes to the new set-point, stiffness and valve; the tank pays for the energy it has more.
  // Where it cannot, the spring stays as weak as can be paid for. Gives the work paid [J].
  double move_spring(const CartesianTarget& target, const ImpedanceGains& gains, const Pose& X, double dt) {
    const double before = spring_.scale * spring_.energy;
    SpringState next{gains.stiffness(target.X_W_d.rotation), target.X_W_d, 0, 0};
    next.energy = next.energy_at(X);
    next.scale = std::min(impedance_tank_.valve(limits_), spring_.scale + dt / Fade::kDuration);
    const double purse = std::max(0.0, impedance_tank_.energy() - limits_.min_j);
    if (next.scale * next.energy - before > purse) next.scale = (before + purse) / next.energy;
    spring_ = next;
    const double work = next.scale * next.energy - before;
    impedance_tank_.give(work);
    return work;
  }

  // The share of a work that a tick may take: at most a tenth of what the tank has. So a fast set-point
  // cannot overdraw it before its valve has shut.
  double affordable(double work_j) const {
    const double purse = 0.1 * std::max(0.0, impedance_tank_.energy() - limits_.min_j);
    return work_j > purse ? purse / work_j : 1.0;
  }

  ForcePart force_part(const ForceSettings& settings, ValveLaw law, double reach, const Vector3& F_d,
                       const Vector3& F_hat, const Vector3& p, const Vector3& v, double dt) {
    ForcePart part;
    const Vector3 n = direction_.update(F_d, dt);
    part.desired = std::max(0.0, n.dot(F_d));
    part.estimated = n.dot(F_hat);
    if (detector_.update(part.estimated, settings.contact_threshold, dt)) {
      touched_ = true;
      p_c_ = p;
    }
    // Down at once, up no faster than any fade.
    const double shape = touched_ ? contact_shape((p - p_c_).norm(), reach) : 0.0;
    gamma_ = std::min(shape, gamma_ + dt / Fade::kDuration);
    alpha_f_ = std::min(force_tank_.valve(limits_), alpha_f_ + dt / Fade::kDuration);
    const double w = fade_.towards(detector_.in_contact(), dt);
    const double f = loop_.update(settings.gains, part.desired, part.estimated, w, dt);
    const Vector3 F_t = settings.tangential_gain * w *
                        direction_.across(across_.update(F_hat, settings.tangential_cutoff, dt));
    const double size = F_t.norm();
    part.command = force_share(law, gamma_, alpha_f_, n.dot(v)) * f;
    part.across = force_share(law, gamma_, alpha_f_, size > 1e-9 ? F_t.dot(v) / size : 0.0) * F_t;
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
    out[kForceTank] = force_tank_.energy();
    out[kImpedanceTank] = impedance_tank_.energy();
    const double kinetic = 0.5 * arm.dq().dot(arm.terms->momentum());
    out[kStored] = kinetic + spring_.scale * spring_.energy + force_tank_.energy() + impedance_tank_.energy();
    out[kSpringPower] = book_.work(kSpringPart) * per_s;
    out[kDampingPower] = book_.work(kDampingPart) * per_s;
    out[kFeedforwardPower] = book_.work(kFeedforwardPart) * per_s;
    out[kNullSpacePower] = book_.work(kNullSpacePart) * per_s;
    out[kCoriolisPower] = book_.work(kCoriolisPart) * per_s;
    out[kForcePower] = book_.work(kForcePart) * per_s;
    out[kForceDampingPower] = book_.work(kForceDampingPart) * per_s;
    out[kSetPointPower] = set_point_work * per_s;
    out[kOtherPower] = book_.work_of_others() * per_s;
    out[kMadeUp] = made_up_;
    std::copy_n(force.across.data(), 3, out.begin() + kAcross);
    std::copy_n(error.data(), 6, out.begin() + kError);
  }

  JointVector q_N_;
  Vector3 p_c_ = Vector3::Zero();  // x_c: where the tool last touched
  bool touched_ = false;
  double gamma_ = 0, alpha_f_ = 0, made_up_ = 0;
  ForceDirection direction_;
  ContactDetector detector_;
  ForceLoop loop_;
  Fade fade_;
  LowPass<Vector3> across_;
  TankLimits limits_;
  EnergyTank force_tank_, impedance_tank_;
  EnergyBook book_;
  SpringState spring_;
};

std::vector<ParameterSpec> parameters() {
  auto specs = cartesian_parameters();
  // Stiff along the ground: what the joints' friction takes of the path is friction over stiffness.
  specs[kTranslationalStiffness].initial = {800, 800, 400};
  for (auto& spec : force_parameters()) specs.push_back(std::move(spec));
  specs.push_back({"valve_law",
                   "",
                   1,
                   {0},
                   0,
                   1,
                   "How gamma and alpha_f let the force part through; 'paper' as printed is not passive.",
                   {"passive", "paper"}});
  specs.push_back(
      {"d_max_m", "m", 1, {0.02}, 0.001, 1, "Width of gamma: the force fades away from the last contact."});
  specs.push_back({"tank_start_j",
                   "J",
                   1,
                   {100},
                   0,
                   1000,
                   "Both tanks at the start, cut to their limits. The paper's K_p |F_d|^2 / 2 is above 100 J "
                   "for any force above 1 N."});
  specs.push_back({"tank_min_j", "J", 1, {0}, 0, 1000, "E_min."});
  specs.push_back({"tank_max_j", "J", 1, {100}, 0, 1000, "E_max; what comes back above it is lost."});
  specs.push_back({"tank_closing_j", "J", 1, {0.1}, 0.01, 10, "Valves close over this range above E_min."});
  specs.push_back(press_direction_parameter());
  return specs;
}

}  // namespace

ControlletType ufic_controllet() {
  return {
      {.type = "ufic",
       .doc = "Unified force-impedance control: follows a pose and presses with a force, kept passive by "
              "two energy tanks.",
       .inputs = {{.name = "pose", .quantity = Quantity::pose, .doc = "X_WE set-point, in the world."},
                  wrench_input()},
       .parameters = parameters(),
       .outputs = {{"force_desired_n", 1, "F_d along n."},
                   {"force_estimated_n", 1, "F_hat along n."},
                   {"force_command_n", 1, "F_f' along n."},
                   {"in_contact", 1, "1 while the estimate says so."},
                   {"gamma_f", 1, "gamma about the last contact."},
                   {"alpha_f", 1, "Valve of the force tank."},
                   {"alpha_i", 1, "Valve of the impedance tank: 0 leaves the spring, -1 takes it away."},
                   {"force_tank_j", 1, "Energy of the force tank."},
                   {"impedance_tank_j", 1, "Energy of the impedance tank."},
                   {"stored_energy_j", 1, "Kinetic + spring + both tanks."},
                   {"power_task_spring_w", 1, "Into the arm, over the period just gone."},
                   {"power_task_damping_w", 1, "The same, of -D_c V."},
                   {"power_feedforward_w", 1, "The same, of the set-point: (D_c + D_z) V_d + Lambda A_d."},
                   {"power_nullspace_w", 1, "The same, of the null space."},
                   {"power_coriolis_w", 1, "The same, of C dq."},
                   {"power_force_w", 1, "The same, of F_f'."},
                   {"power_force_damping_w", 1, "The same, of D_z."},
                   {"power_set_point_w", 1, "Into the spring, by set-point, stiffness and valve."},
                   {"power_other_w", 1, "Into the arm, by features and limits."},
                   {"energy_made_up_j", 1, "Valve law 'paper': what its tanks gave without having it."},
                   {"tangential_force_n", 3, "Part of F_f' across n, world axes."},
                   {"position_error_m", 3, "p_d - p, world axes."},
                   {"orientation_error_rad", 3, "log(R_d R^T), world axes."}}},
      [](ArmModels) -> std::unique_ptr<Controllet> { return std::make_unique<Ufic>(); }};
}

}  // namespace multipanda
