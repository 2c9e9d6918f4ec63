#include <algorithm>
#include <cmath>
#include <numbers>

#include "core/controllets/builtins.hpp"
#include "core/controllets/damping_design.hpp"
#include "core/controllets/energy_balance.hpp"
#include "core/controllets/energy_tank.hpp"
#include "core/controllets/felt_wrench.hpp"
#include "core/controllets/force_law.hpp"
#include "core/controllets/raised_spring.hpp"
#include "core/controllets/teleoperation_channel.hpp"
#include "core/controllets/teleoperation_descriptor.hpp"

namespace multipanda::teleoperation {
namespace {

// One arm's energy: the tank supplies all work of the arm's torque, features and limits included.
struct Side {
  EnergyTank tank;
  EnergyBalance balance;
  double valve = 0;  // of the pull

  void start(const OwnedArm& arm, double energy_j, const TankLimits& limits);
  // Closes the last period: the torque was constant in it, so this work is exact.
  void close(const OwnedArm& arm, const TankLimits& limits, double dt);
  // The part of a pull that the tank passes (6 x 1) [N, N m]: the valve's share where it supplies power, all
  // of it where it absorbs power; and at most a tenth of the tank per tick. `V` (6 x 1) [m/s, rad/s] is the
  // hand's twist, `D` [N s/m, N m s/rad] the damping of the law.
  Vector6 let_through(const Vector6& pull, const Vector6& V, const Matrix6& D, const TankLimits& limits,
                      double dt) const;
};

void Side::start(const OwnedArm& arm, double energy_j, const TankLimits& limits) {
  tank.start(energy_j, limits);
  balance.start(arm.q());
  valve = tank.valve(limits);
}

void Side::close(const OwnedArm& arm, const TankLimits& limits, double dt) {
  balance.close(arm.q(), arm.state->tau_J_d);
  tank.give(balance.work(kForcePart) + balance.work_of_others());
  valve = std::min(tank.valve(limits), valve + dt / Fade::kDuration);
}

Vector6 Side::let_through(const Vector6& pull, const Vector6& V, const Matrix6& D, const TankLimits& limits,
                          double dt) const {
  Vector6 passed = pull;
  for (const Eigen::Index first : {0, 3}) {
    const double size = pull.segment<3>(first).norm();
    if (!(size > 1e-9)) continue;
    const Vector3 n = pull.segment<3>(first) / size;
    const double damping = n.dot(D.block<3, 3>(first, first) * n);
    passed.segment<3>(first) *= force_share(ValveLaw::passive, 1, valve, n.dot(V.segment<3>(first)),
                                            incoming_speed_for(size, 1, valve, damping));
  }
  return passed * tank.affordable(passed.dot(V) * dt, 0.1, limits);
}

// The share of a pull that fits into the joints' limits on top of the rest of the torque, with gravity and
// without: a joint measures the first, and stops its arm beyond its limit; the second is the command, which
// has the same limit. 60 N and 15 N m soon exceed the 12 N m of a wrist.
double bearable_share(const OwnedArm& arm, const JointVector& pull, const JointVector& rest) {
  constexpr double kShare = 0.9;  // of the limit
  const JointVector& g = arm.terms->g();
  double share = 1;
  for (Eigen::Index i = 0; i < pull.size(); ++i) {
    const double size = std::abs(pull[i]), way = pull[i] > 0 ? 1 : -1;
    const double loaded = way * rest[i] + std::max(0.0, way * g[i]);
    const double room = std::max(0.0, kShare * arm.model().limits().tau_max[i] - loaded);
    if (size > room) share = std::min(share, room / size);
  }
  return share;
}

Vector6 rotated(const Matrix3& R, const Vector6& x) {
  Vector6 y;
  y << R * x.head<3>(), R * x.tail<3>();
  return y;
}

// Bilateral teleoperation: the first arm leads, the second follows, and the leader feels what the follower
// meets. Two energy tanks and a channel that only passes energy on keep it passive with any delay and loss
// (two layers: Franken et al., IEEE Transactions on Robotics 2011). Law: docs/controllets/teleoperation.md.
class Teleoperation final : public Controllet {
 public:
  static ControlletDescriptor descriptor() { return teleoperation::descriptor(); }

