#include <cmath>
#include <limits>

#include <gtest/gtest.h>

#include "core/testing/controllet_rig.hpp"
#include "core/testing/test_world.hpp"

// Goals that end by a force or a way, on a world of one arm whose estimated force the test gives.
namespace multipanda::goal_end_test {
namespace {

constexpr double kFast = 0.25;  // greatest speed of a set-point [m/s], as of scenes

struct Watched : test::TestLoop {
  explicit Watched(const char* type)
      : TestLoop({test::test_models(1)[0]},
                 test::test_config(test::test_models(1),
                                   {{.name = "law", .type = type, .arms = {0}, .contact = {}}}, 256),
                 Registry::with_builtins(), true) {
    world.set_position(0, test::bent(7));
    world.tamper = [this](ArmIndex, std::uint64_t, ArmState& state) {
      state.has_wrench_estimate = known;
      state.F_K_W_est = felt;
    };
    steps(3);
    EXPECT_TRUE(activate({"law"}).accepted());
    (void)endings();
  }
  Reference& input() { return modes().instance(find("law")).inputs()[0]; }
  Answer lead(const Target& target, const GoalEnd& until = {}) {
    return ask(
        {.kind = Request::Kind::set_target, .instance = find("law"), .target = target, .until = until});
  }
  Answer lead_by(const Vector3& way, const GoalEnd& until = {}) {
    Pose goal = input().pose();
    goal.position += way;
    return lead(pose_target(goal), until);
  }
  Vector3 hand() {
    ModelTerms terms(models[0]);
    terms.update(world.position(0), JointVector::Zero(7));
    return terms.X_WE().position;
  }
  std::vector<Event> endings() {
    std::vector<Event> found;
    RecordRing& ring = *cycle.record();
    for (const Event* event; (event = ring.events.front()) != nullptr; ring.events.pop()) {
      if (event->kind == EventKind::goal_ended) found.push_back(*event);
    }
    while (ring.ring.front() != nullptr) ring.ring.pop();
    return found;
  }

