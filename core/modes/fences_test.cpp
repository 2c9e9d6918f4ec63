#include <algorithm>

#include <gtest/gtest.h>

#include "core/testing/controllet_rig.hpp"
#include "core/testing/test_world.hpp"

// Bounds in space on a world of one arm: how fast its hand, flange and tool may be led, and how far out.
namespace multipanda::fences_test {
namespace {

const Vector3 kNone = Vector3::Zero();
constexpr double kBound = ContactBounds{}.hand_speed;

struct Led : test::TestLoop {
  // The box ends `out_at` beyond the hand, along x.
  explicit Led(const Vector3& tool_end, const Pose& X_FE, const char* type, double out_at = 100)
      : Led(model_of(tool_end), X_FE, type, out_at) {}
  Led(const std::shared_ptr<const ArmModel>& arm, const Pose& X_FE, const char* type, double out_at)
      : TestLoop({arm}, config(arm, type, end_of(arm, X_FE) + out_at), Registry::with_builtins()),
        model(arm),
        end(end_of(arm, X_FE) + out_at) {
    world.set_position(0, test::bent(7));
    world.tamper = [X_FE](ArmIndex, std::uint64_t, ArmState& state) {
      state.frames.X_FE = X_FE;
      state.config_version = 1;
    };
    steps(3);
  }
  static std::shared_ptr<const ArmModel> model_of(const Vector3& tool_end) {
    ArmModelSource source = test::TestArm::make().source();
    source.tool_end = tool_end;
    source.limits.dq_max =
        JointVector::Constant(7, 4);  // no bound of joints ends a way near a stretched elbow
    return std::make_shared<const ArmModel>(source);
  }
  static double end_of(const std::shared_ptr<const ArmModel>& arm, const Pose& X_FE) {
    ModelTerms terms(arm);
    terms.update(test::bent(7), JointVector::Zero(7));
    return (terms.X_WF() * X_FE).position.x();
  }
  static CycleConfig config(const std::shared_ptr<const ArmModel>& model, const char* type, double end) {
    InstanceConfig law{.name = "law", .type = type, .arms = {0}, .contact = {}};
    if (law.type == "joint_impedance")
      law.inputs = {{.name = "joints", .quantity = Quantity::joints, .max_speed = 2}};
    CycleConfig config = test::test_config({model}, {law});
    config.arms[0].safety.workspace = {Vector3::Constant(-100), Vector3(end, 100, 100)};
    return config;
  }
  Answer start() { return ask({.activate = bit(law())}); }
  InstanceIndex law() { return cycle.modes().find("law"); }
  bool runs() { return cycle.modes().owner(0) == law(); }
  Reference& input() { return cycle.modes().instance(law()).inputs()[0]; }
  Answer lead(const Target& target) {
    return ask({.kind = Request::Kind::set_target, .instance = law(), .target = target});
  }
  Answer lead_by(const Vector3& way, double duration_s = 0) {
    Pose goal = input().pose();
    goal.position += way;
    return lead(pose_target(goal, duration_s));
  }
  void stop_and_resume() {
    cycle.modes().stop(ArmSet::all(1));
    steps(2);
    EXPECT_TRUE(ask({.kind = Request::Kind::resume, .arms = ArmSet::all(1)}).accepted());
    steps(1);
  }
  // Starts and goes outwards until a hold takes the arm. False: the start was refused.
  bool leads_out() {
    const bool started = start().accepted();
    if (started) {
      EXPECT_TRUE(lead_by({0.05, 0, 0}, 12).accepted());
      for (int k = 0; k < 12000 && runs(); ++k) steps(1);
      EXPECT_FALSE(runs());
    }
    steps(300);
    return started;
  }
  double beyond() {
    ModelTerms terms(model);
    terms.update(cycle.data().state[0]);
    return terms.X_WE().position.x() - end;
  }

