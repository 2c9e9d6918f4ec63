#include <gtest/gtest.h>

#include "core/testing/controllet_rig.hpp"
#include "core/testing/test_world.hpp"

// End effectors that are redefined while a law runs, and parameters of holds, on a world of two arms.
namespace multipanda::redefined_frames_test {
namespace {

using test::TestLoop;
using Kind = Request::Kind;

const ArmFrames kNewFrames{.X_FE = {rotation_from_rpy({0.3, -0.2, 0.5}), Vector3(0.02, -0.03, 0.15)},
                           .X_EK = {}};

struct Law {
  const char* type;
  std::size_t arms;
  const char* input;  // moved before and while the frames change; nullptr: none
};
// The common set-point of two hands does not move here: its motion first brings the hands to it.
const Law kLaws[] = {{"cartesian_impedance", 1, "pose"},
                     {"ufic", 1, "pose"},
                     {"force", 1, nullptr},
                     {"hybrid_force", 1, "pose"},
                     {"dual_cartesian_impedance", 2, nullptr},
                     {"dual_cartesian_impedance", 2, "first_pose"},
                     {"coupled_dual_cartesian_impedance", 2, "pose"},
                     {"coupled_ufic", 2, "pose"},
                     {"joint_impedance", 1, nullptr}};

struct Outcome {
  double step = 0;         // largest change of a joint torque in the cycle of the change [N m]
  double usual = 0;        // the same of the cycles before it
  double speed_after = 0;  // highest joint speed after the change [rad/s]
  double usual_speed = 0;  // before it
  std::uint64_t cut = 0;   // interventions
  bool active = false;
};

Outcome change(const Law& law, std::uint64_t at, double duration_s) {
  std::vector<ArmIndex> arms{0};
  if (law.arms == 2) arms.push_back(1);
  InstanceConfig config{.name = "law", .type = law.type, .arms = arms};
  if (law.input != nullptr && std::string_view(law.input) == "first_pose")
    config.parameters = {{.name = "goals", .values = {1}}};
  TestLoop loop(2, {config}, Registry::with_builtins());
  loop.world.tamper = [&](ArmIndex arm, std::uint64_t step, ArmState& state) {
    if (arm != 0 || step < at) return;
    state.frames = kNewFrames;
    state.config_version = 1;
  };
  for (ArmIndex arm = 0; arm < 2; ++arm)
    loop.world.set_position(arm, test::bent(7));  // not near a singular pose
  loop.steps(3);
  EXPECT_TRUE(loop.activate({"law"}).accepted()) << law.type;
  if (law.input != nullptr) {
    const InstanceIndex i = loop.find("law");
    const std::size_t input = loop.modes().instance(i).find_input(law.input);
    Pose goal = loop.modes().instance(i).inputs()[input].pose();
    goal.position += Vector3(0.015, 0.01, 0.02);
    goal.rotation = exp_rotation({0.02, 0.04, -0.03}) * goal.rotation;
    Request request{.kind = Kind::set_target, .instance = i, .index = static_cast<std::uint16_t>(input)};
    request.target = pose_target(goal, duration_s);
    EXPECT_TRUE(loop.ask(request).accepted());
  }
  Outcome outcome;
  JointVector before;
  while (loop.world.steps() < at + 2000) {
    const std::uint64_t step = loop.world.steps();
    loop.step();
    const JointVector& tau = loop.cycle.data().tau_controllet[0];
    if (step > at - 200 && step < at) {
      outcome.usual = std::max(outcome.usual, (tau - before).lpNorm<Eigen::Infinity>());
      outcome.usual_speed = std::max(outcome.usual_speed, loop.world.velocity(0).lpNorm<Eigen::Infinity>());
    }
    if (step == at) outcome.step = (tau - before).lpNorm<Eigen::Infinity>();
    if (step > at)
      outcome.speed_after = std::max(outcome.speed_after, loop.world.velocity(0).lpNorm<Eigen::Infinity>());
    before = tau;
  }
  outcome.cut = loop.cycle.safety().counted(0);
  outcome.active = loop.modes().owner(0) == loop.find("law");
  return outcome;
}

// The end effector jumps by 15 cm and half a radian; a set-point that stayed would pull with 60 N at once.
TEST(RedefinedFrames, AtRestNoLawMovesTheArm) {
  for (const Law& law : kLaws) {
    const Outcome outcome = change(law, 6000, 1.0);
    EXPECT_TRUE(outcome.active) << law.type;
    EXPECT_LT(outcome.step, 0.05) << law.type;
    EXPECT_LT(outcome.speed_after, 0.01) << law.type;
    EXPECT_EQ(outcome.cut, 0u) << law.type;
  }
}

TEST(RedefinedFrames, InMotionTheMotionGoesOn) {
  for (const Law& law : kLaws) {
    const Outcome outcome = change(law, 700, 1.5);
    EXPECT_TRUE(outcome.active) << law.type;
    EXPECT_LT(outcome.step, outcome.usual + 0.5) << law.type;
    EXPECT_LT(outcome.speed_after, 2 * outcome.usual_speed + 0.02) << law.type;
    EXPECT_EQ(outcome.cut, 0u) << law.type;
  }
}

// A law that starts later starts in the new frame.
TEST(RedefinedFrames, ALawThatStartsLaterKnowsThem) {
  TestLoop loop(1, {{.name = "law", .type = "cartesian_impedance", .arms = {0}}}, Registry::with_builtins());
  loop.world.tamper = [](ArmIndex, std::uint64_t step, ArmState& state) {
    if (step < 10) return;
    state.frames = kNewFrames;
    state.config_version = 1;
  };
  loop.steps(20);
  ASSERT_TRUE(loop.activate({"law"}).accepted());
  loop.steps(100);
  EXPECT_LT(loop.cycle.data().tau_controllet[0].norm(), 1e-6);
}

Request stiffness(TestLoop& loop, const char* hold, double value) {
  Request request{.kind = Kind::set_parameter, .instance = loop.find(hold)};
  const Instance& instance = loop.modes().instance(request.instance);
  request.index = static_cast<std::uint16_t>(instance.find_parameter("stiffness_nm_per_rad"));
  request.size = static_cast<std::uint8_t>(instance.parameter_size(request.index));
  request.values.fill(value);
  return request;
}

TEST(HoldParameters, DoNotChangeOnAStoppedArm) {
  TestLoop loop(2, {}, Registry::with_builtins());
  loop.step();
  EXPECT_EQ(loop.ask(stiffness(loop, "arm0_hold", 0)).verdict, Verdict::out_of_bounds);
  EXPECT_EQ(loop.ask(stiffness(loop, "arm0_hold", 19.9)).verdict, Verdict::out_of_bounds);
  EXPECT_TRUE(loop.ask(stiffness(loop, "arm0_hold", 100)).accepted());
  loop.modes().stop(ArmSet::of(0));
  loop.step();
  EXPECT_EQ(loop.ask(stiffness(loop, "arm0_hold", 200)).verdict, Verdict::arm_stopped);
  EXPECT_TRUE(loop.ask(stiffness(loop, "arm1_hold", 200)).accepted());  // of another arm
  // A feature would push it: manipulability turns the elbow.
  Request push{.kind = Kind::set_feature, .instance = loop.find("arm0_hold"), .on = true};
  push.index =
      static_cast<std::uint16_t>(loop.modes().instance(push.instance).find_feature("manipulability"));
  EXPECT_EQ(loop.ask(push).verdict, Verdict::arm_stopped);
  EXPECT_FALSE(loop.modes().instance(push.instance).feature_on(push.index));
  Request resume{.kind = Kind::resume};
  resume.arms = ArmSet::all(2);
  EXPECT_TRUE(loop.ask(resume).accepted());
  EXPECT_TRUE(loop.ask(stiffness(loop, "arm0_hold", 200)).accepted());
  EXPECT_TRUE(loop.ask(push).accepted());
}

}  // namespace
}  // namespace multipanda::redefined_frames_test
