#include <algorithm>
#include <array>
#include <cmath>

#include <Eigen/LU>
#include <gtest/gtest.h>

#include "core/controllets/controllet.hpp"
#include "core/testing/test_laws.hpp"
#include "core/testing/test_world.hpp"

// The loop with an arm that stands on another one: where it is, what happens when the carrier is lost, what
// is refused.
namespace multipanda::moving_base_test {
namespace {

using test::Draw;
using test::TestArm;
using test::TestWorld;

constexpr ArmIndex kCarrier = 0, kCarried = 1;

std::vector<std::shared_ptr<const ArmModel>> arm_models() {
  const Pose upright{rotation_from_rpy({0, 0, 0.7}), {0.3, -0.2, 0.4}};
  return {TestArm::make(8, 1).model(upright, "left"), TestArm::make(7, 2).model({}, "right"),
          TestArm::make(7, 3).model({Matrix3::Identity(), {3, 0, 0}}, "third")};
}

// The carrier of this world does not feel the arm that it carries. The parameters of "torso" therefore use no
// mass matrix.
ContactBounds only_speed() {
  ContactBounds bounds = ContactBounds::lifted();
  bounds.hand_speed = ContactBounds{}.hand_speed;
  return bounds;
}

std::vector<InstanceConfig> laws() {
  return {{.name = "torso",
           .type = "joint_impedance",
           .arms = {kCarrier},
           .parameters = {{"damping_design", {2}}, {"acceleration_feedforward", {0}}},
           .contact = only_speed()},
          {.name = "pressing", .type = "joint_impedance", .arms = {kCarrier}, .contact = {}},
          {.name = "hand", .type = "cartesian_impedance", .arms = {kCarried}},
          {.name = "joints", .type = "joint_impedance", .arms = {kCarried}, .contact = only_speed()},
          {.name = "both", .type = "dual_cartesian_impedance", .arms = {kCarrier, kCarried}},
          {.name = "own", .type = "cartesian_impedance", .arms = {kCarrier}},
          {.name = "guided", .type = "gravity_compensation", .arms = {kCarrier}},
          {.name = "led", .type = "gravity_compensation", .arms = {kCarried}},
          {.name = "across", .type = "dual_cartesian_impedance", .arms = {kCarried, 2}},
          {.name = "aside", .type = "cartesian_impedance", .arms = {2}}};
}

const BaseMount kMount{
    .carrier = kCarrier, .joint = 0, .X_JB = {rotation_from_rpy({0.4, 0.3, 0.2}), {0.1, 1.2, 0.5}}};

CycleConfig config(std::vector<InstanceConfig> controllets = laws()) {
  CycleConfig config = test::test_config(arm_models(), std::move(controllets));
  config.arms[kCarried].mount = kMount;
  return config;
}

struct MovingBaseLoop : testing::Test, test::TestLoop {
  MovingBaseLoop() : TestLoop(arm_models(), config(), Registry::with_builtins()) {
    world.tamper = [this](ArmIndex arm, std::uint64_t, ArmState& state) {
      if (arm == lost) state.mode = mode;
      if (arm == broken) state.q[0] = std::nan("");
    };
    steps(2);
  }
  InstanceSet set(std::string_view name) { return bit(cycle.modes().find(name)); }
  bool activate(std::string_view name) { return ask({.activate = set(name)}).accepted(); }
  // Leads the first joint of a joint law by `angle`.
  void lead(std::string_view name, ArmIndex arm, double angle, double duration_s) {
    const JointVector& q = cycle.data().state[arm].q;
    Request request{.kind = Request::Kind::set_target, .instance = cycle.modes().find(name)};
    request.target.size = static_cast<std::uint8_t>(q.size());
    std::copy(q.begin(), q.end(), request.target.values.begin());
    request.target.values[0] += angle;
    request.target.duration_s = duration_s;
    ASSERT_TRUE(ask(request).accepted());
  }
  bool runs(std::string_view name) { return (cycle.modes().active() & set(name)) != 0; }