  std::shared_ptr<const ArmModel> model;
  double end;
};

// The end effector is half a meter from the flange, on the other side of it than the tool.
TEST(Fences, ATurningHandLeadsFlangeAndToolNoFasterThanItself) {
  const Pose X_FE{rotation_from_rpy({0.4, -0.3, 0.2}), {0.1, -0.2, -0.4}};
  const Vector3 tool_end(0.05, 0.02, 0.12);
  for (const double way : {0.0, 0.1}) {
    for (int axis = 0; axis < 3; ++axis) {
      Led led(tool_end, X_FE, "cartesian_impedance");
      ASSERT_TRUE(led.start().accepted());
      Pose goal = led.input().pose();
      goal.position[(axis + 1) % 3] += way;
      goal.rotation = exp_rotation(0.8 * Vector3::Unit(axis)) * goal.rotation;
      ASSERT_TRUE(led.lead(pose_target(goal)).accepted());
      std::array<double, 3> fastest{};
      for (int k = 0; k < 6000; ++k) {
        const Pose before = led.input().pose() * X_FE.inverse();
        led.steps(1);
        const Pose after = led.input().pose() * X_FE.inverse();
        std::size_t i = 0;
        for (const Vector3& p : {X_FE.position, Vector3(Vector3::Zero()), tool_end}) {
          fastest[i] = std::max(fastest[i], ((after * p) - (before * p)).norm() / kArmPeriod);
          ++i;
        }
      }
      for (const double v : fastest) EXPECT_LT(v, 1.05 * kBound) << axis;
      EXPECT_GT(std::max(fastest[1], fastest[2]), 0.8 * kBound) << axis;
      EXPECT_LT(pose_error(goal, led.input().pose()).norm(), 1e-6);
    }
  }
}

// The same of streams: the hand goes on at nearly its bound and turns, or turns in place, faster than its
// flange may move.
TEST(Fences, AStreamLeadsFlangeAndToolNoFasterThanItself) {
  const Pose X_FE{rotation_from_rpy({0.4, -0.3, 0.2}), {0, 0, 0.45}};
  const Vector3 tool_end(0.05, 0.02, 0.12);
  constexpr double kTurn = 0.9, kLength = 0.8;  // [rad/s], [s]
  for (const std::size_t period : {2, 10, 20}) {
    for (const double way : {0.0, 0.22}) {
      for (int axis = 0; axis < 3; ++axis) {
        Led led(tool_end, X_FE, "cartesian_impedance");
        ASSERT_TRUE(led.start().accepted());
        const Pose start = led.input().pose();
        const auto at = [&](double t) {
          Pose X = start;
          X.position[(axis + 1) % 3] += way * t;
          X.rotation = exp_rotation(kTurn * t * Vector3::Unit(axis)) * X.rotation;
          return X;
        };
        std::array<double, 3> fastest{};
        for (std::size_t k = 0; k < 6000; ++k) {
          if (k % period == 0) {
            const double t = std::min(kLength, static_cast<double>(k) * kArmPeriod);
            ASSERT_EQ(led.input().post(pose_target(at(t), 0, Delivery::stream)), Verdict::accepted);
          }
          const Pose before = led.input().pose() * X_FE.inverse();
          led.steps(1);
          const Pose after = led.input().pose() * X_FE.inverse();
          std::size_t i = 0;
          for (const Vector3& p : {X_FE.position, Vector3(Vector3::Zero()), tool_end}) {
            fastest[i] = std::max(fastest[i], ((after * p) - (before * p)).norm() / kArmPeriod);
            ++i;
          }
        }
        for (const double v : fastest) EXPECT_LT(v, 1.1 * kBound) << period << " ms, axis " << axis << way;
        EXPECT_GT(std::max(fastest[1], fastest[2]), 0.7 * kBound) << period << " ms, axis " << axis << way;
        EXPECT_LT(pose_error(at(kLength), led.input().pose()).norm(), 1e-4) << period << axis << way;
      }
    }
  }
}

// Goals that follow each other faster than the pace can bound them.
TEST(Fences, GoalsInQuickSuccessionLeadTheFlangeNoFasterThanTheHand) {
  const Pose X_FE{Matrix3::Identity(), {0, 0, 0.45}};
  Led led(kNone, X_FE, "cartesian_impedance");
  ASSERT_TRUE(led.start().accepted());
  Pose goal = led.input().pose();
  goal.position.x() += 0.2;
  goal.rotation = exp_rotation(0.8 * Vector3::UnitY()) * goal.rotation;
  double fastest = 0;
  for (int k = 0; k < 8000; ++k) {
    if (k % 10 == 0) {
      ASSERT_TRUE(led.lead(pose_target(goal)).accepted());
    }
    const Vector3 before = (led.input().pose() * X_FE.inverse()).position;
    led.steps(1);
    fastest =
        std::max(fastest, ((led.input().pose() * X_FE.inverse()).position - before).norm() / kArmPeriod);
  }
  EXPECT_LT(fastest, 1.05 * kBound);
  EXPECT_GT(fastest, 0.7 * kBound);
  EXPECT_LT(pose_error(goal, led.input().pose()).norm(), 1e-6);
}

// A common pose turns both hands; only the second one has a long tool.
TEST(Fences, ACommonPoseLeadsTheToolsOfBothHands) {
  const Vector3 tool_end(0.3, 0.4, 0);
  for (const Delivery delivery : {Delivery::goal, Delivery::stream}) {
    const std::vector arms{Led::model_of(kNone), Led::model_of(tool_end)};
    test::TestLoop loop(arms,
                        test::test_config(arms, {{.name = "both",
                                                  .type = "dual_cartesian_impedance",
                                                  .arms = {0, 1},
                                                  .parameters = {{"offset_m", {0, 0, 0}}},
                                                  .contact = {}}}),
                        Registry::with_builtins());
    for (const ArmIndex arm : {0, 1}) loop.world.set_position(arm, test::bent(7));
    loop.steps(3);
    ASSERT_TRUE(loop.activate({"both"}).accepted());
    loop.steps(2000);  // the hands come to their common pose
    Reference& input = loop.modes().instance(loop.find("both")).inputs()[0];
    const Pose start = input.pose();
    double fastest = 0;
    for (std::size_t k = 0; k < 8000; ++k) {
      const double t = delivery == Delivery::goal ? 0.8 : std::min(0.8, static_cast<double>(k) * kArmPeriod);
      Pose X = start;
      X.rotation = exp_rotation(t * Vector3::UnitZ()) * X.rotation;
      if (k == 0 || (delivery == Delivery::stream && k % 10 == 0)) {
        ASSERT_EQ(input.post(pose_target(X, 0, delivery)), Verdict::accepted);
      }
      const Vector3 before = input.pose() * tool_end;
      loop.steps(1);
      fastest = std::max(fastest, (input.pose() * tool_end - before).norm() / kArmPeriod);
    }
    EXPECT_LT(fastest, 1.1 * kBound);
    EXPECT_GT(fastest, 0.7 * kBound);
  }
}

// The hands are between their arms, where neither arm reaches alone.
TEST(Fences, ACommonPoseIsWhereTheMiddleOfTheHandsMayBe) {
  std::vector<std::shared_ptr<const ArmModel>> arms;
  for (const double y : {-1.5, 1.5})
    arms.push_back(test::TestArm::make().model({Matrix3::Identity(), {4, y, 0}}, y < 0 ? "right" : "left"));
  test::TestLoop loop(
      arms, test::test_config(arms, {{.name = "both", .type = "dual_cartesian_impedance", .arms = {0, 1}}}),
      Registry::with_builtins());
  loop.world.tamper = [](ArmIndex, std::uint64_t, ArmState& state) { state.config_version = 1; };
  loop.steps(2);
  ASSERT_TRUE(loop.activate({"both"}).accepted());
  const auto goal = [&](const Vector3& p) {
    return loop.ask({.kind = Request::Kind::set_target,
                     .instance = loop.find("both"),
                     .target = pose_target({Matrix3::Identity(), p})});
  };
  double length = test::TestArm::make().X_JF.position.norm();
  for (std::size_t i = 1; i < 7; ++i) length += test::TestArm::make().links[i].X_PJ.position.norm();
  ASSERT_LT(length, 1.5) << "else each arm reaches the middle by itself";
  const Vector3 middle(4, 0, 0.3);  // of the first joints
  for (const double share : {0.0, 0.99})
    EXPECT_TRUE(goal(middle + share * length * Vector3::UnitX()).accepted()) << share;
  EXPECT_EQ(goal(middle + 1.01 * length * Vector3::UnitX()).verdict, Verdict::out_of_bounds);
}

// The hand is at the flange, and what it carries ends half a meter beside it.
TEST(Fences, JointsLeadTheToolNoFasterThanAHand) {
  const Vector3 tool_end(0.3, 0.4, 0);
  Led led(tool_end, {}, "joint_impedance");
  ASSERT_TRUE(led.start().accepted());
  Target target;
  target.size = 7;
  const JointVector goal = led.input().joints() + 0.8 * JointVector::Unit(7, 6);
  std::copy_n(goal.data(), 7, target.values.begin());
  ASSERT_TRUE(led.lead(target).accepted());
  ModelTerms terms(led.model);
  const auto end = [&] {
    terms.update(led.input().joints(), JointVector::Zero(7));
    return Vector3(terms.X_WF() * tool_end);
  };
  double fastest = 0;
  for (int k = 0; k < 6000; ++k) {
    const Vector3 before = end();
    led.steps(1);
    fastest = std::max(fastest, (end() - before).norm() / kArmPeriod);
  }
  EXPECT_LT(fastest, 1.06 * kBound);
  EXPECT_GT(fastest, 0.8 * kBound);
  EXPECT_LT((led.input().joints() - goal).norm(), 1e-6);
}

// Where a hold stops it, an arm may start and go back, but many starts lead it no farther out than the margin
// of 5 mm (and what a hold needs to stop it).
TEST(Fences, NoNumberOfStartsLeadsOut) {
  Led led(kNone, {}, "cartesian_impedance", 0.02);
  double first = 0, farthest = 0;
  int refused = 0;
  for (int round = 0; round < 10; ++round) {
    if (!led.leads_out()) ++refused;
    if (round == 0) first = led.beyond();
    farthest = std::max(farthest, led.beyond());
  }
  EXPECT_GT(first, 0);
  EXPECT_GT(refused, 0);
  EXPECT_LT(farthest, first + 0.005 + 0.002);

  // The way back: somebody stops the arm and resumes it.
  ASSERT_FALSE(led.start().accepted());
  led.stop_and_resume();
  ASSERT_TRUE(led.start().accepted());
  ASSERT_TRUE(led.lead_by({-0.06, 0, 0}).accepted());
  led.steps(3000);
  EXPECT_TRUE(led.runs());
  EXPECT_LT(led.beyond(), 0);
}

// A program that stops, resumes and starts again after each refusal creeps out by one margin more; then
// somebody has to lead the arm back.
TEST(Fences, NoNumberOfStopsAndResumesLeadsOut) {
  Led led(kNone, {}, "cartesian_impedance", 0.02);
  double first = 0, farthest = 0;
  int refused = 0;
  for (int round = 0; round < 12; ++round) {
    if (!led.leads_out()) ++refused;
    if (round == 0) first = led.beyond();
    farthest = std::max(farthest, led.beyond());
    led.stop_and_resume();
  }
  EXPECT_GT(first, 0);
  EXPECT_GT(refused, 3);
  EXPECT_LT(farthest, first + 2 * 0.005 + 0.002);
}

TEST(Fences, FromWhereItWasStoppedAnArmIsLedBack) {
  Led led(kNone, {}, "cartesian_impedance", 0.02);
  for (int round = 0; round < 4; ++round) {  // back inside, all begins again
    ASSERT_TRUE(led.start().accepted());
    ASSERT_TRUE(led.lead_by({0.08, 0, 0}).accepted());
    for (int k = 0; k < 1000 && led.runs(); ++k) led.steps(1);
    ASSERT_FALSE(led.runs());
    led.steps(500);
    EXPECT_GT(led.beyond(), 0);
    ASSERT_TRUE(led.start().accepted());
    ASSERT_TRUE(led.lead_by({-0.06, 0, 0}).accepted());
    led.steps(3000);
    EXPECT_TRUE(led.runs());
    EXPECT_LT(led.beyond(), -0.01);
  }
}

// It was led there by hand: it takes commands again, and starts from there.
TEST(Fences, AnArmThatSomebodyMovedOutMayStartThere) {
  Led led(kNone, {}, "cartesian_impedance", 0.02);
  bool guided = true;
  led.world.tamper = [&](ArmIndex, std::uint64_t, ArmState& state) {
    if (guided) state.mode = ArmMode::guiding;
  };
  led.steps(5);
  for (int k = 0; led.beyond() < 0.1; ++k) {
    ASSERT_LT(k, 1000);
    ModelTerms terms(led.model);
    terms.update(led.cycle.data().state[0]);
    led.world.set_position(0, led.world.position(0) + 0.01 * terms.J_V_WE().row(0).transpose());
    led.steps(1);
  }
  led.world.set_velocity(0, JointVector::Zero(7));
  guided = false;
  led.steps(100);
  ASSERT_TRUE(led.start().accepted());
  ASSERT_TRUE(led.lead_by({-0.05, 0, 0}).accepted());
  led.steps(2000);
  EXPECT_TRUE(led.runs());
}

}  // namespace
}  // namespace multipanda::fences_test
