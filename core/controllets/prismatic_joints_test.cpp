// Laws, features and the safety stage on prismatic joints: N/m where revolute joints have N m/rad.
#include <algorithm>
#include <array>
#include <cmath>

#include <gtest/gtest.h>

#include "core/controllets/builtins.hpp"
#include "core/controllets/cartesian_law.hpp"
#include "core/controllets/prismatic_parameters.hpp"
#include "core/features/bounded_drive.hpp"
#include "core/features/builtins.hpp"
#include "core/safety/safety.hpp"
#include "core/testing/carriage.hpp"
#include "core/testing/controllet_rig.hpp"
#include "core/testing/test_arm.hpp"

namespace multipanda::prismatic_joints_test {
namespace {

using namespace test;

// Seven skewed revolute joints on a carriage of 20 kg: the null space of the hand moves the carriage.
std::shared_ptr<const ArmModel> arm_on_axis() {
  std::string urdf = TestArm::make(7).urdf();
  const auto insert = [&](const std::string& before, const std::string& text) {
    urdf.insert(urdf.find(before), text);
  };
  urdf.replace(urdf.find("<parent link='base'/>"), 21, "<parent link='carriage'/>");
  insert("<link name='link0'>",
         "<link name='carriage'><inertial><mass value='20'/><inertia ixx='1' ixy='0' ixz='0' iyy='1' iyz='0' "
         "izz='1'/></inertial></link><joint name='slide' type='prismatic'><parent link='base'/>"
         "<child link='carriage'/><origin xyz='0.1 0.2 0' rpy='0.3 0.2 0.1'/><axis xyz='0.6 0.8 0'/>"
         "<limit lower='-2' upper='2' velocity='1' effort='800'/></joint>");
  ArmModelSource source = TestArm::make(7).source({rotation_from_rpy({0.3, 0.2, 1}), {1, 2, 3}});
  source.urdf = urdf;
  source.q_home = JointVector::Zero(8);
  source.q_home.tail(7) = bent(7);
  return std::make_shared<const ArmModel>(std::move(source));
}

// Two slides on each other that point in opposite directions, and an arm of two links on the second one: hand
// and elbow rest while both slides move alike.
std::shared_ptr<const ArmModel> arm_on_opposed_slides() {
  std::string urdf = "<robot name='slides'><link name='link0'/>";
  const char* const axes[] = {"0.6 0.8 0", "-0.6 -0.8 0", "0 0 1", "1 0 0"};
  for (int i = 1; i <= 4; ++i) {
    const std::string number = std::to_string(i);
    urdf += "<link name='link" + number + "'><inertial><origin xyz='0 0.1 0.1'/><mass value='" +
            std::to_string(20 / i) +
            "'/><inertia ixx='0.2' ixy='0' ixz='0' iyy='0.2' iyz='0' izz='0.2'/></inertial></link><joint "
            "name='j" +
            number + "' type='" + (i < 3 ? "prismatic" : "revolute") + "'><parent link='link" +
            std::to_string(i - 1) + "'/><child link='link" + number +
            "'/><origin xyz='0.1 0 0.2'/><axis xyz='" + axes[i - 1] +
            "'/><limit lower='-2' upper='2' velocity='2' effort='500'/></joint>";
  }
  ArmModelSource source;
  source.name = "slides";
  source.urdf = urdf + "</robot>";
  source.flange = "link4";
  source.X_WB = {rotation_from_rpy({0.3, 0.2, 1}), {1, 2, 3}};
  return std::make_shared<const ArmModel>(source);
}

// The least-squares joint velocity at which the hand stands and the carriage moves by 1 m/s.
JointVector with_resting_hand(ModelTerms& terms) {
  Eigen::MatrixXd A = Eigen::MatrixXd::Zero(7, 8);
  A.topRows(6) = terms.J_V_WE();
  A(6, 0) = 1;
  return A.completeOrthogonalDecomposition().solve(Eigen::VectorXd::Unit(7, 6));
}

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
}

// A carriage that is let go coasts for half a second, v exp(-2 t); a light one has 0.1 N m s/rad at a lever
// of 0.1 m, a very heavy one 60 N at 0.25 m/s, and none more than half its mass per millisecond.
TEST(PrismaticJoints, DoNotCoastOnWhenGuided) {
  for (const auto& [mass, D] : {std::pair{25.0, 50.0}, {2.0, 10.0}, {400.0, 240.0}, {0.01, 5.0}}) {
    ControlletRig guided(gravity_compensation_controllet(), {axis(mass)});
    guided.place(0, one(0.1), one(0.5));
    ASSERT_EQ(guided.start(), LawResult::ok);
    ASSERT_EQ(guided.update(), LawResult::ok);
    EXPECT_NEAR(guided.tau(0)[0], -D * 0.5, 1e-9) << mass;
    guided.set("damping_nms_per_rad", {0.25});
    ASSERT_EQ(guided.update(), LawResult::ok);
    EXPECT_NEAR(guided.tau(0)[0], -(D == 10 ? 25 : D) * 0.5, 1e-9) << mass;
  }
  ControlletRig guided(gravity_compensation_controllet(), {axis(25)});
  guided.place(0, one(0), one(0.2));
  ASSERT_EQ(guided.start(), LawResult::ok);
  for (int k = 0; k < 3000; ++k) {
    ASSERT_EQ(guided.tick(0.001), LawResult::ok);
    guided.integrate(0.001, {one(0)}, 2);
  }
  EXPECT_NEAR(guided.state(0).q[0], 0.2 / 2, 1e-3);
  EXPECT_LT(guided.state(0).dq[0], 0.2 * 1.02 * std::exp(-6));
}

// A carriage that does not follow is pushed with the bound of a hand, whatever its stiffness: at rest with 60
// N, and less the faster it comes after its set-point, none at 1.5 times 0.25 m/s.
TEST(PrismaticJoints, PressWithTheBoundForContact) {
  // A pull M n with J n = 0 does not act on the hand: it may accelerate the slides as it likes.
  const auto model = arm_on_opposed_slides();
  JointVector n = JointVector::Zero(4);
  n[0] = n[1] = 1;
  for (const double sign : {1.0, -1.0}) {
    ControlletRig rig(joint_impedance_controllet(), {model});
    const JointVector q = model->q_home() + JointVector::Constant(4, 0.1), none = JointVector::Zero(4);
    rig.place(0, q, none);
    const JointVector pull = 40 * sign * rig.terms(0).M() * n;
    ASSERT_GT(pull.head<2>().lpNorm<Eigen::Infinity>(), 500);
    const JointVector K = rig.parameters().joints(rig.parameters().find("stiffness_nm_per_rad"));
    ASSERT_EQ(rig.start(), LawResult::ok);
    rig.input("joints").start(JointVector(q + pull.cwiseQuotient(K)));
    ASSERT_EQ(rig.update(), LawResult::ok);
    EXPECT_LT((rig.tau(0) - pull).norm(), 1e-9);  // lifted: the stiffness times the error
    rig.bound({});
    ASSERT_EQ(rig.update(), LawResult::ok);
    EXPECT_LT((rig.tau(0) - 60 / pull.head<2>().lpNorm<Eigen::Infinity>() * pull).norm(), 1e-6);
  }
  // One mass on a spring: in closed form.
  const double m = 25, K = 10000, D = 2 * std::sqrt(K * m);
  ControlletRig rig(joint_impedance_controllet(), {axis(m)});
  rig.bound({});
  rig.place(0, one(0.5), one(0));
  rig.input("joints").start(one(0.5));
  ASSERT_EQ(rig.start(), LawResult::ok);
  const auto force = [&](double dq) {
    rig.place(0, one(0.1), one(dq));
    EXPECT_EQ(rig.update(), LawResult::ok);
    return rig.tau(0)[0];
  };
  EXPECT_NEAR(force(0), 60, 1e-9);
  EXPECT_NEAR(force(-0.1), 60 + D * 0.1, 1e-9);           // pushed back: its damping in addition
  EXPECT_NEAR(force(0.1), 60 * (1 - 0.1 / 0.375), 1e-9);  // on its way
  EXPECT_NEAR(force(0.5), -D * 0.5 + D * 0.25, 1e-9);     // too fast: it brakes
}

// The posture moves a carriage while the hand rests.
TEST(PrismaticJoints, AreDrawnToAPostureWithinTheBoundForContact) {
  const auto model = arm_on_axis();
  ModelTerms terms(model);
  ArmState state;
  state.q = model->q_home();
  state.dq = JointVector::Zero(8);
  JointVector tau = JointVector::Zero(8);
  OwnedArm arm{&state, &terms, &tau};
  terms.update(state);
  ASSERT_FALSE(terms.task().floored);
  JointVector q_N = state.q;
  q_N[0] += 1.5;
  NullSpaceGains gains{.stiffness = 50000};
  for (const Projector projector :
       {Projector::dynamic, Projector::paper_pseudoinverse, Projector::damped_pseudoinverse}) {
    gains.projector = projector;
    gains.contact = ContactBounds::lifted();
    const JointVector whole = null_space_torque(gains, arm, q_N);
    ASSERT_GT(std::abs(whole[0]), 100);
    gains.contact = {};
    const JointVector bounded = null_space_torque(gains, arm, q_N);
    EXPECT_LE(std::abs(bounded[0]), 60 + 1e-9);
    EXPECT_LT((bounded - bounded[0] / whole[0] * whole).norm(), 1e-9);  // the same direction
    if (projector == Projector::dynamic) {
      EXPECT_NEAR(std::abs(bounded[0]), 60, 1e-6);
    }
  }
  // As fast as that it draws no more, and only its damping is left.
  gains.projector = Projector::dynamic;
  state.dq = 0.4 * with_resting_hand(terms);
  terms.update(state);
  const JointVector damping = null_space_torque({.stiffness = 50000}, arm, state.q);
  EXPECT_LT((null_space_torque(gains, arm, q_N) - damping).norm(), 0.2);
}

// A leader that moves its carriage under a resting hand leads that of the follower at the speed of hands.
TEST(PrismaticJoints, FollowAtTheSpeedOfHands) {
  const auto model = arm_on_opposed_slides();
  const JointVector none = JointVector::Zero(4);
  for (const bool bounded : {true, false}) {
    ControlletRig rig(joint_follower_controllet(), {model, model});
    if (bounded) rig.bound({.hand_speed = 0.25, .spring_force = 1e6, .spring_moment = 1e6});
    JointVector q = model->q_home(), dq = none;
    rig.place(0, q, none);
    rig.place(1, q, none);
    ASSERT_EQ(rig.start(), LawResult::ok);
    double fastest = 0;
    for (int k = 0; k < 500; ++k) {
      dq[0] = dq[1] = 0.4 * std::min(1.0, k / 200.0);
      q += 0.001 * dq;
      rig.state(1).t_robot.ns += 1'000'000;
      ASSERT_EQ(rig.tick(0.001), LawResult::ok);
      rig.integrate(0.001, {none, none}, 1);
      rig.place(1, q, dq);
      fastest = std::max(fastest, rig.state(0).dq[0]);
    }
    EXPECT_LT(rig.terms(0).V_WE().linear().norm(), 0.02);
    EXPECT_EQ(rig.output("slipped")[0], 0);
    EXPECT_GT(fastest, bounded ? 0.2 : 0.35);
    if (bounded) {
      EXPECT_LT(fastest, 0.27);
    }
  }
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

// With the defaults 60 N at the limit, and never more than the bounds for contact allow.
TEST(PrismaticJoints, ArePushedBackWithinTheBoundForContact) {
  ControlletRig rig(joint_limits_feature(), {axis(25)});
  ASSERT_EQ(rig.start(), LawResult::ok);
  const auto force = [&](double q) {
    rig.place(0, one(q), one(0));
    for (int k = 0; k < 101; ++k) EXPECT_EQ(rig.tick(0.001), LawResult::ok);  // it has come in
    return rig.tau(0)[0];
  };
  EXPECT_NEAR(force(0.7), -60, 1e-9);
  EXPECT_NEAR(force(-0.5), 60, 1e-9);
  EXPECT_NEAR(force(0.675), -30, 1e-9);
  rig.set("stiffness_n_per_m", {20000});
  EXPECT_NEAR(force(0.7), -1000, 1e-9);
  rig.bound({.hand_speed = 0.1, .spring_force = 30, .spring_moment = 7.5});
  EXPECT_NEAR(force(0.7), -30, 1e-9);
  EXPECT_NEAR(force(-0.52), 30, 1e-9);
  EXPECT_NEAR(force(0.651), -20, 1e-9);
}

// The posture of a Cartesian law leads a carriage at the speed of hands, a joint at 0.5 rad/s. What the
// posture draws is linear in its distance.
TEST(PrismaticJoints, AreLedToAPostureAtTheSpeedOfHands) {
  const auto model = arm_on_axis();
  JointVector drawn[2];
  for (const bool bounded : {false, true}) {
    ControlletRig rig(cartesian_impedance_controllet(), {model});
    if (bounded) rig.bound({.hand_speed = 0.1, .spring_force = 1e9, .spring_moment = 1e9});
    rig.place(0, model->q_home(), JointVector::Zero(8));
    std::vector<double> posture(model->q_home().begin(), model->q_home().end());
    posture[0] += 1;
    rig.set("nullspace_posture", {2});
    rig.set("nullspace_posture_rad", posture);
    rig.set("nullspace_stiffness_nm_per_rad", {200});
    ASSERT_EQ(rig.start(), LawResult::ok);
    for (int k = 0; k < 100; ++k) ASSERT_EQ(rig.tick(0.001), LawResult::ok);
    drawn[bounded ? 1 : 0] = rig.tau(0);
  }
  ASSERT_GT(drawn[0].norm(), 1e-3);
  EXPECT_LT((5 * drawn[1] - drawn[0]).norm(), 1e-6 * drawn[0].norm());
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

// Many shapes of an arm near a wall push its carriage, which the hand hardly feels.
TEST(PrismaticJoints, AreDrivenByAFeatureAsAHandIs) {
  const auto model = arm_on_axis();
  ModelTerms terms(model);
  ArmState state;
  state.q = model->q_home();
  state.dq = joint_constant(8, 0);
  terms.update(state.q, state.dq);
  JointVector tau = state.dq, law = state.dq;
  const OwnedArm arm{&state, &terms, &tau};
  std::array scene{OwnedArm{&state, &terms, &law}};
  ControlContext context;
  context.dt = 0.2;  // it comes in at once
  context.scene_arms = scene;
  context.contact = {};
  const double most = context.contact.spring_force;
  for (const double side : {1.0, -1.0}) {
    const JointVector push = side * 600 * JointVector::Unit(8, 0);
    for (const double pressed : {0.0, 0.5, 2.0}) {
      for (const double pushed : {0.0, 0.25, -0.25}) {  // by another feature
        law[0] = -side * pressed * most;
        tau[0] = side * pushed * most;
        const double expected = most * (1 - std::max(0.0, pushed) + std::clamp(pressed - pushed, 0.0, 1.0));
        EXPECT_NEAR(side * BoundedDrive().limit(context, arm, push)[0], expected, 1e-9) << side << pressed;
      }
    }
  }
}

}  // namespace
}  // namespace multipanda::prismatic_joints_test
