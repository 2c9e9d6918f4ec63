#include <cmath>

#include <gtest/gtest.h>

#include "backends/mujoco/testing/test_scenes.hpp"

namespace multipanda::fidelity_test {
namespace {

using namespace test;

// tau_J on joint 1 of an upright arm has no gravity: it shows the torque path alone.
TEST(Fidelity, StepResponseHasTheDelayAndBandwidthStated) {
  PlantFidelity plant{.name = "slow", .torque_bandwidth_hz = 50, .command_delay_s = 0.003};
  Loop loop(scene_of({arm_named("a")}, plant));
  loop.steps(10);
  loop.commands[0].tau_cmd[0] = 1;
  for (int k = 1; k <= 40; ++k) {
    loop.step();
    const double expected = k <= 3 ? 0 : 1 - std::exp(-2 * M_PI * 50 * 0.001 * (k - 3));
    EXPECT_NEAR(loop.state().tau_J[0], expected, 1e-9) << k;
    EXPECT_EQ(loop.state().tau_J_d[0], k <= 3 ? 0 : 1);
  }
}

// The table's function in another form: p1/2 (tanh(p2 (dq + p3) / 2) - tanh(p2 p3 / 2)).
TEST(Fidelity, FrictionFollowsTheTable) {
  const double p1[] = {0.54615, 0.87224, 0.64068, 1.2794, 0.83904, 0.30301, 0.56489};
  const double p2[] = {5.1181, 9.0657, 10.136, 5.5903, 8.3469, 17.133, 10.336};
  const double p3[] = {0.039533, 0.025882, -0.046070, 0.036194, 0.026226, -0.021047, 0.0035526};
  const SceneArm arm = arm_named("a");
  Loop loop(scene_of({arm}, {.name = "rubbing", .joint_friction = true}));
  loop.unwatch();
  ModelTerms terms = terms_of(arm);
  std::mt19937 random(3);
  const auto& limits = terms.model().limits();
  for (int trial = 0; trial < 30; ++trial) {
    const JointVector dq = random_between(-0.5 * limits.dq_max, 0.5 * limits.dq_max, random);
    set_plant(loop.backend, 0, arm.q_start, dq);
    terms.update(arm.q_start, dq);
    loop.step();
    const JointVector friction = loop.commands[0].tau_cmd + terms.g() - loop.state().tau_J;
    for (int i = 0; i < 7; ++i) {
      const auto table = [&](double v) {
        return 0.5 * p1[i] * (std::tanh(0.5 * p2[i] * (v + p3[i])) - std::tanh(0.5 * p2[i] * p3[i]));
      };
      // Taken along the tangent to the velocity at the step's end: off by at most half the curvature times
      // the change squared.
      const double change = loop.state().dq[i] - dq[i];
      const double bound = 0.5 * 0.1 * p1[i] * p2[i] * p2[i] * change * change + 1e-9;
      EXPECT_NEAR(friction[i], table(loop.state().dq[i]), bound) << i;
    }
    // tau_J moves the links: M ddq + c + g.
    const JointVector moved = terms.M() * (loop.state().dq - dq) / 0.001 + terms.c() + terms.g();
    EXPECT_LT((moved - loop.state().tau_J).cwiseAbs().maxCoeff(), 1e-6);
  }
}

TEST(Fidelity, FrictionBringsLightJointsToRest) {
  const SceneArm arm = arm_named("a", {}, false);
  Loop loop(scene_of({arm}, {.name = "rubbing", .joint_friction = true}));
  loop.step();
  JointVector dq = joint_constant(7, 0);
  dq[6] = 2;
  set_plant(loop.backend, 0, arm.q_start, dq);
  loop.steps(3000);
  EXPECT_LT(loop.state().dq.cwiseAbs().maxCoeff(), 1e-3);
}

TEST(Fidelity, NoiseHasTheDeviationStatedAndFollowsTheSeed) {
  PlantFidelity plant{.name = "noisy", .noise_q_rad = 1e-5, .noise_dq_rad_per_s = 1e-3, .noise_tau_nm = 0.05};
  Scene scene = scene_of({arm_named("a"), arm_named("b", pose(0, 2, 0))}, plant);
  Loop loop(scene), again(scene);
  scene.seed = 2;
  Loop other(scene);
  ModelTerms terms = terms_of(scene.arms[0]);
  terms.update(ready(), joint_constant(7, 0));
  constexpr int kSteps = 4000;
  double sum_q = 0, sum_dq = 0, sum_tau = 0, mean_tau = 0, product = 0;
  for (int k = 0; k < kSteps; ++k) {
    loop.step();
    again.step();
    other.step();
    sum_q += (loop.state().q - ready()).squaredNorm();
    sum_dq += loop.state().dq.squaredNorm();
    sum_tau += (loop.state().tau_J - terms.g()).squaredNorm();
    mean_tau += (loop.state().tau_J - terms.g()).sum();
    product += loop.state(0).dq.dot(loop.state(1).dq);
    ASSERT_EQ(loop.state().q, again.state().q);
    ASSERT_NE(loop.state().q, other.state().q);
  }
  constexpr double n = 7.0 * kSteps;  // the deviation of a deviation is 1/sqrt(2 n) = 0.4 %
  EXPECT_NEAR(std::sqrt(sum_q / n), 1e-5, 0.02 * 1e-5);
  EXPECT_NEAR(std::sqrt(sum_dq / n), 1e-3, 0.02 * 1e-3);
  EXPECT_NEAR(std::sqrt(sum_tau / n), 0.05, 0.02 * 0.05);
  EXPECT_LT(std::abs(mean_tau / n), 5 * 0.05 / std::sqrt(n));
  EXPECT_LT(std::abs(product / n), 5 * 1e-6 / std::sqrt(n));  // arms do not share their noise
}

TEST(Fidelity, DelayMustBeWholePeriods) {
  EXPECT_THROW(MujocoBackend(scene_of({arm_named("a")}, {.command_delay_s = 0.0005})), std::invalid_argument);
}

}  // namespace
}  // namespace multipanda::fidelity_test
