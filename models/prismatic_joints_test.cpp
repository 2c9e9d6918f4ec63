// Prismatic joints of imported arms and of model files, against Pinocchio, MuJoCo and closed forms.
#include <cmath>
#include <filesystem>
#include <fstream>
#include <regex>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "models/testing/odd_robot.hpp"
#include "models/testing/panda_on_axis.hpp"
#include "models/write_robot.hpp"

namespace multipanda::prismatic_joints_test {
namespace {

using namespace test;
using Eigen::VectorXd;
using testing::ElementsAre;
using testing::HasSubstr;

// Skew axes: a prismatic joint next to the base, another one in the middle.
std::string sliding_robot() {
  const std::string odd = replaced(OddRobot().text(), "type=\"continuous\"", "type=\"revolute\"");
  return replaced(odd, "name=\"twist\" type=\"revolute\"", "name=\"twist\" type=\"prismatic\"");
}

UrdfChain sliding_chain() {
  return {.base_link = "mast",
          .tip_link = "tool",
          .held_joints = {{"brake", -0.7}, {"thumb", 0.4}},
          .limits = {}};
}

TEST(PrismaticJoints, AnywhereInAChainAreThoseOfTheUrdf) {
  const RobotDescription arm = robot_from_urdf(sliding_robot(), sliding_chain());
  EXPECT_THAT(arm.joint_names, ElementsAre("lift", "shoulder", "elbow", "twist", "wrist"));
  EXPECT_THAT(arm.prismatic, ElementsAre(true, false, false, true, false));
  expect_same_arm(arm, sliding_robot(), "mast", "tool", {{"brake", -0.7}, {"thumb", 0.4}, {"finger", -0.18}},
                  100);
}

std::string panda_urdf() {
  return content(urdf_file("package://example-robot-data/robots/panda_description/urdf/panda.urdf", {}));
}

// The weight of all that an axis carries acts along it, and only that, wherever the joints are.
TEST(PrismaticJoints, UnderAPandaCarryItsWeight) {
  std::string panda;
  try {
    panda = panda_urdf();
  } catch (const std::invalid_argument&) {
    GTEST_SKIP() << "example-robot-data is not installed";
  }
  const std::string whole = panda_on_axis(panda);
  const RobotDescription arm = robot_from_urdf(
      whole, {.base_link = "rail", .tip_link = "panda_hand_tcp", .held_joints = {}, .limits = {}});
  ASSERT_EQ(arm.joint_count(), 8u);
  EXPECT_THAT(arm.prismatic, ElementsAre(true, false, false, false, false, false, false, false));
  expect_same_arm(arm, whole, "rail", "panda_hand_tcp", {}, 40);

  double mass = kCarriageMass;
  const std::regex number("<mass value=\"([0-9.eE+-]+)\"");
  for (std::sregex_iterator at(panda.begin(), panda.end(), number), end; at != end; ++at)
    mass += std::stod((*at)[1]);
  ASSERT_GT(mass, kCarriageMass + 15);
  PinocchioArm engine(to_urdf(arm));
  MujocoArm plant(to_mjcf(arm));
  Random random(5);
  for (const double tilt : {0.0, M_PI / 6, M_PI / 2, -M_PI / 2}) {  // of the axis above the horizontal
    const Pose X_WB{Eigen::AngleAxisd(tilt, Vector3::UnitX()).toRotationMatrix(), {0.3, -0.2, 1}};
    engine.place_base(X_WB);
    plant.place_base(X_WB);
    for (int k = 0; k < 10; ++k) {
      const VectorXd q = random.between(arm.limits.q_min, arm.limits.q_max), still = VectorXd::Zero(8);
      for (const Terms& terms : {engine.terms(q, still, {"flange"}), plant.terms(q, still, {"flange"})}) {
        EXPECT_NEAR(terms.g[0], mass * 9.81 * std::sin(tilt), 1e-9);
        EXPECT_NEAR(terms.M(0, 0), mass, 1e-9);
        EXPECT_LT((terms.jacobians[0].col(0).head<3>() - X_WB.rotation.col(1)).norm(), 1e-12);
        EXPECT_LT(terms.jacobians[0].col(0).tail<3>().norm(), 1e-12);
      }
    }
  }
}

// A folder for model files, removed at the end.
class Folder {
 public:
  Folder() : path_(std::filesystem::path(testing::TempDir()) / ("prismatic_" + std::to_string(::getpid()))) {
    std::filesystem::create_directories(path_);
    write("robot.urdf", sliding_robot());
  }
  ~Folder() { std::filesystem::remove_all(path_); }
  std::string write(const std::string& name, const std::string& text) const {
    std::ofstream(path_ / name) << text;
    return (path_ / name).string();
  }

