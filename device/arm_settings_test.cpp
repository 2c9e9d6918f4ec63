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

// What an axis carries acts along it: its newtons are no bound for a moment.
TEST(DeclaredPayload, HasNoMomentAboutAPrismaticJoint) {
  ArmModelSource source = test::TestArm::make().source();
  const std::string turns = "type='revolute'";
  source.urdf.replace(source.urdf.find(turns), turns.size(), "type='prismatic'");
  source.limits.tau_max = joint_constant(7, 12);
  source.limits.tau_max[0] = 5;
  source.largest_load = 2;
  const ArmModel model(source);
  ASSERT_TRUE(model.is_prismatic(0));
  EXPECT_EQ(refusal(model, 2, {0, 0, 0.61}), "");
  EXPECT_THAT(refusal(model, 2, {0, 0, 0.62}), HasSubstr("12 N m"));
}

}  // namespace
}  // namespace multipanda::arm_settings_test
