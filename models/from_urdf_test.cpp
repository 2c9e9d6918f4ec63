// Arms imported from a URDF: the same arm as Pinocchio finds in the original, with all other joints locked,
// and as MuJoCo finds in the MJCF that is written from the import.
#include "models/from_urdf.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <map>
#include <set>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "models/arm_source.hpp"
#include "models/capsule_fit.hpp"
#include "models/testing/hull_faces.hpp"
#include "models/testing/odd_robot.hpp"
#include "models/urdf_tree.hpp"
#include "models/write_robot.hpp"
#include "yaml_reader/node.hpp"

namespace multipanda::from_urdf_test {
namespace {

using namespace test;
using Eigen::VectorXd;
using testing::ElementsAre;
using testing::HasSubstr;

UrdfChain odd_chain() {
  return {.base_link = "mast",
          .tip_link = "tool",
          .held_joints = {{"lift", 0.3}, {"brake", -0.7}, {"thumb", 0.4}},
          .limits = {{"elbow", {.lower = -2.5, .upper = 2.5}}, {"twist", {.upper = 1.0, .effort = 30}}}};
}

TEST(FromUrdf, EveryChainOfATreeIsTheSameArm) {
  const OddRobot odd;
  const RobotDescription arm = robot_from_urdf(odd.text(), odd_chain());
  EXPECT_THAT(arm.joint_names, ElementsAre("shoulder", "elbow", "twist", "wrist"));
  // Pinocchio has two numbers for the position of a continuous joint; the arm is the same.
  const std::string original = replaced(odd.text(), "type=\"continuous\"", "type=\"revolute\"");
  // The finger follows the thumb: -0.5 * 0.4 + 0.02.
  expect_same_arm(arm, original, "mast", "tool",
                  {{"lift", 0.3}, {"brake", -0.7}, {"thumb", 0.4}, {"finger", -0.18}}, 100);
  EXPECT_THAT(std::vector<double>(arm.limits.q_max.begin(), arm.limits.q_max.end()),
              ElementsAre(2.0, 2.5, 1.0, 2.0));
  EXPECT_THAT(std::vector<double>(arm.limits.tau_max.begin(), arm.limits.tau_max.end()),
              ElementsAre(40.0, 40.0, 30.0, 40.0));
}

std::string refusal(const std::string& urdf, const UrdfChain& chain) {
  try {
    robot_from_urdf(urdf, chain);
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
  return "nothing was refused";
}

TEST(FromUrdf, ErrorsNameTheCure) {
  const std::string odd = OddRobot().text();
  const auto with = [&](auto&& change) {
    UrdfChain chain = odd_chain();
    change(chain);
    return refusal(odd, chain);
  };
  EXPECT_THAT(with([](UrdfChain& c) { c.tip_link = "tol"; }), HasSubstr("did you mean 'tool'?"));
  EXPECT_THAT(with([](UrdfChain& c) { c.held_joints["lft"] = 0; }), HasSubstr("did you mean 'lift'?"));
  EXPECT_THAT(with([](UrdfChain& c) { c.limits["elbw"] = {}; }), HasSubstr("did you mean 'elbow'?"));
  EXPECT_THAT(with([](UrdfChain& c) { std::swap(c.base_link, c.tip_link); }),
              HasSubstr("is not a descendant of"));
  const std::string planar =
      replaced(odd, "name=\"lift\" type=\"prismatic\"", "name=\"lift\" type=\"planar\"");
  UrdfChain free = odd_chain();
  free.held_joints.erase("lift");
  EXPECT_THAT(refusal(planar, free),
              testing::AllOf(HasSubstr("is planar"), HasSubstr("held_joints: {lift: 0.0}")));
  EXPECT_THAT(with([](UrdfChain& c) { c.limits.erase("elbow"); }),
              HasSubstr("limits: {elbow: {lower_rad: ...}}"));
  EXPECT_THAT(with([](UrdfChain& c) { c.limits["twist"].upper = -2; }),
              HasSubstr("lower_rad below upper_rad"));
  EXPECT_THAT(with([](UrdfChain& c) { c.tip_link = c.base_link; }), HasSubstr("0 joints that move"));
  EXPECT_THAT(with([](UrdfChain& c) { c.tip_link = "finger_link", c.held_joints.erase("thumb"); }),
              HasSubstr("'finger' mimics 'thumb'"));

  const UrdfChain chain = odd_chain();
  EXPECT_THAT(refusal("<robot name='a'><link name='b'>", chain), HasSubstr("is not XML"));
  EXPECT_THAT(refusal("<sdf/>", chain), HasSubstr("expected the root element <robot>"));
  EXPECT_THAT(refusal(replaced(odd, "type=\"continuous\"", "type=\"continous\""), chain),
              HasSubstr("did you mean 'continuous'?"));
  EXPECT_THAT(refusal(replaced(odd, "<parent link=\"shell\"/>", "<parent link=\"forearm\"/>"), chain),
              HasSubstr("is its own ancestor"));
  EXPECT_THAT(refusal(replaced(odd, "<parent link=\"shell\"/>", "<parent link=\"shall\"/>"), chain),
              HasSubstr("no link 'shall'"));
  EXPECT_THAT(refusal(replaced(odd, "<child link=\"lower\"/>", "<child link=\"upper\"/>"), chain),
              HasSubstr("already has a parent"));
  EXPECT_THAT(refusal(replaced(odd, "<mimic joint=\"thumb\"", "<mimic joint=\"wrist\""), chain),
              HasSubstr("moves with the arm's joint 'wrist'"));
  EXPECT_THAT(refusal(replaced(odd, "effort=\"40\"", "effort=\"nan\""), chain),
              HasSubstr("not a finite number"));
}

// xacro would add to the file, or replace a name or a number, wherever it finds its own words.
TEST(FromUrdf, RefusesSourcesOfXacro) {
  const std::string odd = OddRobot().text();
  const auto refused = [&](const std::string& from, const std::string& to) {
    return refusal(replaced(odd, from, to), odd_chain());
  };
  for (const std::string& text :
       {refused("<link name=\"tool\">", "<xacro:pen on=\"tool\"/><link name=\"tool\">"),
        refused("<link name=\"tool\">", "<link name=\"tool\"><xacro:shell/>"),
        refused("effort=\"40\"", "effort=\"${strong}\""),
        refused("<parent link=\"shell\"/>", "<parent link=\"$(arg side)_shell\"/>")})
    EXPECT_THAT(text, HasSubstr("Expand it first: xacro FILE > ROBOT.urdf"));
  // What xacro writes names its namespace still; what other programs read of the file may look alike.
  EXPECT_EQ(refused("<robot ", "<robot xmlns:xacro=\"http://www.ros.org/wiki/xacro\" "),
            "nothing was refused");
  EXPECT_EQ(refused("</robot>", "<gazebo><shell command=\"echo ${HOME}\"/></gazebo></robot>"),
            "nothing was refused");
}

TEST(FromUrdf, NamesFrictionThatIsNotSimulated) {
  const std::string odd =
      replaced(replaced(OddRobot().text(), "<child link=\"upper\"/>",
                        "<child link=\"upper\"/><dynamics damping=\"0.25\" friction=\"1.5\"/>"),
               "<child link=\"palm\"/>", "<child link=\"palm\"/><dynamics friction=\"4\"/>");
  EXPECT_THAT(robot_from_urdf(odd, odd_chain()).left_out_friction,
              ElementsAre("shoulder 0.25 N m s/rad and 1.5 N m", "wrist 0 N m s/rad and 4 N m"));
  UrdfChain slide = odd_chain();
  slide.held_joints.erase("lift");
  EXPECT_THAT(robot_from_urdf(replaced(odd, "<child link=\"chest\"/>",
                                       "<child link=\"chest\"/><dynamics damping=\"60\" friction=\"0\"/>"),
                              slide)
                  .left_out_friction[0],
              "lift 60 N s/m and 0 N");

  const std::filesystem::path folder = std::filesystem::path(testing::TempDir()) / "left_out_friction";
  std::filesystem::create_directories(folder);
  std::ofstream(folder / "odd.urdf") << odd;
  const auto loaded = [&](const std::string& more) {
    std::ofstream(folder / "odd.yaml") << "name: odd\nurdf: ./odd.urdf\nbase_link: mast\ntip_link: tool\n"
                                          "held_joints: {lift: 0.3, brake: -0.7, thumb: 0.4}\n"
                                          "limits: {elbow: {lower_rad: -2.5, upper_rad: 2.5}}\n"
                                       << more;
    return load_robot(folder / "odd.yaml").left_out_friction.size();
  };
  EXPECT_EQ(loaded(""), 2u);
  EXPECT_EQ(loaded("link_friction: {viscous_nm_s_per_rad: [0.25, 0, 0, 0]}\n"), 0u);
}

TEST(FromUrdf, RefusesMovingLinksWithoutConsistentMass) {
  const auto arm = [](const std::string& inertial) {
    return "<robot name='a'><link name='b'/><link name='t'>" + inertial +
           "</link><joint name='j' type='revolute'><parent link='b'/><child link='t'/><axis xyz='0 0 1'/>"
           "<limit lower='-1' upper='1' velocity='1' effort='1'/></joint></robot>";
  };
  const UrdfChain chain{.base_link = "b", .tip_link = "t"};
  EXPECT_THAT(refusal(arm(""), chain), HasSubstr("has no mass"));
  const std::string flat =
      "<inertial><mass value='1'/><inertia ixx='1' iyy='1' izz='3' ixy='0' ixz='0' iyz='0'/></inertial>";
  EXPECT_THAT(refusal(arm(flat), chain), HasSubstr("an inertia that is not physically consistent"));
  EXPECT_THAT(refusal(arm(replaced(flat, "izz='3'", "izz='1.5'")), chain), HasSubstr("nothing was refused"));
}

// Robots of other manufacturers, from the Python package example-robot-data, if it is installed.
struct Known {
  const char* model;  // file below tests/models
  const char* base;
  const char* tip;
  std::size_t joints;
  std::map<std::string, double> held;
};

class KnownRobots : public testing::TestWithParam<Known> {};

TEST_P(KnownRobots, AreTheSameArm) {
  const Known& known = GetParam();
  const std::string file = std::string(MULTIPANDA_SOURCE_DIR "/tests/models/") + known.model + ".yaml";
  const std::string urdf = Node::load(file).yaml()["urdf"].Scalar();
  std::filesystem::path original;
  try {
    original = urdf_file(urdf, {});
  } catch (const std::invalid_argument&) {
    GTEST_SKIP() << "example-robot-data is not installed: " << urdf;
  }
  const RobotDescription arm = load_robot(file);
  EXPECT_EQ(arm.joint_count(), known.joints);
  expect_same_arm(arm, content(original), known.base, known.tip, known.held, 40);
}

// Corners of a binary STL file, read without the library that the import uses.
std::vector<Vector3> corners(const std::filesystem::path& file) {
  const std::string bytes = content(file);
  std::uint32_t count = 0;
  std::memcpy(&count, bytes.data() + 80, 4);
  std::vector<Vector3> points;
  for (std::uint32_t triangle = 0; triangle < count; ++triangle) {
    for (int corner = 0; corner < 3; ++corner) {
      float xyz[3];
      std::memcpy(xyz, bytes.data() + 84 + 50 * triangle + 12 + 12 * corner, 12);
      points.emplace_back(xyz[0], xyz[1], xyz[2]);
    }
  }
  return points;
}

std::vector<Vector3> surface(const UrdfGeometry& shape, Random& random) {
  std::vector<Vector3> points;
  if (shape.kind == UrdfGeometry::Kind::mesh) {
    const std::filesystem::path file = urdf_file(shape.file, {});
    const std::string ending = file.extension().string();
    if (ending != ".stl" && ending != ".STL") return mesh_points(file, shape.scale);
    points = corners(file);
    for (auto& p : points) p = p.cwiseProduct(shape.scale);
    return points;
  }
  for (int k = 0; k < 200; ++k) {
    const double angle = random.uniform(-M_PI, M_PI), z = random.uniform(-1, 1), side = z < 0 ? -0.5 : 0.5;
    const double across = std::sqrt(1 - z * z);
    const Vector3 round{std::cos(angle), std::sin(angle), 0};
    if (shape.kind == UrdfGeometry::Kind::box) {
      points.push_back(
          Vector3(random.uniform(-0.5, 0.5), random.uniform(-0.5, 0.5), side).cwiseProduct(shape.size));
    } else if (shape.kind == UrdfGeometry::Kind::cylinder) {
      points.push_back(shape.radius * round + Vector3(0, 0, side * shape.length));
    } else {
      points.push_back(shape.radius * (across * round + Vector3(0, 0, z)));
    }
  }
  return points;
}

double outside(const Vector3& p, const Capsule& capsule, const Pose& X) {
  const Vector3 from = X * capsule.from, along = X * capsule.to - from;
  const double t = along.squaredNorm() > 0 ? along.dot(p - from) / along.squaredNorm() : 0;
  return (p - from - std::clamp(t, 0.0, 1.0) * along).norm() - capsule.radius;
}

// Every shape of a link, placed by Pinocchio from the original, is inside one of the capsules of the import,
// placed by Pinocchio from the URDF that is written from it; every shape of the base inside one of its hulls.
TEST_P(KnownRobots, AreInsideTheirCapsules) {
  const Known& known = GetParam();
  const std::string file = std::string(MULTIPANDA_SOURCE_DIR "/tests/models/") + known.model + ".yaml";
  std::string original;
  try {
    original = content(urdf_file(Node::load(file).yaml()["urdf"].Scalar(), {}));
  } catch (const std::invalid_argument&) {
    GTEST_SKIP() << "example-robot-data is not installed";
  }
  const RobotDescription arm = load_robot(file);
  PinocchioArm reference(original, known.base, arm.joint_names, known.held), ours(to_urdf(arm));
  Random random(17);
  const Pose X_WB = random.pose();
  reference.place_base(X_WB);
  ours.place_base(X_WB);
  const VectorXd q = random.between(arm.limits.q_min, arm.limits.q_max), still = VectorXd::Zero(q.size());
  const UrdfChain chain{.base_link = known.base, .tip_link = known.tip, .held_joints = known.held};
  std::vector<HullFaces> base(arm.base_hulls.begin(), arm.base_hulls.end());
  EXPECT_GT(base.size(), 0u);
  EXPECT_LE(base.size(), kMostBaseHulls);
  std::size_t tested = 0, of_base = 0;
  for (const AttachedShape& attached : attached_shapes(original, chain)) {
    SCOPED_TRACE(attached.link);
    if (attached.segment == 0) {
      const Pose X_BL = reference.terms(q, still, {known.base}).poses[0].inverse() *
                        reference.terms(q, still, {attached.link}).poses[0];
      std::vector<Vector3> points = surface(attached.shape, random);
      for (auto& p : points) p = X_BL * (attached.shape.X_LG * p);
      // Which of them share a hull does not show: one hull has to contain all of the shape.
      double least = 1;
      for (const HullFaces& hull : base) {
        double worst = -1;
        for (const auto& p : points) worst = std::max(worst, hull.outside(p));
        least = std::min(least, worst);
      }
      EXPECT_LT(least, 1e-6);
      ++of_base;
      continue;
    }
    const std::string link = "link" + std::to_string(attached.segment);
    const Pose X_WL = reference.terms(q, still, {attached.link}).poses[0];
    const Pose X_WS = ours.terms(q, still, {link}).poses[0];
    double worst = -1;
    for (const auto& p : surface(attached.shape, random)) {
      double least = 1;
      for (const auto& capsule : arm.capsules) {
        if (capsule.link == link)
          least = std::min(least, outside(X_WL * (attached.shape.X_LG * p), capsule, X_WS));
      }
      worst = std::max(worst, least);
      ++tested;
    }
    EXPECT_LT(worst, 1e-6);
  }
  EXPECT_GT(tested, 1000u);
  EXPECT_GT(of_base, 0u);
}

// Behind the tip of an arm with one joint a chain of joints that are not the arm's: the effort grows with its
// length, not with the number of its configurations. Whichever of the three positions each joint has,
// Pinocchio finds all corners of its links inside the capsules.
TEST(FromUrdf, AChainBehindTheTipIsInsideTheCapsules) {
  constexpr int kLength = 13;  // 3^13 is 1.6 million
  const Vector3 size(0.04, 0.03, 0.05), center(0, 0.01, 0.025);
  XmlText xml;
  xml.open("robot", {{"name", "chain"}});
  const auto link = [&](const std::string& name) {
    xml.open("link", {{"name", name}});
    xml.open("inertial");
    xml.leaf("mass", {{"value", "0.3"}});
    xml.leaf("inertia",
             {{"ixx", "1e-3"}, {"iyy", "1e-3"}, {"izz", "1e-3"}, {"ixy", "0"}, {"ixz", "0"}, {"iyz", "0"}});
    xml.close();
    xml.open("collision");
    xml.leaf("origin", {{"xyz", exact(center)}});
    xml.open("geometry");
    xml.leaf("box", {{"size", exact(size)}});
    xml.close();
    xml.close();
    xml.close();
  };
  const auto joint = [&](const std::string& name, const std::string& parent, const std::string& axis) {
    link(name + "_link");
    xml.open("joint", {{"name", name}, {"type", "revolute"}});
    xml.leaf("origin", {{"xyz", "0.01 0 0.05"}});
    xml.leaf("parent", {{"link", parent}});
    xml.leaf("child", {{"link", name + "_link"}});
    xml.leaf("axis", {{"xyz", axis}});
    xml.leaf("limit", {{"lower", "-0.4"}, {"upper", "0.9"}, {"velocity", "1"}, {"effort", "10"}});
    xml.close();
  };
  const auto name = [](int i) { return "side" + std::to_string(i); };
  link("base");
  joint("turn", "base", "0 0 1");
  for (int i = 0; i < kLength; ++i)
    joint(name(i), i == 0 ? "turn_link" : name(i - 1) + "_link", i % 2 == 0 ? "1 0 0" : "0 0.6 0.8");
  xml.close();

  const UrdfChain chain{.base_link = "base", .tip_link = "turn_link"};
  const auto shapes = attached_shapes(xml.text(), chain);
  ASSERT_EQ(shapes.size(), 2u + kLength);
  for (const AttachedShape& shape : shapes) {
    std::size_t poses = 0;
    for (const auto& step : shape.steps) poses += step.size();
    EXPECT_LE(poses, (kLength / 4 + 1) * kMostPoses);
  }
  RobotDescription arm = robot_from_urdf(xml.text(), chain);
  fit_collision(xml.text(), chain, {}, arm);
  Random random(29);
  const VectorXd zero = VectorXd::Zero(1);
  double worst = -1, widest = 0;
  for (int k = 0; k < 60; ++k) {
    std::map<std::string, double> held;
    const int same = k < 3 ? k : -1;  // all at the same end, or in the middle: the longest reach
    for (int i = 0; i < kLength; ++i) {
      const int at = same >= 0 ? same : static_cast<int>(random.uniform(0, 3));
      held[name(i)] = std::vector{-0.4, 0.25, 0.9}[static_cast<std::size_t>(at)];
    }
    PinocchioArm original(xml.text(), "base", {"turn"}, held);
    const Pose X_WS = original.terms(zero, zero, {"turn_link"}).poses[0];
    for (int i = 0; i < kLength; ++i) {
      const Pose X_WL = original.terms(zero, zero, {name(i) + "_link"}).poses[0];
      for (const auto& corner : box_points(size)) {
        const Vector3 p = X_WL * (center + corner);
        double least = 1;
        for (const auto& capsule : arm.capsules) least = std::min(least, outside(p, capsule, X_WS));
        worst = std::max(worst, least);
        widest = std::max(widest, (p - X_WS.position).norm());
      }
    }
  }
  EXPECT_LT(worst, 1e-6);
  // Not arbitrarily wide: at most 2.5 times as far from the joint as the farthest corner seen.
  for (const auto& capsule : arm.capsules) {
    EXPECT_LT(capsule.from.norm() + capsule.radius, 2.5 * widest);
    EXPECT_LT(capsule.to.norm() + capsule.radius, 2.5 * widest);
  }
}

// A box as a hull.
std::vector<Vector3> box_hull(const Vector3& center) {
  std::vector<Vector3> corners = box_points({0.1, 0.2, 0.3});
  for (auto& p : corners) p += center;
  return corners;
}

// What one hull of a base overlaps says nothing of the others.
TEST(BaseHulls, AreNamedAndIgnoredOneByOne) {
  RobotDescription robot = load_robot("fer");
  robot.base_hulls = {box_hull({-0.5, 0, 0}), box_hull({-0.5, 0.5, 0}), box_hull({-0.5, 1, 0})};
  robot.ignored_pairs.emplace_back("link0.2", "link5");
  robot.ignored_pairs.emplace_back("hand", "link0.3");
  const ArmModelSource source = arm_model_source(robot, Pose{}, true);
  const auto& parts = source.collision_shapes;
  std::map<std::string, std::set<std::string>> met;
  for (const auto& [a, b] : source.self_pairs) met[parts[a].name].insert(parts[b].name);
  EXPECT_THAT(met["link0.1"],
              testing::UnorderedElementsAre("link2", "link3", "link4", "link5", "link6", "link7", "hand"));
  EXPECT_THAT(met["link0.2"],
              testing::UnorderedElementsAre("link2", "link3", "link4", "link6", "link7", "hand"));
  EXPECT_THAT(met["link0.3"],
              testing::UnorderedElementsAre("link2", "link3", "link4", "link5", "link6", "link7"));
}

TEST(BaseHulls, WithTooManyCornersAreRefused) {
  RobotDescription robot = load_robot("fer");
  robot.base_hulls = {box_hull({-0.5, 0, 0}), std::vector<Vector3>(kMaxShapeVertices, {-0.5, 0, 0})};
  EXPECT_NO_THROW(arm_model_source(robot, Pose{}, true));
  robot.base_hulls[1].emplace_back(-0.6, 0, 0);  // it would be outside of what is left
  try {
    (void)arm_model_source(robot, Pose{}, true);
    FAIL() << "accepted";
  } catch (const std::invalid_argument& error) {
    EXPECT_THAT(error.what(), testing::AllOf(HasSubstr("link0.2"), HasSubstr("33 corners"),
                                             HasSubstr("1 to 32"), HasSubstr("'fer'")));
  }
}

INSTANTIATE_TEST_SUITE_P(
    Imported, KnownRobots,
    testing::Values(
        Known{"ur5", "base_link", "tool0", 6, {}}, Known{"baxter_left", "torso", "left_gripper", 7, {}},
        Known{"baxter_right", "torso", "right_gripper", 7, {}},
        Known{"tiago_pro_left", "base_footprint", "arm_left_tool_link", 7, {{"torso_lift_joint", 0.2}}},
        Known{"tiago_pro_right", "base_footprint", "arm_right_tool_link", 7, {{"torso_lift_joint", 0.2}}}),
    [](const auto& param) { return std::string(param.param.model); });

}  // namespace
}  // namespace multipanda::from_urdf_test
