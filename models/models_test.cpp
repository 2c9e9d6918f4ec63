#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>

#include <Eigen/Eigenvalues>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "models/arm_source.hpp"
#include "models/robot_description.hpp"
#include "models/write_robot.hpp"
#include "models/xml_text.hpp"

namespace multipanda::models_test {
namespace {

using testing::AllOf;
using testing::HasSubstr;

const std::string kUr5e = MULTIPANDA_SOURCE_DIR "/tests/models/ur5e.yaml";

std::string content(const std::filesystem::path& file) {
  std::ifstream stream(file, std::ios::binary);
  std::ostringstream text;
  text << stream.rdbuf();
  return text.str();
}

// The message of load_robot for a copy of ur5e.yaml in which `from` was replaced by `to`.
std::string refusal_after(const std::string& from, const std::string& to) {
  std::string text = content(kUr5e);
  const auto at = text.find(from);
  EXPECT_NE(at, std::string::npos) << from;
  text.replace(at, from.size(), to);
  const auto file = std::filesystem::path(MULTIPANDA_BINARY_DIR) / "changed.yaml";
  std::ofstream(file) << text;
  try {
    load_robot(file.string());
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
  return "accepted";
}

// Pseudo-inertia about the link's origin: [integral of r r^T dm, m c; (m c)^T, m], an independent statement
// of "some distribution of positive mass".
double smallest_pseudo_inertia(const RigidBody& body) {
  // Steiner, by cross products.
  const Matrix3 inertia_at_origin = body.inertia - body.mass * skew(body.com) * skew(body.com);
  Eigen::Matrix4d P;
  P.topLeftCorner<3, 3>() = 0.5 * inertia_at_origin.trace() * Matrix3::Identity() - inertia_at_origin;
  P.topRightCorner<3, 1>() = body.mass * body.com;
  P.bottomLeftCorner<1, 3>() = body.mass * body.com.transpose();
  P(3, 3) = body.mass;
  return Eigen::SelfAdjointEigenSolver<Eigen::Matrix4d>(P).eigenvalues().minCoeff();
}

TEST(Robots, AreFoundByName) {
  EXPECT_THAT(available_robots(), testing::ElementsAre("fer", "fr3", "fr3v2"));
  for (const auto& name : available_robots()) {
    const RobotDescription robot = load_robot(name);
    EXPECT_EQ(robot.name, name);
    EXPECT_EQ(robot.joint_count(), 7u);
    EXPECT_TRUE(robot.hand);
    EXPECT_TRUE(robot.friction);
    EXPECT_TRUE(robot.cartesian);
    for (const char* section :
         {"joints", "inertials", "limits", "interface_limits", "joint_friction", "hand"}) {
      EXPECT_FALSE(robot.origin.at(section).empty()) << name << " " << section;
    }
  }
}

TEST(Robots, HaveThePublishedFigures) {
  const RobotDescription fer = load_robot("fer");
  EXPECT_EQ(fer.limits.tau_max[0], 87);
  EXPECT_EQ(fer.limits.tau_max[6], 12);
  EXPECT_EQ(fer.limits.q_max[3], -0.0698);
  EXPECT_EQ(fer.limits.ddq_max[1], 7.5);
  EXPECT_EQ(fer.limits.dddq_max[1], 3750);
  EXPECT_EQ(fer.limits.tau_rate_max[0], 1000);
  EXPECT_EQ(fer.links[1].inertia(1, 2), 0.019169);   // yz
  EXPECT_EQ(fer.links[2].inertia(0, 1), -0.003925);  // xy
  EXPECT_EQ(fer.links[2].inertia(0, 2), 0.010254);   // xz
  EXPECT_EQ(fer.cartesian->rotation_jerk, 12500);
  const RobotDescription fr3 = load_robot("fr3");
  EXPECT_EQ(fr3.limits.q_min[5], 0.5445);
  EXPECT_EQ(fr3.limits.dq_max[4], 5.26);
  EXPECT_EQ(fr3.position_based_velocity->offset[1], 0.2517);
  EXPECT_EQ(fr3.position_based_velocity->deceleration[4], 17);
  EXPECT_EQ(fr3.position_based_velocity->q_max[5], 4.6216);
  EXPECT_FALSE(fer.position_based_velocity);
  EXPECT_EQ(fr3.friction->p1, fer.friction->p1);
  const RobotDescription second = load_robot("fr3v2");
  EXPECT_EQ(second.links[0].mass, 3.85);
  EXPECT_EQ(second.links[2].com.y(), -0.168509);
  EXPECT_EQ(second.links[4].inertia(0, 1), -0.003749);  // xy
  EXPECT_EQ(second.links[5].inertia(1, 2), -0.004734);  // yz
  EXPECT_EQ(second.links[7].inertia(2, 2), 0.000702);   // zz
  EXPECT_EQ(second.limits.q_max, fr3.limits.q_max);
  EXPECT_EQ(second.position_based_velocity->offset, fr3.position_based_velocity->offset);
  EXPECT_EQ(second.name, "fr3v2");
  for (const auto& robot : {fer, fr3, second}) EXPECT_EQ(robot.rated_payload, 3.0) << robot.name;
  EXPECT_THAT(fer.origin.at("rated_payload_kg"), HasSubstr("data sheets"));
  EXPECT_THAT(fr3.origin.at("joint_friction"), HasSubstr("Panda"));
}

TEST(Robots, ConsistOfPhysicalBodies) {
  for (const std::string& name : {std::string("fer"), std::string("fr3"), std::string("fr3v2"), kUr5e}) {
    const RobotDescription robot = load_robot(name);
    ASSERT_EQ(robot.links.size(), robot.joint_count() + 1);
    for (const auto& link : robot.links) EXPECT_GT(smallest_pseudo_inertia(link), 0) << name;
    if (!robot.hand) continue;
    EXPECT_GT(smallest_pseudo_inertia(robot.hand->body), 0);
    EXPECT_GT(smallest_pseudo_inertia(robot.hand->finger), 0);
    EXPECT_GT(smallest_pseudo_inertia(rigid_hand(*robot.hand)), 0);
  }
}

TEST(Robots, HandIsSymmetricallyMerged) {
  const HandDescription hand = *load_robot("fer").hand;
  const RigidBody rigid = rigid_hand(hand);
  EXPECT_DOUBLE_EQ(rigid.mass, 0.6544 + 2 * 0.0291);
  // Both fingers together have their center of mass on the hand's z axis.
  const double z = (0.6544 * 0.020726 + 2 * 0.0291 * (0.0584 + 0.0219675)) / rigid.mass;
  EXPECT_LT((rigid.com - Vector3(0.6544 * -3.76e-05 / rigid.mass, 0.6544 * 0.0119128 / rigid.mass, z)).norm(),
            1e-15);
}

TEST(Robots, CapsulesAndPairs) {
  const RobotDescription fer = load_robot("fer");
  EXPECT_EQ(fer.capsules.size(), 10u);
  EXPECT_EQ(fer.hand->palm_capsules.size() + fer.hand->finger_capsules.size(), 2u);
  for (const auto& capsule : fer.capsules) EXPECT_GT(capsule.radius, 0);
  EXPECT_TRUE(is_ignored_pair(fer, "link0", "link1"));  // neighbors
  EXPECT_TRUE(is_ignored_pair(fer, "hand", "link7"));
  EXPECT_TRUE(is_ignored_pair(fer, "link3", "link1"));
  EXPECT_FALSE(is_ignored_pair(fer, "link0", "link5"));
  EXPECT_FALSE(is_ignored_pair(fer, "link5", "hand"));
}

TEST(Robots, ShareFolderCanBeElsewhere) {
  const auto share = std::filesystem::path(MULTIPANDA_BINARY_DIR) / "share";
  std::filesystem::create_directories(share / "models");
  std::filesystem::copy_file(kUr5e, share / "models/my_arm.yaml",
                             std::filesystem::copy_options::overwrite_existing);
  setenv("MULTIPANDA_SHARE", share.c_str(), 1);
  EXPECT_THAT(available_robots(), testing::ElementsAre("my_arm"));
  EXPECT_EQ(load_robot("my_arm").joint_count(), 6u);
  unsetenv("MULTIPANDA_SHARE");
}

TEST(Robots, ArmSourceCarriesTheLimits) {
  const RobotDescription fer = load_robot("fer");
  const ArmModelSource source = arm_model_source(fer, Pose{}, true);
  EXPECT_EQ(source.flange, "flange");
  EXPECT_EQ(source.limits.tau_rate_max, fer.limits.tau_rate_max);
  EXPECT_EQ(source.q_home, fer.q_home);
  EXPECT_THAT(source.urdf, HasSubstr("hand_tcp"));
  EXPECT_THROW(arm_model_source(load_robot(kUr5e), Pose{}, true), std::invalid_argument);
}

TEST(Refusals, NameTheNearestRobot) {
  try {
    load_robot("fr3v");
    FAIL() << "accepted";
  } catch (const std::invalid_argument& error) {
    EXPECT_THAT(error.what(), HasSubstr("did you mean 'fr3'?"));
  }
  EXPECT_THROW(load_robot("./nothing.yaml"), std::invalid_argument);
}

TEST(Refusals, NameFileLineAndExpectation) {
  EXPECT_EQ(refusal_after("title: UR5e", "title: UR5e"), "accepted");
  EXPECT_THAT(refusal_after("title: UR5e", "titel: UR5e"),
              AllOf(HasSubstr("changed.yaml:3: "), HasSubstr("did you mean 'title'?")));
  EXPECT_THAT(refusal_after("position_m: [0, 0, 0.1625]", "position_m: [0, 0]"),
              HasSubstr("joints: joint1: position_m: expected a list of 3 numbers [m], found a list of 2"));
  EXPECT_THAT(refusal_after("mass_kg: 3.761", "mass_kg: -3.761"),
              AllOf(HasSubstr("inertials: link1: mass_kg"), HasSubstr("above 0")));
  EXPECT_THAT(refusal_after("mass_kg: 3.761", "mass_kg: heavy"),
              HasSubstr("expected a number [kg], above 0, found 'heavy'"));
  EXPECT_THAT(refusal_after("mass_kg: 3.761", "mass_kg: .nan"), HasSubstr("finite"));
  EXPECT_THAT(refusal_after("lower_rad: -3.1416", "lower_rad: -180"), HasSubstr("looks like degrees"));
  EXPECT_THAT(refusal_after("lower_rad: -3.1416", "lower_rad: 3.2"), HasSubstr("must be below"));
  EXPECT_THAT(refusal_after("xx: 0.0103, yy: 0.0103, zz: 0.0067", "xx: 0.0103, yy: 0.0103, zz: 0.0367"),
              AllOf(HasSubstr("inertials: link1"), HasSubstr("not physically consistent")));
  EXPECT_THAT(refusal_after("home_rad: [0,", "home_rad: [7,"), HasSubstr("outside the limits of joint1"));
  EXPECT_THAT(refusal_after("[link4, link6]", "[link4, link9]"), HasSubstr("did you mean"));
  EXPECT_THAT(refusal_after("jerk_rad_per_s3: [5000, ", "jerk_rad_per_s3: ["),
              HasSubstr("a list of 6 numbers"));
  EXPECT_THAT(refusal_after("name: ur5e\n", "name: ur5e\nname: ur5e\n"), HasSubstr("duplicate key 'name'"));
  EXPECT_THAT(refusal_after("name: ur5e\n", "name: ur5e\nbase: nowhere\n"), HasSubstr("there is no file"));
  EXPECT_THAT(refusal_after("name: ur5e\n", "name: ur5e\nbase: changed.yaml\n"), HasSubstr("its own base"));
  EXPECT_THAT(refusal_after("name: ur5e\n", "name: [ur5e\n"), HasSubstr("not readable as YAML"));
}

TEST(Texts, NumbersReadBackExactly) {
  for (const double value : {1.0 / 3.0, -1.570796326794897, 1e-300, 6.02e23, 0.1 + 0.2}) {
    EXPECT_EQ(std::strtod(exact(value).c_str(), nullptr), value);
  }
  EXPECT_EQ(exact(-0.0), "0");
}

TEST(Texts, XmlIsEscapedAndClosed) {
  XmlText xml;
  xml.open("a", {{"name", "x<\"&y"}});
  xml.leaf("b");
  xml.close();
  EXPECT_EQ(xml.text(), "<a name=\"x&lt;&quot;&amp;y\">\n  <b/>\n</a>\n");
  EXPECT_THROW(xml.close(), std::logic_error);
}

TEST(Texts, RefuseAHandThatTheRobotDoesNotHave) {
  const RobotDescription robot = load_robot(kUr5e);
  EXPECT_THROW(to_urdf(robot, {.hand = true}), std::invalid_argument);
  EXPECT_THROW(to_mjcf(robot, {.hand = true}), std::invalid_argument);
}

TEST(Texts, MeshesReplacePrimitives) {
  const RobotDescription fer = load_robot("fer");
  const std::string text = to_mjcf(fer, {.hand = true, .meshes = "some/folder"});
  EXPECT_THAT(text,
              AllOf(HasSubstr("file=\"some/folder/collision/link5.stl\""), HasSubstr("mesh=\"link5\"")));
  EXPECT_THAT(text, testing::Not(HasSubstr("type=\"cylinder\"")));  // no primitive is left
  const auto installed = installed_meshes();
  if (!installed.empty()) {
    for (const auto& mesh : fer.meshes)
      EXPECT_TRUE(std::filesystem::exists(installed / mesh.second)) << mesh.second;
  }
}

void expect_up_to_date(const std::filesystem::path& folder,
                       const std::map<std::string, std::string>& expected) {
  for (const auto& [name, text] : expected) {
    EXPECT_TRUE(content(folder / name) == text)
        << name << " is out of date: build and run the target export_models";
  }
  for (const auto& entry : std::filesystem::directory_iterator(folder)) {
    EXPECT_EQ(expected.count(entry.path().filename().string()), 1u) << entry.path() << " belongs to no robot";
  }
}

TEST(Generated, FilesAreUpToDate) {
  EXPECT_EQ(exported_models().size(), 12u);
  expect_up_to_date(MULTIPANDA_SOURCE_DIR "/models/generated", exported_models());
  EXPECT_EQ(exported_descriptions().size(), 4u);
  expect_up_to_date(MULTIPANDA_SOURCE_DIR "/ros/multipanda_description/urdf/generated",
                    exported_descriptions());
}

// Robots are read once; a changed file, or a changed base, is read again.
TEST(Models, AChangedFileIsReadAgain) {
  const auto folder = std::filesystem::path(MULTIPANDA_BINARY_DIR) / "known_models";
  std::filesystem::create_directories(folder);
  const auto write = [&](const char* name, const std::string& text) { std::ofstream(folder / name) << text; };
  const auto own = (folder / "own.yaml").string();
  write("between.yaml", "name: between\ntitle: Between\nbase: fer\nrated_payload_kg: 1\n");
  write("own.yaml", "name: own\ntitle: First\nbase: between\n");
  EXPECT_EQ(load_robot(own).title, "First");
  EXPECT_EQ(load_robot(own).rated_payload, 1);
  write("own.yaml", "name: own\ntitle: Other\nbase: between\n");  // as long as before
  EXPECT_EQ(load_robot(own).title, "Other");
  write("between.yaml", "name: between\ntitle: Between\nbase: fer\nrated_payload_kg: 2\n");
  EXPECT_EQ(load_robot(own).rated_payload, 2);
  EXPECT_THAT(robot_files(own), testing::IsSupersetOf({models_folder() / "fer.yaml", folder / "between.yaml",
                                                       std::filesystem::path(own)}));
  EXPECT_THAT(robot_files(MULTIPANDA_SOURCE_DIR "/tests/models/ur5.yaml"), testing::SizeIs(9))
      << "and its URDF, and the seven meshes that the capsules are fitted to";
}

}  // namespace
}  // namespace multipanda::models_test
