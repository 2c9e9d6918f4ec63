#include "scene/build.hpp"

#include <bit>
#include <cmath>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/testing/wrong_goals.hpp"
#include "scene/load.hpp"

namespace multipanda::build_test {
namespace {

// Accepts torques and does nothing: enough to build a cycle.
class StillBackend final : public Backend {
 public:
  explicit StillBackend(std::size_t arms) : arms_(arms) {}
  std::size_t arm_count() const override { return arms_; }
  Capabilities capabilities(ArmIndex) const override { return {}; }
  ArmSet wait() override { return {}; }
  LoopTime now() const override { return {}; }
  void read(ArmSet, std::span<ArmState>) override {}
  void write(ArmSet, std::span<const ArmCommand>) override {}
  using Backend::request;
  std::future<RequestAnswer> request(ArmIndex, ArmRequest) override { return {}; }

 private:
  std::size_t arms_;
};

TEST(Build, TcpOfTheReadyPoseInTheWorld) {
  const Scene scene = open_scene("two_arms").scene;
  for (const SceneArm& arm : scene.arms) {
    ModelTerms terms(build_arm_model(arm));
    const ArmConfig config = arm_config(arm);
    terms.set_config(config.frames, config.tool, config.load);
    terms.update(arm.q_start, joint_constant(7, 0));
    // Shoulder at 0.333 m; upper arm 0.316 m leans back by 45 degrees, its offset 0.0825 m forward;
    // the forearm (-0.0825, 0.384) is then level, the wrist 0.088 m ahead, flange 0.107 m and hand
    // 0.1034 m straight down.
    const double c = std::sqrt(0.5);
    const double x = -0.316 * c + 0.0825 * c + 0.384 + 0.088,
                 z = 0.333 + 0.316 * c + 0.0825 * c + 0.0825 - 0.107 - 0.1034;
    EXPECT_NEAR(terms.X_WE().position.x(), x, 1e-6);
    EXPECT_NEAR(terms.X_WE().position.y(), arm.X_WB.position.y(), 1e-6);
    EXPECT_NEAR(terms.X_WE().position.z(), z, 1e-6);
    EXPECT_LT((terms.X_WE().rotation - Vector3(1, -1, -1).asDiagonal().toDenseMatrix()).norm(), 1e-6);
  }
}

TEST(Build, WithoutHandTheFlangeIsTheEndEffector) {
  const Registry registry = Registry::with_builtins();
  const auto frames = [&](const std::string& more) {
    return arm_config(parse_scene("arms:\n  - {name: a" + more + "}\n", "s.yaml", registry).arms.at(0))
        .frames;
  };
  EXPECT_EQ(frames(", hand: false").X_FE.position, Vector3::Zero());
  EXPECT_NEAR(frames("").X_FE.position.z(), 0.1034, 1e-9);
  EXPECT_EQ(frames(", end_effector: {position_m: [0, 0, 0.3]}").X_FE.position.z(), 0.3);
}

TEST(Build, AnEndEffectorIsAsFarFromTheFlangeAsTheSceneSays) {
  const Registry registry = Registry::with_builtins();
  const auto arm = [&](const std::string& more) {
    return parse_scene("arms:\n  - {name: a, end_effector: {position_m: [0, 0.3, 0.4]}" + more + "}\n",
                       "s.yaml", registry)
        .arms[0];
  };
  EXPECT_EQ(build_arm_model(arm(""))->farthest_end_effector(), 0.5);
  EXPECT_TRUE(arm("").loosened.empty());
  EXPECT_THROW(arm(", farthest_end_effector_m: 0.49"), std::invalid_argument);
  const SceneArm far = arm(", farthest_end_effector_m: 1.25");
  EXPECT_EQ(build_arm_model(far)->farthest_end_effector(), 1.25);
  ASSERT_EQ(far.loosened.size(), 1u);
  EXPECT_EQ(far.loosened[0], "farthest_end_effector_m: 1.25 m, usually 0.5 m");
}

TEST(Build, TheToolEndsAtItsFarthestCorner) {
  const Registry registry = Registry::with_builtins();
  const auto end = [&](const std::string& more) {
    const Scene scene = parse_scene("arms:\n  - {name: a" + more + "}\n", "s.yaml", registry);
    return build_controller_model(scene.arms[0])->tool_end();
  };
  EXPECT_EQ(end(", hand: false"), Vector3::Zero());
  EXPECT_TRUE(end("").isApprox(Vector3(0, 0, 0.1034), 1e-9));
  EXPECT_TRUE(end(", end_effector: {position_m: [0, 0, -0.3]}").isApprox(Vector3(0, 0, 0.1034), 1e-9));
  // 3, 4 and 12 cm from the flange are 13 cm; the ball is 2 cm thick around it.
  EXPECT_TRUE(end(", hand: false, tool_shapes: [{shape: sphere, diameter_m: 0.04, position_m: [0.03, 0.04, "
                  "0.12]}]")
                  .isApprox(Vector3(0.03, 0.04, 0.12) * 15 / 13, 1e-12));
  EXPECT_TRUE(
      end(", hand: false, tool_shapes: [{shape: box, size_m: [0.02, 0.04, 0.5], position_m: [-0.1, 0, 0], "
          "rpy_rad: [0, pi/2, 0]}]")
          .cwiseAbs()
          .isApprox(Vector3(0.35, 0.02, 0.01), 1e-12));
}

// Largest declared payload: 3 kg less hand (0.6544 + 2 x 0.0291 kg) and tool, or the scene's own limit.
TEST(Build, LargestLoadIsWhatTheModelIsRatedFor) {
  const Registry registry = Registry::with_builtins();
  const auto arm = [&](const std::string& more) {
    return parse_scene("arms:\n  - {name: left" + more + "}\n", "s.yaml", registry).arms[0];
  };
  const auto most = [&](const std::string& more) {
    return build_arm_model(arm(more))->largest_load().value();
  };
  for (const char* model : {"fer", "fr3", "fr3v2"}) {
    EXPECT_NEAR(most(std::string(", model: ") + model), 3 - 0.7126, 1e-12);
    EXPECT_EQ(most(std::string(", hand: false, model: ") + model), 3);
  }
  EXPECT_NEAR(most(", tool: {mass_kg: 1.5}"), 3 - 0.7126 - 1.5, 1e-12);
  EXPECT_NEAR(most(", largest_load_kg: 5"), 5 - 0.7126, 1e-12);
  EXPECT_EQ(arm(", largest_load_kg: 2").loosened.size(), 0u);
  ASSERT_EQ(arm(", largest_load_kg: 5").loosened.size(), 1u);
  EXPECT_EQ(arm(", largest_load_kg: 5").loosened[0], "largest_load_kg: 5 kg, the model is rated for 3 kg");
  // A model without a rating carries nothing until the scene says what it can.
  const std::string ur = ", hand: false, model: " MULTIPANDA_SOURCE_DIR "/tests/models/ur5e.yaml";
  EXPECT_EQ(most(ur), 0);
  EXPECT_EQ(most(ur + ", largest_load_kg: 5"), 5);
  EXPECT_THROW(arm(ur + ", load_declared: {mass_kg: 1}"), std::invalid_argument);
  EXPECT_EQ(arm(ur + ", largest_load_kg: 5, load_declared: {mass_kg: 1}").load_declared.mass, 1);

  const auto text = [&](const std::string& more, double payload) {
    return load_text(flange_load(arm(more), robot_of(arm(more))), payload);
  };
  EXPECT_EQ(
      text("", 0.3),
      "a payload of 0.3 kg is declared: with hand and tool (0.7126 kg) the flange carries 1.013 kg of the "
      "3 kg that the model is rated for, 1.987 kg remain");
  EXPECT_EQ(text(", hand: false", 3),
            "a payload of 3 kg is declared: the flange carries 3 kg of the 3 kg that the model is rated for, "
            "0 kg remain");
  EXPECT_EQ(text(", tool: {mass_kg: 1}, largest_load_kg: 5", 0),
            "a payload of 0 kg is declared: with hand and tool (1.713 kg) the flange carries 1.713 kg of the "
            "5 kg that the scene allows (the model is rated for 3 kg), 3.287 kg remain");
  EXPECT_EQ(
      text(ur + ", largest_load_kg: 5", 1),
      "a payload of 1 kg is declared: the flange carries 1 kg of the 5 kg that the scene allows (the model "
      "has no rating), 4 kg remain");
  EXPECT_EQ(text(ur, 0), "a payload of 0 kg is declared: the flange carries 0 kg; the model has no rating");
}

TEST(Build, UsesKnownFrictionOnlyWhenTheSceneDeclaresIt) {
  const Registry registry = Registry::with_builtins();
  const auto model = [&](const std::string& more) {
    return build_arm_model(parse_scene("arms:\n  - {name: left" + more + "}\n", "s.yaml", registry).arms[0]);
  };
  EXPECT_FALSE(model("")->known_friction());
  const auto knowing = model(", known_friction: model");
  ASSERT_TRUE(knowing->known_friction());
  EXPECT_EQ(knowing->known_friction()->p1[3], 1.2794);
  EXPECT_EQ(knowing->known_friction()->p2[0], 5.1181);
  EXPECT_EQ(knowing->known_friction()->p3[2], -0.046070);
}

// Holds, features and checks of goals read the limits of the controllers' model; the plant keeps its own.
TEST(Build, TightenedLimitsReachTheControllers) {
  const Registry registry = Registry::with_builtins();
  const Scene scene = parse_scene(
      "arms:\n"
      "  - name: left\n"
      "    safety: {position_max_rad: [1, 1, 1, -1, 1, 2.5, 1], velocity_max_rad_per_s: 1.0}\n",
      "s.yaml", registry);
  const CycleConfig config = build_cycle_config(scene);
  const ArmLimits& controllers = config.arms[0].model->limits();
  const auto plant = build_arm_model(scene.arms[0]);
  EXPECT_EQ(controllers.q_max[3], -1);
  EXPECT_EQ(controllers.q_max[6], 1);
  EXPECT_EQ(controllers.dq_max[0], 1);
  EXPECT_EQ(controllers.q_min, plant->limits().q_min);
  EXPECT_EQ(controllers.tau_max, plant->limits().tau_max);
  EXPECT_EQ(plant->limits().q_max[3], -0.0698);
  EXPECT_EQ(plant->limits().dq_max[0], 2.175);
}

TEST(Build, LoosenedPositionLimitsStayThoseOfTheModel) {
  const Registry registry = Registry::with_builtins();
  const Scene scene = parse_scene(
      "arms:\n"
      "  - name: left\n"
      "    safety: {position_max_rad: [3, 3, 3, 0, 3, 4, 3], allow_looser_limits: true}\n",
      "s.yaml", registry);
  EXPECT_EQ(build_cycle_config(scene).arms[0].model->limits().q_max, load_robot("fer").limits.q_max);
}

// The damping of the manufacturer's joint impedance example suits arms with motors: it is accepted on real
// arms, refused where the plant is known to have none, and the refusal says so.
TEST(Build, DampingIsBoundedByTheInertiaOfTheArm) {
  const Registry registry = Registry::with_builtins();
  const auto refusal = [&](const std::string& more) -> std::string {
    const Scene scene = parse_scene(
        "arms:\n"
        "  - {name: left, hand: true" +
            more +
            "}\n"
            "controllets:\n"
            "  - name: a\n"
            "    type: joint_impedance\n"
            "    arms: left\n"
            "    parameters: {damping_design: given, stiffness_nm_per_rad: [600, 600, 600, 600, 250, 150, "
            "50],\n"
            "                 damping_nms_per_rad: [50, 50, 50, 50, 30, 25, 15]}\n",
        "s.yaml", registry);
    StillBackend backend(1);
    try {
      const ControlCycle cycle(build_cycle_config(scene), registry, backend);
    } catch (const std::invalid_argument& error) {
      return error.what();
    }
    return {};
  };
  EXPECT_EQ(refusal(", fci: 172.16.0.2"), "");
  EXPECT_EQ(refusal(", model: fr3, fci: 172.16.0.2"), "");
  EXPECT_EQ(refusal(", fci: 127.arm.example"), "");  // a name, which may lead to a real arm
  for (const std::string arm : {"", ", fci: 127.0.0.1", ", model: fr3"}) {
    const std::string why = refusal(arm);
    EXPECT_NE(why.find("'damping_nms_per_rad' of joint"), std::string::npos) << why;
    EXPECT_NE(why.find("no motor inertia"), std::string::npos) << why;
    EXPECT_NE(why.find("N m s/rad"), std::string::npos) << why;
  }
}

TEST(Build, BuildsCycleAndScheduleOfEveryShippedScene) {
  for (const auto& name : available_scenes()) {
    const OpenedScene opened = open_scene(name);
    StillBackend backend(opened.scene.arms.size());
    ControlCycle cycle(build_cycle_config(opened.scene), opened.registry, backend);
    const auto schedule = build_schedule(opened.scene, cycle.modes());
    auto timeline = opened.scene.timeline;
    std::erase_if(timeline, [](const auto& event) { return event.what == TimelineEvent::What::place; });
    ASSERT_EQ(schedule.size(), timeline.size()) << name;
    const InstanceSet start = start_set(opened.scene, cycle.modes());
    EXPECT_EQ(static_cast<std::size_t>(std::popcount(start)), opened.scene.active.size()) << name;
    EXPECT_NO_THROW(cycle.modes().activate_at_start(start)) << name;
    for (std::size_t i = 0; i < schedule.size(); ++i) {
      EXPECT_NEAR(schedule[i].at.seconds(), timeline[i].at_s, 1e-9);
    }
  }
}

// Fixed objects are obstacles, free ones are not; tools collide behind the last joint.
TEST(Build, ModelsHaveTheObstaclesOfTheScene) {
  const Registry registry = Registry::with_builtins();
  const Scene scene = parse_scene(
      "arms:\n"
      "  - {name: a, tool_shapes: [{shape: sphere, diameter_m: 0.04, position_m: [0, 0, 0.2]},\n"
      "                            {shape: box, size_m: [0.06, 0.04, 0.02], position_m: [0, 0, 0.1]}]}\n"
      "  - {name: b, hand: false, base: {position_m: [0, 1, 0]}}\n"
      "objects:\n"
      "  - {name: floor, shape: plane, position_m: [0, 0, -1]}\n"
      "  - {name: can, shape: cylinder, diameter_m: 0.2, length_m: 0.5, position_m: [1, 2, 3]}\n"
      "  - {name: ball, shape: sphere, diameter_m: 0.1, fixed: false, mass_kg: 1, position_m: [2, 0, 1]}\n",
      "s.yaml", registry);
  const CycleConfig config = build_cycle_config(scene);
  ASSERT_EQ(config.obstacles.size(), 2u);
  EXPECT_EQ(config.obstacles[0].name, "floor");
  EXPECT_EQ(config.obstacles[0].shape.kind, ConvexShape::Kind::half_space);
  EXPECT_EQ(config.obstacles[0].X_WO.position, Vector3(0, 0, -1));
  EXPECT_EQ(config.obstacles[1].shape.kind, ConvexShape::Kind::cylinder);
  EXPECT_EQ(config.obstacles[1].shape.half, Vector3(0.1, 0, 0.25));

  const auto& with_tool = config.arms[0].model->collision_shapes();
  const auto& bare = config.arms[1].model->collision_shapes();
  ASSERT_EQ(bare.size(), 10u);       // links
  ASSERT_EQ(with_tool.size(), 14u);  // links, two of the hand, two of the tool
  EXPECT_EQ(with_tool[12].joint, 6);
  EXPECT_EQ(with_tool[12].shape.radius, 0.02);
  ModelTerms terms(config.arms[0].model);
  const Vector3 p_W = terms.X_WJ(6) * with_tool[12].X_JS * Vector3(0, 0, 0);
  EXPECT_LT((p_W - terms.X_WF() * Vector3(0, 0, 0.2)).norm(), 1e-12);
  EXPECT_EQ(with_tool[13].shape.half, Vector3(0.03, 0.02, 0.01));
  for (const auto& [i, k] : config.arms[0].model->self_pairs()) {
    EXPECT_TRUE(k < 12 || with_tool[i].joint < 5) << with_tool[i].name;  // not what the tool is mounted on
  }
}

TEST(Build, ScheduleMatchesTheTimeline) {
  const Registry registry = Registry::with_builtins();
  const Scene scene = parse_scene(
      "arms:\n"
      "  - {name: left, base: {position_m: [0, 1, 0]}}\n"
      "  - {name: right}\n"
      "objects:\n"
      "  - {name: floor, shape: plane, position_m: [0, 0, -1]}\n"
      "controllets:\n"
      "  - {name: a, type: gravity_compensation, arms: right}\n"
      "timeline:\n"
      "  - {at_s: 1, switch: {activate: [a], only: true}}\n"
      "  - {at_s: 1.5, place: {object: floor, position_m: [0, 0, -2]}}\n"  // the simulation's own
      "  - {at_s: 2, parameter: {controllet: a, name: damping_nms_per_rad, value: 0.2}}\n"
      "  - {at_s: 3, feature: {controllet: a, name: joint_limits}}\n"
      "  - {at_s: 4, stop: [right]}\n"
      "  - {at_s: 5, resume: all}\n",
      "s.yaml", registry);
  StillBackend backend(2);
  ControlCycle cycle(build_cycle_config(scene), registry, backend);
  const auto schedule = build_schedule(scene, cycle.modes());
  ASSERT_EQ(schedule.size(), 5u);
  const InstanceIndex a = cycle.modes().find("a");
  EXPECT_EQ(schedule[0].request.activate, bit(a));
  EXPECT_TRUE(schedule[0].request.only);
  EXPECT_EQ(schedule[1].request.instance, a);
  EXPECT_EQ(schedule[1].request.values[0], 0.2);
  EXPECT_EQ(schedule[2].request.kind, Request::Kind::set_feature);
  EXPECT_TRUE(schedule[2].request.on);
  EXPECT_EQ(schedule[3].what, ScheduledRequest::What::stop);
  EXPECT_EQ(schedule[3].stop, ArmSet::of(1));
  EXPECT_EQ(schedule[4].request.arms, ArmSet::all(2));
}

// As the socket, ROS and native worlds say it, with the place in the file.
TEST(Build, WrongGoalsOfTheTimelineGetTheSentenceOfAllWaysIn) {
  const Registry registry = Registry::with_builtins();
  Scene scene = parse_scene(
      "arms:\n  - {name: arm}\n"
      "controllets:\n"
      "  - {name: pose, type: cartesian_impedance, arms: arm}\n"
      "  - {name: joint, type: joint_impedance, arms: arm}\n"
      "active: [joint]\n"
      "timeline:\n"
      "  - {at_s: 1.5, reference: {controllet: joint, input: joints, q_rad: [0, 0, 0, -1.5, 0, 1.5, 0]}}\n",
      "s.yaml", registry);
  StillBackend backend(1);
  const CycleConfig config = build_cycle_config(scene);
  ControlCycle cycle(config, registry, backend);
  EXPECT_NO_THROW((void)build_schedule(scene, cycle.modes()));
  for (const auto& goal : test::wrong_goals(*config.arms[0].model)) {
    TimelineEvent& event = scene.timeline[0];
    event.controllet = goal.quantity == Quantity::pose ? "pose" : "joint";
    event.name = goal.quantity == Quantity::pose ? "pose" : "joints";
    event.values = goal.values;
    event.duration_s = goal.duration_s;
    try {
      (void)build_schedule(scene, cycle.modes());
      ADD_FAILURE() << "accepted, expected: " << goal.sentence;
    } catch (const ConfigError& error) {
      EXPECT_THAT(
          error.what(),
          testing::AllOf(testing::HasSubstr("s.yaml:8: the event at 1.5 s is refused: '" + event.controllet),
                         testing::HasSubstr(goal.sentence)));
    }
  }
}

}  // namespace
}  // namespace multipanda::build_test
