#include <array>
#include <cmath>

#include <gtest/gtest.h>

#include "core/controllets/controllet.hpp"
#include "core/testing/test_laws.hpp"
#include "core/testing/test_world.hpp"

// The loop with an arm that stands on another one: where it is, what happens when the carrier is lost, what is refused.
namespace multipanda::moving_base_test {
namespace {

using test::Draw;
using test::TestArm;
using test::TestWorld;

constexpr ArmIndex kCarrier = 0, kCarried = 1;

std::vector<std::shared_ptr<const ArmModel>> models() {
  const Pose upright{rotation_from_rpy({0, 0, 0.7}), {0.3, -0.2, 0.4}};
  return {TestArm::make(8, 1).model(upright, "left"), TestArm::make(7, 2).model({}, "right"),
          TestArm::make(7, 3).model({Matrix3::Identity(), {3, 0, 0}}, "third")};
}

// The carrier of this world does not feel the arm that it carries: the parameters of "torso" use no mass matrix.
ContactBounds only_speed() {
  ContactBounds bounds = ContactBounds::lifted();
  bounds.hand_speed = ContactBounds{}.hand_speed;
  return bounds;
}

std::vector<InstanceConfig> laws() {
  return {{.name = "torso", .type = "joint_impedance", .arms = {kCarrier}, .parameters = {{"damping_design", {2}}, {"acceleration_feedforward", {0}}}, .contact = only_speed()},
          {.name = "hand", .type = "cartesian_impedance", .arms = {kCarried}},
          {.name = "joints", .type = "joint_impedance", .arms = {kCarried}},
          {.name = "both", .type = "dual_cartesian_impedance", .arms = {kCarrier, kCarried}},
          {.name = "aside", .type = "cartesian_impedance", .arms = {2}}};
}

const BaseMount kMount{.carrier = kCarrier, .joint = 0, .X_JB = {rotation_from_rpy({0.4, 0.3, 0.2}), {0.1, 1.2, 0.5}}};

CycleConfig config(std::vector<InstanceConfig> controllets = laws()) {
  CycleConfig config = test::test_config(models(), std::move(controllets));
  config.arms[kCarried].mount = kMount;
  return config;
}

struct MovingBaseLoop : testing::Test {
  MovingBaseLoop() : world(models()), cycle(config(), Registry::with_builtins(), world) {
    world.tamper = [this](ArmIndex arm, std::uint64_t, ArmState& state) {
      if (arm == lost) state.mode = mode;
      if (arm == broken) state.q[0] = std::nan("");
    };
    steps(2);
  }
  void steps(std::size_t count) {
    for (std::size_t i = 0; i < count; ++i) cycle.step(world.wait());
  }
  InstanceSet set(std::string_view name) { return bit(cycle.modes().find(name)); }
  Answer ask(const Request& request) {
    Answer answer;
    std::uint64_t ticket = 0;
    answer.verdict = cycle.modes().post(std::span(&request, 1), ticket);
    steps(1);
    if (answer.accepted() && !cycle.modes().poll(ticket, answer)) answer.verdict = Verdict::timeout;
    return answer;
  }
  bool activate(std::string_view name) { return ask({.activate = set(name)}).accepted(); }
  bool runs(std::string_view name) { return (cycle.modes().active() & set(name)) != 0; }

