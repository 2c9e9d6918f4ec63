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

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "config_file/node.hpp"
#include "models/testing/two_engines.hpp"
#include "models/to_mjcf.hpp"
#include "models/to_urdf.hpp"
#include "models/urdf_tree.hpp"
#include "models/xml_text.hpp"

namespace multipanda::from_urdf_test {
namespace {

using namespace test;
using Eigen::VectorXd;
using testing::ElementsAre;
using testing::HasSubstr;

std::string content(const std::filesystem::path& file) {
  std::ifstream stream(file);
  return {std::istreambuf_iterator<char>(stream), std::istreambuf_iterator<char>()};
}

// Bases anywhere, joints anywhere within their limits, against the original.
void expect_same_arm(const RobotDescription& arm, const std::string& original, const std::string& base,
                     const std::string& tip, const std::map<std::string, double>& held, int configurations) {
  PinocchioArm reference(original, base, arm.joint_names, held);
  PinocchioArm ours(to_urdf(arm));
  MujocoArm plant(to_mjcf(arm));
  ASSERT_EQ(reference.joints(), static_cast<int>(arm.joint_count()));
  ASSERT_EQ(ours.joints(), reference.joints());
  ASSERT_EQ(plant.joints(), reference.joints());
  Random random(91);
  double coriolis = 0, gravity = 0;
  for (int i = 0; i < configurations && !testing::Test::HasFailure(); ++i) {
    SCOPED_TRACE(i);
    const Pose X_WB = random.pose();
    reference.place_base(X_WB);
    ours.place_base(X_WB);
    plant.place_base(X_WB);
    const VectorXd q = random.between(arm.limits.q_min, arm.limits.q_max);
    const VectorXd dq = random.between(-arm.limits.dq_max, arm.limits.dq_max);
    const Terms expected = reference.terms(q, dq, {tip});
    expect_equal(ours.terms(q, dq, {"flange"}), expected);
    expect_equal(plant.terms(q, dq, {"flange"}), expected);
    coriolis = std::max(coriolis, expected.c.norm());
    gravity = std::max(gravity, expected.g.norm());
  }
  EXPECT_GT(coriolis, 0.1);  // the compared values are not zero
  EXPECT_GT(gravity, 1.0);
}

// A robot with everything that an import must handle: skew axes, a prismatic joint below the arm, a held
// joint and a fixed link in the middle of it, side links that rotate, slide and mimic, another arm.
class OddRobot {
 public:
  OddRobot() {
    xml_.open("robot", {{"name", "odd"}});
    link("ground");
    joint("mount", "fixed", "ground", "mast");
    joint("lift", "prismatic", "mast", "chest");
    joint("shoulder", "revolute", "chest", "upper");
    joint("cover", "fixed", "upper", "shell");
    joint("elbow", "continuous", "shell", "lower");
    joint("twist", "revolute", "lower", "forearm");
    joint("brake", "revolute", "forearm", "cuff");
    joint("wrist", "revolute", "cuff", "palm", "0 0 -1");
    joint("tool_mount", "fixed", "palm", "tool");
    joint("thumb", "revolute", "palm", "thumb_link");
    joint("finger", "prismatic", "palm", "finger_link", "0 1 0", {"thumb", "-0.5", "0.02"});
    joint("other_arm", "revolute", "chest", "other");
    xml_.close();
  }
  const std::string& text() const { return xml_.text(); }

 private:
  struct Follows {
    std::string joint, multiplier, offset;
  };

  void link(const std::string& name) {
    // Eight point masses make a body whose inertia is consistent by construction.
    RigidBody body;
    for (int i = 0; i < 8; ++i) {
      const RigidBody point{random_.uniform(0.1, 0.4), 0.15 * random_.pose().position,
                            1e-4 * Matrix3::Identity()};
      body = i == 0 ? point : merged(body, point);
    }
    const Pose X_LC{random_.pose().rotation, body.com};  // principal directions are not those of the link
    const Matrix3 I = X_LC.rotation.transpose() * body.inertia * X_LC.rotation;
    const Vector3 rpy = X_LC.rotation.eulerAngles(2, 1, 0).reverse();
    xml_.open("link", {{"name", name}});
    xml_.open("inertial");
    xml_.leaf("origin", {{"xyz", exact(body.com)}, {"rpy", exact(rpy)}});
    xml_.leaf("mass", {{"value", exact(body.mass)}});
    xml_.leaf("inertia", {{"ixx", exact(I(0, 0))},
                          {"ixy", exact(I(0, 1))},
                          {"ixz", exact(I(0, 2))},
                          {"iyy", exact(I(1, 1))},
                          {"iyz", exact(I(1, 2))},
                          {"izz", exact(I(2, 2))}});
    xml_.close();
    xml_.close();
  }

