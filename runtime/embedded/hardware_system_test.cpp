// Logic of a hardware component on simulated arms, with and without our controller.

#include "runtime/embedded/hardware_system.hpp"

#include <cmath>
#include <numbers>
#include <set>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/rt/guard/loop_guard.hpp"
#include "runtime/embedded/testing/hosted_fixture.hpp"
#include "runtime/request_text.hpp"
#include "scene/load.hpp"

namespace multipanda::hardware_system_test {

namespace {

using test::HostedFixture;
using testing::HasSubstr;
using testing::Not;

const Registry& builtins() {
  static const Registry registry = Registry::with_builtins();
  return registry;
}

// One name contains the other.
const char* const kArms =
    "arms:\n"
    "  left: {model: fer, base: {position_m: [0, 0.6, 0], rpy_rad: [0, 0, 0.4]}}\n"
    "  mj_left: {model: fr3, hand: false, base: {position_m: [0, -0.6, 0.1]}}\n";

struct World {
  explicit World(const std::string& more = "")
      : scene(parse_scene(kArms + more, "test", builtins())),
        hardware(scene, mujoco_arms(scene)),
        fixture(hardware) {
    hardware.connect();
  }
  std::unique_ptr<HostedCycle> hosted(const std::string& controllets) {
    const Scene parsed = parse_scene(kArms + controllets, "test", builtins());
    HostedOptions options;
    for (const auto& arm : parsed.arms) options.arms.push_back({.name = arm.name});
    return std::make_unique<HostedCycle>(parsed, builtins(), options);
  }
  RequestAnswer ask(ArmIndex arm, ArmRequest request) {
    return wait_for(hardware.backend().request(arm, std::move(request)));
  }
  RequestAnswer ask(WorldRequest request) { return wait_for(hardware.backend().request(std::move(request))); }
  RequestAnswer wait_for(std::future<RequestAnswer> answer) {
    EXPECT_TRUE(fixture.steps_until(
        [&] { return answer.wait_for(std::chrono::seconds(0)) == std::future_status::ready; }));
    return answer.get();
  }
  const JointVector& q(ArmIndex arm) const { return hardware.state(arm).q; }