  LawResult start(ControlContext& context) override {
    const ParameterSet& parameters = *context.parameters;
    OwnedArm& follower = context.arms[1];
    if (needs_estimate(parameters) && !follower.state->has_wrench_estimate) return LawResult::fault;
    for (std::size_t i = 0; i < 2; ++i) {
      jumps_[i].start(context.arms[i]);
      felt_wrench_[i].start(context.arms[i]);
    }
    const TankLimits limits = tank_limits(parameters);
    for (std::size_t i = 0; i < 2; ++i)
      sides_[i].start(context.arms[i], parameters.number(kTankStart), limits);
    to_follower_.start(1);
    to_leader_.start(2);
    led_.start(context.arms[0], follower.terms->X_WE());
    follows_.start(follower.terms->X_WE());
    q_N_ = follower.q();
    raised_ = {};
    p_offset_.setZero();
    R_offset_.setIdentity();
    alignments_ = aligned_ = 0;
    closed_ = faded_out_ = unattended_ = slipped_ = false;
    driven_s_ = slipped_at_s_ = 0;
    engaged_.reset(false);
    correction_.reset(Vector6::Zero());
    felt_ = {};
    return LawResult::ok;
  }

  LawResult update(ControlContext& context) override {
    const ParameterSet& parameters = *context.parameters;
    if (needs_estimate(parameters) && !context.arms[1].state->has_wrench_estimate) return LawResult::fault;
    for (std::size_t i = 0; i < 2; ++i) {
      if (jumps_[i].jumped(context.arms[i])) return LawResult::fault;
    }
    // A person holds the leader; what it feels is bounded as a bias is.
    for (std::size_t i = 0; i < 2; ++i)
      felt_wrench_[i].update(context.arms[i], i == 1 && closed_, context.dt);
    const TankLimits limits = tank_limits(parameters);
    for (std::size_t i = 0; i < 2; ++i) sides_[i].close(context.arms[i], limits, context.dt);
    turn_clutch(parameters);
    map_ = leading_rotation(static_cast<LeadingAxes>(parameters.choice(kAxes)), context.arms[0].model(),
                            context.arms[1].model());
    lead(context);
    exchange(context, limits);
    if (follow(context, limits) != LawResult::ok || reflect(context, limits) != LawResult::ok)
      return LawResult::fault;
    show(context);
    return LawResult::ok;
  }

  // Both are aligned again where they are, as if the clutch had been opened and closed. (LedPose sees a
  // leader's new end effector.)
  void end_effector_moved(ControlContext& /*context*/, std::size_t arm, const Pose& X) override {
    closed_ = false;
    if (arm == 0) {  // the felt force fades out at its last value
      const Vector3 p_back = -(felt_.R * X.position);
      felt_.spring = shifted({felt_.spring}, p_back).vector;
      correction_.reset(shifted({correction_.value()}, p_back).vector);
      return;
    }
    follows_.carry(X);
    aligned_ = 0;
  }

 private:
  static bool needs_estimate(const ParameterSet& parameters) {
    return parameters.choice(kArchitecture) == static_cast<std::size_t>(Architecture::position_force);
  }
  static TankLimits tank_limits(const ParameterSet& parameters) {
    return {0, parameters.number(kTankMax), parameters.number(kTankClosing)};
  }

  // Both sides align again when it closes, and when the axes change; what the leader felt fades out before.
  void turn_clutch(const ParameterSet& parameters) {
    if (!parameters.flag(kClutch)) unattended_ = false;
    const bool closed = parameters.flag(kClutch) && !unattended_;
    const std::size_t axes = parameters.choice(kAxes);
    if (closed && (!closed_ || axes != axes_)) {
      ++alignments_;
      faded_out_ = false;
    }
    closed_ = closed;
    axes_ = axes;
  }

