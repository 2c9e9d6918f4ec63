// Compares estimated forces with known forces.
#include <complex>

#include <gtest/gtest.h>

#include "backends/mujoco/testing/forces_rig.hpp"

namespace multipanda::forces_test {
namespace {

using namespace test;

PlantFidelity without_friction(PlantFidelity plant) {
  plant.joint_friction = false;
  return plant;
}

void expect_static(const WrenchError& error) {
  EXPECT_LT(error.force.max, 0.05);
  EXPECT_LT(error.torque.max, 0.01);
}

// Noise passes the observer, but it has no bias: its mean over half a second is nearly zero.
void expect_realistic(const WrenchError& error) {
  EXPECT_LT(error.force.bias, 0.25);
  EXPECT_LT(error.force.rms, 1.5);
  EXPECT_LT(error.torque.bias, 0.05);
  EXPECT_LT(error.torque.rms, 0.3);
}

TEST(Forces, PushesAtTheToolAreTheirReaction) {
  for (const auto& [name, arm] : measured_arms()) {
    SCOPED_TRACE(name);
    expect_static(error_under_pushes(arm, PlantFidelity::ideal()));
  }
}

TEST(Forces, PayloadIsAForceOnlyIfItWasNotDeclared) {
  for (const auto& [name, arm] : measured_arms()) {
    for (const bool declared : {false, true}) {
      SCOPED_TRACE(name + (declared ? ", declared" : ", not declared"));
      expect_static(error_with_payload(arm, declared, PlantFidelity::ideal()));
    }
  }
}

TEST(Forces, PressingAndSqueezingMatchTheContacts) {
  for (const auto& [name, arm] : measured_arms()) {
    SCOPED_TRACE(name);
    expect_static(error_pressing(arm, PlantFidelity::ideal()));
  }
  SCOPED_TRACE("squeezing");
  expect_static(error_squeezing(PlantFidelity::ideal()));
}

TEST(Forces, FreeMotionIsNoForce) {
  for (const auto& [name, arm] : measured_arms()) {
    SCOPED_TRACE(name);
    EXPECT_LT(error_in_motion(arm, PlantFidelity::ideal()).force.max, 0.1);
  }
}

TEST(Forces, RealisticPlantAddsNoiseAndFrictionNothing) {
  const auto arms = measured_arms();
  const SceneArm& arm = arms.back().arm;
  const PlantFidelity real = PlantFidelity::realistic();
  expect_realistic(error_under_pushes(arm, real));
  expect_realistic(error_pressing(arm, real));
  expect_realistic(error_squeezing(real));
  const WrenchError rubbing = error_in_motion(arm, real),
                    smooth = error_in_motion(arm, without_friction(real));
  expect_realistic(rubbing);
  EXPECT_NEAR(rubbing.force.bias, smooth.force.bias, 0.1);
  EXPECT_NEAR(rubbing.force.rms, smooth.force.rms, 0.1);
}

// A first-order low-pass of 30 Hz by backward Euler, H(z) = a / (1 + a - 1/z) with a = 2 pi 30 Hz 1 ms, of
// the period's mean force, which lies half a period back.
TEST(Forces, EstimateHasTheBandwidthAndLagStated) {
  constexpr double kPeriod = 0.001;
  const double a = 2 * M_PI * ExternalForceObserver::kBandwidth * kPeriod;
  for (const double f : {1.0, 5.0, 10.0, 27.56, 60.0}) {
    const double turn = 2 * M_PI * f * kPeriod;
    const std::complex<double> H = a / (1 + a - std::polar(1.0, -turn));
    const Response response = response_to_sine(f, PlantFidelity::ideal());
    EXPECT_NEAR(response.gain, std::abs(H), 0.005) << f;
    EXPECT_NEAR(response.lag_s, -std::arg(H) / (2 * M_PI * f) + 0.5 * kPeriod, 1e-4) << f;
    if (f == 27.56) {
      EXPECT_NEAR(response.gain, std::sqrt(0.5), 0.005);
    }
  }
  const Response ideal = response_to_sine(10, PlantFidelity::ideal());
  const Response noisy = response_to_sine(10, PlantFidelity::realistic());
  EXPECT_NEAR(noisy.gain, ideal.gain, 0.03);
  EXPECT_NEAR(noisy.lag_s, ideal.lag_s, 5e-4);
  const StepResponse step = response_to_step(PlantFidelity::ideal());
  EXPECT_NEAR(step.to_63_s, 0.0053, 0.0007);
  EXPECT_LT(step.overshoot, 0.005);
}

}  // namespace
}  // namespace multipanda::forces_test
