// What a hold does to an arm that it catches, on the `realistic` plant (friction, 50 Hz torque tracking,
// noise) with commands that are 3 ms late: how far the arm still goes, and how hard it pushes.
#include <cmath>
#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/model/model_terms.hpp"
#include "runtime/session.hpp"
#include "scene/build.hpp"
#include "scene/load.hpp"

namespace multipanda::hold_figures_test {
namespace {

using testing::IsEmpty;

constexpr double kStop = 1.5;    // when the hold takes over [s]
constexpr double kRest = 0.006;  // of the sensors' noise (1e-3 rad/s) no more is seen at rest [rad/s]

// Bounds for contact are lifted: hold must catch what moves faster than hands beside people may.
std::string scene_text(const std::string& arm, const std::string& rest) {
  return "seed: 5\n"
         "contact_bounds: {hand_speed_m_per_s: 3, spring_force_n: 1000, spring_moment_nm: 300}\n"
         "plant: {fidelity: realistic, command_delay_s: 0.003}\n"
         "arms:\n"
         "  - {name: left, model: fer, hand: true" +
         arm + "}\n" + rest;
}

std::string with_law(const std::string& type, const std::string& motion) {
  return "controllets:\n  - {name: law, type: " + type +
         ", arms: left}\n"
         "active: [law]\n"
         "timeline:\n"
         "  - {at_s: 0.01, " +
         motion +
         "}\n"
         "  - {at_s: 1.5, stop: [left]}\n";
}

struct Figures {
  double speed = 0;         // of the hand when the hold takes over [m/s]
  double way = 0;           // farthest from where it was then [m]
  double joint_way = 0;     // the same of a joint [rad]
  double standstill_s = 0;  // until no joint moves faster than 0.02 rad/s [s]
  double torque = 0;        // greatest |tau_cmd| of a joint after that moment [N m]
  double force = 0;         // greatest true contact force [N]
  double beyond = -1e9;     // farthest beyond the nearer position limit [rad]; negative: inside
  double rest_speed = 0;    // greatest joint speed in the last half second [rad/s]
  double sag = 0;           // of the hand, from the start to the end [m]
};

Figures run(const std::string& text, bool from_start = false) {
  const Registry registry = Registry::with_builtins();
  const Scene scene = parse_scene(text, "hold.yaml", registry);
  const auto model = build_arm_model(scene.arms[0]);
  ModelTerms terms(model);
  const ArmConfig config = arm_config(scene.arms[0]);
  terms.set_config(config.frames, config.tool, config.load);
  Figures figures;
  JointVector q_caught;
  Vector3 p_caught = Vector3::Zero(), p_start = Vector3::Zero();
  const double caught_s = from_start ? 0.0 : kStop;
  SessionOptions options{.paced = false, .duration_s = kStop + 3};
  options.observer = [&](const CycleRecord& record) {
    const ArmSample& arm = record.arms[0];
    const double t = record.t.seconds();
    const JointVector q = Eigen::Map<const Eigen::VectorXd>(arm.q.data(), 7);
    const JointVector dq = Eigen::Map<const Eigen::VectorXd>(arm.dq.data(), 7);
    terms.update(q, dq);
    const Vector3 p = terms.X_WE().position;
    if (p_start.isZero(0)) p_start = p;
    if (t < caught_s) return;
    if (q_caught.size() == 0) {
      q_caught = q;
      p_caught = p;
      figures.speed = terms.V_WE().linear().norm();
    }
    figures.way = std::max(figures.way, (p - p_caught).norm());
    figures.joint_way = std::max(figures.joint_way, (q - q_caught).lpNorm<Eigen::Infinity>());
    if (dq.lpNorm<Eigen::Infinity>() > 0.02) figures.standstill_s = t - caught_s;
    for (std::size_t i = 0; i < 7; ++i) {
      const auto k = static_cast<Eigen::Index>(i);
      figures.torque = std::max(figures.torque, std::abs(arm.tau_cmd[i]));
      figures.beyond =
          std::max({figures.beyond, q[k] - model->limits().q_max[k], model->limits().q_min[k] - q[k]});
    }
    const Vector3 force(arm.F_K_W_true[0], arm.F_K_W_true[1], arm.F_K_W_true[2]);
    figures.force = std::max(figures.force, force.norm());
    if (t > kStop + 2.5) figures.rest_speed = std::max(figures.rest_speed, dq.lpNorm<Eigen::Infinity>());
    figures.sag = p_start.z() - p.z();
  };
  Session session(scene, registry, std::move(options));
  session.start();
  const RunSummary summary = session.finish();
  EXPECT_THAT(summary.faults(), IsEmpty()) << text;
  return figures;
}

void show(const char* what, const Figures& f) {
  std::printf(
      "%s: %.3f m/s, way %.1f mm, joint %.4f rad, still after %.3f s, torque %.1f N m, force %.1f N, beyond "
      "%.4f rad, rest %.4f rad/s, sag %.1f mm\n",
      what, f.speed, 1e3 * f.way, f.joint_way, f.standstill_s, f.torque, f.force, f.beyond, f.rest_speed,
      1e3 * f.sag);
}

// All joints swing; the stop comes at about their highest speed.
TEST(HoldFigures, CatchesAnArmInMotion) {
  const Figures f = run(scene_text(
      "", with_law("joint_impedance",
                   "motion: {controllet: law, input: joints, sine: [0.2, 0.15, 0.15, 0.2, 0.15, 0.15, 0.15], "
                   "period_s: 2.9, cycles: 3, ramp_s: 0.5}")));
  show("in motion", f);
  EXPECT_GT(f.speed, 0.3);
  EXPECT_LT(f.way, 0.012);
  EXPECT_LT(f.joint_way, 0.016);
  EXPECT_LT(f.standstill_s, 0.45);
  EXPECT_LT(f.torque, 20);
  EXPECT_LT(f.rest_speed, kRest);
}

// Joint 4 on its way beyond its upper limit of -0.0698 rad, stopped 35 mrad before it at 0.48 rad/s.
TEST(HoldFigures, CatchesAnArmAtAJointLimit) {
  const Figures f = run(scene_text(
      ", start_rad: [0, 0, 0, -0.105, 0, 1.8, 0.785]",
      with_law("joint_impedance, parameters: {stiffness_nm_per_rad: [200, 200, 200, 200, 80, 50, 30]}",
               "motion: {controllet: law, input: joints, sine: [0, 0, 0, -0.19, 0, 0, 0], "
               "period_s: 2.5, cycles: 3, ramp_s: 0.5}")));
  show("at a joint limit", f);
  EXPECT_GT(f.speed, 0.2);
  EXPECT_LT(f.joint_way, 0.014);
  EXPECT_LT(f.beyond, -0.02);  // of the 0.035 rad that were left
  EXPECT_LT(f.standstill_s, 0.5);
  EXPECT_LT(f.torque, 17);
  EXPECT_LT(f.rest_speed, kRest);
}

TEST(HoldFigures, CarriesAnUndeclaredKilogram) {
  const std::string load = ", load_present: {mass_kg: 1, com_m: [0, 0, 0.12]}";
  const Figures still = run(scene_text(load, ""), true);
  show("1 kg from rest", still);
  EXPECT_LT(still.sag, 0.015);
  EXPECT_GT(still.sag, 0.005);  // a spring
  EXPECT_LT(still.standstill_s, 0.4);
  EXPECT_LT(still.rest_speed, kRest);
  const Figures moving = run(scene_text(
      load,
      with_law("joint_impedance",
               "motion: {controllet: law, input: joints, sine: [0.2, 0.15, 0.15, 0.2, 0.15, 0.15, 0.15], "
               "period_s: 2.9, cycles: 3, ramp_s: 0.5}")));
  show("1 kg in motion", moving);
  EXPECT_LT(moving.way, 0.018);
  EXPECT_LT(moving.standstill_s, 0.5);
  EXPECT_LT(moving.torque, 20);
  EXPECT_LT(moving.rest_speed, kRest);
}

// The hand comes down at 0.15 m/s and is stopped near a table, whose height is varied: above it by more or
// less than the way that the arm needs, or already on it.
TEST(HoldFigures, CatchesAnArmAboveATable) {
  double hardest = 0, fastest = 0;
  for (int k = 0; k < 8; ++k) {
    const double table = 0.351 + 0.0015 * k;  // top [m]
    const Figures f = run(scene_text(
        "",
        "objects:\n"
        "  - {name: table, shape: box, size_m: [0.6, 0.6, 0.2], position_m: [0.45, 0, " +
            std::to_string(table - 0.1) + "]}\n" +
            with_law("cartesian_impedance",
                     "reference: {controllet: law, input: pose, position_m: [0.307, 0, 0.247], rpy_rad: "
                     "[pi, 0, 0], duration_s: 3}")));
    show(("table " + std::to_string(table)).c_str(), f);
    EXPECT_LT(f.rest_speed, kRest);
    EXPECT_LT(f.standstill_s, 0.5);
    hardest = std::max(hardest, f.force);
    if (f.force > 0) fastest = std::max(fastest, f.speed);
  }
  EXPECT_GT(fastest, 0.1);  // at least one touched the table only after the stop
  EXPECT_GT(hardest, 5);
  EXPECT_LT(hardest, 85);
}

// The end effector of an arm is redefined while a Cartesian law holds it, then while it moves.
TEST(RedefinedEndEffector, DoesNotMoveASimulatedArm) {
  const Registry registry = Registry::with_builtins();
  const Scene scene = parse_scene(
      "plant: {fidelity: realistic}\n"
      "arms:\n  - {name: left, model: fer, hand: true}\n"
      "controllets:\n  - {name: law, type: cartesian_impedance, arms: left}\n"
      "active: [law]\n"
      "timeline:\n"
      "  - {at_s: 1.9, motion: {controllet: law, input: pose, rise: [0, 0, 0.1], period_s: 2, cycles: 1}}\n",
      "frames.yaml", registry);
  Session* running = nullptr;
  std::vector<std::future<RequestAnswer>> answers;
  double rest_speed = 0, fastest = 0;
  std::uint64_t errors = 0;
  SessionOptions options{.paced = false, .duration_s = 4};
  options.observer = [&](const CycleRecord& record) {
    const double t = record.t.seconds();
    const ArmFrames frames{{Matrix3::Identity(), Vector3(0, 0, 0.25)}, {}};
    if ((answers.empty() && t > 0.5) || (answers.size() == 1 && t > 2.5)) {
      const Pose X =
          answers.empty() ? frames.X_FE : Pose{rotation_from_rpy({0.5, 0, 0}), Vector3(0.1, 0, 0.1)};
      answers.push_back(running->backend().request(0, SetFrames{.X_FE = X, .X_EK = {}}));
    }
    errors |= record.arms[0].errors;
    for (std::size_t i = 0; i < 7; ++i) {
      double& top = t < 1.9 ? rest_speed : fastest;
      top = std::max(top, std::abs(record.arms[0].dq[i]));
    }
  };
  Session session(scene, registry, std::move(options));
  running = &session;
  session.start();
  const RunSummary summary = session.finish();
  EXPECT_THAT(summary.faults(), IsEmpty());
  EXPECT_THAT(summary.interventions, IsEmpty());
  ASSERT_EQ(answers.size(), 2u);
  for (auto& answer : answers) EXPECT_TRUE(answer.get().success);
  EXPECT_EQ(errors, 0u);
  EXPECT_LT(rest_speed, 0.02);  // the noise of the sensors alone is 0.005
  EXPECT_LT(fastest, 0.6);
}

// A load that hangs on the arm is declared while a Cartesian law holds it, and taken back: the set-point
// stays, and the spring brings the arm to it without an intervention. (A real arm takes the setting at rest
// only.)
TEST(DeclaredLoad, MovesASimulatedArmSoftly) {
  const Registry registry = Registry::with_builtins();
  const Scene scene = parse_scene(
      "plant: {fidelity: realistic}\n"
      "arms:\n  - {name: left, model: fer, hand: true, load_present: {mass_kg: 1, com_m: [0, 0, 0.12]}}\n"
      "controllets:\n  - {name: law, type: cartesian_impedance, arms: left}\n"
      "active: [law]\n",
      "load.yaml", registry);
  Session* running = nullptr;
  std::vector<std::future<RequestAnswer>> answers;
  double fastest = 0;
  std::uint64_t errors = 0;
  SessionOptions options{.paced = false, .duration_s = 4};
  options.observer = [&](const CycleRecord& record) {
    const double t = record.t.seconds();
    if ((answers.empty() && t > 1) || (answers.size() == 1 && t > 2.5)) {
      Load load;
      if (answers.empty()) load = {.mass = 1, .p_FC = Vector3(0, 0, 0.12)};
      answers.push_back(running->backend().request(0, SetLoad{load}));
    }
    errors |= record.arms[0].errors;
    for (std::size_t i = 0; i < 7; ++i) fastest = std::max(fastest, std::abs(record.arms[0].dq[i]));
  };
  Session session(scene, registry, std::move(options));
  running = &session;
  session.start();
  const RunSummary summary = session.finish();
  EXPECT_THAT(summary.faults(), IsEmpty());
  EXPECT_THAT(summary.interventions, IsEmpty());
  ASSERT_EQ(answers.size(), 2u);
  for (auto& answer : answers) EXPECT_TRUE(answer.get().success);
  EXPECT_EQ(errors, 0u);
  std::printf("load: %.3f rad/s\n", fastest);
  EXPECT_GT(fastest, 0.01);  // the gravity that the arm compensates did change
  EXPECT_LT(fastest, 0.5);
}

}  // namespace
}  // namespace multipanda::hold_figures_test