  Scene scene;
  HardwareSystem hardware;
  HostedFixture fixture;
};

TEST(HardwareSystem, ExportsEveryArmsNumbersUnderItsOwnName) {
  World world;
  EXPECT_EQ(world.hardware.states().size(), 2u * (21 + 16 + 6 + 6));
  EXPECT_EQ(world.hardware.commands().size(), 2u * (21 + 16 + 6));
  std::set<std::string> names;
  for (const auto& number : world.hardware.states()) names.insert(number.full_name());
  EXPECT_EQ(names.size(), world.hardware.states().size());
  for (const char* name : {"left_joint1/position", "mj_left_joint7/effort", "left_ee_cartesian_position/15",
                           "mj_left_ee_cartesian_velocity/omega_z", "left/multipanda_state",
                           "left/multipanda_model", "mj_left/mode", "left/error"}) {
    EXPECT_TRUE(names.contains(name)) << name;
  }
  // Franka's components read structs of their own behind these.
  for (const auto& name : names)
    EXPECT_FALSE(name.ends_with("/robot_state") || name.ends_with("/robot_model"));
  world.fixture.step();
  for (int i = 0; i < 7; ++i) {
    EXPECT_EQ(world.fixture.state("left_joint" + std::to_string(i + 1) + "/position"), world.q(0)[i]);
  }
  // The pose is E in the arm's base, so for equal joints it does not depend on the base.
  const ModelTerms* model = shared_arm_state(world.fixture.state("left/multipanda_model"))->model;
  ASSERT_NE(model, nullptr);
  const Pose X_WE = const_cast<ModelTerms*>(model)->X_WE();
  const Vector3 p_B(world.fixture.state("left_ee_cartesian_position/12"),
                    world.fixture.state("left_ee_cartesian_position/13"),
                    world.fixture.state("left_ee_cartesian_position/14"));
  EXPECT_LT((world.scene.arms[0].X_WB * p_B - X_WE.position).norm(), 1e-12);
}

TEST(HardwareSystem, ASwitchIsCheckedAsAWholeAndARefusalChangesNothing) {
  World world;
  auto& fixture = world.fixture;
  const auto efforts = fixture.efforts("left");
  auto partial = efforts;
  partial.pop_back();
  EXPECT_THAT(fixture.change(partial), HasSubstr("arm 'left': claim all of one kind"));
  auto both = efforts;
  for (const auto& name : HostedFixture::joint_names("left", "position")) both.push_back(name);
  EXPECT_THAT(fixture.change(both), HasSubstr("claim all of one kind"));
  auto crossed = efforts;
  crossed[6] = "mj_left_joint7/effort";
  EXPECT_THAT(fixture.change(crossed), HasSubstr("claim all"));
  EXPECT_EQ(world.hardware.drive(0), ArmDrive::none);

  ASSERT_EQ(fixture.change(efforts), "");
  EXPECT_EQ(world.hardware.drive(0), ArmDrive::effort);
  EXPECT_EQ(world.hardware.drive(1), ArmDrive::none);  // whose name contains the other's
  EXPECT_THAT(fixture.change(efforts), HasSubstr("already claimed"));
  EXPECT_THAT(fixture.change(fixture.all("left_ee_cartesian_position")), HasSubstr("stop that controller"));
  EXPECT_EQ(world.hardware.drive(0), ArmDrive::effort);
  // A request with one wrong arm leaves the other arm unchanged, too.
  auto two = HostedFixture::joint_names("mj_left", "velocity");
  two.push_back("left_joint1/position");
  EXPECT_NE(fixture.change(two), "");
  EXPECT_EQ(world.hardware.drive(1), ArmDrive::none);
  // Interfaces of other components are ignored.
  EXPECT_EQ(fixture.change({"gripper/position"}, {"wheel/velocity"}), "");
  EXPECT_EQ(fixture.change(HostedFixture::joint_names("left", "velocity"), efforts), "");
  EXPECT_EQ(world.hardware.drive(0), ArmDrive::joint_velocity);
}

TEST(HardwareSystem, AnArmWithoutClaimHoldsItself) {
  World world;
  const JointVector start = world.q(0);
  world.fixture.steps(300);
  EXPECT_LT((world.q(0) - start).lpNorm<Eigen::Infinity>(), 1e-4);
  ASSERT_EQ(world.fixture.change(world.fixture.efforts("left")), "");
  double torque = 0;  // as fast as the arm accepts
  world.fixture.between_ = [&] {
    *world.fixture.command("left_joint1/effort") = torque = std::min(5.0, torque + 0.5);
  };
  world.fixture.steps(100);
  EXPECT_GT(world.q(0)[0], start[0] + 0.01);
  world.fixture.between_ = {};
  ASSERT_EQ(world.fixture.change({}, world.fixture.efforts("left")), "");
  world.fixture.steps(500);
  const JointVector rest = world.q(0);
  world.fixture.steps(300);  // the earlier torque is forgotten
  EXPECT_LT((world.q(0) - rest).lpNorm<Eigen::Infinity>(), 1e-4);
}

TEST(HardwareSystem, OurControllerOwnsOneArmAndAPositionControllerTheOther) {
  World world;
  auto& fixture = world.fixture;
  auto cycle = world.hosted("controllets: {pose: {type: cartesian_impedance, arms: left}}\nactive: pose\n");
  // With an error in its list: a controller for both arms claims both, one for one arm claims one.
  const Scene one = parse_scene(
      "arms: {left: {model: fer, base: {position_m: [0, 0.6, 0], rpy_rad: [0, 0, 0.4]}}}\n"
      "controllets: {pose: {type: cartesian_impedance, arms: left}}\nactive: pose\n",
      "test", builtins());
  cycle = std::make_unique<HostedCycle>(one, builtins(), HostedOptions{.arms = {{.name = "left"}}});
  auto start = fixture.efforts("left");
  const auto positions = HostedFixture::joint_names("mj_left", "position");
  start.insert(start.end(), positions.begin(), positions.end());
  ASSERT_EQ(fixture.change(start), "");
  fixture.activate(*cycle);
  EXPECT_EQ(cycle->check(), "");
  const double q1 = *fixture.command("mj_left_joint1/position");
  EXPECT_NEAR(q1, world.q(1)[0], 1e-3);  // starts where the arm is, not at zero
  double t = 0;
  fixture.between_ = [&] {  // a trajectory: 0.3 rad in 2 s
    t += 0.001;
    const double s = std::min(1.0, t / 2);
    *fixture.command("mj_left_joint1/position") = q1 + 0.3 * s * s * s * (10 + s * (6 * s - 15));
  };
  const InstanceIndex pose = cycle->modes().find("pose");
  ASSERT_TRUE(fixture.steps_until([&] { return (cycle->modes().active() & bit(pose)) != 0; }));
  fixture.step();
  const Pose X_WE =
      const_cast<ModelTerms*>(shared_arm_state(fixture.state("left/multipanda_state"))->model)->X_WE();
  const Pose goal{X_WE.rotation, X_WE.position + Vector3(0.05, -0.03, 0.04)};
  ASSERT_EQ(cycle->modes().instance(pose).inputs()[0].post(pose_target(goal, 1, Delivery::goal)),
            Verdict::accepted);
  fixture.steps(4000);
  EXPECT_TRUE(fixture.last());
  const Pose reached =
      const_cast<ModelTerms*>(shared_arm_state(fixture.state("left/multipanda_state"))->model)->X_WE();
  EXPECT_LT((reached.position - goal.position).norm(), 1e-3);
  EXPECT_NEAR(world.q(1)[0], q1 + 0.3, 2e-3);
  EXPECT_EQ(fixture.state("mj_left/following"), 1);
  // The hardware's data reach the controller.
  EXPECT_EQ(cycle->data().state[0].frames.X_FE.position, world.hardware.state(0).frames.X_FE.position);
  EXPECT_TRUE(cycle->backend().request(0, SetLoad{{.mass = 0.5}}).wait_for(std::chrono::seconds(0)) !=
              std::future_status::ready);  // it went to the arm, which answers in its loop
  EXPECT_TRUE(fixture.steps_until([&] { return cycle->data().state[0].load.mass == 0.5; }));

  // Swapped in one switch: the other controller takes left, ours takes nothing.
  fixture.between_ = {};
  fixture.deactivate();
  for (const auto& name : fixture.efforts("left")) EXPECT_EQ(*fixture.command(name), 0.0);
  auto stop = start;
  ASSERT_EQ(fixture.change(HostedFixture::joint_names("left", "position"), stop), "");
  const JointVector there = world.q(0);
  fixture.steps(300);
  EXPECT_LT((world.q(0) - there).lpNorm<Eigen::Infinity>(), 2e-3);
}

// The hardware serves the grippers' requests, and a controller beside it stops and resumes the arms.
TEST(HardwareSystem, AStopOfAControllerReachesTheGrippersOfItsArms) {
  World world;
  auto& fixture = world.fixture;
  auto cycle = world.hosted("controllets: {pose: {type: cartesian_impedance, arms: left}}\nactive: pose\n");
  const RunContext served = world.hardware.run_context();
  auto starts = fixture.efforts("left");
  std::ranges::copy(fixture.efforts("mj_left"), std::back_inserter(starts));
  ASSERT_EQ(fixture.change(starts), "");
  fixture.activate(*cycle);
  const auto begins = [&](ArmIndex arm) {
    auto answer =
        request_arm(*served.modes, *served.backend, arm, GripperMove{.width = 0.02}, served.newest(arm).mode);
    const bool refused = answer.wait_for(std::chrono::seconds(0)) == std::future_status::ready;
    return refused ? answer.get().reason : world.wait_for(std::move(answer)).reason;
  };
  EXPECT_THAT(begins(0), Not(HasSubstr("is stopped")));
  EXPECT_FALSE(gripper_stops(*served.modes, 0, served.newest(0).mode));

  cycle->modes().stop(ArmSet::of(0));
  fixture.steps(2);  // the loop's, then the hardware's next reading
  EXPECT_TRUE(gripper_stops(*served.modes, 0, served.newest(0).mode));
  EXPECT_FALSE(gripper_stops(*served.modes, 1, served.newest(1).mode));
  EXPECT_THAT(begins(0), HasSubstr("arm 'left' is stopped, and so is its gripper: resume the arm first"));

  const Request resume{.kind = Request::Kind::resume, .arms = ArmSet::of(0)};
  std::uint64_t ticket = 0;
  ASSERT_EQ(cycle->modes().post({&resume, 1}, ticket), Verdict::accepted);
  fixture.steps(SharedArmState::kStopped + 1);
  EXPECT_THAT(begins(0), Not(HasSubstr("is stopped")));

  // A stop outlasts the controller that took it, but not for ever: nobody could resume the arm.
  cycle->modes().stop(ArmSet::of(0));
  fixture.step();
  fixture.deactivate();
  fixture.steps(SharedArmState::kStopped / 2);
  EXPECT_TRUE(gripper_stops(*served.modes, 0, served.newest(0).mode));
  fixture.steps(SharedArmState::kStopped);
  EXPECT_FALSE(gripper_stops(*served.modes, 0, served.newest(0).mode));

  ASSERT_TRUE(world.ask(0, SetUserStop{true}).success);  // the arm's own button
  ASSERT_TRUE(fixture.steps_until([&] { return gripper_stops(*served.modes, 0, served.newest(0).mode); }));
  EXPECT_THAT(begins(0), HasSubstr("by its button"));
}

TEST(HardwareSystem, VelocityAndCartesianCommandsMoveTheArm) {
  World world;
  auto& fixture = world.fixture;
  // Joint velocity starts from zero, even if a velocity is commanded at once.
  ASSERT_EQ(fixture.change(HostedFixture::joint_names("left", "velocity")), "");
  const double q4 = world.q(0)[3];
  fixture.between_ = [&] { *fixture.command("left_joint4/velocity") = 0.2; };
  fixture.steps(1500);
  EXPECT_EQ(fixture.state("left/error"), 0);
  EXPECT_NEAR(fixture.state("left_joint4/velocity"), 0.2, 5e-3);
  EXPECT_NEAR(world.q(0)[3] - q4, 0.2 * (1.5 - 0.25), 0.01);

  // Cartesian velocity, in the base.
  ASSERT_EQ(fixture.change(fixture.all("mj_left_ee_cartesian_velocity")), "");
  const double z = fixture.state("mj_left_ee_cartesian_position/14");
  fixture.between_ = [&] { *fixture.command("mj_left_ee_cartesian_velocity/tz") = -0.05; };
  fixture.steps(1000);
  EXPECT_EQ(fixture.state("mj_left/error"), 0);
  EXPECT_NEAR(fixture.state("mj_left_ee_cartesian_velocity/tz"), -0.05, 2e-3);
  EXPECT_NEAR(fixture.state("mj_left_ee_cartesian_position/14"), z - 0.05 * 0.75, 2e-3);

  // Cartesian pose: a circle of 2 cm about the current position.
  double tz = -0.05;
  fixture.between_ = [&] {
    *fixture.command("mj_left_ee_cartesian_velocity/tz") = tz = std::min(0.0, tz + 1e-4);
  };
  fixture.steps(600);
  ASSERT_EQ(fixture.change(fixture.all("mj_left_ee_cartesian_position"),
                           fixture.all("mj_left_ee_cartesian_velocity")),
            "");
  fixture.between_ = {};
  fixture.steps(300);
  double y[1] = {*fixture.command("mj_left_ee_cartesian_position/13")};
  double t = 0;
  fixture.between_ = [&] {
    t += 0.001;
    *fixture.command("mj_left_ee_cartesian_position/13") =
        y[0] + 0.01 * (1 - std::cos(std::numbers::pi * std::min(t, 1.0)));
  };
  fixture.steps(1500);
  EXPECT_EQ(fixture.state("mj_left/error"), 0);
  EXPECT_NEAR(fixture.state("mj_left_ee_cartesian_position/13"), y[0] + 0.02, 2e-3);
}

TEST(HardwareSystem, ADistantCommandIsNotFollowedAndNanStopsTheArm) {
  World world;
  auto& fixture = world.fixture;
  ASSERT_EQ(fixture.change(HostedFixture::joint_names("left", "position")), "");
  const JointVector start = world.q(0);
  fixture.between_ = [&] { *fixture.command("left_joint2/position") = start[1] + 0.4; };
  fixture.steps(300);
  EXPECT_EQ(fixture.state("left/following"), 0);
  EXPECT_EQ(fixture.state("left/error"), 0);
  EXPECT_LT((world.q(0) - start).lpNorm<Eigen::Infinity>(), 2e-3);
  fixture.between_ = [&] {
    *fixture.command("left_joint2/position") = start[1] + 0.04;
  };  // near: followed smoothly
  fixture.steps(1000);
  EXPECT_EQ(fixture.state("left/following"), 1);
  EXPECT_EQ(fixture.state("left/error"), 0);
  EXPECT_NEAR(world.q(0)[1], start[1] + 0.04, 2e-3);
  fixture.between_ = [&] { *fixture.command("left_joint2/position") = NAN; };
  fixture.steps(100);
  EXPECT_EQ(world.hardware.drive(0), ArmDrive::none);
  EXPECT_EQ(fixture.state("left/error"), 0);
  EXPECT_NEAR(world.q(0)[1], start[1] + 0.04, 5e-3);
}

TEST(HardwareSystem, OneArmsFaultDoesNotAffectTheOtherAndIsRecovered) {
  World world;
  auto& fixture = world.fixture;
  auto start = HostedFixture::joint_names("left", "position");
  for (const auto& name : HostedFixture::joint_names("mj_left", "velocity")) start.push_back(name);
  ASSERT_EQ(fixture.change(start), "");
  const JointVector q0 = world.q(0);
  fixture.between_ = [&] { *fixture.command("mj_left_joint1/velocity") = 0.1; };
  fixture.steps(700);
  EXPECT_EQ(fixture.state("left/following"), 1);
  // A jump is an error in that arm's motion.
  fixture.between_ = [&] {
    *fixture.command("mj_left_joint1/velocity") = 0.1;
    *fixture.command("left_joint1/position") = q0[0] + 0.5;
  };
  fixture.steps(100);
  EXPECT_EQ(fixture.state("left/error"), 1);
  EXPECT_EQ(world.hardware.read(), HardwareSystem::Result::ok);
  EXPECT_EQ(world.hardware.write(), HardwareSystem::Result::ok);
  EXPECT_EQ(fixture.state("mj_left/error"), 0);
  EXPECT_NEAR(fixture.state("mj_left_joint1/velocity"), 0.1, 1e-2);
  // After recovery the arm does not follow an earlier command.
  ASSERT_TRUE(world.ask(0, RecoverFromError{}).success);
  fixture.steps(300);
  EXPECT_EQ(fixture.state("left/error"), 0);
  EXPECT_EQ(fixture.state("left/following"), 0);
  EXPECT_NEAR(world.q(0)[0], q0[0], 1e-2);
  EXPECT_FALSE(world.ask(0, RecoverFromError{}).success);  // nothing to recover from
  fixture.between_ = [&] {
    *fixture.command("mj_left_joint1/velocity") = 0.1;
    *fixture.command("left_joint1/position") = q0[0];
  };
  fixture.steps(100);
  EXPECT_EQ(fixture.state("left/following"), 1);
  // The other arm, driven by velocities: after a fault they must have been zero once.
  ASSERT_TRUE(world.ask(1, SetUserStop{true}).success);
  fixture.steps(50);
  ASSERT_TRUE(world.ask(1, SetUserStop{false}).success);
  fixture.steps(300);
  EXPECT_EQ(fixture.state("mj_left/following"), 0);
  EXPECT_NEAR(fixture.state("mj_left_joint1/velocity"), 0, 1e-2);
  fixture.between_ = [&] { *fixture.command("mj_left_joint1/velocity") = 0; };
  fixture.steps(5);
  fixture.between_ = [&] { *fixture.command("mj_left_joint1/velocity") = -0.1; };
  fixture.steps(800);
  EXPECT_NEAR(fixture.state("mj_left_joint1/velocity"), -0.1, 1e-2);
}

TEST(HardwareSystem, OurControllerHoldsARecoveredArm) {
  World world;
  auto& fixture = world.fixture;
  auto cycle = world.hosted(
      "controllets: {a: {type: joint_impedance, arms: left}, b: {type: joint_impedance, arms: mj_left}}\n"
      "active: [a, b]\n");
  auto start = fixture.efforts("left");
  for (const auto& name : fixture.efforts("mj_left")) start.push_back(name);
  ASSERT_EQ(fixture.change(start), "");
  fixture.activate(*cycle);
  const auto runs = [&](const char* name) {
    return (cycle->modes().active() & bit(cycle->modes().find(name))) != 0;
  };
  ASSERT_TRUE(fixture.steps_until([&] { return runs("a") && runs("b"); }));
  ASSERT_TRUE(world.ask(0, SetUserStop{true}).success);
  fixture.steps(20);
  EXPECT_FALSE(runs("a"));
  EXPECT_TRUE(runs("b"));
  EXPECT_TRUE(fixture.last());
  ASSERT_TRUE(world.ask(0, SetUserStop{false}).success);
  const JointVector there = world.q(0);
  fixture.steps(300);
  EXPECT_FALSE(runs("a"));  // held until a controllet is activated
  EXPECT_LT((world.q(0) - there).lpNorm<Eigen::Infinity>(), 5e-3);
  // A pause does not count as silence.
  ASSERT_TRUE(world.ask(PauseSimulation{true}).success);
  fixture.steps(200);
  EXPECT_TRUE(runs("b"));
  ASSERT_TRUE(world.ask(PauseSimulation{false}).success);
  fixture.steps(50);
  EXPECT_TRUE(runs("b"));
}

TEST(HardwareSystem, TheLoopNeitherAllocatesNorLocks) {
  if (!kLoopGuardWorks) GTEST_SKIP() << "sanitizers replace malloc themselves";
  World world;
  auto& fixture = world.fixture;
  const std::vector<std::vector<std::string>> kinds{
      fixture.efforts("left"), HostedFixture::joint_names("left", "position"),
      HostedFixture::joint_names("left", "velocity"), fixture.all("left_ee_cartesian_position"),
      fixture.all("left_ee_cartesian_velocity")};
  std::vector<std::string> before;
  fixture.steps(20);
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
    EXPECT_EQ(fixture.state("left/following"), 1) << kind[0];
    before = kind;
  }
}

TEST(HardwareSystem, ConnectsAgainAndWithdrawsItsAddressInBetween) {
  World world;
  auto& fixture = world.fixture;
  ASSERT_EQ(fixture.change(fixture.efforts("left")), "");
  fixture.steps(5);
  for (int i = 0; i < 3; ++i) {
    EXPECT_NE(shared_arm_state(fixture.state("left/multipanda_state")), nullptr);
    world.hardware.disconnect();
    EXPECT_EQ(shared_arm_state(fixture.state("left/multipanda_state")), nullptr);
    EXPECT_EQ(world.hardware.drive(0), ArmDrive::none);
    world.hardware.connect();
    ASSERT_EQ(fixture.change(fixture.efforts("left")), "");
    fixture.steps(5);
    EXPECT_EQ(fixture.state("left/following"), 1);
  }
}

TEST(HardwareSystem, HardwareHasAContextForItsServices) {
  World world;
  const RunContext run = world.hardware.run_context();
  EXPECT_EQ(run.modes->arm_name(1), "mj_left");
  EXPECT_EQ(run.models.size(), 2u);
  EXPECT_EQ(run.backend, &world.hardware.backend());
}

}  // namespace