  // The leader's goal in this tick.
  void lead(const ControlContext& context) {
    if (closed_) {
      led_.advance(context.arms[0], map_, context.parameters->number(kScale));
    } else {
      led_.skip(context.arms[0]);
    }
  }

  // Both sides send, then receive: without delay in the same tick. The fuller tank gives to the other, as
  // far as it knows; what is lost on the way is gone.
  void exchange(const ControlContext& context, const TankLimits& limits) {
    // [1/s]: with 0.2 s of delay well below pi / (2 * 0.2 s), where it would swing.
    constexpr double kRate = 4;
    const auto gift = [&](EnergyTank& tank, const TeleoperationChannel& other) {
      if (!other.any()) return 0.0;
      const double surplus = std::max(0.0, tank.energy() - other.newest().tank);
      const double energy =
          std::min(0.5 * kRate * context.dt * surplus, std::max(0.0, tank.energy() - limits.min_j));
      tank.give(energy);
      return energy;
    };
    const OwnedArm& follower = context.arms[1];
    TeleoperationPacket forth{.sent_s = context.time_s, .alignment = closed_ ? alignments_ : 0};
    forth.X = led_.X();
    forth.V = led_.V();
    forth.energy = gift(sides_[0].tank, to_leader_);
    forth.tank = sides_[0].tank.energy();
    TeleoperationPacket back{.sent_s = context.time_s, .alignment = aligned_};
    back.energy = gift(sides_[1].tank, to_follower_);
    back.tank = sides_[1].tank.energy();

    const double delay = context.parameters->number(kDelay), loss = context.parameters->number(kLoss);
    to_follower_.send(forth, loss);
    sides_[1].tank.give(-to_follower_.receive(context.time_s, delay, context.dt));
    align();
    slip(context);
    back.alignment = aligned_;
    back.X = to_led(follower.terms->X_WE());
    back.V = follower.terms->V_WE().vector;
    back.F = felt_wrench_[1].at_E();
    to_leader_.send(back, loss);
    sides_[0].tank.give(-to_leader_.receive(context.time_s, delay, context.dt));
  }

  // The follower: whenever the clutch closes, the leader's goal begins at its set-point. If the set-point
  // lags too far later, the clutch slips until it is opened.
  void align() {
    const TeleoperationPacket& packet = to_follower_.newest();
    if (packet.alignment == 0 && packet.sent_s >= slipped_at_s_) slipped_ = false;
    const std::uint32_t alignment = to_follower_.any() && !slipped_ ? packet.alignment : 0;
    if (alignment != 0 && alignment != aligned_) {
      p_offset_ = follows_.X().position - packet.X.position;
      R_offset_ = packet.X.rotation.transpose() * follows_.X().rotation;
    }
    aligned_ = alignment;
  }
  void slip(const ControlContext& context) {
    if (aligned_ == 0 || !(follows_.left_behind(from_led(to_follower_.newest().X), context.contact) ||
                           strain(context) > kLargestStrain)) {
      return;
    }
    slipped_ = true;
    slipped_at_s_ = context.time_s;  // a clutch opened before does not end it
    aligned_ = 0;
  }
  double strain(const ControlContext& context) const {
    return follows_.strain(context.arms[1].terms->X_WE(),
                           impedance_gains(*context.parameters, context.contact));
  }
  Pose from_led(const Pose& X) const { return {X.rotation * R_offset_, X.position + p_offset_}; }
  Pose to_led(const Pose& X) const { return {X.rotation * R_offset_.transpose(), X.position - p_offset_}; }