  bool known = true;
  Wrench felt;
};

GoalEnd until(double force, double moment = GoalEnd::kNever, double distance = GoalEnd::kNever) {
  return {.limits = {force, moment, distance}};
}

TEST(GoalEnds, ByAForceBeyondThatAtTheStart) {
  Watched arm("cartesian_impedance");
  arm.felt.force() = Vector3(0, -30, 5);  // an undeclared load
  ASSERT_TRUE(arm.lead_by({0.2, 0, 0}, until(10)).accepted());
  const Pose start = arm.input().pose();
  arm.felt.force() += Vector3(0, 6, 7.9);  // 9.92 N
  arm.steps(400);
  EXPECT_TRUE(arm.endings().empty());
  const double speed = arm.input().twist().linear().norm();
  ASSERT_GT(speed, 0.6 * kFast);
  const Vector3 before = arm.input().pose().position;
  arm.felt.force() += Vector3(0, 0, 0.1);  // 10 N
  arm.step();
  const auto endings = arm.endings();
  ASSERT_EQ(endings.size(), 1u);
  EXPECT_EQ(endings[0].arm, 0);
  EXPECT_EQ(endings[0].instance, arm.find("law"));
  EXPECT_EQ(endings[0].index, 0);
  ASSERT_EQ(endings[0].size, 3);
  EXPECT_EQ(endings[0].values[0], GoalEnd::force);
  EXPECT_NEAR(endings[0].values[1], 10, 1e-12);
  EXPECT_EQ(endings[0].values[2], 10);
  // From this speed it rests within what a constant 2.5 m/s^2 would need, twice over; the arm is not let go.
  arm.steps(200);
  EXPECT_EQ(arm.input().twist().vector.norm(), 0);
  const double further = (arm.input().pose().position - before).norm();
  EXPECT_LT(further, 2 * speed * speed / (2 * 2.5));
  EXPECT_GT(further, 0);
  EXPECT_LT((arm.input().pose().position - start.position).norm(), 0.15);
  EXPECT_EQ(arm.modes().owner(0), arm.find("law"));
  // Later forces end nothing any more, and the next goal goes all its way.
  arm.felt.force() += Vector3(100, 0, 0);
  const Vector3 goal = arm.input().pose().position + Vector3(0, 0, 0.05);
  ASSERT_TRUE(arm.lead_by({0, 0, 0.05}).accepted());
  arm.steps(1500);
  EXPECT_LT((arm.input().pose().position - goal).norm(), 1e-9);
  EXPECT_TRUE(arm.endings().empty());
}

TEST(GoalEnds, ByAMomentByAWayAndNotOnceItIsThere) {
  Watched arm("cartesian_impedance");
  ASSERT_TRUE(arm.lead_by({0.2, 0, 0}, until(50, 2)).accepted());
  arm.steps(100);
  arm.felt.torque() = Vector3(0, 2, 0);
  arm.step();
  auto endings = arm.endings();
  ASSERT_EQ(endings.size(), 1u);
  EXPECT_EQ(endings[0].values[0], GoalEnd::moment);
  arm.steps(300);

  const Vector3 from = arm.hand();
  ASSERT_TRUE(arm.lead_by({0, 0.2, 0}, until(GoalEnd::kNever, GoalEnd::kNever, 0.05)).accepted());
  double way = 0;
  for (int k = 0; k < 3000 && endings.size() < 2; ++k) {
    way = (arm.hand() - from).norm();  // of the state that the next step reads
    arm.step();
    for (const Event& event : arm.endings()) endings.push_back(event);
  }
  ASSERT_EQ(endings.size(), 2u);
  EXPECT_EQ(endings[1].values[0], GoalEnd::distance);
  EXPECT_NEAR(endings[1].values[1], way, 2e-4);  // the hand was already moving when the goal came
  EXPECT_GE(endings[1].values[1], 0.05);
  arm.steps(300);

  ASSERT_TRUE(arm.lead_by({0, 0, 0.02}, until(10)).accepted());
  arm.steps(2000);
  arm.felt.force() = Vector3(40, 0, 0);
  arm.steps(10);
  EXPECT_TRUE(arm.endings().empty());
}

TEST(GoalEnds, OfJoints) {
  Watched arm("joint_impedance");
  Target goal;
  goal.size = 7;
  const JointVector q = arm.input().joints() + 0.5 * JointVector::Unit(7, 0);
  std::copy_n(q.data(), 7, goal.values.begin());
  ASSERT_TRUE(arm.lead(goal, until(10)).accepted());
  arm.steps(500);
  arm.felt.force() = Vector3(-11, 0, 0);
  arm.steps(200);
  ASSERT_EQ(arm.endings().size(), 1u);
  EXPECT_EQ(arm.input().joint_velocity().norm(), 0);
  EXPECT_LT(arm.input().joints()[0], q[0] - 0.1);
}

TEST(GoalEnds, AreRefusedBeforeAnythingMoves) {
  Watched arm("cartesian_impedance");
  const Pose start = arm.input().pose();
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  for (const double limit : {0.0, -1.0, kNan}) {
    const Request request{.kind = Request::Kind::set_target,
                          .instance = arm.find("law"),
                          .target = pose_target(start),
                          .until = until(limit, 5)};
    EXPECT_EQ(arm.modes().check(request), Verdict::out_of_bounds) << limit;
  }
  Request stream{.kind = Request::Kind::set_target,
                 .instance = arm.find("law"),
                 .target = pose_target(start, 0, Delivery::stream),
                 .until = until(10)};
  EXPECT_EQ(arm.modes().check(stream), Verdict::out_of_bounds);
  arm.known = false;
  arm.step();
  EXPECT_EQ(arm.lead_by({0.1, 0, 0}, until(10)).verdict, Verdict::arm_not_ready);
  arm.steps(100);
  EXPECT_LT((arm.input().pose().position - start.position).norm(), 1e-12);
  ASSERT_TRUE(arm.lead_by({0.1, 0, 0}, until(GoalEnd::kNever, GoalEnd::kNever, 1)).accepted());
}

TEST(GoalEnds, RemainWhereTheNextGoalIsRefused) {
  Watched arm("cartesian_impedance");
  arm.known = false;
  arm.step();
  ASSERT_TRUE(arm.lead_by({0.2, 0, 0}, until(GoalEnd::kNever, GoalEnd::kNever, 0.05)).accepted());
  arm.steps(50);
  ASSERT_EQ(arm.lead_by({0, 0.1, 0}, until(10)).verdict, Verdict::arm_not_ready);
  arm.steps(2000);
  EXPECT_EQ(arm.endings().size(), 1u);
}

// Otherwise an arm whose force is not known any more would press on.
TEST(GoalEnds, WhenTheForceIsNotKnownAnyMore) {
  Watched arm("cartesian_impedance");
  ASSERT_TRUE(arm.lead_by({0.2, 0, 0}, until(10)).accepted());
  arm.steps(100);
  arm.known = false;
  arm.step();
  const auto endings = arm.endings();
  ASSERT_EQ(endings.size(), 1u);
  EXPECT_TRUE(std::isnan(endings[0].values[1]));
}

TEST(GoalEnds, AreOfTheirGoalOnly) {
  Watched arm("cartesian_impedance");
  ASSERT_TRUE(arm.lead_by({0.2, 0, 0}, until(10)).accepted());
  arm.steps(50);
  ASSERT_TRUE(arm.lead_by({0, 0.1, 0}).accepted());
  arm.felt.force() = Vector3(20, 0, 0);
  arm.steps(50);
  ASSERT_TRUE(arm.lead_by({0.2, 0, 0}, until(10)).accepted());  // from the force that acts now
  arm.steps(50);
  EXPECT_TRUE(arm.endings().empty());
  ASSERT_TRUE(arm.ask({.deactivate = bit(arm.find("law"))}).accepted());
  ASSERT_TRUE(arm.activate({"law"}).accepted());
  arm.felt.force() = Vector3(90, 0, 0);
  arm.steps(50);
  EXPECT_TRUE(arm.endings().empty());
}

}  // namespace
}  // namespace multipanda::goal_end_test
