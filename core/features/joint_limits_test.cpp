#include <gtest/gtest.h>

#include "core/features/builtins.hpp"
#include "core/testing/controllet_rig.hpp"
#include "core/testing/test_arm.hpp"

namespace multipanda::joint_limits_test {
namespace {

using namespace test;

TEST(JointLimits, IsTheGradientOfItsEnergyAndOnlyNearTheLimits) {
  Draw draw(91);
  const auto model = TestArm::make().model();
  const auto& limits = model->limits();
  ControlletRig rig(joint_limits_feature(), {model});
  rig.set("range_rad", {0.2});
  rig.set("stiffness_nm_per_rad", {50});
  ASSERT_EQ(rig.start(), LawResult::ok);
  // V = 1/2 k (r - d)^2 within the range r of the nearer limit.
  const auto energy = [&](Eigen::Index i, double q) {
    const double d = std::min(q - limits.q_min[i], limits.q_max[i] - q);
    return d < 0.2 ? 25.0 * (0.2 - d) * (0.2 - d) : 0.0;
  };
  bool near = false, far = false;
  for (int trial = 0; trial < 500; ++trial) {
    JointVector q = joint_constant(7, 0);
    for (Eigen::Index i = 0; i < 7; ++i) {
      const double beyond = draw.uniform(-0.4, 0.05);  // of a limit
      q[i] = draw.coin() ? limits.q_max[i] + beyond : limits.q_min[i] - beyond;
    }
    rig.place(0, q, joint_constant(7, 0));
    ASSERT_EQ(rig.update(), LawResult::ok);
    for (Eigen::Index i = 0; i < 7; ++i) {
      constexpr double h = 1e-7;
      EXPECT_NEAR(rig.tau(0)[i], -(energy(i, q[i] + h) - energy(i, q[i] - h)) / (2 * h), 1e-4);
      (rig.tau(0)[i] == 0 ? far : near) = true;
    }
    EXPECT_DOUBLE_EQ(rig.output("largest_torque_nm")[0], rig.tau(0).lpNorm<Eigen::Infinity>());
  }
  EXPECT_TRUE(near && far);
}

TEST(JointLimits, DampsOutwardMotionOnlyAndAddsToWhatIsThere) {
  const auto model = TestArm::make().model();
  const auto& limits = model->limits();
  ControlletRig rig(joint_limits_feature(), {model});
  for (const double side : {1.0, -1.0}) {
    JointVector q = joint_constant(7, 0), dq = joint_constant(7, 0);
    q[2] = side > 0 ? limits.q_max[2] - 0.05 : limits.q_min[2] + 0.05;
    rig.place(0, q, dq);
    ASSERT_EQ(rig.update(), LawResult::ok);
    const double still = rig.tau(0)[2];
    EXPECT_LT(still * side, 0);
    dq[2] = side * 0.5;
    rig.place(0, q, dq);
    ASSERT_EQ(rig.update(), LawResult::ok);
    // D = 2, half of the way into the range of 0.1 rad: 2 * 0.5 * 0.5 against the motion.
    EXPECT_NEAR(rig.tau(0)[2], still - side * 0.5, 1e-12);
    dq[2] = -side * 0.5;
    rig.place(0, q, dq);
    ASSERT_EQ(rig.update(), LawResult::ok);
    EXPECT_EQ(rig.tau(0)[2], still);
  }
}

}  // namespace
}  // namespace multipanda::joint_limits_test