  LawResult follow(ControlContext& context, const TankLimits& limits) {
    OwnedArm& arm = context.arms[1];
    const ParameterSet& parameters = *context.parameters;
    const TeleoperationPacket& packet = to_follower_.newest();
    if (aligned_ != 0) {
      follows_.advance(from_led(packet.X), to_follower_.trust() * packet.V, context.contact, context.dt);
    } else {
      follows_.brake(arm.terms->X_WE(), strain(context), context.contact, context.dt);
    }
    const CartesianTarget target = follows_.target();
    ModelTerms& terms = *arm.terms;
    ImpedanceGains gains = impedance_gains(parameters, context.contact);
    context.outputs[kStiffnessShare] = gains.soften(target.X_W_d.rotation, terms);
    const Vector6 V = terms.V_WE().vector;
    const TaskForce force =
        impedance_force(impedance_gains(parameters, context.contact), target, terms, context.dt, raised_);
    const Matrix3& R_d = target.X_W_d.rotation;
    const Matrix6 D = gains.damping(R_d, gains.stiffness(R_d).matrix(), terms);
    const Vector6 damping = D * V;
    follows_.resist(force.pull, force.bounded.force_share, force.bounded.moment_share, context.dt);
    const JointVector rest =
        null_space_torque(null_space_gains(parameters, context.contact), arm, q_N_, sides_[1].valve);
    return apply(context, 1, force.total + damping, D, rest, limits);
  }

  // The torque of one side: the pull within the limits of joints and tank, less the damping D V of the hand,
  // and the rest of the law.
  LawResult apply(ControlContext& context, std::size_t i, const Vector6& pull, const Matrix6& D,
                  const JointVector& rest, const TankLimits& limits) {
    OwnedArm& arm = context.arms[i];
    ModelTerms& terms = *arm.terms;
    const auto in_joints = [&](const Vector6& F) {
      return JointVector(terms.J_V_WE().transpose().lazyProduct(F));
    };
    const Vector6 V = terms.V_WE().vector, damping = D * V;
    const JointVector others = terms.c() + rest - in_joints(damping);
    const Vector6 bearable = bearable_share(arm, in_joints(pull), others) * pull;
    const Vector6 passed = sides_[i].let_through(bearable, V, D, limits, context.dt), F = passed - damping;
    std::copy_n(F.data(), 6, context.outputs.begin() + (i == 0 ? kLeaderForce : kFollowerForce));
    *arm.tau = others + in_joints(passed);
    sides_[i].balance.open(kForcePart, *arm.tau);
    return arm.tau->allFinite() ? LawResult::ok : LawResult::fault;
  }

  // The leader: felt force and damping.
  LawResult reflect(ControlContext& context, const TankLimits& limits) {
    OwnedArm& arm = context.arms[0];
    const ParameterSet& parameters = *context.parameters;
    const TeleoperationPacket& packet = to_leader_.newest();
    if (engaged_.value() == 0) faded_out_ = true;
    const bool coupled = closed_ && faded_out_ && to_leader_.any() && packet.alignment == alignments_;
    if (coupled) felt_ = coupling_of(parameters, arm);
    const double engaged = engaged_.towards(coupled, context.dt);
    if (!coupled && engaged == 0) {
      correction_.reset(Vector6::Zero());
      felt_ = {};
    }
    const Vector6 V = arm.terms->V_WE().vector, damper = felt_.D * felt_.V;
    if (coupled) correct(parameters, felt_.spring + damper - felt_.D * V, packet, context);
    Matrix6 D = engaged * felt_.D;
    D.diagonal().head<3>().array() += parameters.number(kLeaderDamping) + refill(parameters, engaged);
    const Vector6 drive = felt_.spring + correction_.value();
    attend(arm, drive, coupled, context.dt);
    const Vector6 pull = engaged * (bound_drive(drive, V, context.contact) + damper);
    const BoundedPull bounded = bound_pull(context.contact, pull, D * V, V.head<3>());
    const JointVector rest = -parameters.number(kLeaderJointDamping) * arm.dq();
    return apply(context, 0, bounded.remaining(pull), D, rest, limits);
  }