 private:
  std::filesystem::path path_;
};

std::string refusal(const std::string& file) {
  try {
    (void)load_robot(file);
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
  return "nothing was refused";
}

std::string imported(const std::string& limits) {
  return "name: odd\nurdf: robot.urdf\nbase_link: mast\ntip_link: tool\nheld_joints: {brake: -0.7, thumb: "
         "0.4}\n"
         "limits: {" +
         limits + "}\nself_collision: {capsules: {}, ignored_pairs: []}\n";
}

TEST(PrismaticJoints, HaveLimitsInTheirOwnUnits) {
  const Folder folder;
  const RobotDescription arm =
      load_robot(folder.write("good.yaml", imported("lift: {lower_m: -0.3, upper_m: 0.6, velocity_m_per_s: "
                                                    "0.4, effort_n: 900}, twist: {effort_n: 50}")));
  const JointLimits& limits = arm.limits;
  EXPECT_THAT((std::vector<double>{limits.q_min[0], limits.q_max[0], limits.dq_max[0], limits.tau_max[0]}),
              ElementsAre(-0.3, 0.6, 0.4, 900));
  // The force of a strong axis may reach its limit within 0.1 s; a weak joint has the usual rate.
  EXPECT_THAT(std::vector<double>(limits.tau_rate_max.begin(), limits.tau_rate_max.end()),
              ElementsAre(9000, 1000, 1000, 1000, 1000));
  EXPECT_THAT(std::vector<double>(limits.ddq_max.begin(), limits.ddq_max.end()),
              ElementsAre(5, 10, 10, 5, 10));
  EXPECT_THAT(
      refusal(folder.write("rad.yaml", imported("lift: {upper_rad: 0.6}"))),
      HasSubstr("joint 'lift' is prismatic; expected its limits as lower_m, upper_m, velocity_m_per_s"));
  EXPECT_THAT(refusal(folder.write("m.yaml", imported("wrist: {effort_n: 5}"))),
              HasSubstr("joint 'wrist' is revolute; expected its limits as lower_rad"));
  EXPECT_THAT(refusal(folder.write("both.yaml", imported("lift: {upper_m: 0.6, effort_nm: 5}"))),
              HasSubstr("limits of one kind of joint"));
}

const char* const kOwn = R"(name: crane
title: Crane
joints:
  joint1: {position_m: [0.1, 0.2, 0.3], rpy_rad: [0.4, -0.2, 0.1]}
  joint2: {position_m: [0, 0, 0.2], rpy_rad: [1.2, 0, 0.5], type: prismatic}
flange: {position_m: [0.05, 0, 0.1]}
inertials:
  link0: {mass_kg: 4, com_m: [0, 0, 0], inertia_kg_m2: {xx: 0.1, yy: 0.1, zz: 0.1, xy: 0, xz: 0, yz: 0}}
  link1: {mass_kg: 3, com_m: [0.1, 0, 0.1], inertia_kg_m2: {xx: 0.02, yy: 0.03, zz: 0.04, xy: 0, xz: 0, yz: 0}}
  link2: {mass_kg: 2, com_m: [0, 0.1, 0.2], inertia_kg_m2: {xx: 0.02, yy: 0.03, zz: 0.02, xy: 0, xz: 0, yz: 0}}
limits:
  joint1: {lower_rad: -2, upper_rad: 2, velocity_rad_per_s: 2, effort_nm: 50}
  joint2: {lower_m: -0.2, upper_m: 0.7, velocity_m_per_s: 0.5, effort_n: 200}
interface_limits:
  acceleration_rad_per_s2: [10, 5]
  jerk_rad_per_s3: [5000, 500]
  torque_rate_nm_per_s: [1000, 2000]
home_rad: [0.2, 0.1]
self_collision: {capsules: {}, ignored_pairs: []}
)";

TEST(PrismaticJoints, OfAModelFileSlideAlongZ) {
  const Folder folder;
  const RobotDescription crane = load_robot(folder.write("crane.yaml", kOwn));
  EXPECT_THAT(crane.prismatic, ElementsAre(false, true));
  PinocchioArm engine(to_urdf(crane));
  MujocoArm plant(to_mjcf(crane));
  const Eigen::Vector2d q(0.7, 0.4), dq(1.1, -0.3);
  const Terms found = engine.terms(q, dq, {"flange"});
  expect_equal(plant.terms(q, dq, {"flange"}), found);
  const Pose X_01 =
      crane.joints[0].pose() * Pose{Eigen::AngleAxisd(0.7, Vector3::UnitZ()).toRotationMatrix(), {0, 0, 0}};
  const Pose X_02 = X_01 * crane.joints[1].pose() * Pose{Matrix3::Identity(), {0, 0, 0.4}};
  EXPECT_LT((X_02 * crane.flange.position - found.poses[0].position).norm(), 1e-12);
  EXPECT_LT((X_02.rotation - found.poses[0].rotation).norm(), 1e-12);

  // Written relative to its base, a joint keeps its type.
  RobotDescription individual = crane;
  individual.joints[1].position.z() += 0.001;
  const std::string file = folder.write("individual.yaml", "");
  write_robot(individual, crane, file);
  EXPECT_THAT(load_robot(file).prismatic, ElementsAre(false, true));
  EXPECT_EQ(load_robot(file).joints[1].position, individual.joints[1].position);

  EXPECT_THAT(refusal(folder.write("type.yaml", replaced(kOwn, "type: prismatic", "type: prismatc"))),
              HasSubstr("prismatic"));
  EXPECT_THAT(refusal(folder.write("units.yaml", replaced(kOwn, "lower_m: -0.2", "lower_rad: -0.2"))),
              HasSubstr("lower_m"));
  folder.write("odd.yaml", imported(""));
  EXPECT_THAT(refusal(folder.write("other.yaml",
                                   "name: other\nbase: odd.yaml\njoints:\n"
                                   "  joint1: {position_m: [0, 0, 0], type: revolute}\n"
                                   "  joint2: {position_m: [0, 0, 0]}\n  joint3: {position_m: [0, 0, 0]}\n"
                                   "  joint4: {position_m: [0, 0, 0]}\n  joint5: {position_m: [0, 0, 0]}\n")),
              HasSubstr("the URDF defines this joint as prismatic"));
}

}  // namespace
}  // namespace multipanda::prismatic_joints_test