  void joint(const std::string& name, const std::string& type, const std::string& parent,
             const std::string& child, std::string axis = "", const Follows& follows = {}) {
    if (axis.empty()) axis = exact(Vector3(random_.pose().position.normalized()));
    link(child);
    xml_.open("joint", {{"name", name}, {"type", type}});
    const Vector3 rpy(random_.uniform(-3, 3), random_.uniform(-1.5, 1.5), random_.uniform(-3, 3));
    xml_.leaf("origin", {{"xyz", exact(Vector3(0.3 * random_.pose().position))}, {"rpy", exact(rpy)}});
    xml_.leaf("parent", {{"link", parent}});
    xml_.leaf("child", {{"link", child}});
    if (type != "fixed") {
      xml_.leaf("axis", {{"xyz", axis}});
      xml_.leaf("limit", {{"lower", "-1.5"}, {"upper", "2"}, {"velocity", "2"}, {"effort", "40"}});
    }
    if (!follows.joint.empty()) {
      xml_.leaf("mimic",
                {{"joint", follows.joint}, {"multiplier", follows.multiplier}, {"offset", follows.offset}});
    }
    xml_.close();
  }

  Random random_{17};
  XmlText xml_;
};

UrdfChain odd_chain() {
  return {.base_link = "mast",
          .tip_link = "tool",
          .held_joints = {{"lift", 0.3}, {"brake", -0.7}, {"thumb", 0.4}},
          .limits = {{"elbow", {.lower = -2.5, .upper = 2.5}}, {"twist", {.upper = 1.0, .effort = 30}}}};
}

std::string replaced(std::string text, const std::string& from, const std::string& to) {
  const auto at = text.find(from);
  EXPECT_NE(at, std::string::npos) << from;
  return text.replace(at, from.size(), to);
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
  EXPECT_THAT(with([](UrdfChain& c) { c.held_joints.erase("lift"); }),
              testing::AllOf(HasSubstr("is prismatic"), HasSubstr("held_joints: {lift: 0.0}")));
  EXPECT_THAT(with([](UrdfChain& c) { c.limits.erase("elbow"); }),
              HasSubstr("limits: {elbow: {lower_rad: ...}}"));
  EXPECT_THAT(with([](UrdfChain& c) { c.limits["twist"].upper = -2; }),
              HasSubstr("lower_rad below upper_rad"));
  EXPECT_THAT(with([](UrdfChain& c) { c.tip_link = c.base_link; }), HasSubstr("0 revolute joints"));
  EXPECT_THAT(with([](UrdfChain& c) { c.tip_link = "finger_link", c.held_joints.erase("thumb"); }),
              HasSubstr("'finger' between base_link and tip_link is prismatic"));

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

TEST(FromUrdf, RefusesMovingLinksWithoutConsistentMass) {
  const auto arm = [](const std::string& inertial) {
    return "<robot name='a'><link name='b'/><link name='t'>" + inertial +
           "</link><joint name='j' type='revolute'><parent link='b'/><child link='t'/><axis xyz='0 0 1'/>"
           "<limit lower='-1' upper='1' velocity='1' effort='1'/></joint></robot>";
  };
  const UrdfChain chain{.base_link = "b", .tip_link = "t"};
  EXPECT_THAT(refusal(arm(""), chain), HasSubstr("has no mass"));
  const std::string flat =
      "<inertial><mass value='1'/><inertia ixx='1' iyy='1' izz='3' ixy='0' ixz='0' iyz='0'/>"
      "</inertial>";
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
    points = corners(urdf_file(shape.file, {}));
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

// Every shape of a moving link, placed by Pinocchio from the original, is inside one of the capsules of the
// import, placed by Pinocchio from the URDF that is written from it.
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
  std::size_t tested = 0;
  for (const AttachedShape& attached : attached_shapes(original, chain)) {
    if (attached.segment == 0) continue;
    SCOPED_TRACE(attached.link);
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