  // The drive of the leader ends at kDriveEnds along its motion, below the speed of a hand: without a person
  // the coupling moves it no faster, and no harder where a scene lifts the bounds.
  static Vector6 bound_drive(const Vector6& drive, const Vector6& V, const ContactBounds& bounds) {
    constexpr double kDriveEnds = 0.2;  // [m/s]: 60 N over this is the steepest fall of bound_pull
    const double size = drive.head<3>().norm();
    if (!(size > 0)) return drive;
    const double speed = std::max(0.0, drive.head<3>().dot(V.head<3>()) / size);
    const double most = tighter(bounds, {}).spring_force * std::max(0.0, 1 - speed / kDriveEnds);
    Vector6 left = drive;
    left.head<3>() *= std::min(1.0, most / size);
    return left;
  }

  // A leader that the follower drives without resistance is not held by a person: its clutch opens. A person
  // who leads is ahead of the follower, so the coupling resists the motion.
  void attend(const OwnedArm& arm, const Vector6& drive, bool coupled, double dt) {
    constexpr double kMoves = 0.05, kDrives = 2, kResists = 6, kLongest = 0.5;  // [m/s], [N], [N], [s]
    const Vector3 v = arm.terms->V_WE().linear();
    const double speed = v.norm();
    const bool driven = coupled && speed > kMoves && drive.head<3>().dot(v) > kDrives * speed;
    const FeltWrench& felt = felt_wrench_[0];
    // A leader whose sensor has failed feels nothing and counts as not held.
    const bool free = !arm.state->has_wrench_estimate ||
                      felt.at_E().head<3>().norm() < kResists + felt.motion(1) + felt.doubt(1);
    driven_s_ = driven && free ? driven_s_ + dt : 0;
    if (driven_s_ > kLongest) unattended_ = true;
  }

  // A spring and damper between both hands, in the leader's axes:
  //   K x~ + D (V_f - V_l),   x~ from the leader's goal to the follower's hand
  // K is that of the follower, times the scales, so that both get the same force at rest; no stiffer than the
  // largest K, whatever the scales are. While the clutch is open, all parts stay as they were when it was
  // opened, so that they fade out together.
  struct Coupling {
    Vector6 spring = Vector6::Zero();
    Matrix6 D = Matrix6::Zero();
    Vector6 V = Vector6::Zero();      // of the follower
    Matrix3 R = Matrix3::Identity();  // of the leader's hand
  };
  Coupling coupling_of(const ParameterSet& parameters, const OwnedArm& leader) const {
    const TeleoperationPacket& packet = to_leader_.newest();
    const double scale = parameters.number(kScale);
    ImpedanceGains gains = impedance_gains(parameters);
    const Matrix3 R = map_.transpose() * gains.axes_at(packet.X.rotation);
    const double force_scale = parameters.number(kForceScale);
    gains.translational_stiffness = (force_scale * scale * gains.translational_stiffness).cwiseMin(kStiffest);
    gains.rotational_stiffness = (force_scale * gains.rotational_stiffness).cwiseMin(kStiffestTurning);
    gains.axes = StiffnessAxes::end_effector;
    gains.soften(R, *leader.terms);
    const Matrix6 own = gains.stiffness(R).matrix();
    gains.translational_stiffness /= scale;
    const Vector6 error = rotated(map_.transpose(), pose_error(packet.X, led_.X()));
    Coupling coupling{.spring = spring_wrench(gains.stiffness(R), error),
                      .D = task_damping(leader.terms->task().Lambda, own, gains.damping_ratio),
                      .V = to_leader_.trust() * rotated(map_.transpose(), packet.V),
                      .R = leader.terms->X_WE().rotation};
    if (states_motors(leader.model()))
      raise_modes(leader.terms->task().Lambda, Matrix6(kLeastDampingTime * own), coupling.D);
    coupling.V.head<3>() /= scale;
    return coupling;
  }

