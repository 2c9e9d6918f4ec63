// Which prismatic joints bear weight, by how they are mounted and by what joints before them do.
#include "core/model/prismatic_joints.hpp"

#include <array>
#include <cmath>
#include <optional>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/controllets/contact_bounds.hpp"
#include "core/model/model_terms.hpp"
#include "core/testing/test_arm.hpp"

namespace multipanda::weight_on_an_axis_test {
namespace {

using namespace test;
using testing::AllOf;
using testing::HasSubstr;

// A slide along y of its base, a boom that turns about z, and on it another slide along x: 25, 3 and 2 kg.
// `twice`: the boom turns about a second axis, too, which leans by 0.7 degrees from the first one.
std::shared_ptr<const ArmModel> slide_turn_slide(const Matrix3& R_WB, std::optional<double> largest_load,
                                                 bool twice = false) {
  const auto link = [](const char* name, double m) {
    return std::string("<link name='") + name + "'><inertial><mass value='" + std::to_string(m) +
           "'/><inertia ixx='1' ixy='0' ixz='0' iyy='1' iyz='0' izz='1'/></inertial></link>";
  };
  const auto joint = [](const char* name, const char* type, const char* parent, const char* child,
                        const char* along) {
    return std::string("<joint name='") + name + "' type='" + type + "'><parent link='" + parent +
           "'/><child link='" + child + "'/><axis xyz='" + along +
           "'/><limit lower='-1' upper='1' velocity='1' effort='600'/></joint>";
  };
  ArmModelSource source;
  source.name = "cross";
  source.urdf =
      "<robot name='cross'><link name='base'/>" + link("carriage", 25) + link("boom", 3) + link("tip", 2) +
      joint("slide", "prismatic", "base", "carriage", "0 1 0") +
      joint("turn", "revolute", "carriage", "boom", "0 0 1") +
      (twice ? link("second", 0.1) + joint("turn2", "revolute", "boom", "second", "0.012 0 1") : "") +
      joint("last", "prismatic", twice ? "second" : "boom", "tip", "1 0 0") + "</robot>";
  source.flange = "tip";
  source.X_WB = {R_WB, {1, 2, 3}};
  source.largest_load = largest_load;
  return std::make_shared<const ArmModel>(source);
}

// An axis that can be steeper than 2.9 degrees bears weight, also one that a joint before it turns up.
TEST(PrismaticJoints, BearNoWeight) {
  static_assert(kMostWeight == ContactBounds{}.spring_force);
  const auto why = [](double tilt, double force = 600, std::optional<double> largest_load = 10) {
    const auto model = slide_turn_slide(rotation_from_rpy({tilt, 0, 0}), largest_load);
    return weight_on_an_axis(*model, JointVector::Constant(3, force));
  };
  EXPECT_EQ(why(0), "");
  EXPECT_EQ(why(0, 1), "");  // level: the weakest axis carries none
  for (const double sign : {1.0, -1.0}) {
    EXPECT_THAT(why(sign * M_PI / 2), AllOf(HasSubstr("joint1 of arm 'cross'"), HasSubstr("90 degrees"),
                                            HasSubstr("brake"), HasSubstr("held_joints")));
    EXPECT_THAT(why(sign * M_PI / 6), HasSubstr("30 degrees"));
    // The axis of the joint that turns leans by as much: the second slide may rise by twice the sine.
    EXPECT_THAT(why(sign * 0.03), HasSubstr("joint3"));
    EXPECT_EQ(why(sign * 0.02), "");
  }
  // (30 + 10) kg and 0.02 g press with 7.85 N, a quarter of 31.4 N. Payloads of up to 100 kg count where no
  // bound of them is known.
  EXPECT_EQ(why(0.02, 31.5), "");
  EXPECT_THAT(why(0.02, 31.3), AllOf(HasSubstr("40 kg"), HasSubstr("7.8"), HasSubstr("31.3 N")));
  // The second slide: 102 kg and 0.04 g press with 40.0 N, a quarter of 160 N.
  EXPECT_EQ(why(0.02, 161, {}), "");
  EXPECT_THAT(why(0.02, 159, {}), HasSubstr("102 kg"));
  // What may rest on a person, however strong the drive: (2 + 170) kg press with 67.5 N.
  EXPECT_THAT(why(0.02, 600, 170), AllOf(HasSubstr("172 kg"), HasSubstr("and 60 N")));
  EXPECT_EQ(why(0.02, 600, 145), "");
  EXPECT_THAT(why(0, std::nan("")), HasSubstr("would bear weight"));
  // The limits of the model count as well as those of the commands.
  EXPECT_EQ(why(0.02, 1e9), "");
  EXPECT_EQ(weight_on_an_axis(*TestArm::make(7).model(), joint_constant(7, 87)), "");
}

// Whatever joints do: an arm that is taken has no slope beyond 5 % in any pose.
TEST(PrismaticJoints, OfArmsThatAreTakenStayLevelInEveryPose) {
  Draw draw(71);
  std::array<int, 2> taken{}, refused{};
  std::array<double, 2> steepest{};
  for (int trial = 0; trial < 300; ++trial) {
    const double yaw = draw.uniform(-3, 3), pitch = draw.uniform(-0.04, 0.04);
    const Vector3 rpy(draw.uniform(-0.04, 0.04), pitch, yaw);
    const bool twice = trial % 2 == 1;
    const auto model = slide_turn_slide(rotation_from_rpy(twice ? 0.5 * rpy : rpy), 5, twice);
    const auto joints = static_cast<Eigen::Index>(model->joint_count());
    const bool fits = weight_on_an_axis(*model, joint_constant(model->joint_count(), 600)).empty();
    ++(fits ? taken : refused)[twice];
    if (!fits) continue;
    ModelTerms terms(model);
    for (int k = 0; k < 30; ++k) {
      terms.update(draw.joints(joints, 3.2), JointVector::Zero(joints));
      for (const Eigen::Index slide : {Eigen::Index{0}, joints - 1})
        steepest[twice] = std::max(steepest[twice], std::abs(terms.J_V_WE()(2, slide)));
    }
  }
  for (const bool twice : {false, true}) {
    EXPECT_GT(taken[twice], 10);
    EXPECT_GT(refused[twice], 10);
    EXPECT_LE(steepest[twice], kLevel);
    EXPECT_GT(steepest[twice], 0.3 * kLevel);
  }
}

}  // namespace
}  // namespace multipanda::weight_on_an_axis_test