  ArmIndex lost = 9, broken = 9;
  ArmMode mode = ArmMode::reflex;
  TestWorld world;
  ControlCycle cycle;
};

TEST_F(MovingBaseLoop, KnowsWhereTheCarriedArmIsInEveryCycle) {
  Draw draw(5);
  ModelTerms carrier(models()[kCarrier]), carried(models()[kCarried]);
  for (int k = 0; k < 5; ++k) {
    const JointVector q = draw.joints(8, 1.5);
    world.set_position(kCarrier, q);
    world.set_velocity(kCarrier, draw.joints(8, 0.5));
    steps(1);
    carrier.update(cycle.data().state[kCarrier].q, cycle.data().state[kCarrier].dq);
    carried.update(cycle.data().state[kCarried]);
    // The arm's own chain from its base, placed where the carrier's link is.
    const Pose X = carrier.X_WJ(0) * kMount.X_JB * carried.X_WE();  // its model's base is the world's origin
    ModelTerms& terms = const_cast<ModelTerms&>(cycle.data().terms[kCarried]);
    EXPECT_LT((terms.X_WE().position - X.position).norm(), 1e-12);
    EXPECT_LT((terms.X_WE().rotation - X.rotation).norm(), 1e-12);
  }
}

// Also in cycles in which no packet of the carried arm arrives.
TEST_F(MovingBaseLoop, PlacesTheBaseBetweenPacketsOfTheCarriedArm) {
  world.due_in_step = [](std::uint64_t step) { return step % 2 == 0 ? ArmSet::all(3) : ArmSet::of(kCarrier); };
  const Vector3 before = cycle.data().terms[kCarried].X_WB().position;
  for (int k = 0; k < 2; ++k) {
    world.set_position(kCarrier, JointVector::Constant(8, 0.5 + 0.1 * k));
    steps(1);
    ModelTerms carrier(models()[kCarrier]);
    carrier.update(cycle.data().state[kCarrier].q, cycle.data().state[kCarrier].dq);
    const Pose X = carrier.X_WJ(0) * kMount.X_JB;
    EXPECT_LT((cycle.data().terms[kCarried].X_WB().position - X.position).norm(), 1e-12);
    EXPECT_GT((cycle.data().terms[kCarried].X_WB().position - before).norm(), 1e-3);
  }
}

TEST_F(MovingBaseLoop, HoldsTheCarriedArmWhenItsCarrierIsLost) {
  for (const ArmMode how : {ArmMode::reflex, ArmMode::user_stopped, ArmMode::disconnected}) {
    lost = 9;
    mode = how;
    steps(5);
    ASSERT_TRUE(activate("torso"));
    ASSERT_TRUE(activate("hand"));
    ASSERT_TRUE(activate("aside"));
    const auto counted = cycle.safety().counted(kCarried, Intervention::observed_arm_lost);
    lost = kCarrier;
    steps(1);
    EXPECT_FALSE(runs("hand"));
    EXPECT_TRUE(runs("right_hold") && runs("aside"));
    EXPECT_EQ(cycle.safety().counted(kCarried, Intervention::observed_arm_lost), counted + 1);
    EXPECT_FALSE(activate("hand")) << "while its base is not known";
  }
}

TEST_F(MovingBaseLoop, StopsTheCarriedArmWithItsCarrier) {
  ASSERT_TRUE(activate("hand"));
  cycle.modes().stop(ArmSet::of(kCarrier));
  steps(1);
  EXPECT_FALSE(runs("hand"));
}

// A state that is not finite reaches no torque of the other arm.
TEST_F(MovingBaseLoop, KeepsFaultsOfOneArmOutOfTheTorquesOfTheOther) {
  for (const ArmIndex arm : {kCarrier, kCarried}) {
    broken = 9;
    steps(20);
    ASSERT_TRUE(activate("torso"));
    ASSERT_TRUE(activate("joints"));
    world.set_velocity(kCarrier, JointVector::Constant(8, 0.1));
    const std::array before{cycle.safety().counted(kCarrier + kCarried - arm, Intervention::torque_not_finite),
                            cycle.safety().counted(kCarrier + kCarried - arm, Intervention::state_not_finite)};
    broken = arm;
    for (int k = 0; k < 50; ++k) {
      steps(1);
      for (const ArmIndex each : {kCarrier, kCarried}) ASSERT_TRUE(world.torque(each).allFinite()) << k;
    }
    for (const auto code : {Intervention::torque_not_finite, Intervention::state_not_finite})
      EXPECT_EQ(cycle.safety().counted(kCarrier + kCarried - arm, code), before[code == Intervention::state_not_finite]);
    broken = 9;
    for (const ArmIndex each : {kCarrier, kCarried}) {
      world.set_velocity(each, JointVector::Zero(world.velocity(each).size()));
    }
  }
}

// The joints of the carrier move the carried hand, too: it is the faster one here.
TEST_F(MovingBaseLoop, BoundsTheSpeedOfTheCarriedHand) {
  ASSERT_TRUE(activate("torso"));
  const JointVector q = cycle.data().state[kCarrier].q;
  Request request{.kind = Request::Kind::set_target, .instance = cycle.modes().find("torso")};
  request.target.size = 8;
  for (std::size_t i = 0; i < 8; ++i) request.target.values[i] = q[static_cast<Eigen::Index>(i)];
  request.target.values[0] += 1.5;
  request.target.duration_s = 2;
  ASSERT_TRUE(ask(request).accepted());
  double fastest = 0, own = 0;
  Instance& torso = const_cast<Instance&>(cycle.modes().instance(cycle.modes().find("torso")));
  JointVector last = torso.inputs()[0].joints();
  for (int k = 0; k < 14'000; ++k) {
    steps(1);
    const JointVector now = torso.inputs()[0].joints(), rate = (now - last) / kArmPeriod;
    last = now;
    ModelTerms& carrier = const_cast<ModelTerms&>(cycle.data().terms[kCarrier]);
    ModelTerms& carried = const_cast<ModelTerms&>(cycle.data().terms[kCarried]);
    // About the vertical axis of the torso.
    const Vector3 lever = carried.X_WE().position - carrier.X_WJ(0).position;
    fastest = std::max(fastest, std::abs(rate[0]) * lever.head<2>().norm());
    own = std::max(own, (carrier.J_V_WE() * rate).head<3>().norm());
  }
  EXPECT_LT(fastest, 1.02 * ContactBounds{}.hand_speed);
  EXPECT_GT(fastest, 0.9 * ContactBounds{}.hand_speed) << "else the test shows nothing; own hand " << own;
  EXPECT_LT(own, fastest) << "the carried hand is the one that bounds";
}

TEST(MovingBaseCycle, RefusesMountsThatItCannotDrive) {
  const auto refusal = [](const CycleConfig& config) -> std::string {
    TestWorld world(models());
    try {
      const ControlCycle cycle(config, Registry::with_builtins(), world);
    } catch (const std::invalid_argument& error) {
      return error.what();
    }
    return "";
  };
  EXPECT_EQ(refusal(config()), "");
  CycleConfig bad = config();
  bad.arms[kCarried].mount->carrier = kCarried;
  EXPECT_NE(refusal(bad).find("expected another arm of this loop"), std::string::npos);
  bad = config();
  bad.arms[kCarried].mount->carrier = 3;
  EXPECT_NE(refusal(bad).find("arm number 3"), std::string::npos);
  bad = config();
  bad.arms[2].mount = BaseMount{.carrier = kCarried, .joint = 0, .X_JB = {}};
  EXPECT_NE(refusal(bad).find("stands on an arm itself"), std::string::npos);
  bad = config();
  bad.arms[2].mount = BaseMount{.carrier = kCarrier, .joint = 0, .X_JB = {}};
  EXPECT_NE(refusal(bad).find("expected one at most"), std::string::npos);
  bad = config();
  bad.arms[kCarried].mount->joint = 8;
  EXPECT_NE(refusal(bad).find("behind joint 9"), std::string::npos);
  bad = config();
  bad.arms[kCarried].mount->joint = 1;
  EXPECT_NE(refusal(bad).find("degrees from vertical"), std::string::npos) << refusal(bad);
}

TEST(MovingBaseCycle, RefusesLawsAndFeaturesThatKnowNoMovingBase) {
  const auto refusal = [](InstanceConfig of) -> std::string {
    TestWorld world(models());
    try {
      const ControlCycle cycle(config({std::move(of)}), Registry::with_builtins(), world);
    } catch (const std::invalid_argument& error) {
      return error.what();
    }
    return "";
  };
  for (const std::string type : {"ufic", "force", "hybrid_force"}) {
    for (const ArmIndex arm : {kCarrier, kCarried}) {
      EXPECT_NE(refusal({.name = "x", .type = type, .arms = {arm}}).find("stands on another one"), std::string::npos)
          << type;
    }
    EXPECT_EQ(refusal({.name = "x", .type = type, .arms = {2}}), "") << "an arm beside them";
  }
  for (const ArmIndex leader : {kCarrier, kCarried}) {
    EXPECT_NE(refusal({.name = "x", .type = "pose_follower", .arms = {2}, .observes = {leader}})
                  .find("stands on another one"),
              std::string::npos);
  }
  for (ArmIndex arm = 0; arm < 3; ++arm) {
    EXPECT_NE(refusal({.name = "x", .type = "joint_impedance", .arms = {arm}, .features = {"collision_avoidance"}})
                  .find("knows no base that moves"),
              std::string::npos);
    EXPECT_EQ(refusal({.name = "x", .type = "cartesian_impedance", .arms = {arm}, .features = {"manipulability"}}),
              "");
  }
}

}  // namespace
}  // namespace multipanda::moving_base_test