  // Position-force: below the cutoff, what the follower exerts replaces the spring and damper, `felt`. Above
  // it they remain, since an impact that kicks the leader would lift the follower off, again and again. The
  // cutoff is lower where packets are old, 1 / (4 age) [rad/s], so that the reply to the leader's own motion
  // does not make it swing.
  void correct(const ParameterSet& parameters, const Vector6& felt, const TeleoperationPacket& packet,
               const ControlContext& context) {
    const Vector6 F = -parameters.number(kForceScale) * rotated(map_.transpose(), packet.F);
    const double age = context.time_s - packet.sent_s,
                 cutoff =
                     std::min(parameters.number(kCutoff), 1 / (8 * std::numbers::pi * std::max(age, 1e-6)));
    const bool by_estimate = needs_estimate(parameters);  // otherwise its remainder fades
    correction_.update(by_estimate ? Vector6(F - felt) : Vector6(Vector6::Zero()), cutoff, context.dt);
  }

  // Additional damping of the leader: while its tank is nearly empty, and as far as the coupling does not act
  // although the clutch should be closed, since perhaps nobody holds the leader.
  double refill(const ParameterSet& parameters, double engaged) const {
    const double below = parameters.number(kRefillBelow);
    const double empty = below > 0 ? std::clamp((below - sides_[0].tank.energy()) / below, 0.0, 1.0) : 0;
    const double open = parameters.flag(kClutch) ? 1 - engaged : 0;
    return parameters.number(kRefillDamping) * std::max(empty, open);
  }

  void show(ControlContext& context) const {
    const auto out = context.outputs;
    double kinetic = 0;
    for (const OwnedArm& arm : context.arms) kinetic += 0.5 * arm.dq().dot(arm.terms->momentum());
    const double under_way = to_follower_.under_way() + to_leader_.under_way();
    out[kEngaged] = engaged_.value();
    out[kLeaderTank] = sides_[0].tank.energy();
    out[kFollowerTank] = sides_[1].tank.energy();
    out[kUnderWay] = under_way;
    out[kStored] = kinetic + sides_[0].tank.energy() + sides_[1].tank.energy() + under_way;
    out[kLost] = to_follower_.lost() + to_leader_.lost();
    out[kLeaderValve] = sides_[0].valve;
    out[kFollowerValve] = sides_[1].valve;
    out[kAge] = to_follower_.any() ? context.time_s - to_follower_.newest().sent_s : 0;
    const Vector6 error = pose_error(from_led(led_.X()), context.arms[1].terms->X_WE());
    std::copy_n(error.data(), 6, out.begin() + kError);
    out[kSlipped] = slipped_ || unattended_ ? 1 : 0;
  }

  static constexpr double kStiffest = 5000, kStiffestTurning = 300;  // [N/m], [N m/rad]

  std::array<Side, 2> sides_;
  TeleoperationChannel to_follower_, to_leader_;
  std::array<JumpDetector, 2> jumps_;
  std::array<FeltWrench, 2> felt_wrench_;
  LedPose led_;            // the leader's side
  FollowingPose follows_;  // the follower's side
  JointVector q_N_;
  RaisedSpring raised_;
  Matrix3 map_ = Matrix3::Identity();
  bool closed_ = false;
  std::size_t axes_ = 0;
  std::uint32_t alignments_ = 0;  // the leader's side: times that the clutch was closed
  bool faded_out_ = false;        // what the leader felt, since then
  bool unattended_ = false;       // nobody held the leader, until the clutch is opened
  double driven_s_ = 0;           // duration for which it was driven
  std::uint32_t aligned_ = 0;     // the follower's side: the one that it is aligned to; 0: none
  bool slipped_ = false;          // it lagged too far, until the clutch is opened
  double slipped_at_s_ = 0;
  Vector3 p_offset_ = Vector3::Zero();
  Matrix3 R_offset_ = Matrix3::Identity();
  Fade engaged_;
  Coupling felt_;
  LowPass<Vector6> correction_;
};

}  // namespace
}  // namespace multipanda::teleoperation

namespace multipanda {

ControlletType teleoperation_controllet() { return controllet_type<teleoperation::Teleoperation>(); }

}  // namespace multipanda
