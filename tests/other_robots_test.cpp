// The same controllets on robots of other manufacturers, imported from their URDFs: each arm must reach a
// pose, on a base away from the origin, next to its second arm. Skipped without the Python package
// example-robot-data.
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <map>
#include <set>
#include <sstream>
#include <unistd.h>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "backends/simulated_arm/inverse_kinematics.hpp"
#include "core/geometry/shape.hpp"
#include "core/model/model_terms.hpp"
#include "core/testing/test_arm.hpp"
#include "core/testing/test_world.hpp"
#include "models/arm_source.hpp"
#include "models/from_urdf.hpp"
#include "models/testing/panda_on_axis.hpp"
#include "runtime/session.hpp"
#include "scene/build.hpp"
#include "scene/load.hpp"
#include "yaml_reader/node.hpp"

namespace multipanda::other_robots_test {
namespace {

std::string content(const std::filesystem::path& file) {
  std::ifstream stream(file);
  return {std::istreambuf_iterator<char>(stream), std::istreambuf_iterator<char>()};
}

// A Panda on a linear axis, written for this run.
std::string panda_on_axis_file() {
  static const std::string file = [] {
    const std::string panda = "package://example-robot-data/robots/panda_description/urdf/panda.urdf";
    const auto folder = std::filesystem::path(testing::TempDir()) / ("axis_" + std::to_string(::getpid()));
    std::filesystem::create_directories(folder);
    std::string urdf = panda;
    try {
      std::ofstream(folder / "panda_on_axis.urdf") << test::panda_on_axis(content(urdf_file(panda, {})));
      urdf = (folder / "panda_on_axis.urdf").string();
    } catch (const std::invalid_argument&) {  // not installed: the tests skip it
    }
    const auto path = folder / "panda_on_axis.yaml";
    std::ofstream(path) << "name: panda_on_axis\nurdf: " << urdf
                        << "\nbase_link: rail\ntip_link: panda_hand_tcp\n"
                           "home_rad: [0.1, 0, -0.785, 0, -2.356, 0, 1.571, 0.785]\n";
    return path.string();
  }();
  return file;
}

std::string model_file(const std::string& name) {
  if (name == "panda_on_axis") return panda_on_axis_file();
  return MULTIPANDA_SOURCE_DIR "/tests/models/" + name + ".yaml";
}

bool is_installed(const std::string& name) {
  try {
    (void)urdf_file(Node::load(model_file(name)).yaml()["urdf"].Scalar(), {});
    return true;
  } catch (const std::invalid_argument&) {
    return false;
  }
}

std::string listed(const std::vector<double>& values) {
  std::ostringstream text;
  text.precision(15);
  for (std::size_t i = 0; i < values.size(); ++i) text << (i > 0 ? ", " : "") << values[i];
  return "[" + text.str() + "]";
}

std::string listed(const Pose& X) {
  const Quaternion q = X.quaternion();
  return "position_m: " + listed({X.position.x(), X.position.y(), X.position.z()}) +
         ", quaternion_wxyz: " + listed({q.w(), q.x(), q.y(), q.z()});
}

class OtherRobots : public testing::TestWithParam<std::vector<std::string>> {};

TEST_P(OtherRobots, ArriveInCartesianImpedance) {
  const std::vector<std::string>& names = GetParam();
  for (const auto& name : names) {
    if (!is_installed(name)) GTEST_SKIP() << "example-robot-data is not installed, needed by " << name;
  }
  const Registry registry = Registry::with_builtins();
  test::Draw draw(static_cast<std::uint32_t>(names.size() + names[0].size()));
  // A linear axis stays level.
  const Vector3 leans = names[0] == "panda_on_axis" ? Vector3::UnitY() : Vector3::UnitX();
  const Pose X_WB{
      Quaternion(Eigen::AngleAxisd(0.7, Vector3::UnitZ()) * Eigen::AngleAxisd(0.2, leans)).toRotationMatrix(),
      {0.8, -0.5, 0.6}};
  std::vector<std::unique_ptr<ModelTerms>> models;
  std::vector<Pose> goals;
  std::string arms = "arms:\n", controllets = "controllets:\n", timeline = "timeline:\n", active;
  for (const auto& name : names) {
    const RobotDescription robot = load_robot(model_file(name));
    models.push_back(
        std::make_unique<ModelTerms>(std::make_shared<const ArmModel>(arm_model_source(robot, X_WB, false))));
    ModelTerms& model = *models.back();
    const JointVector rest = joint_constant(robot.joint_count(), 0);
    const Pose start = model.X_WE();  // at home
    // A reachable pose, at least 10 cm and 10 degrees away.
    do {
      const JointVector q = robot.q_home + draw.joints(robot.joint_count(), 0.3);
      model.update(q.cwiseMax(robot.limits.q_min).cwiseMin(robot.limits.q_max), rest);
    } while ((model.X_WE().position - start.position).norm() < 0.1 ||
             Eigen::AngleAxisd(model.X_WE().rotation * start.rotation.transpose()).angle() < 0.17);
    goals.push_back(model.X_WE());
    arms += "  - {name: " + name + ", model: " + model_file(name) + ", hand: false, base: {" + listed(X_WB) +
            "}}\n";
    controllets += "  - {name: to_" + name + ", type: cartesian_impedance, arms: " + name + "}\n";
    timeline += "  - {at_s: 0.2, reference: {controllet: to_" + name + ", input: pose, " +
                listed(goals.back()) + ", duration_s: 2}}\n";
    active += (active.empty() ? "" : ", ") + ("to_" + name);
  }
  const Scene scene =
      parse_scene(arms + controllets + "active: [" + active + "]\n" + timeline, "others.yaml", registry);
  std::vector<JointArray> q(names.size());
  SessionOptions options{.paced = false, .duration_s = 5};
  options.observer = [&](const CycleRecord& record) {
    for (std::size_t i = 0; i < q.size(); ++i) q[i] = record.arms[i].q;
  };
  Session session(scene, registry, std::move(options));
  session.start();
  const RunSummary summary = session.finish();
  EXPECT_THAT(summary.faults(), testing::IsEmpty());
  EXPECT_THAT(summary.interventions, testing::IsEmpty());
  for (std::size_t i = 0; i < names.size(); ++i) {
    ModelTerms& model = *models[i];
    const auto n = static_cast<Eigen::Index>(model.joint_count());
    model.update(Eigen::Map<const Eigen::VectorXd>(q[i].data(), n), joint_constant(model.joint_count(), 0));
    const double distance = (model.X_WE().position - goals[i].position).norm();
    const double angle = Eigen::AngleAxisd(model.X_WE().rotation * goals[i].rotation.transpose()).angle();
    EXPECT_LT(distance, 1e-3) << names[i];           // [m]
    EXPECT_LT(angle, 0.1 * M_PI / 180) << names[i];  // [rad]
    RecordProperty(names[i] + "_mm", std::to_string(1e3 * distance));
    RecordProperty(names[i] + "_deg", std::to_string(angle * 180 / M_PI));
  }
}

// No pair of shapes that is checked overlaps at home, or is closer than 20 mm if one is a hull of the base.
// Those that are not checked are neighbors, or named with what they do: one hull of the base may be, and
// another one not.
void expect_only_overlaps_ignored(const RobotDescription& robot) {
  const Pose X_WB{rotation_from_rpy({0.1, -0.2, 0.7}), {0.3, -0.2, 0.5}};
  ModelTerms terms(std::make_shared<const ArmModel>(arm_model_source(robot, X_WB, false)));
  terms.update(robot.q_home, joint_constant(robot.joint_count(), 0));
  const auto& parts = terms.model().collision_shapes();
  const auto placed = [&](const CollisionShape& part) {
    return (part.joint < 0 ? X_WB : terms.X_WJ(static_cast<std::size_t>(part.joint))) * part.X_JS;
  };
  const auto& checked = terms.model().self_pairs();
  std::set<std::string> overlap, named;
  for (std::size_t a = 0; a < parts.size(); ++a) {
    for (std::size_t b = a + 1; b < parts.size(); ++b) {
      if (parts[b].joint <= parts[a].joint + 1) continue;
      const double apart =
          closest_points(parts[a].shape, placed(parts[a]), parts[b].shape, placed(parts[b])).distance;
      const std::string pair = parts[a].name + " and " + parts[b].name;
      if (apart < -1e-3) overlap.insert(pair);
      if (std::find(checked.begin(), checked.end(), std::pair(a, b)) != checked.end()) {
        const bool hull = parts[a].joint < 0 && parts[a].shape.kind == ConvexShape::Kind::vertices;
        EXPECT_GT(apart, (hull ? 0.02 : 0) - 1e-3) << pair;
      } else {
        named.insert(pair);
      }
    }
  }
  std::set<std::string> at_home, all;
  for (const std::string& text : robot.unguarded_pairs) {
    const std::string pair = text.substr(0, text.find(" ("));
    all.insert(pair);
    if (text.ends_with("(overlap at home)")) at_home.insert(pair);
  }
  EXPECT_EQ(named, all);
  for (const auto& pair : overlap) EXPECT_EQ(at_home.count(pair), 1u) << pair;
  testing::Test::RecordProperty(robot.name + "_unguarded", testing::PrintToString(robot.unguarded_pairs));
}

// Capsules come from the geometry of the URDF: every vertex of a link's meshes is inside of them, at any
// joint angles, and no pair that is checked overlaps at home.
TEST_P(OtherRobots, HaveCapsulesAroundTheirGeometry) {
  for (const auto& name : GetParam()) {
    if (!is_installed(name)) GTEST_SKIP() << "example-robot-data is not installed, needed by " << name;
    const RobotDescription robot = load_robot(model_file(name));
    SCOPED_TRACE(name + ": " + robot.origin.at("self_collision"));
    EXPECT_GE(robot.capsules.size(), robot.joint_count());
    EXPECT_LE(robot.capsules.size(), 3 * robot.joint_count());
    for (const auto& capsule : robot.capsules) {
      EXPECT_GT(capsule.radius, 0.005);
      EXPECT_LT(capsule.radius, 0.2);
      EXPECT_LT((capsule.to - capsule.from).norm(), 0.7);
    }
    EXPECT_GT(robot.base_hulls.size(), 0u);
    const ArmModel model(arm_model_source(robot, Pose{}, false));
    std::size_t with_base = 0;
    for (const auto& [a, b] : model.self_pairs()) with_base += model.collision_shapes()[a].joint < 0 ? 1 : 0;
    EXPECT_GT(with_base, 0u);
    EXPECT_GT(model.self_pairs().size(), with_base);
    RecordProperty(name + "_pairs", std::to_string(model.self_pairs().size()));
    RecordProperty(name + "_with_base", std::to_string(with_base));
    expect_only_overlaps_ignored(robot);
  }
}

enum class Base { both, with, without };

// The least distance of the pairs that a model names: with its base, without it, or both [m].
double nearest(ModelTerms& terms, Base base) {
  const auto& parts = terms.model().collision_shapes();
  const auto placed = [&](const CollisionShape& part) {
    return (part.joint < 0 ? terms.model().X_WB() : terms.X_WJ(static_cast<std::size_t>(part.joint))) *
           part.X_JS;
  };
  double least = 1;
  for (const auto& [a, b] : terms.model().self_pairs()) {
    if (base != Base::both && (parts[a].joint < 0) != (base == Base::with)) continue;
    const double apart =
        closest_points(parts[a].shape, placed(parts[a]), parts[b].shape, placed(parts[b])).distance;
    least = std::min(least, apart);
  }
  return least;
}

// A hand is sent into its own upper arm: with the feature the capsules stay apart.
TEST(OtherRobotsAvoid, TheirOwnArm) {
  if (!is_installed("ur5")) GTEST_SKIP() << "example-robot-data is not installed";
  const Registry registry = Registry::with_builtins();
  std::map<std::string, double> smallest;
  for (const std::string features : {"", "collision_avoidance"}) {
    const Scene scene =
        parse_scene("arms: [{name: arm, model: " + model_file("ur5") +
                        ", hand: false, base: {position_m: [0.3, -0.2, 0.5], rpy_rad: [0, 0, 0.7]}}]\n"
                        "controllets: [{name: joint, type: joint_impedance, arms: arm, parameters: "
                        "{stiffness_nm_per_rad: 60}, features: [" +
                        features +
                        "]}]\nactive: [joint]\ntimeline: [{at_s: 0.2, reference: {controllet: "
                        "joint, input: joints, q_rad: [0, -1.2, 2.9, -1.7, -1.5, 0], duration_s: 4}}]\n",
                    "avoid.yaml", registry);
    const RobotDescription robot = load_robot(model_file("ur5"));
    ModelTerms model(std::make_shared<const ArmModel>(arm_model_source(robot, Pose{}, false)));
    double least = 1;
    SessionOptions options{.paced = false, .duration_s = 6};
    options.observer = [&](const CycleRecord& record) {
      const auto n = static_cast<Eigen::Index>(model.joint_count());
      model.update(Eigen::Map<const Eigen::VectorXd>(record.arms[0].q.data(), n),
                   joint_constant(model.joint_count(), 0));
      least = std::min(least, nearest(model, Base::both));
    };
    Session session(scene, registry, std::move(options));
    session.start();
    const RunSummary summary = session.finish();
    // Without the feature the simulated arm stops itself, as a Panda does.
    EXPECT_EQ(summary.faults().empty(), !features.empty()) << testing::PrintToString(summary.faults());
    smallest[features] = least;
  }
  EXPECT_LT(smallest[""], 0.005);
  EXPECT_GT(smallest["collision_avoidance"], 0.01);
}

// An arm is sent through the torso that carries it and its twin: with the feature it stays clear.
TEST(OtherRobotsAvoid, TheBodyThatCarriesThem) {
  if (!is_installed("baxter_left")) GTEST_SKIP() << "example-robot-data is not installed";
  const Registry registry = Registry::with_builtins();
  const Pose X_WB{rotation_from_rpy({0.1, -0.2, 0.7}), {0.3, -0.2, 0.5}};
  ModelTerms model(
      std::make_shared<const ArmModel>(arm_model_source(load_robot(model_file("baxter_left")), X_WB, false)));
  const ArmLimits& limits = model.model().limits();
  const JointVector rest = joint_constant(7, 0);
  test::Draw draw(21);
  JointVector goal;
  do {  // inside of the base, and clear of the arm itself all the way
    goal = model.model().q_home() + draw.joints(7, 1.2);
    goal = goal.cwiseMax(limits.q_min).cwiseMin(limits.q_max).eval();
    model.update(goal, rest);
    if (nearest(model, Base::with) > -0.03) continue;
    double clear = 1;
    for (const double part : {0.25, 0.5, 0.75, 1.0}) {
      model.update(model.model().q_home() + part * (goal - model.model().q_home()), rest);
      clear = std::min(clear, nearest(model, Base::without));
    }
    if (clear > 0.05) break;
  } while (true);
  std::ostringstream q_goal;
  for (const double q : goal) q_goal << (q_goal.tellp() == 0 ? "" : ", ") << q;
  std::string arms;
  for (const std::string side : {"left", "right"})
    arms += "  - {name: " + side + ", model: " + model_file("baxter_" + side) + ", hand: false, base: {" +
            listed(X_WB) + "}}\n";
  std::map<std::string, double> smallest;
  for (const std::string features : {"", "collision_avoidance"}) {
    const Scene scene =
        parse_scene("arms:\n" + arms +
                        "controllets: [{name: joint, type: joint_impedance, arms: left, "
                        "parameters: {stiffness_nm_per_rad: 40}, features: [" +
                        features +
                        "]}]\nactive: [joint]\ntimeline: [{at_s: 0.2, reference: {controllet: "
                        "joint, input: joints, q_rad: [" +
                        q_goal.str() + "], duration_s: 4}}]\n",
                    "torso.yaml", registry);
    double least = 1;
    SessionOptions options{.paced = false, .duration_s = 6};
    options.observer = [&](const CycleRecord& record) {
      model.update(Eigen::Map<const Eigen::VectorXd>(record.arms[0].q.data(), 7), rest);
      least = std::min(least, nearest(model, Base::with));
    };
    Session session(scene, registry, std::move(options));
    session.start();
    const RunSummary summary = session.finish();
    EXPECT_EQ(summary.faults().empty(), !features.empty()) << testing::PrintToString(summary.faults());
    smallest[features] = least;
    EXPECT_EQ(scene.arms[0].unguarded, load_robot(model_file("baxter_left")).unguarded_pairs);  // it is told
    EXPECT_FALSE(scene.arms[0].unguarded.empty());
  }
  EXPECT_LT(smallest[""], 0.005);
  EXPECT_GT(smallest["collision_avoidance"], 0.01);
}

// Where an arm reaches into a hull, the feature would throw it out of there: it is not switched on, and the
// arm is held.
TEST(OtherRobotsAvoid, NotFromWithinTheBodyThatCarriesThem) {
  if (!is_installed("baxter_left")) GTEST_SKIP() << "example-robot-data is not installed";
  const Registry registry = Registry::with_builtins();
  const RobotDescription robot = load_robot(model_file("baxter_left"));
  ModelTerms model(std::make_shared<const ArmModel>(arm_model_source(robot, Pose{}, false)));
  test::Draw draw(22);
  JointVector q;
  do {  // clear of the arm itself, so that its own reflex does not decide
    q = robot.q_home + draw.joints(7, 1.2);
    q = q.cwiseMax(robot.limits.q_min).cwiseMin(robot.limits.q_max).eval();
    model.update(q, joint_constant(7, 0));
  } while (nearest(model, Base::with) > -0.03 || nearest(model, Base::without) < 0.05);
  for (const bool inside : {true, false}) {
    const JointVector start = inside ? q : robot.q_home;
    const Scene scene = parse_scene(
        "arms: [{name: left, model: " + model_file("baxter_left") +
            ", hand: false, start_rad: " + listed(std::vector<double>(start.begin(), start.end())) +
            "}]\ncontrollets: [{name: joint, type: joint_impedance, arms: left, features: "
            "[collision_avoidance]}]\nactive: [joint]\n",
        "inside.yaml", registry);
    JointVector end = start;
    SessionOptions options{.paced = false, .duration_s = 0.5};
    options.observer = [&](const CycleRecord& record) {
      end = Eigen::Map<const Eigen::VectorXd>(record.arms[0].q.data(), 7);
    };
    Session session(scene, registry, std::move(options));
    session.start();
    (void)session.finish();
    const InstanceIndex joint = session.modes().find("joint");
    EXPECT_EQ((session.modes().active() & bit(joint)) != 0, !inside);
    EXPECT_LT((end - start).lpNorm<Eigen::Infinity>(), 0.01);
  }
  // A hold must start there, too, so it cannot have the feature.
  try {
    Session(
        parse_scene("arms: [{name: left, model: " + model_file("baxter_left") +
                        ", hand: false}]\ncontrollets: [{name: left_hold, type: hold, arms: left, features: "
                        "[collision_avoidance]}]\n",
                    "hold.yaml", registry),
        registry, {});
    ADD_FAILURE() << "was accepted";
  } catch (const std::exception& error) {
    EXPECT_NE(std::string(error.what()).find("a hold must be able to start anywhere"), std::string::npos)
        << error.what();
  }
}

// A carriage is sent 0.5 m in a second: it is no faster than a hand may be, and arrives later.
TEST(PandaOnAxis, MovesItsCarriageAtTheSpeedOfHands) {
  if (!is_installed("panda_on_axis")) GTEST_SKIP() << "example-robot-data is not installed";
  const Registry registry = Registry::with_builtins();
  const Pose X_WB{rotation_from_rpy({0, 0, 0.7}), {0.4, 0.1, 0.5}};
  const Scene scene = parse_scene(
      "arms: [{name: arm, model: " + model_file("panda_on_axis") + ", hand: false, base: {" + listed(X_WB) +
          "}}]\ncontrollets: [{name: joint, type: joint_impedance, arms: arm}]\nactive: [joint]\ntimeline: "
          "[{at_s: 0.2, reference: {controllet: joint, input: joints, q_rad: [0.6, 0, -0.785, 0, -2.356, 0, "
          "1.571, 0.785], duration_s: 1}}]\n",
      "carriage.yaml", registry);
  double fastest = 0, at_end = 0;
  SessionOptions options{.paced = false, .duration_s = 6};
  options.observer = [&](const CycleRecord& record) {
    fastest = std::max(fastest, std::abs(record.arms[0].dq[0]));
    at_end = record.arms[0].q[0];
  };
  Session session(scene, registry, std::move(options));
  session.start();
  const RunSummary summary = session.finish();
  EXPECT_THAT(summary.faults(), testing::IsEmpty());
  EXPECT_THAT(summary.interventions, testing::IsEmpty());
  EXPECT_LT(fastest, 1.05 * 0.25);
  EXPECT_GT(fastest, 0.1);
  EXPECT_NEAR(at_end, 0.6, 1e-3);
}

// Whatever gravity pulls along an axis is refused: nothing here closes a brake.
TEST(PandaOnAxis, IsRefusedWhereItBearsWeight) {
  if (!is_installed("panda_on_axis")) GTEST_SKIP() << "example-robot-data is not installed";
  const Registry registry = Registry::with_builtins();
  const auto refusal = [&](const std::string& base, const std::string& more = "") -> std::string {
    try {
      (void)parse_scene("arms:\n  - name: arm\n    model: " + model_file("panda_on_axis") +
                            "\n    hand: false\n    base: {rpy_rad: " + base + "}\n" + more,
                        "axis.yaml", registry);
    } catch (const ConfigError& error) {
      return error.what();
    }
    return {};
  };
  EXPECT_EQ(refusal("[0, 0, 0.7]"), "");
  EXPECT_EQ(refusal("[0, 1.2, 0.7]"), "");  // turned about the axis
  EXPECT_THAT(
      refusal("[pi/2, 0, 0]"),
      testing::AllOf(testing::HasSubstr("axis.yaml:3"), testing::HasSubstr("prismatic joint1 of arm 'arm'"),
                     testing::HasSubstr("90 degrees"), testing::HasSubstr("held_joints")));
  EXPECT_THAT(refusal("[-pi/2, 0, 0]"), testing::HasSubstr("90 degrees"));
  EXPECT_THAT(refusal("[0.1, 0, 0]"), testing::HasSubstr("5.73 degrees"));
  // 43 kg and 0.04 g press with 17 N, and 25 N with the heaviest payload that may be declared: a quarter of
  // what the scene leaves of the force.
  const std::string load = "    largest_load_kg: 20\n";
  const std::string safety = "    safety: {torque_max_nm: [80, 40, 40, 40, 40, 6, 6, 6]}\n";
  EXPECT_EQ(refusal("[0.04, 0, 0]", load), "");
  EXPECT_EQ(refusal("[0.04, 0, 0]", safety), "");
  EXPECT_THAT(refusal("[0.04, 0, 0]", load + safety), testing::HasSubstr("of its 80 N"));
}

// Joint impedance holds a Panda on a level axis, and on one that leans by nearly as much as it may. A weight
// at the hand that nobody knows of draws the axis aside by its part along it over the stiffness, whatever the
// other joints do.
TEST(PandaOnAxis, IsDrawnAsideByTheWeightAlongItOverTheStiffness) {
  if (!is_installed("panda_on_axis")) GTEST_SKIP() << "example-robot-data is not installed";
  const Registry registry = Registry::with_builtins();
  constexpr double kStiffness = 5000, kMass = 2;
  for (const double tilt : {0.0, 0.04}) {
    const Scene scene = parse_scene(
        "arms: [{name: arm, model: " + model_file("panda_on_axis") +
            ", hand: false, base: {position_m: [0.4, 0.1, 2], rpy_rad: [" + std::to_string(tilt) +
            ", 0, 0]}, load_present: {mass_kg: 2}}]\ncontrollets: [{name: joint, type: joint_impedance, "
            "arms: "
            "arm, parameters: {stiffness_nm_per_rad: [5000, 600, 600, 600, 600, 250, 150, 50]}}]\nactive: "
            "[joint]\n",
        "axis.yaml", registry);
    double q = 0;
    SessionOptions options{.paced = false, .duration_s = 5};
    options.observer = [&](const CycleRecord& record) { q = record.arms[0].q[0]; };
    Session session(scene, registry, std::move(options));
    session.start();
    const RunSummary summary = session.finish();
    EXPECT_THAT(summary.faults(), testing::IsEmpty());
    EXPECT_THAT(summary.interventions, testing::IsEmpty());
    // 0 and 0.157 mm
    EXPECT_NEAR(scene.arms[0].q_start[0] - q, kMass * 9.81 * std::sin(tilt) / kStiffness, 2e-5);
  }
}

// The carriage of a held arm can be pushed aside with 60 N and stays where it was left.
TEST(PandaOnAxis, StaysWhereItWasPushedAsideWhileItIsHeld) {
  if (!is_installed("panda_on_axis")) GTEST_SKIP() << "example-robot-data is not installed";
  const Registry registry = Registry::with_builtins();
  const Scene scene = parse_scene("arms: [{name: arm, model: " + model_file("panda_on_axis") +
                                      ", hand: false, base: {rpy_rad: [0, 0, 0.7]}}]\n",
                                  "held.yaml", registry);
  const std::vector<std::shared_ptr<const ArmModel>> models{build_controller_model(scene.arms[0])};
  test::TestWorld world(models);
  ControlCycle cycle(build_cycle_config(scene, 0), registry, world);
  const auto largest_force = [&](int steps) {
    double most = 0;
    for (int k = 0; k < steps; ++k) {
      cycle.step(world.wait());
      most = std::max(most, std::abs(world.torque(0)[0]));
    }
    return most;
  };
  cycle.modes().stop(ArmSet::of(0));
  EXPECT_LT(largest_force(100), 1e-6);
  const Instance& hold = cycle.modes().instance(cycle.modes().owner(0));
  ASSERT_EQ(hold.name(), "arm_hold");
  const double stiffness = hold.parameter(hold.find_parameter("stiffness_nm_per_rad"))[0];
  JointVector q = world.position(0);
  for (const double shoved : {0.04, -0.1}) {
    q[0] = world.position(0)[0] + shoved;
    world.set_position(0, q);
    EXPECT_LT(largest_force(4000), 63);  // and what the arm on it pulls at
    EXPECT_NEAR(world.position(0)[0], q[0] - std::copysign(60, shoved) / stiffness, 5e-4);
    EXPECT_LT(world.velocity(0).norm(), 1e-4);
    EXPECT_LT((world.position(0) - q).tail(7).norm(), 1e-3);
  }
}

// The simulated arm's own kinematics against those of Pinocchio.
TEST(PandaOnAxis, HasTheSameKinematicsInTheSimulatedArm) {
  if (!is_installed("panda_on_axis")) GTEST_SKIP() << "example-robot-data is not installed";
  test::Draw draw(4);
  const Pose X_WB = draw.pose(2);
  const RobotDescription robot = load_robot(model_file("panda_on_axis"));
  const auto model = std::make_shared<const ArmModel>(arm_model_source(robot, X_WB, false));
  ASSERT_TRUE(model->is_prismatic(0));
  ModelTerms terms(model);
  const KinematicChain chain(model);
  for (int k = 0; k < 50; ++k) {
    const JointVector q = draw.joints(8, 1);
    terms.update(q, joint_constant(8, 0));
    Jacobian J_V_BE;
    const Pose X_WE = X_WB * chain.X_BE(q, J_V_BE);
    EXPECT_LT((X_WE.position - terms.X_WE().position).norm(), 1e-12);
    EXPECT_LT((X_WE.rotation - terms.X_WE().rotation).norm(), 1e-12);
    for (Eigen::Index i = 0; i < 8; ++i) {
      const Vector6 column = terms.J_V_WE().col(i);
      EXPECT_LT((X_WB.rotation * J_V_BE.col(i).head<3>() - column.head<3>()).norm(), 1e-12);
      EXPECT_LT((X_WB.rotation * J_V_BE.col(i).tail<3>() - column.tail<3>()).norm(), 1e-12);
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Imported, OtherRobots,
                         testing::Values(std::vector<std::string>{"ur5"},
                                         std::vector<std::string>{"panda_on_axis"},
                                         std::vector<std::string>{"baxter_left", "baxter_right"},
                                         std::vector<std::string>{"tiago_pro_left", "tiago_pro_right"}),
                         [](const auto& param) { return param.param[0]; });

}  // namespace
}  // namespace multipanda::other_robots_test