namespace {

using testing::HasSubstr;

TEST(HardwareParameters, DescribeASceneAlsoInTheReferenceSystemsTerms) {
  const Scene own = hardware_scene({{"arm_names", "left, right"},
                                    {"arms.left.base.position_m", "[0, 0.26, 0]"},
                                    {"arms.right.hand", "false"},
                                    {"objects.box.shape", "box"},
                                    {"objects.box.size_m", "[0.1, 0.1, 0.1]"},
                                    {"objects.box.fixed", "false"},
                                    {"objects.box.mass_kg", "0.5"},
                                    {"node_name", "x"}},
                                   false, {"node_name"});
  ASSERT_EQ(own.arms.size(), 2u);
  EXPECT_EQ(own.arms[0].X_WB.position, Vector3(0, 0.26, 0));
  EXPECT_FALSE(own.arms[1].hand);
  EXPECT_FALSE(own.objects.at(0).fixed);
  const Scene known = hardware_scene({{"robot_count", "2"},
                                      {"ns_1", "mj_left"},
                                      {"ns_2", "mj_right"},
                                      {"hand_1", "True"},
                                      {"hand_2", "False"},
                                      {"robot_ip_1", "172.16.0.2"},
                                      {"robot_ip_2", "172.16.1.2"},
                                      {"arms.mj_right.base.position_m", "[0, -0.26, 0]"}},
                                     true);
  EXPECT_EQ(known.arms.at(1).name, "mj_right");
  EXPECT_FALSE(known.arms[1].hand);
  EXPECT_EQ(known.arms[1].fci->address, "172.16.1.2");
  const Scene named = hardware_scene({{"scene", "two_arms"}}, false);
  EXPECT_EQ(named.arms.size(), 2u);
  EXPECT_TRUE(named.controllets.empty());
  const auto refusal = [](std::map<std::string, std::string> parameters, bool real) -> std::string {
    try {
      (void)hardware_scene(parameters, real);
    } catch (const std::invalid_argument& error) {
      return error.what();
    }
    return "none";
  };
  EXPECT_THAT(refusal({{"arm_names", "left"}}, true), HasSubstr("'left' has no address"));
  EXPECT_THAT(refusal({{"arm_names", "left"}, {"arms.left.fci", "1.2.3.4"}}, false), HasSubstr("FciSystem"));
  EXPECT_THAT(refusal({{"arm_name", "left"}}, false), HasSubstr("did you mean 'arm_names'"));
  EXPECT_THAT(refusal({{"scene", "two_arms"}, {"arm_names", "left"}}, false),
              HasSubstr("define it in that scene"));
  EXPECT_THAT(refusal({{"robot_count", "2"}, {"ns_1", "left"}}, false), HasSubstr("ns_2"));
  EXPECT_THAT(refusal({{"robot_count", "two"}}, false), HasSubstr("whole number"));
}

}  // namespace

}  // namespace multipanda::hardware_system_test
