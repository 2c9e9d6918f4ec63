#include "device/arm_settings.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/testing/test_arm.hpp"

namespace multipanda::arm_settings_test {
namespace {

using testing::AllOf;
using testing::HasSubstr;

std::string refusal(const ArmModel& model, double mass, const Vector3& p_FC) {
  Load load;
  load.mass = mass;
  load.p_FC = p_FC;
  return check_request(SetLoad{load}, model);
}

// An arm pushes up what is declared and not there, at the lever of its center of mass.
TEST(DeclaredPayload, WeighsNoMoreAtTheFlangeThanTheWeakestJointCarries) {
  ArmModelSource source = test::TestArm::make().source();
  source.limits.tau_max = joint_constant(7, 87);
  source.limits.tau_max[6] = 12;
  source.largest_load = 2;
  const ArmModel model(source);
  // 2 kg weigh 19.62 N, and 12 N m at 0.612 m.
  EXPECT_EQ(refusal(model, 2, {0, 0, 0.61}), "");
  EXPECT_EQ(refusal(model, 2, {0.43, -0.43, 0}), "");  // at 0.608 m
  EXPECT_THAT(refusal(model, 2, {0.44, -0.44, 0}),
              AllOf(HasSubstr("0.6223 m"), HasSubstr("12 N m"), HasSubstr("'test'")));
  EXPECT_THAT(refusal(model, 0.2, {0, 0, -7}), HasSubstr("check the center of mass"));
  EXPECT_EQ(refusal(model, 0.01, {0, 0, 7}), "");  // next to nothing
  EXPECT_EQ(refusal(model, 0, {0, 0, 1}), "");
  EXPECT_THAT(refusal(model, 2.1, {0, 0, 0}), HasSubstr("too heavy"));
}

// A slide of 30 kg, its axis up to vertical and 600 N strong, and behind it a joint that turns, perhaps with
// another slide.
std::string lift(double tilt, const std::string& second, double mass) {
  const auto link = [](const char* name, double m) {
    return std::string("<link name='") + name + "'><inertial><mass value='" + std::to_string(m) +
           "'/><inertia ixx='1' ixy='0' ixz='0' iyy='1' iyz='0' izz='1'/></inertial></link>";
  };
  const auto joint = [](const char* name, const std::string& type, const char* parent, const char* child,
                        const char* axis, const char* effort) {
    return std::string("<joint name='") + name + "' type='" + type + "'><parent link='" + parent +
           "'/><child link='" + child + "'/><axis xyz='" + axis +
           "'/><limit lower='-1' upper='1' velocity='1' effort='" + effort + "'/></joint>";
  };
  ArmModelSource source;
  source.name = "lift";
  source.urdf = "<robot name='lift'><link name='base'/>" + link("carriage", 25) + link("boom", 3) +
                link("tip", 2) + joint("slide", "prismatic", "base", "carriage", "0 1 0", "600") +
                joint("turn", "revolute", "carriage", "boom", "0 0 1", "900") +
                joint("last", second, "boom", "tip", "1 0 0", second == "prismatic" ? "40" : "900") +
                "</robot>";
  source.flange = "tip";
  source.X_WB = {rotation_from_rpy({tilt, 0, 0.7}), {1, 2, 3}};
  source.largest_load = 60;
  return refusal(ArmModel(source), mass, {0, 0, 0});
}

// Whatever its lever, all of a payload's weight acts along a prismatic joint.
TEST(DeclaredPayload, WeighsNoMoreThanTheAxesCarry) {
  const double most = 600 / 9.81 - 30;  // 31.16 kg
  for (const double sign : {1.0, -1.0}) {
    EXPECT_EQ(lift(sign * M_PI / 2, "revolute", most - 0.01), "");
    EXPECT_THAT(lift(sign * M_PI / 2, "revolute", most + 0.01),
                AllOf(HasSubstr("prismatic joint1"), HasSubstr("600 N"), HasSubstr("30 kg")));
  }
  EXPECT_EQ(lift(M_PI / 6, "revolute", 59), "");  // 0.5 g (30 + 59) kg = 437 N
  EXPECT_EQ(lift(0, "revolute", 59), "");         // level
  // Behind a joint that turns, an axis counts as vertical: 40 N carry 2 kg and 2.07 kg more.
  EXPECT_EQ(lift(0, "prismatic", 2.07), "");
  EXPECT_THAT(lift(0, "prismatic", 2.08), HasSubstr("prismatic joint3"));
  EXPECT_EQ(lift(0, "prismatic", 0), "");
}

}  // namespace
}  // namespace multipanda::arm_settings_test
