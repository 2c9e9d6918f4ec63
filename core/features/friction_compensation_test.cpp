#include <cmath>

#include <gtest/gtest.h>

#include "core/features/builtins.hpp"
#include "core/testing/controllet_rig.hpp"
#include "core/testing/test_arm.hpp"

namespace multipanda::friction_compensation_test {
namespace {

using namespace test;

JointFrictionTable some_table(std::size_t n, double scale = 1) {
  Draw draw(77);
  JointFrictionTable table{joint_constant(n, 0), joint_constant(n, 0), joint_constant(n, 0)};
  for (Eigen::Index i = 0; i < table.p1.size(); ++i) {
    table.p1[i] = scale * draw.uniform(0.3, 1.2);
    table.p2[i] = draw.uniform(5, 20);
    table.p3[i] = draw.uniform(-0.05, 0.05);
  }
  return table;
}

std::shared_ptr<const ArmModel> arm(bool known, const std::string& name = "test") {
  auto source = TestArm::make().source({}, name);
  if (known) source.known_friction = some_table(7);
  return std::make_shared<const ArmModel>(std::move(source));
}

// Franka's form of the law, written with tanh: 1 / (1 + exp(-x)) = (1 + tanh(x / 2)) / 2.
double friction(const JointFrictionTable& t, Eigen::Index i, double dq) {
  return 0.5 * t.p1[i] * (std::tanh(0.5 * t.p2[i] * (dq + t.p3[i])) - std::tanh(0.5 * t.p2[i] * t.p3[i]));
}

TEST(FrictionCompensation, AddsItsShareOfTheKnownFrictionAndFadesAtRest) {
  Draw draw(1);
  const JointFrictionTable table = some_table(7);
  ControlletRig rig(friction_compensation_feature(), {arm(true)});
  rig.set("gain", {0.7});
  rig.set("fade_rad_per_s", {0.02});
  ASSERT_EQ(rig.start(), LawResult::ok);
  for (int trial = 0; trial < 300; ++trial) {
    const JointVector dq = draw.joints(7, std::pow(10.0, draw.uniform(-4, 0.3)));
    rig.place(0, draw.joints(7, 1), dq);
    ASSERT_EQ(rig.update(), LawResult::ok);
    double power = 0;
    for (Eigen::Index i = 0; i < 7; ++i) {
      const double true_one = friction(table, i, dq[i]);
      const double share = 0.7 / (1 + 0.02 * 0.02 / (dq[i] * dq[i]));
      EXPECT_NEAR(rig.tau(0)[i], share * true_one, 1e-12);
      // In phase with the friction and never larger: both together dissipate power.
      EXPECT_GE(rig.tau(0)[i] * dq[i], 0);
      EXPECT_LE(std::abs(rig.tau(0)[i]), std::abs(true_one) + 1e-15);
      power += rig.tau(0)[i] * dq[i];
    }
    EXPECT_NEAR(rig.output("power_w")[0], power, 1e-12);
    EXPECT_NEAR(rig.output("largest_torque_nm")[0], rig.tau(0).lpNorm<Eigen::Infinity>(), 1e-15);
  }
  rig.place(0, joint_constant(7, 0.3), joint_constant(7, 0));
  ASSERT_EQ(rig.update(), LawResult::ok);
  EXPECT_EQ(rig.tau(0).norm(), 0);
}

// Velocity noise about rest gives negligible torque, so there is no chatter: at a tenth of the fade the
// slope is a hundredth of what the table alone has.
TEST(FrictionCompensation, IsFlatAtRest) {
  const JointFrictionTable table = some_table(7);
  ControlletRig rig(friction_compensation_feature(), {arm(true)});
  rig.set("gain", {1});
  for (const double dq : {1e-6, 1e-4, 1e-3, -1e-3}) {
    rig.place(0, joint_constant(7, 0.3), joint_constant(7, dq));
    ASSERT_EQ(rig.update(), LawResult::ok);
    for (Eigen::Index i = 0; i < 7; ++i) {
      EXPECT_LE(std::abs(rig.tau(0)[i]), 0.011 * table.p1[i] * table.p2[i] / 4 * 1.3 * std::abs(dq));
    }
  }
}

TEST(FrictionCompensation, IsRefusedWithItsReason) {
  const Models unknown{arm(true, "left"), arm(false, "right")}, known{arm(true, "left"), arm(true, "right")};
  const FeatureType type = friction_compensation_feature();
  const std::vector<ArmIndex> first{0}, second{1}, both{0, 1};
  const auto refusal = [&](const Models& models, const std::vector<ArmIndex>& own, ArmSet compensated) {
    return std::string(type.create({models, own, {}, compensated})->refusal());
  };
  EXPECT_EQ(refusal(unknown, first, {}), "");
  EXPECT_NE(refusal(unknown, second, {}).find("'right'"), std::string::npos);
  EXPECT_NE(refusal(unknown, both, {}).find("known_friction"), std::string::npos);
  EXPECT_EQ(refusal(known, both, {}), "");
  EXPECT_NE(refusal(known, both, ArmSet::of(1)).find("'right'"), std::string::npos);
  EXPECT_EQ(refusal(known, first, ArmSet::of(1)), "");

  ControlletRig rig(type, {arm(false)});
  EXPECT_EQ(rig.start(), LawResult::fault);
}

}  // namespace
}  // namespace multipanda::friction_compensation_test