  ArmIndex lost = 9, broken = 9;
  ArmMode mode = ArmMode::reflex;
};

TEST_F(MovingBaseLoop, KnowsWhereTheCarriedArmIsInEveryCycle) {
  Draw draw(5);
  ModelTerms carrier(arm_models()[kCarrier]), carried(arm_models()[kCarried]);
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
  world.due_in_step = [](std::uint64_t step) {
    return step % 2 == 0 ? ArmSet::all(3) : ArmSet::of(kCarrier);
  };
  const Vector3 before = cycle.data().terms[kCarried].X_WB().position;
  for (int k = 0; k < 2; ++k) {
    world.set_position(kCarrier, JointVector::Constant(8, 0.5 + 0.1 * k));
    steps(1);
    ModelTerms carrier(arm_models()[kCarrier]);
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

TEST_F(MovingBaseLoop, RunsACartesianCarrierOnlyBesideACartesianCarriedArm) {
  for (const char* other : {"right_hold", "joints"}) {
    ASSERT_TRUE(activate(other));
    EXPECT_EQ(ask({.activate = set("own")}).verdict, Verdict::start_refused) << other;
    EXPECT_TRUE(runs(other));
    ASSERT_TRUE(activate("torso")) << "a joint law bounds the carried hand";
  }
  EXPECT_TRUE(ask({.activate = set("own") | set("hand")}).accepted());
  steps(5);
  EXPECT_TRUE(runs("own") && runs("hand"));
  ASSERT_TRUE(ask({.deactivate = set("hand")}).accepted());
  EXPECT_TRUE(runs("left_hold") && runs("right_hold"));
  ASSERT_TRUE(activate("hand"));
  ASSERT_TRUE(activate("own"));
  ASSERT_TRUE(activate("joints")) << "of the carried arm alone";
  EXPECT_TRUE(runs("left_hold") && runs("joints"));
  EXPECT_TRUE(activate("both"));
}

// A torso that is guided by hand comes to rest: by half within 0.35 s, at 2 1/s.
TEST_F(MovingBaseLoop, BrakesATorsoThatIsGuided) {
  ASSERT_TRUE(activate("guided"));
  world.set_velocity(kCarrier, JointVector::Unit(8, 0) * 0.3);
  steps(1);
  ModelTerms& terms = const_cast<ModelTerms&>(cycle.data().terms[kCarrier]);
  const double brake = cycle.data().tau_controllet[kCarrier][0] - terms.c()[0];
  EXPECT_NEAR(brake, -(2.0 * terms.M()(0, 0) + 0.1) * cycle.data().state[kCarrier].dq[0], 1e-9);
}

// Torques are computed for the arms that are due: the carrier bears a hand that presses on, packet or not.
TEST_F(MovingBaseLoop, TheCarrierBearsBetweenPacketsOfTheCarriedArm) {
  ASSERT_TRUE(activate("guided"));
  ASSERT_TRUE(activate("hand"));
  world.set_position(kCarried, world.position(kCarried) + JointVector::Constant(7, 0.02));
  steps(1);
  world.set_velocity(kCarrier, JointVector::Zero(8));
  world.set_velocity(kCarried, JointVector::Zero(7));
  steps(1);
  const double bears = cycle.data().tau_controllet[kCarrier][0];
  ASSERT_GT(std::abs(bears), 0.1);
  world.due_in_step = [](std::uint64_t) { return ArmSet::of(kCarrier); };
  steps(1);
  EXPECT_NEAR(cycle.data().tau_controllet[kCarrier][0], bears, 0.2 * std::abs(bears));
}

// A law of the carried arm and of one that stands elsewhere.
TEST_F(MovingBaseLoop, HoldsTheOtherArmOfALawWhoseCarrierIsLost) {
  ASSERT_TRUE(activate("across"));
  lost = kCarrier;
  steps(1);
  EXPECT_FALSE(runs("across"));
  EXPECT_TRUE(runs("right_hold") && runs("third_hold"));
}

TEST_F(MovingBaseLoop, StopsTheCarriedArmWithItsCarrier) {
  ASSERT_TRUE(activate("hand"));
  cycle.modes().stop(ArmSet::of(kCarrier));
  steps(1);
  EXPECT_FALSE(runs("hand"));
}

// A carrier that went on would sweep the arm on it, which stopped itself or was stopped.
TEST_F(MovingBaseLoop, StopsTheCarrierWithTheArmThatItCarries) {
  const auto mover = [this](const char* law) {
    EXPECT_TRUE(activate(law));
    lead(law, kCarrier, 0.5, 2);
    steps(800);
    EXPECT_GT(std::abs(world.velocity(kCarrier)[0]), 0.01);
  };
  for (const ArmMode how : {ArmMode::reflex, ArmMode::user_stopped, ArmMode::disconnected}) {
    mode = how;
    mover("torso");
    lost = kCarried;
    steps(1);
    EXPECT_TRUE(runs("left_hold"));
    const Vector3 held = cycle.data().terms[kCarried].X_WB().position;
    for (int k = 0; k < 3000; ++k) {
      steps(1);
      ASSERT_LT((cycle.data().terms[kCarried].X_WB().position - held).norm(), 0.01);
    }
    EXPECT_FALSE(activate("torso")) << "while the arm is not there";
    EXPECT_FALSE(activate("guided"));
    lost = 9;
    steps(5);
  }
  mover("torso");
  cycle.modes().stop(ArmSet::of(kCarried));
  // It waits with the stop: accepted, it would be undone at the same boundary.
  EXPECT_EQ(ask({.activate = set("torso")}).verdict, Verdict::arm_stopped);
  EXPECT_TRUE(runs("left_hold"));
  EXPECT_EQ(cycle.modes().stopped(), ArmSet::of(kCarried) | ArmSet::of(kCarrier));
  EXPECT_EQ(ask({.activate = set("torso")}).verdict, Verdict::arm_stopped);
  ASSERT_TRUE(ask({.kind = Request::Kind::resume, .arms = ArmSet::of(kCarrier)}).accepted());
  EXPECT_EQ(ask({.activate = set("torso")}).verdict, Verdict::arm_stopped) << "the arm on it still is";
  ASSERT_TRUE(ask({.kind = Request::Kind::resume, .arms = ArmSet::of(kCarried)}).accepted());
  EXPECT_TRUE(activate("torso"));
  // The other arm of the scene stops nothing.
  cycle.modes().stop(ArmSet::of(2));
  steps(1);
  EXPECT_TRUE(runs("torso"));
}

// Somebody leads the carried arm, by its own button or by a law, and the torso would pull it out of the hand.
TEST_F(MovingBaseLoop, StopsTheCarrierOfAnArmThatIsGuided) {
  for (const bool by_law : {false, true}) {
    ASSERT_TRUE(activate("torso"));
    lead("torso", kCarrier, 0.5, 2);
    steps(800);
    ASSERT_GT(std::abs(world.velocity(kCarrier)[0]), 0.01);
    mode = ArmMode::guiding;
    if (by_law) {
      ASSERT_TRUE(activate("led"));
    } else {
      lost = kCarried;
    }
    steps(1);
    EXPECT_TRUE(runs("left_hold"));
    steps(1000);
    EXPECT_LT(std::abs(world.velocity(kCarrier)[0]), 1e-3);
    EXPECT_EQ(ask({.activate = set("torso")}).verdict, Verdict::start_refused);
    EXPECT_TRUE(activate("guided")) << "a torso that is led, too, sweeps nobody";
    lost = 9;
    ASSERT_TRUE(ask({.deactivate = set("led") | set("guided")}).accepted());
    steps(5);
  }
  EXPECT_TRUE(activate("torso"));
}

// A state that is not finite reaches no torque of the other arm.
TEST_F(MovingBaseLoop, KeepsFaultsOfOneArmOutOfTheTorquesOfTheOther) {
  for (const ArmIndex arm : {kCarrier, kCarried}) {
    broken = 9;
    steps(20);
    ASSERT_TRUE(activate("torso"));
    ASSERT_TRUE(activate("joints"));
    world.set_velocity(kCarrier, JointVector::Constant(8, 0.1));
    const std::array before{
        cycle.safety().counted(kCarrier + kCarried - arm, Intervention::torque_not_finite),
        cycle.safety().counted(kCarrier + kCarried - arm, Intervention::state_not_finite)};
    broken = arm;
    for (int k = 0; k < 50; ++k) {
      steps(1);
      for (const ArmIndex each : {kCarrier, kCarried}) ASSERT_TRUE(world.torque(each).allFinite()) << k;
    }
    for (const auto code : {Intervention::torque_not_finite, Intervention::state_not_finite})
      EXPECT_EQ(cycle.safety().counted(kCarrier + kCarried - arm, code),
                before[code == Intervention::state_not_finite]);
    broken = 9;
    for (const ArmIndex each : {kCarrier, kCarried}) {
      world.set_velocity(each, JointVector::Zero(world.velocity(each).size()));
    }
  }
}

// The joints of the carrier move the carried hand, too: it is the faster one here.
TEST_F(MovingBaseLoop, BoundsTheSpeedOfTheCarriedHand) {
  ASSERT_TRUE(activate("torso"));
  lead("torso", kCarrier, 1.5, 2);
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

// A torso that is kept from its set-point presses with no more than the bound at the hand of an arm that is
// held. The force of the whole torque there, the carrier's other joints free, is that of the torso's axis
// alone: F = (M^-1 tau)_1 / (r (M^-1)_11), r the distance of the hand from the axis.
TEST_F(MovingBaseLoop, BoundsTheForceOfTheTorsoAtTheCarriedHand) {
  for (const char* law : {"pressing", "torso"}) {
    world.set_position(kCarrier, arm_models()[kCarrier]->q_home());
    world.set_velocity(kCarrier, JointVector::Zero(8));
    steps(1);
    ASSERT_TRUE(activate(law));
    JointVector away = world.position(kCarrier);
    away[0] -= 0.5;
    world.set_position(kCarrier, away);
    world.set_velocity(kCarrier, JointVector::Zero(8));
    steps(1);
    ModelTerms& carrier = const_cast<ModelTerms&>(cycle.data().terms[kCarrier]);
    ModelTerms& carried = const_cast<ModelTerms&>(cycle.data().terms[kCarried]);
    const Eigen::MatrixXd M_inverse = Eigen::MatrixXd(carrier.M()).inverse();
    const Eigen::VectorXd pull = cycle.data().tau_controllet[kCarrier] - carrier.c();
    const double r = (carried.X_WE().position - carrier.X_WJ(0).position).head<2>().norm();
    const double force = M_inverse.row(0).dot(pull) / (r * M_inverse(0, 0));
    if (law == std::string_view("torso")) {
      EXPECT_GT(force, 2 * ContactBounds{}.spring_force) << "lifted: the bound is what holds it back";
    } else {
      EXPECT_LT(force, 1.1 * ContactBounds{}.spring_force);
      EXPECT_GT(force, 0.8 * ContactBounds{}.spring_force);
    }
  }
}

// What sweeps the base takes its share of the bound from the joints of the carried arm.
TEST_F(MovingBaseLoop, SharesTheBoundWithWhatSweepsTheBase) {
  ASSERT_TRUE(activate("joints"));
  const Instance& joints = cycle.modes().instance(cycle.modes().find("joints"));
  lead("joints", kCarried, 1.0, 1);
  steps(1500);
  JointVector last = joints.inputs()[0].joints();
  const auto set_point_speed = [&](std::size_t count) {
    double fastest = 0;
    for (std::size_t k = 0; k < count; ++k) {
      steps(1);
      const JointVector now = joints.inputs()[0].joints();
      ModelTerms& terms = const_cast<ModelTerms&>(cycle.data().terms[kCarried]);
      fastest = std::max(fastest, (terms.J_V_WE() * JointVector((now - last) / kArmPeriod)).head<3>().norm());
      last = now;
    }
    return fastest;
  };
  const double alone = set_point_speed(20);
  EXPECT_GT(alone, 0.1);
  // The torso is turned by hand, faster than the whole bound.
  world.tamper = [](ArmIndex arm, std::uint64_t, ArmState& state) {
    if (arm == kCarrier) state.dq = JointVector::Unit(8, 0);
  };
  steps(1000);
  last = joints.inputs()[0].joints();
  EXPECT_LT(set_point_speed(100), 0.01);
}

// What sweeps the base has the whole bound of the hand when a goal comes: the goal waits, and is reached.
TEST_F(MovingBaseLoop, AGoalOfJointsWhoseBaseHasTheWholeBoundWaits) {
  ASSERT_TRUE(activate("joints"));
  const Instance& joints = cycle.modes().instance(cycle.modes().find("joints"));
  bool turned = true;
  world.tamper = [&](ArmIndex arm, std::uint64_t, ArmState& state) {
    if (arm == kCarrier && turned) state.dq = JointVector::Unit(8, 0);
  };
  steps(2);
  const JointVector start = joints.inputs()[0].joints();
  lead("joints", kCarried, 0.02, 0.1);
  const double goal = cycle.data().state[kCarried].q[0] + 0.02;
  for (int k = 0; k < 500; ++k) {
    world.set_velocity(kCarrier, JointVector::Zero(8));  // its hold brakes what it only seems to do
    steps(1);
    ASSERT_TRUE(joints.inputs()[0].joints().allFinite()) << k;
  }
  EXPECT_LT((joints.inputs()[0].joints() - start).norm(), 0.01);
  turned = false;
  steps(6000);
  EXPECT_TRUE(runs("joints"));
  EXPECT_NEAR(joints.inputs()[0].joints()[0], goal, 1e-3);
}

// The torso's joint gets the moment of the carried hand's wrench about its axis, in a law of both arms and
// beside hand guiding and a hold: what the wrench does for a turn of the torso.
TEST_F(MovingBaseLoop, TheCarrierBearsWhatTheCarriedHandPresses) {
  Draw draw(9);
  for (const std::string carrier_runs : {"both", "guided", "left_hold"}) {
    const bool one_law = carrier_runs == "both";
    world.set_position(kCarrier, arm_models()[kCarrier]->q_home());
    world.set_position(kCarried, arm_models()[kCarried]->q_home());
    for (const ArmIndex arm : {kCarrier, kCarried}) world.set_velocity(arm, 0 * world.velocity(arm));
    steps(1);
    ASSERT_TRUE(activate(carrier_runs));
    if (!one_law) {
      ASSERT_TRUE(activate("hand"));
    }
    // The carried hand is led away, so that its law pulls.
    world.set_position(kCarrier, arm_models()[kCarrier]->q_home());
    world.set_position(kCarried, arm_models()[kCarried]->q_home() + draw.joints(7, 0.03));
    for (const ArmIndex arm : {kCarrier, kCarried}) world.set_velocity(arm, 0 * world.velocity(arm));
    steps(1);
    const CycleData& data = cycle.data();
    ModelTerms& carrier = const_cast<ModelTerms&>(data.terms[kCarrier]);
    ModelTerms& carried = const_cast<ModelTerms&>(data.terms[kCarried]);
    // F of the law at the carried hand; at rest its torque is J^T F and a posture without force there.
    const Vector6 F = carried.task().J_bar.transpose() * data.tau_controllet[kCarried];
    ASSERT_GT(F.norm(), 1);
    const Vector3 p = carried.X_WE().position, o = carrier.X_WJ(0).position;
    const double of_carried = (p - o).cross(Vector3(F.head<3>())).z() + F[5];  // about the vertical axis
    const Vector6 F_own = carrier.task().J_bar.transpose() * data.tau_controllet[kCarrier];
    JointVector rest = data.tau_controllet[kCarrier];
    rest[0] -= of_carried;
    if (one_law) {
      // Without it the carrier's own law is left: its hand is where it is to be.
      const Vector6 left = carrier.task().J_bar.transpose() * rest;
      EXPECT_LT(left.norm(), 0.02 * F.norm()) << F_own.transpose();
    } else {
      EXPECT_LT(rest.cwiseAbs().maxCoeff(), carrier_runs == "guided" ? 1e-9 : 0.01)
          << "its hold has a spring";
    }
    EXPECT_GT(std::abs(of_carried), 0.1);
  }
}

// A load of either arm changes the momentum that both observers count, and not what pushes on them.
TEST_F(MovingBaseLoop, ALoadOfOneArmIsNoForceOnTheOther) {
  double push = 0;
  std::uint32_t loads = 0;
  world.tamper = [&](ArmIndex arm, std::uint64_t, ArmState& state) {
    if (arm == kCarried) state.tau_J[3] += push;
    if (arm == kCarrier) state.config_version = loads;
  };
  const auto felt = [&] { return cycle.data().state[kCarried].tau_ext_hat[3]; };
  steps(200);
  const double before = felt();  // this world's arms do not feel each other
  push = 4;
  steps(200);
  EXPECT_NEAR(felt() - before, push, 0.01 * push);
  ++loads;
  steps(1);
  for (const ArmIndex arm : {kCarrier, kCarried}) EXPECT_EQ(cycle.data().state[arm].tau_ext_hat.norm(), 0);
  steps(200);
  EXPECT_NEAR(felt() - before, push, 0.01 * push);
}

// The first arm of the scene stands on the second link of the second arm.
TEST(MovingBaseOrder, AnArmMayStandOnALaterOneBehindAnyJoint) {
  test::TestArm torso = TestArm::make(8, 1);
  torso.links[1].X_PJ.rotation = Matrix3::Identity();  // its second axis is vertical, too
  const std::vector arms{TestArm::make(7, 2).model({}, "right"), torso.model({}, "left")};
  CycleConfig config =
      test::test_config(arms, {{.name = "hand", .type = "cartesian_impedance", .arms = {0}},
                               {.name = "own", .type = "cartesian_impedance", .arms = {1}},
                               {.name = "guided", .type = "gravity_compensation", .arms = {1}}});
  config.arms[0].mount = BaseMount{.carrier = 1, .joint = 1, .X_JB = kMount.X_JB};
  test::TestLoop loop(arms, config, Registry::with_builtins());
  loop.steps(2);
  EXPECT_EQ(loop.activate({"own"}).verdict, Verdict::start_refused) << "beside the hold of the carried arm";
  ASSERT_TRUE(loop.activate({"guided"}).accepted());
  loop.world.set_velocity(1, JointVector::Unit(8, 1) * 0.3);
  loop.step();
  ModelTerms& carrier = const_cast<ModelTerms&>(loop.cycle.data().terms[1]);
  ModelTerms& carried = const_cast<ModelTerms&>(loop.cycle.data().terms[0]);
  const double brake = loop.cycle.data().tau_controllet[1][1] - carrier.c()[1];
  EXPECT_NEAR(brake, -(2.0 * carrier.M()(1, 1) + 0.1) * loop.cycle.data().state[1].dq[1], 1e-9);
  // It bears the moment of the hand that presses about that axis.
  ASSERT_TRUE(loop.activate({"hand"}).accepted());
  loop.world.set_position(0, loop.world.position(0) + JointVector::Constant(7, 0.02));
  for (const ArmIndex arm : {0, 1}) loop.world.set_velocity(arm, 0 * loop.world.velocity(arm));
  loop.step();
  const Vector6 F = carried.task().J_bar.transpose() * loop.cycle.data().tau_controllet[0];
  const Vector3 lever = carried.X_WE().position - carrier.X_WJ(1).position;
  EXPECT_NEAR(loop.cycle.data().tau_controllet[1][1], lever.cross(Vector3(F.head<3>())).z() + F[5], 1e-9);
  EXPECT_GT(F.norm(), 1);
  loop.modes().stop(ArmSet::of(0));
  loop.step();
  EXPECT_EQ(loop.modes().stopped(), ArmSet::all(2));
}

std::string refused_by(const CycleConfig& config, Backend& world) {
  try {
    const ControlCycle cycle(config, Registry::with_builtins(), world);
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
  return "";
}

std::string refusal(const CycleConfig& config) {
  TestWorld world(arm_models());
  return refused_by(config, world);
}

// One of its arms is real, or estimates its forces itself.
class Other final : public Backend {
 public:
  explicit Other(const std::vector<std::shared_ptr<const ArmModel>>& models) : world_(models) {}
  ArmIndex real = 9, estimating = 9;

  std::size_t arm_count() const override { return world_.arm_count(); }
  Capabilities capabilities(ArmIndex arm) const override {
    return {.simulated = arm != real && arm < arm_count(), .has_external_torque = arm == estimating};
  }
  ArmSet wait() override { return world_.wait(); }
  LoopTime now() const override { return world_.now(); }
  void read(ArmSet due, std::span<ArmState> states) override { world_.read(due, states); }
  void write(ArmSet due, std::span<const ArmCommand> commands) override { world_.write(due, commands); }
  using Backend::request;
  std::future<RequestAnswer> request(ArmIndex arm, ArmRequest request) override {
    return world_.request(arm, std::move(request));
  }

 private:
  TestWorld world_;
};

TEST(MovingBaseCycle, RefusesMountsThatItCannotDrive) {
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
  for (ArmIndex arm = 0; arm < 3; ++arm) {
    Other world(arm_models());
    world.real = arm;
    EXPECT_NE(refused_by(config(), world).find("expected simulated arms only"), std::string::npos) << arm;
    world.real = 9;
    world.estimating = arm;
    EXPECT_EQ(refused_by(config(), world) != "", arm != 2) << arm;
  }
  bad = config();
  bad.arms[kCarried].mount->joint = 8;
  EXPECT_NE(refusal(bad).find("behind joint 9"), std::string::npos);
  bad = config();
  bad.arms[kCarried].mount->joint = 1;
  EXPECT_NE(refusal(bad).find("degrees from vertical"), std::string::npos) << refusal(bad);
}

TEST(MovingBaseCycle, RefusesLawsAndFeaturesThatKnowNoMovingBase) {
  const auto refusal = [](InstanceConfig of) {
    TestWorld world(arm_models());
    return refused_by(config({std::move(of)}), world);
  };
  for (const std::string type : {"ufic", "force", "hybrid_force"}) {
    for (const ArmIndex arm : {kCarrier, kCarried}) {
      EXPECT_NE(refusal({.name = "x", .type = type, .arms = {arm}}).find("stands on another one"),
                std::string::npos)
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
    EXPECT_NE(
        refusal({.name = "x", .type = "joint_impedance", .arms = {arm}, .features = {"collision_avoidance"}})
            .find("does not support a moving base"),
        std::string::npos);
    EXPECT_EQ(
        refusal({.name = "x", .type = "cartesian_impedance", .arms = {arm}, .features = {"manipulability"}}),
        "");
  }
}

}  // namespace
}  // namespace multipanda::moving_base_test
