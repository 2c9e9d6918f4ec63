// Elastic joints that are measured at their motors, and gear ripple, on bases off the origin and turned.
#include <numbers>

#include <gtest/gtest.h>

#include "backends/simulated_arm/testing/arm_rig.hpp"
#include "core/model/model_terms.hpp"
#include "core/types/spatial.hpp"

namespace multipanda::transmission_test {
namespace {

using test::ArmRig;

const Pose X_WB{rotation_from_rpy({0.5, -0.3, 1.1}), {0.4, -0.2, 0.7}};

SimulatedArmConfig config_with(const Transmission& transmission) {
  SimulatedArmConfig config = ArmRig::config_of("fer", X_WB, {}, {}, true);
  config.transmission = transmission;
  return config;
}

// A joint at rest carries its weight, so the spring is twisted by g / K, the motor ahead of the link in the
// direction of the torque that carries.
TEST(Transmission, ASpringIsTwistedByTheWeightThatItCarries) {
  const JointVector K = (JointVector(7) << 5e3, 8e3, 1e4, 6e3, 9e3, 7e3, 1.2e4).finished();
  ArmRig rig(config_with({.stiffness = K, .ripple = {}, .ripple_cycles = {}, .ripple_phase = {}}));
  rig.steps(300);
  ASSERT_LT(rig.dq.cwiseAbs().maxCoeff(), 1e-6);
  rig.body.update(rig.q, rig.dq);
  ASSERT_GT(rig.body.g().cwiseAbs().maxCoeff(), 10);
  for (int i = 0; i < 7; ++i) {
    EXPECT_NEAR(rig.arm.state().q[i] - rig.q[i], rig.body.g()[i] / K[i], 1e-7) << "joint " << i + 1;
    EXPECT_EQ(rig.arm.state().report.theta[i], rig.arm.state().q[i]);
  }
}

// A gap that docs/like_a_real_arm.md states: between a real motor and its link a step of torque would swing.
TEST(Transmission, SpringsDoNotSwing) {
  ArmRig rig(config_with(
      {.stiffness = joint_constant(7, 5e3), .ripple = {}, .ripple_cycles = {}, .ripple_phase = {}}));
  rig.steps(300);
  const JointVector step = joint_constant(7, 1);
  for (int k = 0; k < 15; ++k) {  // then the bare wrist is too fast
    rig.torque(step);
    EXPECT_LT((rig.arm.state().tau_J - rig.body.g() - step).cwiseAbs().maxCoeff(), 0.05) << k;
  }
}

// A turn of a joint crosses zero twice per cycle, the largest torque is the amplitude, and the work is zero.
TEST(Transmission, RippleHasItsCyclesPerTurnAndDoesNoWork) {
  const JointVector amplitude = (JointVector(7) << 0.1, 0.2, 0.3, 0.15, 0.25, 0.05, 0.12).finished();
  JointVector cycles = joint_constant(7, 160);
  cycles.head(4).setConstant(240);
  ArmRig plain(ArmRig::config_of("fer", X_WB, {}, {}, true));
  ArmRig rippled(config_with({.stiffness = {},
                              .ripple = amplitude,
                              .ripple_cycles = cycles,
                              .ripple_phase = JointVector::LinSpaced(7, 0.05, 0.65)}));
  constexpr int kSteps = 48'000;
  for (int i = 0; i < 7; ++i) {
    JointVector q = plain.q;
    int crossings = 0;
    double largest = 0, work = 0, before = 0;
    for (int k = 0; k <= kSteps; ++k) {
      q[i] = plain.q[i] + 2 * std::numbers::pi * k / kSteps;
      // In an arm that holds: both have the same torque but for the ripple.
      const JointVector difference = rippled.arm.motor_torque(q, joint_constant(7, 0), 0) -
                                     plain.arm.motor_torque(q, joint_constant(7, 0), 0);
      const double now = difference[i];
      if (k > 0) crossings += (now > 0) != (before > 0) ? 1 : 0;
      if (k > 0) work += 0.5 * (now + before) * 2 * std::numbers::pi / kSteps;
      largest = std::max(largest, std::abs(now));
      before = now;
    }
    EXPECT_EQ(crossings, 2 * static_cast<int>(cycles[i])) << "joint " << i + 1;
    EXPECT_NEAR(largest, amplitude[i], 1e-3 * amplitude[i]);
    EXPECT_NEAR(work, 0, 1e-9);
  }
}

TEST(Transmission, RefusesWhatDoesNotFitTheArm) {
  EXPECT_THROW(ArmRig(config_with({.stiffness = joint_constant(6, 1e4)})), std::invalid_argument);
  EXPECT_THROW(ArmRig(config_with({.stiffness = joint_constant(7, 0)})), std::invalid_argument);
  EXPECT_THROW(ArmRig(config_with({.ripple = joint_constant(7, 0.1)})), std::invalid_argument);
}

}  // namespace
}  // namespace multipanda::transmission_test
