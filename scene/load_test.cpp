#include "scene/load.hpp"

#include <fstream>
#include <map>
#include <numbers>
#include <sstream>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "common/text.hpp"
#include "core/modes/registry.hpp"
#include "scene/build.hpp"
#include "scene/testing/test_scenes.hpp"

namespace multipanda::load_test {

namespace {

// What a sensor bears is the hand and the tool, unless the scene says otherwise.
TEST(LoadScene, ForceSensor) {
  const auto mount = [](const std::string& arm, const std::string& sensor) {
    return build_cycle_config(parse("arms:\n  - {name: left, " + arm + ", force_sensor: {" + sensor + "}}\n"))
        .arms[0]
        .force_sensor.value();
  };
  const ForceSensorMount plain =
      mount("tool: {mass_kg: 0.5, com_m: [0, 0, 0.2]}", "position_m: [0, 0, 0.03]");
  EXPECT_NEAR(plain.carried.mass, 0.73 + 0.5, 0.03);
  EXPECT_EQ(plain.X_FS.position, Vector3(0, 0, 0.03));
  EXPECT_EQ(plain.max_age_s, 0.01);
  const ForceSensorMount told =
      mount("hand: false", "carries: {mass_kg: 0.9, com_m: [0, 0, 0.08]}, range_n: 200, range_nm: 10");
  EXPECT_EQ(told.carried.mass, 0.9);
  EXPECT_EQ(told.carried.p_FC, Vector3(0, 0, 0.08));
  EXPECT_EQ(told.range_n, 200);
  EXPECT_EQ(told.range_nm, 10);
  EXPECT_EQ(mount("hand: false", "range_n: 200").carried.mass, 0);
}

TEST(Load, UsesTheDefaultsOfTheModel) {
  const Scene scene = parse("arms:\n  - name: left\n");
  EXPECT_EQ(scene.name, "s");
  EXPECT_EQ(scene.seed, 1u);
  EXPECT_EQ(scene.substeps, 1u);
  EXPECT_EQ(scene.plant.name, "ideal");
  const SceneArm& arm = scene.arms.at(0);
  EXPECT_EQ(arm.model, "fer");
  EXPECT_TRUE(arm.hand);
  EXPECT_FALSE(arm.X_FE);
  EXPECT_NEAR(arm.q_start[3], -3 * std::numbers::pi / 4, 1e-8);
  EXPECT_EQ(arm.safety.joints.tau_max[0], 87);
  EXPECT_EQ(arm.safety.max_state_age_s, 0.002);
  EXPECT_TRUE(arm.loosened.empty());
  EXPECT_EQ(arm.place.line, 2);
}

TEST(Load, ReadsTheRosSection) {
  const RosSection usual = parse("arms:\n  - name: left\n").ros;
  EXPECT_EQ(usual.node, "multipanda");
  EXPECT_EQ(usual.name_space, "/");
  EXPECT_EQ(usual.time, RosSection::Time::automatic);
  EXPECT_EQ(usual.compat, RosSection::Compat::none);
  EXPECT_EQ(usual.rates_hz.joint_states, RosSection::Rates{}.joint_states);
  EXPECT_EQ(usual.rates_hz.diagnostics, RosSection::Rates{}.diagnostics);

  // Every rate has a different value, so that none can be mistaken for another.
  const RosSection ros =
      parse(
          "arms:\n  - name: left\n"
          "ros:\n"
          "  node: cell\n  namespace: /hall_2/cell_1\n  time: system\n  compat: franka_ros2\n"
          "  rates_hz: {joint_states: 1000, robot_state: 1, model: 2, wrench: 3, tf: 4, "
          "references: 5, outputs: 6, gripper: 7, object_poses: 8, markers: 11, clock: 9, "
          "loop_statistics: 10, diagnostics: 0}\n")
          .ros;
  EXPECT_EQ(ros.node, "cell");
  EXPECT_EQ(ros.name_space, "/hall_2/cell_1");
  EXPECT_EQ(ros.time, RosSection::Time::system);
  EXPECT_EQ(ros.compat, RosSection::Compat::franka_ros2);
  const RosSection::Rates& r = ros.rates_hz;
  EXPECT_THAT(
      (std::vector<double>{r.joint_states, r.robot_state, r.model, r.wrench, r.tf, r.references, r.outputs,
                           r.gripper, r.object_poses, r.markers, r.clock, r.loop_statistics, r.diagnostics}),
      testing::ElementsAre(1000, 1, 2, 3, 4, 5, 6, 7, 8, 11, 9, 10, 0));
}

TEST(Load, ReadsTheRobotiqOfAnArm) {
  const Scene scene =
      parse("arms:\n  - {name: a, hand: false, fci: {robotiq: /dev/ttyUSB0, robotiq_model: 2f-140}}\n");
  EXPECT_EQ(scene.arms[0].fci->robotiq, "/dev/ttyUSB0");
  EXPECT_EQ(scene.arms[0].fci->robotiq_model, "2f-140");
}

TEST(Load, ReadsTheSettingsOfTheArmItself) {
  const Scene scene = parse(
      "arms:\n"
      "  - {name: left, fci: 172.16.0.3, base: {position_m: [0, 1, 0]}}\n"
      "  - name: right\n"
      "    fci: {version: 5, gripper: false, vacuum: true, low_pass_hz: 100, check_model: false}\n"
      "    collision:\n"
      "      torque_upper_nm: 10\n"
      "      wrench_upper: [20, 20, 30, 5, 5, 5]\n"
      "      wrench_lower: 4\n"
      "      acceleration: {torque_upper_nm: [20, 20, 20, 20, 20, 9, 20], torque_lower_nm: 8}\n"
      "    joint_stiffness_nm_per_rad: [3000, 3000, 3000, 2500, 2500, 2000, 2000]\n"
      "  - {name: third, base: {position_m: [0, 2, 0]}, hand: false, vacuum: true}\n");
  const SceneArm &left = scene.arms[0], &right = scene.arms[1], &third = scene.arms[2];
  EXPECT_EQ(left.fci->address, "172.16.0.3");
  EXPECT_EQ(left.fci->version, 0);
  EXPECT_TRUE(left.fci->gripper && !left.fci->vacuum && left.fci->check_model);
  EXPECT_FALSE(left.collision || left.joint_stiffness || left.cartesian_stiffness || left.movable_fingers);

  EXPECT_EQ(right.fci->address, "172.16.0.2");
  EXPECT_EQ(right.fci->version, 5);
  EXPECT_EQ(right.fci->low_pass_hz, 100);
  EXPECT_TRUE(!right.fci->gripper && right.fci->vacuum && !right.fci->check_model);
  const ContactThresholds& nominal = right.collision.value().nominal;
  EXPECT_EQ(nominal.torque_upper, joint_constant(7, 10));
  EXPECT_EQ(nominal.torque_lower, joint_constant(7, 10));
  EXPECT_EQ(nominal.wrench_upper[2], 30);
  EXPECT_EQ(nominal.wrench_lower, Vector6(Vector6::Constant(4)));
  const ContactThresholds& accelerating = right.collision->acceleration.value();
  EXPECT_EQ(accelerating.torque_upper[5], 9);
  EXPECT_EQ(accelerating.torque_lower, joint_constant(7, 8));
  EXPECT_EQ(accelerating.wrench_upper, nominal.wrench_upper);
  EXPECT_EQ(right.joint_stiffness.value()[3], 2500);

  EXPECT_FALSE(third.fci);
  EXPECT_TRUE(third.vacuum);
}

TEST(Load, ContactBoundsHoldForAllControlletsUnlessLifted) {
  const std::string arms = "arms: [{name: left}]\n";
  const std::string law = "controllets: [{name: a, type: solo, arms: left}]\n";
  const Scene usual = parse(arms + law);
  EXPECT_EQ(usual.controllets.at(0).contact.hand_speed, 0.25);
  EXPECT_EQ(usual.controllets.at(0).contact.spring_force, 60);
  EXPECT_EQ(usual.controllets.at(0).contact.spring_moment, 15);
  EXPECT_TRUE(usual.lifted.empty());
  // Lifted in any order of the keys, and told; lowered without a word.
  const Scene lifted = parse(law + "contact_bounds: {hand_speed_m_per_s: 0.1, spring_force_n: 90}\n" + arms);
  EXPECT_EQ(lifted.controllets.at(0).contact.hand_speed, 0.1);
  EXPECT_EQ(lifted.controllets.at(0).contact.spring_force, 90);
  EXPECT_EQ(lifted.controllets.at(0).contact.spring_moment, 15);
  ASSERT_EQ(lifted.lifted.size(), 1u);
  EXPECT_EQ(lifted.lifted[0], "spring_force_n: 90 N, usually 60 N");
}

TEST(Load, PresetsGiveValuesUnlessTheSceneDoes) {
  const Registry registry = Registry::with_builtins();
  const auto read = [&](const std::string& law) {
    return parse_scene("arms: [{name: left}]\ncontrollets: [{name: a, arms: left, " + law + "}]\n", "s.yaml",
                       registry)
        .controllets.at(0)
        .parameters;
  };
  const auto value = [](const auto& parameters, const std::string& name) {
    for (const auto& parameter : parameters) {
      if (parameter.name == name) return parameter.values;
    }
    return std::vector<double>{};
  };
  const auto own = read("type: joint_impedance, parameters: {damping_of: error, preset: reference}");
  EXPECT_EQ(value(own, "stiffness_nm_per_rad"), (std::vector<double>{24, 24, 24, 24, 10, 6, 2}));
  EXPECT_EQ(value(own, "damping_of"), std::vector<double>{0});
  EXPECT_EQ(value(own, "damping_design"), std::vector<double>{2});
  const auto of_feature = read("type: ufic, parameters: {preset: paper, manipulability: {preset: paper}}");
  EXPECT_EQ(value(of_feature, "rotational_stiffness_nm_per_rad"), (std::vector<double>{10, 10, 10}));
  EXPECT_EQ(value(of_feature, "manipulability.damping_nms_per_rad"), std::vector<double>{0});
  try {
    read("type: ufic, parameters: {preset: papr}");
    FAIL();
  } catch (const ConfigError& error) {
    EXPECT_THAT(error.what(), testing::HasSubstr("no preset 'papr'"));
    EXPECT_THAT(error.what(), testing::HasSubstr("'paper'"));
  }
}

TEST(Load, NamesLawsWithoutAllSafeguards) {
  const Registry registry = Registry::with_builtins();
  const auto named = [&](const std::string& parameters) {
    return parse_scene("arms: [{name: left}]\ncontrollets: [{name: a, arms: left, type: ufic, parameters: {" +
                           parameters + "}}]\n",
                       "s.yaml", registry)
        .unsafer_laws;
  };
  EXPECT_TRUE(named("force_may_pull: false, valve_law: passive").empty());
  EXPECT_THAT(named("force_may_pull: true"), testing::ElementsAre(testing::HasSubstr("'a': force_may_pull")));
  EXPECT_EQ(named("preset: paper").size(), 5u);  // the preset and all it gives up
  EXPECT_EQ(named("preset: paper, force_feedback: in_contact").size(), 4u);
}

// Every preset of every type names its parameters and keeps to their bounds.
TEST(Load, EveryPresetIsAccepted) {
  const Registry registry = Registry::with_builtins();
  std::size_t seen = 0;
  const auto check = [&](const ControlletDescriptor& descriptor) {
    ParameterSet parameters(descriptor.parameters, 7);
    for (const Preset& preset : descriptor.presets) {
      for (const auto& [name, values] : preset.values) {
        SCOPED_TRACE(descriptor.type + ", " + preset.name + ", " + name);
        const std::size_t i = parameters.find(name);
        ASSERT_LT(i, parameters.size());
        std::vector<double> all = values;
        all.resize(parameters.value_size(i), values.at(0));
        EXPECT_EQ(parameters.check(i, all), Verdict::accepted);
        ++seen;
      }
    }
  };
  for (const auto& type : registry.controllets()) check(type.descriptor);
  for (const auto& type : registry.features()) check(type.descriptor);
  EXPECT_GT(seen, 50u);
}

// Code that adds a controllet to a scene that was read, as `multipanda move` does, gets the same bounds.
TEST(Load, ContactBoundsHoldForControlletsThatAreAddedLater) {
  Scene scene = parse("arms: [{name: left}]\ncontact_bounds: {spring_force_n: 90}\n");
  scene.controllets.push_back({.name = "added", .type = "solo", .arms = {0}});
  scene.controllets.push_back({.name = "lower", .type = "solo", .arms = {0}});
  scene.controllets.back().contact.spring_force = 20;
  const CycleConfig config = build_cycle_config(scene);
  ASSERT_EQ(config.controllets.size(), 2 + scene.arms.size());  // with the holds
  EXPECT_EQ(config.controllets[0].contact.hand_speed, 0.25);
  EXPECT_EQ(config.controllets[0].contact.spring_force, 90);
  EXPECT_EQ(config.controllets[0].contact.spring_moment, 15);
  EXPECT_EQ(config.controllets[1].contact.spring_force, 20);
}

// A speed that a scene names and does not get is told, with the key that lifts it; the usual speeds of the
// types, which are lowered as well, are not.
TEST(Load, SpeedsLoweredByTheContactBoundsAreTold) {
  const auto lowered = [](const std::string& bounds, const std::string& inputs) {
    return parse("arms: [{name: left}]\n" + bounds +
                 "controllets: [{name: a, type: solo, arms: left, inputs: {" + inputs + "}}]\n")
        .lowered;
  };
  EXPECT_THAT(lowered("", "pose: {timeout_s: 0.5}"), testing::IsEmpty());
  EXPECT_THAT(lowered("", "pose: {max_speed_m_per_s: 0.25}"), testing::IsEmpty());
  EXPECT_THAT(lowered("", "pose: {max_speed_m_per_s: 0.4}"),
              testing::ElementsAre("'a': max_speed_m_per_s 0.4 of 'pose' is lowered to 0.25 m/s; a larger "
                                   "hand_speed_m_per_s in the scene's contact_bounds lifts it"));
  EXPECT_THAT(lowered("contact_bounds: {hand_speed_m_per_s: 0.4}\n", "pose: {max_speed_m_per_s: 0.4}"),
              testing::IsEmpty());
}

// A follower that touches its leader pushes what leads it.
TEST(Load, FollowersThatMayReachTheirLeadersAreTold) {
  const Registry types = Registry::with_builtins();
  const auto near = [&](const std::string& y, const std::string& keys) {
    return parse_scene("arms: [{name: left}, {name: right, base: {position_m: [0, " + y +
                           ", 0]}}]\ncontrollets: [{name: f, type: pose_follower, arms: right, observes: "
                           "left" +
                           keys + "}]\n",
                       "s.yaml", types)
        .near_leaders;
  };
  EXPECT_THAT(near("1.5", ""),
              testing::ElementsAre(testing::AllOf(testing::HasSubstr("'f': arm 'right' may reach its leader "
                                                                     "'left'"),
                                                  testing::HasSubstr("collision_avoidance"))));
  EXPECT_THAT(near("1.5", ", features: [joint_limits, collision_avoidance]"), testing::IsEmpty());
  EXPECT_THAT(near("2.5", ""), testing::IsEmpty());
}

TEST(Load, ReadsWhatIsWritten) {
  const Scene scene = parse(
      "plant: {fidelity: realistic, noise_tau_nm: 0.1}\n"
      "arms:\n"
      "  - name: left\n"
      "    hand: false\n"
      "    base: {position_m: [1, 2, 3], rpy_rad: [0, 0, pi/2]}\n"
      "    start_rad: [0.1, 0.2, 0.3, -1, 0.5, 0.6, -pi/4]\n"
      "    end_effector: {position_m: [0, 0, 0.2], quaternion_wxyz: [0, 1, 0, 0]}\n"
      "    load_present: {mass_kg: 2, com_m: [0, 0, 0.1], inertia_kg_m2: {xx: 3, yy: 2, zz: 2, xy: 0.1}}\n"
      "    safety: {allow_looser_limits: true, torque_max_nm: [90, 80, 87, 87, 12, 12, 12], "
      "velocity_max_rad_per_s: 2.5}\n"
      "objects:\n"
      "  - {name: can, shape: cylinder, diameter_m: 0.06, length_m: 0.1, fixed: false, mass_kg: 0.3, "
      "position_m: [0, 0, 1]}\n"
      "controllets:\n"
      "  - name: a\n"
      "    type: solo\n"
      "    arms: left\n"
      "    parameters: {stiffness_n_per_m: 7, axes: tool, feedforward: false, joint_limits: {range_rad: "
      "0.2}}\n"
      "    inputs: {pose: {timeout_s: 0.5, max_angular_speed_rad_per_s: 2}}\n"
      "  - {name: left_hold, type: hold, arms: left, parameters: {damping_ratio: 0.7}}\n"
      "active: a\n"
      "timeline:\n"
      "  - {at_s: 3, reference: {controllet: a, input: wrench, torque_nm: [1, 2, 3]}}\n"
      "  - {at_s: 2, reference: {controllet: a, input: pose, position_m: [1, 2, 3], quaternion_wxyz: [0, 0, "
      "1, 0], duration_s: 4}}\n"
      "  - {at_s: 3, stop: all}\n");
  EXPECT_EQ(scene.plant.name, "realistic (changed)");
  EXPECT_EQ(scene.plant.noise_tau_nm, 0.1);
  EXPECT_EQ(scene.plant.torque_bandwidth_hz, 50);
  const SceneArm& arm = scene.arms.at(0);
  EXPECT_LT((arm.X_WB * Vector3(1, 0, 0) - Vector3(1, 3, 3)).norm(), 1e-12);
  EXPECT_NEAR(arm.q_start[6], -0.785398, 1e-6);
  EXPECT_LT((arm.X_FE->rotation - Vector3(1, -1, -1).asDiagonal().toDenseMatrix()).norm(), 1e-12);
  EXPECT_EQ(arm.load_declared.mass, 0);
  EXPECT_EQ(arm.load_present.mass, 2);
  EXPECT_EQ(arm.load_present.inertia_C(1, 0), 0.1);
  EXPECT_EQ(arm.safety.joints.tau_max[0], 90);
  EXPECT_EQ(arm.safety.joints.dq_max[0], 2.175);  // the model's is below the cap
  EXPECT_EQ(arm.safety.joints.dq_max[6], 2.5);
  ASSERT_EQ(arm.loosened.size(), 1u);
  EXPECT_THAT(arm.loosened[0], testing::HasSubstr("joint1: 90 N m"));
  EXPECT_EQ(scene.objects.at(0).size, Vector3(0.06, 0, 0.1));
  const InstanceConfig& a = scene.controllets.at(0);
  ASSERT_EQ(a.parameters.size(), 4u);
  EXPECT_EQ(a.parameters[0].values, (std::vector<double>{7, 7, 7}));
  EXPECT_EQ(a.parameters[1].values, std::vector<double>{1});
  EXPECT_EQ(a.parameters[2].values, std::vector<double>{0});
  EXPECT_EQ(a.parameters[3].name, "joint_limits.range_rad");
  EXPECT_EQ(a.inputs.at(0).timeout_s, 0.5);
  EXPECT_EQ(a.inputs.at(0).max_speed, InputSpec{}.max_speed);
  EXPECT_EQ(scene.active, std::vector<std::string>{"a"});
  ASSERT_EQ(scene.timeline.size(), 3u);
  EXPECT_EQ(scene.timeline[0].at_s, 2);
  EXPECT_EQ(scene.timeline[0].duration_s, 4);
  ASSERT_EQ(scene.timeline[0].values.size(), 7u);
  EXPECT_NEAR(std::abs(scene.timeline[0].values[5]), 1, 1e-12);
  EXPECT_EQ(scene.timeline[1].values, (std::vector<double>{0, 0, 0, 1, 2, 3}));
  EXPECT_EQ(scene.timeline[2].what, TimelineEvent::What::stop);
}

TEST(Load, ReadsInteraction) {
  const Scene scene = parse(
      "plant: {noslip_iterations: 5, stiction_nm: 0.3, rotor_inertia_hidden: 0.25}\n"
      "arms:\n"
      "  - name: left\n"
      "    known_friction: model\n"
      "    tool_shapes:\n"
      "      - {shape: sphere, diameter_m: 0.04, position_m: [0, 0, 0.2]}\n"
      "      - {shape: box, size_m: [0.06, 0.05, 0.02], position_m: [0, 0, 0.1], rpy_rad: [0, 0, pi/2]}\n"
      "objects:\n"
      "  - name: table\n"
      "    shape: box\n"
      "    size_m: [1, 1, 0.1]\n"
      "    position_m: [2, 0, 0]\n"
      "    rpy_rad: [0, 0, pi/2]\n"
      "    contact: {stiffness_n_per_m: 1e5, damping_ratio: 0.05}\n"
      "  - {name: wall, shape: plane, contact: {}}\n"
      "  - {name: post, shape: box, size_m: [1, 1, 1], position_m: [3, 0, 0]}\n"
      "timeline:\n"
      "  - {at_s: 5, place: {object: table, position_m: [0, 0, -1]}}\n"
      "  - {at_s: 6, place: {object: table, position_m: [0, 0, -2], rpy_rad: [0, 0, 0]}}\n");
  EXPECT_EQ(scene.noslip_iterations, 5u);
  EXPECT_EQ(scene.plant.stiction_nm, 0.3);
  EXPECT_EQ(scene.plant.name, "ideal (changed)");
  const SceneArm& arm = scene.arms.at(0);
  EXPECT_TRUE(arm.known_friction);
  EXPECT_EQ(arm.rotor_hidden, 0.25);
  ASSERT_EQ(arm.tool_shapes.size(), 2u);
  EXPECT_EQ(arm.tool_shapes[0].shape, ShapeType::sphere);
  EXPECT_EQ(arm.tool_shapes[0].size.x(), 0.04);
  EXPECT_EQ(arm.tool_shapes[0].X_FS.position, Vector3(0, 0, 0.2));
  EXPECT_EQ(arm.tool_shapes[1].shape, ShapeType::box);
  EXPECT_EQ(arm.tool_shapes[1].size, Vector3(0.06, 0.05, 0.02));
  EXPECT_LT((arm.tool_shapes[1].X_FS * Vector3(1, 0, 0) - Vector3(0, 1, 0.1)).norm(), 1e-12);
  EXPECT_EQ(arm.tool_shapes[1].place.line, 7);
  ASSERT_TRUE(scene.objects.at(0).contact);
  EXPECT_EQ(scene.objects[0].contact->stiffness_n_per_m, 1e5);
  EXPECT_EQ(scene.objects[0].contact->damping_ratio, 0.05);
  EXPECT_EQ(scene.objects[0].contact->tangential_damping_n_s_per_m, 100);
  ASSERT_TRUE(scene.objects[1].contact);
  EXPECT_EQ(scene.objects[1].contact->stiffness_n_per_m, SurfaceContact{}.stiffness_n_per_m);
  EXPECT_EQ(scene.objects[1].contact->damping_ratio, SurfaceContact{}.damping_ratio);
  EXPECT_FALSE(scene.objects[2].contact);
  ASSERT_EQ(scene.timeline.size(), 2u);
  EXPECT_EQ(scene.timeline[0].what, TimelineEvent::What::place);
  EXPECT_EQ(scene.timeline[0].object, "table");
  EXPECT_EQ(scene.timeline[0].X_WO.position, Vector3(0, 0, -1));
  EXPECT_EQ(scene.timeline[0].X_WO.rotation, scene.objects[0].X_WO.rotation);  // stays turned
  EXPECT_EQ(scene.timeline[1].X_WO.rotation, Matrix3::Identity());

  const Scene plain = parse("arms:\n  - name: left\n");
  EXPECT_FALSE(plain.arms[0].known_friction);
  EXPECT_EQ(plain.arms[0].rotor_hidden, 1);
  EXPECT_TRUE(plain.arms[0].tool_shapes.empty());
  EXPECT_EQ(plain.noslip_iterations, 0u);
  EXPECT_EQ(plain.plant.stiction_nm, 0);
}

TEST(Load, ReadsMotions) {
  const Scene scene = parse(
      "arms:\n  - name: left\n"
      "controllets: [{name: a, type: solo, arms: left}]\n"
      "active: a\n"
      "timeline:\n"
      "  - {at_s: 1, motion: {controllet: a, input: pose, sine: [0, 0.1, 0], rise: [-0.2, 0, 0], period_s: "
      "9}}\n"
      "  - {at_s: 2, motion: {controllet: a, input: joints, rise: [0, 0, 0, 0.5, 0.5, 0, 0], period_s: 10, "
      "cycles: 2, ramp_s: 1}}\n"
      "  - {at_s: 30, motion: {controllet: a, input: pose, overtones: [{}, {rise: [0, 0, 0.1]}], period_s: "
      "9}}\n");
  ASSERT_EQ(scene.timeline.size(), 3u);
  const TimelineEvent& circle = scene.timeline[0];
  EXPECT_EQ(circle.what, TimelineEvent::What::set_motion);
  EXPECT_THAT(circle.sine, testing::ElementsAre(0, 0.1, 0));
  EXPECT_THAT(circle.rise, testing::ElementsAre(-0.2, 0, 0));
  EXPECT_EQ(circle.period_s, 9);
  EXPECT_EQ(circle.cycles, 1);
  EXPECT_EQ(circle.ramp_s, 0.1);
  EXPECT_EQ(scene.timeline[1].rise.size(), 7u);
  EXPECT_EQ(scene.timeline[1].sine, std::vector<double>(7, 0.0));
  EXPECT_EQ(scene.timeline[1].cycles, 2);
  EXPECT_TRUE(circle.overtones.empty());
  ASSERT_EQ(scene.timeline[2].overtones.size(), 2u);
  EXPECT_THAT(scene.timeline[2].sine, testing::ElementsAre(0, 0, 0));
  EXPECT_THAT(scene.timeline[2].overtones[0].rise, testing::ElementsAre(0, 0, 0));
  EXPECT_THAT(scene.timeline[2].overtones[1].rise, testing::ElementsAre(0, 0, 0.1));
}

TEST(Load, ReadsEveryShippedScene) {
  const auto names = available_scenes();
  EXPECT_THAT(names, testing::IsSupersetOf({"one_arm", "two_arms", "two_arms_facing", "four_arms"}));
  for (const auto& name : names) {
    EXPECT_NO_THROW({ EXPECT_EQ(open_scene(name).scene.name, name); }) << name;
  }
  EXPECT_THROW(open_scene("two_armss"), ConfigError);
  EXPECT_THROW(open_scene("none/two_arms.yaml"), ConfigError);
}

TEST(Reference, CommittedPageAndSchemaAreUpToDate) {
  const auto committed = [](const std::string& file) {
    std::ifstream in(std::string(MULTIPANDA_SOURCE_DIR) + "/" + file);
    std::ostringstream text;
    text << in.rdbuf();
    return text.str();
  };
  const Registry registry = Registry::with_builtins();
  const char* hint = " is out of date: build the target scene_reference and commit the file";
  EXPECT_TRUE(committed("docs/scene_reference.md") == scene_reference_markdown(registry))
      << "docs/scene_reference.md" << hint;
  EXPECT_TRUE(committed("config/schemas/scene.json") == scene_json_schema(registry))
      << "config/schemas/scene.json" << hint;
}

TEST(Reference, ThePagesExampleIsAScene) {
  const Registry registry = Registry::with_builtins();
  const std::string page = scene_reference_markdown(registry), fence = "```yaml\n";
  const std::size_t begin = page.find(fence) + fence.size();
  const Scene scene =
      parse_scene(page.substr(begin, page.find("```", begin) - begin), "press.yaml", registry);
  EXPECT_EQ(scene.name, "press");
  EXPECT_EQ(scene.controllets.size(), 2u);
}

TEST(Load, AliasesInNamedListsKeepTheirOwnNames) {
  const Scene scene = parse(
      "arms: {left: {}}\n"
      "objects:\n"
      "  first: &wall {shape: box, size_m: [1, 1, 1]}\n"
      "  second: *wall\n");
  EXPECT_EQ(scene.objects.at(0).name, "first");
  EXPECT_EQ(scene.objects.at(1).name, "second");
}

TEST(Names, EditDistanceCountsEdits) {
  EXPECT_EQ(edit_distance("kitten", "sitting"), 3u);
  EXPECT_EQ(edit_distance("ab", "ba"), 1u);
  EXPECT_EQ(edit_distance("", "abc"), 3u);
  EXPECT_EQ(split_unit("torque_rate_max_nm_per_s").unit, "nm_per_s");
  EXPECT_EQ(split_unit("name").unit, "");
}

}  // namespace

namespace {

using testing::HasSubstr;

std::string refusal(const std::string& setting) {
  const OpenedScene opened = open_scene("one_arm");
  try {
    with_values(opened, {setting});
  } catch (const ConfigError& error) {
    return error.what();
  }
  return "not refused";
}

TEST(SetValues, AreThoseOfTheSceneAndOfItsText) {
  const OpenedScene opened = open_scene("one_arm");
  const Scene scene = with_values(opened, {"controllets.cartesian.inputs.pose.timeout_s=0.7",
                                           "controllets.joint.inputs={joints: {timeout_s: 0.3}}",
                                           "contact_bounds={hand_speed_m_per_s: 0.1}"});
  std::map<std::string, double> timeouts_s;
  for (const auto& controllet : scene.controllets)
    for (const auto& input : controllet.inputs) timeouts_s[input.name] = input.timeout_s;
  EXPECT_EQ(timeouts_s, (std::map<std::string, double>{{"pose", 0.7}, {"joints", 0.3}}));
  EXPECT_EQ(scene.contact_bounds.hand_speed, 0.1);
  EXPECT_EQ(scene.path, opened.scene.path);
  const Scene again = parse_scene(scene.text, opened.scene.path, opened.registry);
  EXPECT_EQ(again.contact_bounds.hand_speed, 0.1);
  EXPECT_EQ(with_values(opened, {}).controllets.size(), opened.scene.controllets.size());
}

TEST(SetValues, ThatAreNoneAreRefused) {
  EXPECT_THAT(refusal("timeout_s"), HasSubstr("--set: expected KEY=VALUE, found 'timeout_s'"));
  EXPECT_THAT(refusal("=1"), HasSubstr("expected KEY=VALUE"));
  EXPECT_THAT(refusal("controllets.cartesia.parameters={}"), HasSubstr("did you mean 'cartesian'"));
  EXPECT_THAT(refusal("controllets.cartesian.inputs={pose: {timeout_s: -1}}"), HasSubstr("timeout_s"));
  EXPECT_THAT(refusal("controllets.cartesian.inputs={pose: "), HasSubstr("is not YAML"));
  EXPECT_THAT(refusal("seeed=2"), HasSubstr("seeed"));
}

}  // namespace

}  // namespace multipanda::load_test
