// Laws, features and the safety stage on prismatic joints: N/m where revolute joints have N m/rad.
#include <cmath>

#include <gtest/gtest.h>

#include "core/controllets/gravity_compensation.hpp"
#include "core/controllets/hold.hpp"
#include "core/controllets/joint_follower.hpp"
#include "core/controllets/joint_impedance.hpp"
#include "core/controllets/prismatic_parameters.hpp"
#include "core/features/joint_limits.hpp"
#include "core/safety/safety.hpp"
#include "core/testing/controllet_rig.hpp"
#include "core/testing/test_arm.hpp"

namespace multipanda::prismatic_joints_test {
namespace {

using namespace test;

// A carriage of `mass` on a tilted axis, and on it, if `turns`, an arm of one link.
std::shared_ptr<const ArmModel> axis(double mass, bool turns = false) {
  const auto link = [](const char* name, double m) {
    const std::string kg = std::to_string(m);
    return std::string("<link name='") + name + "'><inertial><origin xyz='0.1 0 0.05'/><mass value='" + kg +
           "'/><inertia ixx='0.2' ixy='0' ixz='0' iyy='0.2' iyz='0' izz='0.2'/></inertial></link>";
  };
  std::string urdf = "<robot name='axis'><link name='base'/>" + link("carriage", mass) +
                     "<joint name='slide' type='prismatic'><parent link='base'/><child link='carriage'/>"
                     "<origin xyz='0.3 0 0.2' rpy='0.4 0.2 0.1'/><axis xyz='0 0.6 0.8'/>"
                     "<limit lower='-0.5' upper='0.7' velocity='1' effort='900'/></joint>";
  if (turns) {
    urdf += link("boom", 4) +
            "<joint name='turn' type='revolute'><parent link='carriage'/><child link='boom'/>"
            "<axis xyz='0 0 1'/><limit lower='-2' upper='2' velocity='2' effort='80'/></joint>";
  }
  ArmModelSource source;
  source.name = "axis";
  source.urdf = urdf + "</robot>";
  source.flange = turns ? "boom" : "carriage";
  source.X_WB = {rotation_from_rpy({0.3, 0.2, 1}), {1, 2, 3}};
  return std::make_shared<const ArmModel>(source);
}

JointVector one(double value) { return JointVector::Constant(1, value); }

TEST(PrismaticJoints, HaveAStiffnessThatSuitsWhatTheyCarry) {
  EXPECT_EQ(usual_prismatic_stiffness(*axis(25), 0), 10000);  // 25 kg (20 rad/s)^2
  EXPECT_EQ(usual_prismatic_stiffness(*axis(0.3), 0), 500);
  EXPECT_EQ(usual_prismatic_stiffness(*axis(400), 0), 20000);
}

// One mass on a spring: every law is known in closed form.
TEST(PrismaticJoints, AreHeldAsAMassOnASpring) {
  const double m = 25, K = 10000, D = 2 * std::sqrt(K * m);
  const auto model = axis(m);
  ControlletRig hold(hold_controllet(), {model});
  hold.place(0, one(0.1), one(0));
  ASSERT_EQ(hold.start(), LawResult::ok);
  hold.place(0, one(0.103), one(0.05));
  ASSERT_EQ(hold.update(), LawResult::ok);
  EXPECT_NEAR(hold.tau(0)[0], -K * 0.003 - D * 0.05, 1e-9);

  ControlletRig spring(joint_impedance_controllet(), {model});
  spring.place(0, one(0.1), one(0));
  spring.input("joints").start(one(0.1));
  ASSERT_EQ(spring.start(), LawResult::ok);
  spring.place(0, one(0.103), one(0.05));
  ASSERT_EQ(spring.update(), LawResult::ok);
  EXPECT_NEAR(spring.tau(0)[0], -K * 0.003 - D * 0.05, 1e-9);

  ControlletRig guided(gravity_compensation_controllet(), {model});
  guided.place(0, one(0.1), one(0.5));
  ASSERT_EQ(guided.start(), LawResult::ok);
  ASSERT_EQ(guided.update(), LawResult::ok);
  EXPECT_NEAR(guided.tau(0)[0], -10 * 0.5, 1e-12);  // 0.1 N m s/rad at a lever of 0.1 m
}

TEST(PrismaticJoints, HaveTheirOwnBounds) {
  ControlletRig rig(joint_impedance_controllet(), {axis(25, true)});
  const ParameterSet& parameters = rig.parameters();
  const std::size_t stiffness = parameters.find("stiffness_nm_per_rad");
  const auto verdict = [&](double slides, double turns) {
    return parameters.check(stiffness, std::vector<double>{slides, turns});
  };
  EXPECT_EQ(verdict(50000, 1000), Verdict::accepted);
  EXPECT_EQ(verdict(50001, 1000), Verdict::out_of_bounds);
  EXPECT_EQ(verdict(50000, 1001), Verdict::out_of_bounds);
  EXPECT_GT(parameters.target(stiffness)[0], 5000);
  EXPECT_EQ(parameters.target(stiffness)[1], 600);
  ControlletRig plain(joint_impedance_controllet(), {TestArm::make(2).model()});
  EXPECT_EQ(plain.parameters().spec(stiffness).max, 1000);
}

TEST(PrismaticJoints, ArePushedBackFromTheirLimits) {
  Draw draw(3);
  const auto model = axis(25);
  ControlletRig rig(joint_limits_feature(), {model});
  rig.set("range_m", {0.08});
  rig.set("stiffness_n_per_m", {1500});
  ASSERT_EQ(rig.start(), LawResult::ok);
  const auto energy = [](double q) {
    const double d = std::min(q + 0.5, 0.7 - q);
    return d < 0.08 ? 750 * (0.08 - d) * (0.08 - d) : 0.0;
  };
  int near = 0;
  for (int trial = 0; trial < 300; ++trial) {
    const double q = draw.uniform(-0.6, 0.8), h = 1e-7;
    rig.place(0, one(q), one(0));
    ASSERT_EQ(rig.update(), LawResult::ok);
    EXPECT_NEAR(rig.tau(0)[0], -(energy(q + h) - energy(q - h)) / (2 * h), 1e-3);
    near += rig.tau(0)[0] != 0 ? 1 : 0;
  }
  EXPECT_GT(near, 50);
  EXPECT_LT(near, 250);
}

// Slower than what counts as outwards, a joint may creep 5 mm beyond its limit.
TEST(PrismaticJoints, DoNotCreepOut) {
  const auto model = axis(25);
  ModelTerms terms(model);
  SafetyStage stage({SafetyLimits::of(*model)});
  ArmState state;
  state.mode = ArmMode::move;
  state.dq = one(0.005);
  ArmCondition condition;
  condition.usable = true;
  const auto rule = [&](double q) {
    state.q = one(q);
    terms.update(state);
    stage.track_limits(0, state, terms, false);
    return stage.inspect(0, condition, state, terms).rule;
  };
  EXPECT_EQ(rule(0.69), Intervention::none);
  EXPECT_EQ(rule(0.7049), Intervention::none);
  EXPECT_EQ(rule(0.7051), Intervention::joint_position_limit);
}

TEST(PrismaticJoints, FollowOnlyJointsOfTheirKind) {
  const auto slides = axis(25), turns = TestArm::make(1).model();
  EXPECT_THROW(ControlletRig(joint_follower_controllet(), {slides, turns}), std::invalid_argument);
  EXPECT_NO_THROW(ControlletRig(joint_follower_controllet(), {slides, axis(10)}));
}

}  // namespace
}  // namespace multipanda::prismatic_joints_test
