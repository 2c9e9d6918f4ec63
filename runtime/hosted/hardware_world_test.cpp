// A hardware component's logic on simulated arms, with and without our controller behind it.
#include "runtime/hosted/hardware_world.hpp"

#include <cmath>
#include <numbers>
#include <set>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/rt/guard/loop_guard.hpp"
#include "runtime/hosted/hosted_rig.hpp"
#include "scene/load.hpp"

namespace multipanda {
namespace {

using test::HostedRig;
using testing::HasSubstr;

const Registry& builtins() {
  static const Registry registry = Registry::with_builtins();
  return registry;
}

// One name is part of the other.
const char* const kArms =
    "arms:\n"
    "  left: {model: fer, base: {position_m: [0, 0.6, 0], rpy_rad: [0, 0, 0.4]}}\n"
    "  mj_left: {model: fr3, hand: false, base: {position_m: [0, -0.6, 0.1]}}\n";

struct World {
  explicit World(const std::string& more = "")
      : scene(parse_scene(kArms + more, "test", builtins())),
        hardware(scene, mujoco_arms(scene)),
        rig(hardware) {
    hardware.connect();
  }
  std::unique_ptr<HostedCycle> hosted(const std::string& controllets) {
    const Scene wanted = parse_scene(kArms + controllets, "test", builtins());
    HostedOptions options;
    for (const auto& arm : wanted.arms) options.arms.push_back({.name = arm.name});
    return std::make_unique<HostedCycle>(wanted, builtins(), options);
  }
  ArmAnswer ask(ArmIndex arm, ArmRequest request) {
    auto answer = hardware.backend().request(arm, std::move(request));
    EXPECT_TRUE(rig.steps_until(
        [&] { return answer.wait_for(std::chrono::seconds(0)) == std::future_status::ready; }));
    return answer.get();
  }
  const JointVector& q(ArmIndex arm) const { return hardware.state(arm).q; }

