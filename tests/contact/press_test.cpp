#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <optional>
#include <random>
#include <stdexcept>
#include <string>
#include <string_view>

#include <gtest/gtest.h>

#include "backends/mujoco/mujoco_backend.hpp"
#include "core/cycle/control_cycle.hpp"
#include "core/modes/registry.hpp"
#include "core/testing/series.hpp"
#include "scene/build.hpp"
#include "tests/teleoperation/operator.hpp"

// A goal on the far side of a person's hand: how hard is it pressed? The hand is the model of ISO/TS 15066
// (table A.3, hands and fingers): 0.6 kg on a spring of 75 N/mm; clamped, because the spring ends at a table.
namespace multipanda::press {

struct Press {
  std::string controllet;
  int pose = 0;  // of the arm, 0 to 3
  bool motor_inertia = false;
  bool bounded = true;          // with the bounds for contact
  double released_after_s = 0;  // since it was touched, the person's hand is gone; 0: never
  double stiffness = 0;         // of cartesian_impedance [N/m]; 0: its usual one
  bool axes = false;            // of ufic: a force along z, no moments about x and y
  double beyond = 0.3;          // way from the person's hand to the goal [m]
};

inline constexpr int kPoses = 4;
// ISO/TS 15066, table A.2, back and palm of the hand: 140 N clamped (quasi-static), twice that in the first
// 0.5 s (transient).
inline constexpr double kTransient = 280, kQuasiStatic = 140, kTransientTime = 0.5;  // [N], [s]

struct Outcome {
  double impact = 0, later = 0;  // largest force of the spring until and after kTransientTime [N]
  double swing = 0;              // of the force in the last second [N]
  double at_end = 0;             // [N]
  double hand_speed = 0;         // largest speed of the robot's hand before it touched [m/s]
  double let_go_speed = 0;       // the same after the person's hand is gone [m/s]
  bool touched = false;
  std::string intervention;  // the first one, if any
};

Outcome run(const Press& press);
std::string name(const Press& press);

namespace {

constexpr double kMass = 0.6, kStiffness = 75e3;  // [kg], [N/m]
constexpr double kHalf = 0.05;                    // of the box that stands for the person's hand [m]
constexpr double kFree = 0.12;                    // way to the person's hand [m]
constexpr double kBefore = 0.3, kWatched = 6;     // [s]
// Rotor inertia seen at the joints, of the size that MuJoCo Menagerie's model of FR3 has [kg m^2].
constexpr std::array<double, 7> kMotor = {0.195, 0.195, 0.195, 0.195, 0.074, 0.074, 0.074};

SceneArm franka(const std::string& name, const Pose& X_WB, int pose) {
  static const std::array<std::array<double, 7>, kPoses> starts = {{{0, -0.785, 0, -2.356, 0, 1.571, 0.785},
                                                                    {0.4, -0.2, -0.3, -2.1, 0.1, 2.0, 0.9},
                                                                    {-0.5, 0.2, 0.3, -1.7, -0.2, 1.9, 0.6},
                                                                    {0.2, -0.9, 0.4, -2.2, 0.4, 1.6, 0.5}}};
  SceneArm arm;
  arm.name = name;
  arm.model = "fr3";
  arm.X_WB = X_WB;
  arm.q_start = Eigen::Map<const Eigen::VectorXd>(starts.at(static_cast<std::size_t>(pose)).data(), 7);
  arm.safety = SafetyLimits::of(*build_arm_model(arm));
  // The arm's own reflex shall not help.
  ContactThresholds none;
  none.torque_upper = none.torque_lower = joint_constant(7, 1e4);
  none.wrench_upper.setConstant(1e4);
  none.wrench_lower.setConstant(1e4);
  arm.collision = SetCollisionThresholds{.nominal = none, .acceleration = none};
  return arm;
}

// Kinematics of one arm with its hand.
struct Kinematics {
  explicit Kinematics(const SceneArm& arm) : terms(build_arm_model(arm)) {
    const ArmConfig config = arm_config(arm);
    terms.set_config(config.frames, config.tool, config.load);
  }
  const Pose& at(const JointVector& q) {
    terms.update(q, joint_constant(7, 0));
    return terms.X_WE();
  }
  // Damped least squares from q, as a user would find a joint goal.
  JointVector to(const Pose& X, JointVector q) {
    for (int i = 0; i < 200; ++i) {
      const Vector6 error = pose_error(X, at(q));
      const Jacobian J = terms.J_V_WE();
      const Matrix6 A = J * J.transpose() + 1e-4 * Matrix6::Identity();
      q += J.transpose() * A.ldlt().solve(error);
    }
    return q;
  }
  ModelTerms terms;
};

struct Trial {
  Scene scene;
  std::vector<ScheduledRequest> goals;
};

std::size_t arms_of(const std::string& type, const Registry& registry) {
  const ControlletType* found = registry.controllet(type);
  if (found == nullptr) throw std::invalid_argument("no controllet '" + type + "'");
  return found->descriptor.arms + found->descriptor.observes;
}

bool is_follower(const Press& press) {
  return press.controllet == "joint_follower" || press.controllet == "pose_follower";
}
bool is_teleoperation(const Press& press) { return press.controllet == "teleoperation"; }

Scene scene_of(const Press& press, std::size_t arms) {
  Scene scene;
  scene.name = "press";
  scene.plant = PlantFidelity::ideal();
  scene.plant.command_delay_s = 0.003;
  // The base is turned and off the origin; a second arm stands beside it.
  const Pose X_WB{rotation_from_rpy({0, 0, 0.3}), {0.1, -0.2, 0.05}};
  scene.arms = {franka("first", X_WB, press.pose)};
  if (arms == 2) {
    const Pose beside{Matrix3::Identity(), {0, -0.9, 0}};
    scene.arms.push_back(franka("second", X_WB * beside, press.pose));
  }
  SceneObject hand;
  hand.name = "person";
  hand.fixed = false;
  hand.mass = kMass;
  hand.size = {0.4, 0.4, 2 * kHalf};  // wide: joint goals do not lead straight down
  Kinematics kinematics(scene.arms[0]);
  const Vector3 p = kinematics.at(scene.arms[0].q_start).position;
  hand.X_WO.position = p - Vector3(0, 0, kFree + kHalf);
  scene.objects = {hand};
  InstanceConfig law{.name = "law", .type = press.controllet, .arms = {0}};
  if (is_follower(press)) {
    law.observes = {1};
  } else if (is_teleoperation(press)) {
    law.arms = {1, 0};  // the second arm leads
  } else if (arms == 2) {
    law.arms.push_back(1);
  }
  if (press.controllet == "dual_cartesian_impedance") law.parameters = {{"goals", {1}}};
  if (press.controllet == "coupled_dual_cartesian_impedance") law.parameters = {{"damping_ratio", {0.5}}};
  if (press.controllet == "force") law.parameters = {{"approach_speed_m_per_s", {0.2}}};
  if (press.controllet == "hybrid_force") {
    law.parameters = {
        {"approach_speed_m_per_s", {0.2}}, {"force_z", {1}}, {"moment_x", {1}}, {"moment_y", {1}}};
  }
  if (press.axes) law.parameters = {{"force_z", {1}}, {"moment_x", {1}}, {"moment_y", {1}}};
  if (press.stiffness > 0) law.parameters = {{"translational_stiffness_n_per_m", {press.stiffness}}};
  if (press.bounded) law.contact = ContactBounds{};
  scene.contact_bounds = law.contact;
  scene.controllets = {law};
  scene.active = {"law"};
  if (is_follower(press)) {  // the leader goes where nothing is in the way
    scene.controllets.push_back({.name = "lead", .type = "cartesian_impedance", .arms = {1}});
    scene.active.push_back("lead");
  }
  return scene;
}

// The person's hand hangs on springs, equal along all axes, and does not turn.
int spring_mount(MujocoBackend& backend, bool motor_inertia) {
  mjModel* model = backend.world().model();
  const int body = mj_name2id(model, mjOBJ_BODY, "person");
  if (body < 0 || model->body_jntnum[body] != 1) throw std::logic_error("the hand is no free body");
  const int joint = model->body_jntadr[body];
  model->jnt_stiffness[joint] = kStiffness;
  for (int i = 0; i < 3; ++i) model->body_inertia[3 * body + i] = 50;  // the spring acts on its rotation, too
  model->body_gravcomp[body] = 1;
  model->ngravcomp = std::max(model->ngravcomp, decltype(model->ngravcomp){1});
  if (motor_inertia) {
    for (int dof = 0, k = 0; dof < model->nv; ++dof) {
      if (model->jnt_type[model->dof_jntid[dof]] != mjJNT_HINGE) continue;
      model->dof_armature[dof] += kMotor[static_cast<std::size_t>(k++ % 7)];
    }
  }
  mjData* scratch = mj_makeData(model);  // mj_setConst moves everything to the reference configuration
  mj_setConst(model, scratch);
  mj_deleteData(scratch);
  return joint;
}

double force_on(const MujocoBackend& backend, int joint) {
  const mjModel* model = backend.world().model();
  const int at = model->jnt_qposadr[joint];
  const mjtNum* q = backend.world().data()->qpos + at;
  const mjtNum* q_0 = model->qpos_spring + at;
  return kStiffness * Vector3(q[0] - q_0[0], q[1] - q_0[1], q[2] - q_0[2]).norm();
}

// The person's hand is pulled away: nothing touches it any more.
void remove_hand(MujocoBackend& backend) {
  mjModel* model = backend.world().model();
  const int body = mj_name2id(model, mjOBJ_BODY, "person");
  for (int i = 0; i < model->body_geomnum[body]; ++i) {
    model->geom_contype[model->body_geomadr[body] + i] = 0;
    model->geom_conaffinity[model->body_geomadr[body] + i] = 0;
  }
}

// A person leads the leader of a teleoperation downwards, as far as the goals of the others are.
void lead(MujocoBackend& backend, teleoperation::Operator& person, double way, double seconds) {
  constexpr double kSpeed = 0.4;  // faster than the follower's hand may be [m/s]
  Pose X = person.start();
  X.position.z() -= std::clamp(kSpeed * seconds, 0.0, way);
  person.apply(backend, X);
}

void set_goals(const Press& press, const Scene& scene, MultimodeController& modes) {
  if (is_teleoperation(press)) return;
  ScheduledRequest scheduled;
  scheduled.at = LoopTime::from_seconds(kBefore);
  scheduled.request.kind = Request::Kind::set_target;
  scheduled.request.instance = modes.find(is_follower(press) ? "lead" : "law");
  const Instance& law = modes.instance(scheduled.request.instance);
  std::vector<ScheduledRequest> schedule;
  const auto ask = [&](std::string_view input, const Target& target) {
    scheduled.request.index = static_cast<std::uint16_t>(law.find_input(input));
    scheduled.request.target = target;
    schedule.push_back(scheduled);
  };
  Target force;
  force.size = 6;
  force.values[2] = -200;  // more than is allowed
  Kinematics kinematics(scene.arms[0]);
  Pose X = kinematics.at(scene.arms[0].q_start);
  const Vector3 way(0, 0, -(kFree + press.beyond));
  if (press.controllet == "joint_impedance") {
    X.position += way;
    const JointVector q = kinematics.to(X, scene.arms[0].q_start);
    Target target;
    target.size = 7;
    std::copy_n(q.data(), 7, target.values.begin());
    ask("joints", target);
  } else if (press.controllet == "force" || press.controllet == "hybrid_force") {
    ask("wrench", force);
  } else if (law.find_input("first_pose") < law.inputs().size()) {
    X.position += way;
    ask("first_pose", pose_target(X));
  } else {
    if (is_follower(press)) {
      X = Kinematics(scene.arms[1]).at(scene.arms[1].q_start);
    } else if (scene.arms.size() == 2) {
      Kinematics other(scene.arms[1]);
      X = {Matrix3::Identity(), 0.5 * (X.position + other.at(scene.arms[1].q_start).position)};
    }
    X.position += way;
    ask("pose", pose_target(X));
    if (press.axes) ask("wrench", force);
  }
  modes.schedule(schedule);
}

}  // namespace

std::string name(const Press& press) {
  return press.controllet + (press.axes ? " along axes" : "") + ", pose " + std::to_string(press.pose) +
         (press.motor_inertia ? ", motor inertia" : "") + (press.released_after_s > 0 ? ", let go" : "") +
         (press.bounded ? "" : ", bounds lifted");
}

Outcome run(const Press& press) {
  static const Registry registry = Registry::with_builtins();
  const Scene scene = scene_of(press, arms_of(press.controllet, registry));
  MujocoBackend backend(scene, {.pace = Pace::unpaced});
  const int joint = spring_mount(backend, press.motor_inertia);
  ControlCycle cycle(build_cycle_config(scene), registry, backend);
  MultimodeController& modes = cycle.modes();
  modes.activate_at_start(start_set(scene, modes));
  set_goals(press, scene, modes);

  std::optional<teleoperation::Operator> person;
  if (is_teleoperation(press)) person.emplace(scene.arms[1], 1);

  Outcome outcome;
  backend.start();
  Kinematics kinematics(scene.arms[0]);
  JointVector q = joint_constant(7, 0), dq = q;
  double touched_at = 0, low = 1e9, high = 0;
  for (int k = 0; k < static_cast<int>(1000 * (kBefore + kWatched)); ++k) {
    if (person) lead(backend, *person, kFree + press.beyond, 1e-3 * k - kBefore);
    cycle.step(backend.wait());
    const double t = 1e-3 * k, force = force_on(backend, joint);
    const bool let_go =
        outcome.touched && press.released_after_s > 0 && t >= touched_at + press.released_after_s;
    if (!outcome.touched || let_go) {
      backend.world().joints(0, q, dq);
      kinematics.terms.update(q, dq);
      double& fastest = let_go ? outcome.let_go_speed : outcome.hand_speed;
      fastest = std::max(fastest, kinematics.terms.V_WE().linear().norm());
    }
    if (let_go) {
      remove_hand(backend);
      continue;
    }
    if (!outcome.touched) {
      outcome.touched = force > 5;
      touched_at = t;
    }
    if (!outcome.touched) continue;
    double& largest = t - touched_at < kTransientTime ? outcome.impact : outcome.later;
    largest = std::max(largest, force);
    outcome.at_end = force;
    if (t < kBefore + kWatched - 1) continue;
    low = std::min(low, force);
    high = std::max(high, force);
  }
  outcome.swing = std::max(0.0, high - low);
  // The leader of a follower does not count: its goal may be out of reach.
  const std::size_t pressing = is_follower(press) ? 1 : scene.arms.size();
  for (std::size_t i = 0; i < pressing; ++i) {
    for (std::size_t k = 1; k < static_cast<std::size_t>(Intervention::count_); ++k) {
      const auto what = static_cast<Intervention>(k);
      if (what == Intervention::torque_rate_clamped) continue;  // by the impact; the law goes on
      if (cycle.safety().counted(i, what) > 0 && outcome.intervention.empty()) {
        outcome.intervention = to_string(what);
      }
    }
  }
  return outcome;
}

// The full series prints its figures; by default one pose of each controllet runs, with and without motor
// inertia in turn.

namespace {

const char* const kControllets[] = {"cartesian_impedance",
                                    "joint_impedance",
                                    "dual_cartesian_impedance",
                                    "coupled_dual_cartesian_impedance",
                                    "force",
                                    "hybrid_force",
                                    "ufic",
                                    "coupled_ufic",
                                    "joint_follower",
                                    "pose_follower",
                                    "teleoperation",
                                    "ufic along axes"};

// An arm that is led, no farther than it may be left behind: it presses on.
Press pressing(const char* controllet, int pose, bool motor_inertia) {
  Press press{controllet, pose, motor_inertia};
  const std::string_view name(controllet);
  if (name == "ufic along axes") {
    press.controllet = "ufic";
    press.axes = true;
  }
  if (name.ends_with("_follower") || name == "teleoperation") press.beyond = 0.1;
  return press;
}

TEST(Press, PersonsHandBetweenArmAndTable) {
  test::Series series;
  int at = 0;
  for (const char* controllet : kControllets) {
    ++at;
    for (int pose = 0; pose < kPoses; ++pose) {
      for (const bool motor_inertia : {false, true}) {
        // With rotor inertia, a hand that is blocked may end in a hold at a joint's velocity limit.
        const bool coupled = std::string_view(controllet) == "coupled_dual_cartesian_impedance";
        if (coupled && !motor_inertia) {
          if (series.whole() && series.full()) {
            std::printf(
                "%s\n",
                (name({controllet, pose, motor_inertia}) +
                 " skipped: without its rotor, joint 7 moves 0.002 kg m^2, and springs of 400 N/m hold "
                 "hands 0.9 m apart with a lever of 0.45 m: a mode of 299 rad/s, stable with 1 ms of "
                 "delay, unstable with 2 ms and more, before any contact")
                    .c_str());
          }
          continue;
        }
        if (!series.takes(pose == at % kPoses && motor_inertia == (at % 2 == 0))) continue;
        const Press press = pressing(controllet, pose, motor_inertia);
        SCOPED_TRACE(name(press));
        const Outcome outcome = run(press);
        series.record("impact_n", outcome.impact);
        series.record("later_n", outcome.later);
        series.record("swing_n", outcome.swing);
        series.record("hand_speed_m_per_s", outcome.hand_speed);
        if (series.full()) {
          std::printf("%-62s impact %5.1f N, later %5.1f N, swing %5.2f N, %5.3f m/s %s\n",
                      name(press).c_str(), outcome.impact, outcome.later, outcome.swing, outcome.hand_speed,
                      outcome.intervention.c_str());
          std::fflush(stdout);
        }
        EXPECT_TRUE(outcome.touched);  // otherwise the rest proves nothing
        EXPECT_LE(outcome.impact, kTransient);
        EXPECT_LE(outcome.later, kQuasiStatic);
        EXPECT_LE(outcome.hand_speed, 1.1 * 0.25);
        if (!coupled) {
          EXPECT_EQ(outcome.intervention, "");
        }
      }
    }
  }
}

// Held back until the set-point waits, then let go. Soft springs store the most.
TEST(Press, AnArmThatIsLetGoDoesNotLeap) {
  test::Series series;
  int at = 0;
  for (const char* controllet : kControllets) {
    ++at;
    for (int pose = 0; pose < kPoses; ++pose) {
      for (const bool motor_inertia : {false, true}) {
        const bool coupled = std::string_view(controllet) == "coupled_dual_cartesian_impedance";
        if (coupled && !motor_inertia) continue;
        const int usual = coupled ? 1 : at % kPoses;  // where it is fastest
        if (!series.takes(pose == usual && motor_inertia == (at % 2 == 0))) continue;
        Press press = pressing(controllet, pose, motor_inertia);
        press.released_after_s = 2;
        SCOPED_TRACE(name(press));
        const Outcome outcome = run(press);
        series.record("let_go_speed_m_per_s", outcome.let_go_speed);
        if (series.full()) {
          std::printf("%-62s let go: %5.3f m/s %s\n", name(press).c_str(), outcome.let_go_speed,
                      outcome.intervention.c_str());
          std::fflush(stdout);
        }
        EXPECT_TRUE(outcome.touched);
        if (outcome.intervention.empty()) {
          EXPECT_GT(outcome.let_go_speed, 0.02);  // it goes on
        }
        // Joint springs are bounded by what they do at the hand while the rest of the arm stands still. Two
        // hands on one set-point may end in a hold, whose springs are joint springs, too, but stiffer.
        const bool held = coupled && !outcome.intervention.empty();
        EXPECT_LE(outcome.let_go_speed, held ? 0.7 : (coupled ? 1.8 : 1.7) * 0.25);
      }
    }
  }
}

// Led farther, it is left behind, and the hand is free within some seconds. (Who leads a `teleoperation`
// feels the hand, and is not ahead as far. In pose 0 the joints of the leader end before.)
TEST(Press, AnArmThatIsLeftBehindLetsAHandGo) {
  test::Series series;
  for (const char* controllet : {"joint_follower", "pose_follower"}) {
    for (int pose = 1; pose < kPoses; ++pose) {
      if (!series.takes(pose == 1)) continue;
      const Press press{controllet, pose};
      SCOPED_TRACE(name(press));
      const Outcome outcome = run(press);
      series.record("later_n", outcome.later);
      series.record("at_end_n", outcome.at_end);
      EXPECT_GT(outcome.impact, 20);
      EXPECT_LE(outcome.later, kQuasiStatic);
      EXPECT_LT(outcome.at_end, 10);  // what is left is the friction of a table against a hand
      EXPECT_EQ(outcome.intervention, "");
    }
  }
}

TEST(Press, NorDoesAnArmOnSoftSprings) {
  for (const double stiffness : {50.0, 150.0}) {
    Press press{"cartesian_impedance", 0, true};
    press.released_after_s = 4;
    press.stiffness = stiffness;
    const Outcome outcome = run(press);
    EXPECT_GT(outcome.let_go_speed, 0.1);
    EXPECT_LE(outcome.let_go_speed, 1.6 * 0.25);
    Press lifted = press;
    lifted.bounded = false;
    EXPECT_GT(run(lifted).let_go_speed, outcome.let_go_speed);  // the test can fail
  }
}

// The same press without bounds is one that a hand does not bear: the test can fail.
TEST(Press, LiftedBoundsPressHarder) {
  const Outcome bounded = run({"cartesian_impedance", 0, false, true});
  const Outcome lifted = run({"cartesian_impedance", 0, false, false});
  EXPECT_GT(lifted.hand_speed, 1.5 * bounded.hand_speed);
  EXPECT_GT(lifted.impact, 1.2 * bounded.impact);
  EXPECT_GT(lifted.later, 1.3 * bounded.later);
}

}  // namespace

}  // namespace multipanda::press
