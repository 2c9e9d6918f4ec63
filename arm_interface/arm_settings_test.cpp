#include "arm_interface/arm_settings.hpp"

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

// A threshold that no arm reaches is none.
TEST(Thresholds, AreNumbersThatAnArmReaches) {
  ArmModelSource source = test::TestArm::make().source();
  source.limits.tau_max = joint_constant(7, 80);
  source.limits.tau_max[0] = 1500;
  const ArmModel model(source);
  const auto set_at = [&](const char* which, double value) {
    SetCollisionThresholds set = careful_thresholds(model);
    ContactThresholds& t = *which == 'a' ? set.acceleration.emplace(set.nominal) : set.nominal;
    if (which[1] == 't') t.torque_upper[2] = value;
    if (which[1] == 'T') t.torque_upper[0] = value;
    if (which[1] == 'l') t.torque_lower[6] = value;
    if (which[1] == 'w') t.wrench_upper[5] = value;
    if (which[1] == 'W') t.wrench_lower[0] = value;
    return check_request(set, model);
  };
  for (const char* which : {"nt", "nl", "nw", "nW", "at", "al", "aw", "aW"}) {
    EXPECT_EQ(set_at(which, 1000), "") << which;
    EXPECT_THAT(set_at(which, 1001), HasSubstr("at most 1000 N")) << which;
    EXPECT_THAT(set_at(which, 1e300), HasSubstr("at most 1000 N")) << which;
  }
  EXPECT_EQ(set_at("nT", 1500), "") << "an axis that is stronger";
  EXPECT_NE(set_at("nT", 1501), "");
}

// Bounds for contact hold where the end effector is: half a turn of a point meters away throws the real tool.
TEST(EndEffector, IsNoFartherFromTheFlangeThanItsModelSays) {
  ArmModelSource source = test::TestArm::make().source();
  const auto refused = [](const ArmModel& model, const Vector3& p_FE) {
    return check_request(SetFrames{Pose{Matrix3::Identity(), p_FE}, {}}, model);
  };
  const ArmModel usual(source);
  EXPECT_EQ(refused(usual, {0.3, 0, -0.4}), "");
  EXPECT_THAT(refused(usual, {0.3, 0, -0.401}),
              AllOf(HasSubstr("0.5008 m"), HasSubstr("'test'"), HasSubstr("farthest_end_effector_m")));
  source.farthest_end_effector = 1.2;
  EXPECT_EQ(refused(ArmModel(source), {0, 1.2, 0}), "");
  EXPECT_NE(refused(ArmModel(source), {0, 1.21, 0}), "");
}

}  // namespace
}  // namespace multipanda::arm_settings_test