  Scene scene;
  HardwareWorld hardware;
  HostedRig rig;
};

TEST(HardwareWorld, ExportsEveryArmsNumbersUnderItsOwnName) {
  World world;
  EXPECT_EQ(world.hardware.states().size(), 2u * (21 + 16 + 6 + 6));
  EXPECT_EQ(world.hardware.commands().size(), 2u * (21 + 16 + 6));
  std::set<std::string> names;
  for (const auto& number : world.hardware.states()) names.insert(number.full_name());
  EXPECT_EQ(names.size(), world.hardware.states().size());
  for (const char* name : {"left_joint1/position", "mj_left_joint7/effort", "left_ee_cartesian_position/15",
                           "mj_left_ee_cartesian_velocity/omega_z", "left/robot_state", "left/robot_model",
                           "mj_left/mode", "left/error"}) {
    EXPECT_TRUE(names.contains(name)) << name;
  }
  world.rig.step();
  for (int i = 0; i < 7; ++i) {
    EXPECT_EQ(world.rig.state("left_joint" + std::to_string(i + 1) + "/position"), world.q(0)[i]);
  }
  // The pose is E in the arm's base: the same for the same joints wherever the base stands.
  const ModelTerms* model = window_behind(world.rig.state("left/robot_model"))->model;
  ASSERT_NE(model, nullptr);
  const Pose X_WE = const_cast<ModelTerms*>(model)->X_WE();
  const Vector3 p_B(world.rig.state("left_ee_cartesian_position/12"),
                    world.rig.state("left_ee_cartesian_position/13"),
                    world.rig.state("left_ee_cartesian_position/14"));
  EXPECT_LT((world.scene.arms[0].X_WB * p_B - X_WE.position).norm(), 1e-12);
}

TEST(HardwareWorld, ASwitchIsJudgedWholeAndARefusalChangesNothing) {
  World world;
  auto& rig = world.rig;
  const auto efforts = rig.efforts("left");
  auto partial = efforts;
  partial.pop_back();
  EXPECT_THAT(rig.change(partial), HasSubstr("arm 'left': claim all of one kind"));
  auto both = efforts;
  for (const auto& name : HostedRig::joint_names("left", "position")) both.push_back(name);
  EXPECT_THAT(rig.change(both), HasSubstr("claim all of one kind"));
  auto crossed = efforts;
  crossed[6] = "mj_left_joint7/effort";
  EXPECT_THAT(rig.change(crossed), HasSubstr("claim all"));
  EXPECT_EQ(world.hardware.drive(0), ArmDrive::none);

  ASSERT_EQ(rig.change(efforts), "");
  EXPECT_EQ(world.hardware.drive(0), ArmDrive::effort);
  EXPECT_EQ(world.hardware.drive(1), ArmDrive::none);  // whose name contains the other's
  EXPECT_THAT(rig.change(efforts), HasSubstr("claimed already"));
  EXPECT_THAT(rig.change(rig.all("left_ee_cartesian_position")), HasSubstr("stop that controller"));
  EXPECT_EQ(world.hardware.drive(0), ArmDrive::effort);
  // A request with one wrong arm leaves the right one as it was, too.
  auto two = HostedRig::joint_names("mj_left", "velocity");
  two.push_back("left_joint1/position");
  EXPECT_NE(rig.change(two), "");
  EXPECT_EQ(world.hardware.drive(1), ArmDrive::none);
  // Others' interfaces are none of ours.
  EXPECT_EQ(rig.change({"gripper/position"}, {"wheel/velocity"}), "");
  EXPECT_EQ(rig.change(HostedRig::joint_names("left", "velocity"), efforts), "");
  EXPECT_EQ(world.hardware.drive(0), ArmDrive::joint_velocity);
}

TEST(HardwareWorld, AnArmThatNobodyDrivesHoldsItself) {
  World world;
  const JointVector start = world.q(0);
  world.rig.steps(300);
  EXPECT_LT((world.q(0) - start).lpNorm<Eigen::Infinity>(), 1e-4);
  ASSERT_EQ(world.rig.change(world.rig.efforts("left")), "");
  double torque = 0;  // as fast as the arm takes it
  world.rig.between_ = [&] {
    *world.rig.command("left_joint1/effort") = torque = std::min(5.0, torque + 0.5);
  };
  world.rig.steps(100);
  EXPECT_GT(world.q(0)[0], start[0] + 0.01);
  world.rig.between_ = {};
  ASSERT_EQ(world.rig.change({}, world.rig.efforts("left")), "");
  world.rig.steps(500);
  const JointVector rest = world.q(0);
  world.rig.steps(300);  // the torque of before is forgotten
  EXPECT_LT((world.q(0) - rest).lpNorm<Eigen::Infinity>(), 1e-4);
}

TEST(HardwareWorld, OurControllerOwnsOneArmAndAPositionControllerTheOther) {
  World world;
  auto& rig = world.rig;
  auto cycle = world.hosted("controllets: {pose: {type: cartesian_impedance, arms: left}}\nactive: pose\n");
  // It is built for both arms, and claims both; a controller for one arm is built for one.
  const Scene one = parse_scene(
      "arms: {left: {model: fer, base: {position_m: [0, 0.6, 0], rpy_rad: [0, 0, 0.4]}}}\n"
      "controllets: {pose: {type: cartesian_impedance, arms: left}}\nactive: pose\n",
      "test", builtins());
  cycle = std::make_unique<HostedCycle>(one, builtins(), HostedOptions{.arms = {{.name = "left"}}});
  auto start = rig.efforts("left");
  const auto positions = HostedRig::joint_names("mj_left", "position");
  start.insert(start.end(), positions.begin(), positions.end());
  ASSERT_EQ(rig.change(start), "");
  rig.activate(*cycle);
  EXPECT_EQ(cycle->check(), "");
  const double q1 = *rig.command("mj_left_joint1/position");
  EXPECT_NEAR(q1, world.q(1)[0], 1e-3);  // seeded with where the arm is, not with zeros
  double t = 0;
  rig.between_ = [&] {  // a trajectory: 0.3 rad in 2 s
    t += 0.001;
    const double s = std::min(1.0, t / 2);
    *rig.command("mj_left_joint1/position") = q1 + 0.3 * s * s * s * (10 + s * (6 * s - 15));
  };
  const InstanceIndex pose = cycle->modes().find("pose");
  ASSERT_TRUE(rig.steps_until([&] { return (cycle->modes().active() & bit(pose)) != 0; }));
  rig.step();
  const Pose X_WE = const_cast<ModelTerms*>(window_behind(rig.state("left/robot_state"))->model)->X_WE();
  const Pose goal{X_WE.rotation, X_WE.position + Vector3(0.05, -0.03, 0.04)};
  ASSERT_EQ(cycle->modes().instance(pose).inputs()[0].post(pose_target(goal, 1, Delivery::goal)),
            Verdict::accepted);
  rig.steps(4000);
  EXPECT_TRUE(rig.last());
  const Pose reached = const_cast<ModelTerms*>(window_behind(rig.state("left/robot_state"))->model)->X_WE();
  EXPECT_LT((reached.position - goal.position).norm(), 1e-3);
  EXPECT_NEAR(world.q(1)[0], q1 + 0.3, 2e-3);
  EXPECT_EQ(rig.state("mj_left/following"), 1);
  // What the hardware knows reaches the controller.
  EXPECT_EQ(cycle->data().state[0].frames.X_FE.position, world.hardware.state(0).frames.X_FE.position);
  EXPECT_TRUE(cycle->backend().request(0, SetLoad{{.mass = 0.5}}).wait_for(std::chrono::seconds(0)) !=
              std::future_status::ready);  // it went to the arm, which answers in its loop
  EXPECT_TRUE(rig.steps_until([&] { return cycle->data().state[0].load.mass == 0.5; }));

  // Swapped in one switch: theirs takes left, ours nothing.
  rig.between_ = {};
  rig.deactivate();
  for (const auto& name : rig.efforts("left")) EXPECT_EQ(*rig.command(name), 0.0);
  auto stop = start;
  ASSERT_EQ(rig.change(HostedRig::joint_names("left", "position"), stop), "");
  const JointVector there = world.q(0);
  rig.steps(300);
  EXPECT_LT((world.q(0) - there).lpNorm<Eigen::Infinity>(), 2e-3);
}

TEST(HardwareWorld, VelocityAndCartesianCommandsMoveTheArm) {
  World world;
  auto& rig = world.rig;
  // Joint velocity: begins from zero, whatever is commanded at once.
  ASSERT_EQ(rig.change(HostedRig::joint_names("left", "velocity")), "");
  const double q4 = world.q(0)[3];
  rig.between_ = [&] { *rig.command("left_joint4/velocity") = 0.2; };
  rig.steps(1500);
  EXPECT_EQ(rig.state("left/error"), 0);
  EXPECT_NEAR(rig.state("left_joint4/velocity"), 0.2, 5e-3);
  EXPECT_NEAR(world.q(0)[3] - q4, 0.2 * (1.5 - 0.25), 0.01);

  // Cartesian velocity, in the base.
  ASSERT_EQ(rig.change(rig.all("mj_left_ee_cartesian_velocity")), "");
  const double z = rig.state("mj_left_ee_cartesian_position/14");
  rig.between_ = [&] { *rig.command("mj_left_ee_cartesian_velocity/tz") = -0.05; };
  rig.steps(1000);
  EXPECT_EQ(rig.state("mj_left/error"), 0);
  EXPECT_NEAR(rig.state("mj_left_ee_cartesian_velocity/tz"), -0.05, 2e-3);
  EXPECT_NEAR(rig.state("mj_left_ee_cartesian_position/14"), z - 0.05 * 0.75, 2e-3);

  // Cartesian pose: a circle of 2 cm about where it stands.
  double tz = -0.05;
  rig.between_ = [&] { *rig.command("mj_left_ee_cartesian_velocity/tz") = tz = std::min(0.0, tz + 1e-4); };
  rig.steps(600);
  ASSERT_EQ(rig.change(rig.all("mj_left_ee_cartesian_position"), rig.all("mj_left_ee_cartesian_velocity")),
            "");
  rig.between_ = {};
  rig.steps(300);
  double y[1] = {*rig.command("mj_left_ee_cartesian_position/13")};
  double t = 0;
  rig.between_ = [&] {
    t += 0.001;
    *rig.command("mj_left_ee_cartesian_position/13") =
        y[0] + 0.01 * (1 - std::cos(std::numbers::pi * std::min(t, 1.0)));
  };
  rig.steps(1500);
  EXPECT_EQ(rig.state("mj_left/error"), 0);
  EXPECT_NEAR(rig.state("mj_left_ee_cartesian_position/13"), y[0] + 0.02, 2e-3);
}

TEST(HardwareWorld, ACommandFarFromTheArmIsNotFollowedAndNoNumberStopsIt) {
  World world;
  auto& rig = world.rig;
  ASSERT_EQ(rig.change(HostedRig::joint_names("left", "position")), "");
  const JointVector start = world.q(0);
  rig.between_ = [&] { *rig.command("left_joint2/position") = start[1] + 0.4; };
  rig.steps(300);
  EXPECT_EQ(rig.state("left/following"), 0);
  EXPECT_EQ(rig.state("left/error"), 0);
  EXPECT_LT((world.q(0) - start).lpNorm<Eigen::Infinity>(), 2e-3);
  rig.between_ = [&] { *rig.command("left_joint2/position") = start[1] + 0.04; };  // near: followed smoothly
  rig.steps(1000);
  EXPECT_EQ(rig.state("left/following"), 1);
  EXPECT_EQ(rig.state("left/error"), 0);
  EXPECT_NEAR(world.q(0)[1], start[1] + 0.04, 2e-3);
  rig.between_ = [&] { *rig.command("left_joint2/position") = NAN; };
  rig.steps(100);
  EXPECT_EQ(world.hardware.drive(0), ArmDrive::none);
  EXPECT_EQ(rig.state("left/error"), 0);
  EXPECT_NEAR(world.q(0)[1], start[1] + 0.04, 5e-3);
}

TEST(HardwareWorld, OneArmsFaultLeavesTheOtherAndIsRecovered) {
  World world;
  auto& rig = world.rig;
  auto start = HostedRig::joint_names("left", "position");
  for (const auto& name : HostedRig::joint_names("mj_left", "velocity")) start.push_back(name);
  ASSERT_EQ(rig.change(start), "");
  const JointVector q0 = world.q(0);
  rig.between_ = [&] { *rig.command("mj_left_joint1/velocity") = 0.1; };
  rig.steps(700);
  EXPECT_EQ(rig.state("left/following"), 1);
  // A jump is an error of that arm's motion.
  rig.between_ = [&] {
    *rig.command("mj_left_joint1/velocity") = 0.1;
    *rig.command("left_joint1/position") = q0[0] + 0.5;
  };
  rig.steps(100);
  EXPECT_EQ(rig.state("left/error"), 1);
  EXPECT_EQ(world.hardware.read(), HardwareWorld::Result::ok);
  EXPECT_EQ(world.hardware.write(), HardwareWorld::Result::ok);
  EXPECT_EQ(rig.state("mj_left/error"), 0);
  EXPECT_NEAR(rig.state("mj_left_joint1/velocity"), 0.1, 1e-2);
  // Recovered: the arm does not run after a command of before.
  ASSERT_TRUE(world.ask(0, RecoverFromError{}).success);
  rig.steps(300);
  EXPECT_EQ(rig.state("left/error"), 0);
  EXPECT_EQ(rig.state("left/following"), 0);
  EXPECT_NEAR(world.q(0)[0], q0[0], 1e-2);
  EXPECT_FALSE(world.ask(0, RecoverFromError{}).success);  // nothing to recover from
  rig.between_ = [&] {
    *rig.command("mj_left_joint1/velocity") = 0.1;
    *rig.command("left_joint1/position") = q0[0];
  };
  rig.steps(100);
  EXPECT_EQ(rig.state("left/following"), 1);
  // The other arm by its velocities: after a fault they must have been zero once.
  ASSERT_TRUE(world.ask(1, SetUserStop{true}).success);
  rig.steps(50);
  ASSERT_TRUE(world.ask(1, SetUserStop{false}).success);
  rig.steps(300);
  EXPECT_EQ(rig.state("mj_left/following"), 0);
  EXPECT_NEAR(rig.state("mj_left_joint1/velocity"), 0, 1e-2);
  rig.between_ = [&] { *rig.command("mj_left_joint1/velocity") = 0; };
  rig.steps(5);
  rig.between_ = [&] { *rig.command("mj_left_joint1/velocity") = -0.1; };
  rig.steps(800);
  EXPECT_NEAR(rig.state("mj_left_joint1/velocity"), -0.1, 1e-2);
}

TEST(HardwareWorld, OurControllerHoldsARecoveredArm) {
  World world;
  auto& rig = world.rig;
  auto cycle = world.hosted(
      "controllets: {a: {type: joint_impedance, arms: left}, b: {type: joint_impedance, arms: mj_left}}\n"
      "active: [a, b]\n");
  auto start = rig.efforts("left");
  for (const auto& name : rig.efforts("mj_left")) start.push_back(name);
  ASSERT_EQ(rig.change(start), "");
  rig.activate(*cycle);
  const auto runs = [&](const char* name) {
    return (cycle->modes().active() & bit(cycle->modes().find(name))) != 0;
  };
  ASSERT_TRUE(rig.steps_until([&] { return runs("a") && runs("b"); }));
  ASSERT_TRUE(world.ask(0, SetUserStop{true}).success);
  rig.steps(20);
  EXPECT_FALSE(runs("a"));
  EXPECT_TRUE(runs("b"));
  EXPECT_TRUE(rig.last());
  ASSERT_TRUE(world.ask(0, SetUserStop{false}).success);
  const JointVector there = world.q(0);
  rig.steps(300);
  EXPECT_FALSE(runs("a"));  // held, until somebody switches
  EXPECT_LT((world.q(0) - there).lpNorm<Eigen::Infinity>(), 5e-3);
  // A pause is no silence.
  ASSERT_TRUE(world.ask(1, PauseSimulation{true}).success);
  rig.steps(200);
  EXPECT_TRUE(runs("b"));
  ASSERT_TRUE(world.ask(1, PauseSimulation{false}).success);
  rig.steps(50);
  EXPECT_TRUE(runs("b"));
}

TEST(HardwareWorld, TheLoopNeitherAllocatesNorLocks) {
  if (!kLoopGuardWorks) GTEST_SKIP() << "sanitizers replace malloc themselves";
  World world;
  auto& rig = world.rig;
  const std::vector<std::vector<std::string>> kinds{
      rig.efforts("left"), HostedRig::joint_names("left", "position"),
      HostedRig::joint_names("left", "velocity"), rig.all("left_ee_cartesian_position"),
      rig.all("left_ee_cartesian_velocity")};
  std::vector<std::string> before;
  rig.steps(20);
  for (const auto& kind : kinds) {
    std::string why;
    ASSERT_TRUE(world.hardware.prepare_switch(kind, before, why)) << why;
    LoopGuard::arm();
    world.hardware.perform_switch(kind, before);
    for (int i = 0; i < 50; ++i) {
      (void)world.hardware.read();
      (void)world.hardware.write();
    }
    const LoopGuardCounts counts = LoopGuard::disarm();
    EXPECT_EQ(counts.heap_calls, 0u) << kind[0];
    EXPECT_EQ(counts.lock_calls, 0u) << kind[0];
    EXPECT_EQ(rig.state("left/following"), 1) << kind[0];
    before = kind;
  }
}

TEST(HardwareWorld, ConnectsAgainAndTakesItsAddressBackInBetween) {
  World world;
  auto& rig = world.rig;
  ASSERT_EQ(rig.change(rig.efforts("left")), "");
  rig.steps(5);
  for (int i = 0; i < 3; ++i) {
    EXPECT_NE(window_behind(rig.state("left/robot_state")), nullptr);
    world.hardware.disconnect();
    EXPECT_EQ(window_behind(rig.state("left/robot_state")), nullptr);
    EXPECT_EQ(world.hardware.drive(0), ArmDrive::none);
    world.hardware.connect();
    ASSERT_EQ(rig.change(rig.efforts("left")), "");
    rig.steps(5);
    EXPECT_EQ(rig.state("left/following"), 1);
  }
}

TEST(HardwareWorld, ServicesOfTheHardwareHaveAWorldToSpeakFor) {
  World world;
  const RunWorld run = world.hardware.run_world();
  EXPECT_EQ(run.modes->arm_name(1), "mj_left");
  EXPECT_EQ(run.models.size(), 2u);
  EXPECT_EQ(run.backend, &world.hardware.backend());
}

}  // namespace
}  // namespace multipanda
