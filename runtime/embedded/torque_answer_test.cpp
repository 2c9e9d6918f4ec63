// Torques of a program on another clock, on a simulated arm with its own checks, in simulated time.
#include <cmath>

#include <gtest/gtest.h>

#include "backends/simulated_arm/testing/arm_rig.hpp"
#include "core/rt/guard/loop_guard.hpp"
#include "core/testing/lagging_motors.hpp"
#include "runtime/embedded/arm_answer.hpp"
#include "runtime/embedded/testing/two_clocks.hpp"

namespace multipanda::torque_answer_test {
namespace {

using test::ArmRig;
using test::ClocksConfig;
using test::Draw;
using test::Quintics;
using test::TwoClocks;

// A program's law: joint springs about a motion, as of the newest state that it has.
struct Program {
  Program(const ArmRig& rig, double speed, std::uint32_t seed) : tau(rig.zero()) {
    for (Eigen::Index i = 0; i < 7; ++i) {
      axes.emplace_back(rig.q[i],
                        Quintics::Limits{.range = 0.3, .velocity = speed, .acceleration = 2, .jerk = 200},
                        seed + static_cast<std::uint32_t>(i));
    }
  }
  void compute(double t, const JointVector& q, const JointVector& dq) {
    const JointVector K = test_stiffness();
    for (Eigen::Index i = 0; i < 7; ++i) {
      double v = 0;
      const double x = axes[static_cast<std::size_t>(i)].at(t, v);
      tau[i] = K[i] * (x - q[i]) + 0.1 * K[i] * (v - dq[i]);
    }
  }
  static JointVector test_stiffness() {
    JointVector K = joint_constant(7, 200);
    K.tail<3>() << 60, 40, 20;
    return K;
  }
  std::vector<Quintics> axes;
  JointVector tau;
};

struct Trial {
  explicit Trial(const ClocksConfig& config, double speed = 0.8)
      : rig("fer", Draw(3).pose(1)),
        answer(rig.body.shared_model()),
        program(rig, speed, config.seed),
        clocks(config) {
    answer.begin();
    clocks.cycle = [this](std::int64_t now, std::int64_t) {
      program.compute(1e-9 * static_cast<double>(now), rig.state().q, rig.state().dq);
    };
    clocks.publish = [this] { answer.take(program.tau); };
    clocks.packet = [this](bool lost) {
      const JointVector before = sent;
      sent = answer.step(rig.state());
      holding += clocks.now() > 0.2 && answer.is_holding() ? 1 : 0;
      fastest = std::max(fastest, rig.dq.lpNorm<Eigen::Infinity>());
      if (lost && rig.arm.mode() == ArmMode::move) {
        rig.arm.miss_command();
        rig.step();
      } else {
        rig.torque(sent);
        if (before.size() > 0) step = std::max(step, (sent - before).lpNorm<Eigen::Infinity>());
      }
      if (rig.arm.errors() != 0) reflex = true;
    };
  }
  ArmRig rig;
  TorqueAnswer answer;
  Program program;
  TwoClocks clocks;
  JointVector sent;
  double step = 0, fastest = 0;
  int holding = 0;  // periods, after the beginning
  bool reflex = false;
};

TEST(TorqueAnswer, NoReflexOverPhasesDriftsJitterStallsAndLosses) {
  test::Series series;
  std::uint32_t seed = 0;
  for (const std::int64_t jitter : {20'000, 200'000, 1'000'000}) {
    for (const double ppm : {-50.0, 50.0}) {
      ++seed;
      if (!series.takes(true)) continue;
      Trial trial({.drift_ppm = ppm,
                   .phase_ns = static_cast<std::int64_t>(seed * 373'000 % 1'000'000),
                   .jitter_ns = jitter,
                   .stalls_per_s = 1,
                   .loss = 0.02,
                   .seed = seed});
      trial.clocks.run(static_cast<int>(1000 * test::trial_seconds(series, 4)));
      EXPECT_FALSE(trial.reflex) << jitter << " ns, " << ppm
                                 << " ppm: " << static_cast<int>(trial.rig.arm.reflex_detail().error);
      EXPECT_EQ(trial.rig.arm.mode(), ArmMode::move);
      EXPECT_GT(trial.fastest, 0.2);
      EXPECT_EQ(trial.holding, 0);  // stalls of 5 ms are no silence
      series.record("fastest_rad_per_s", trial.fastest);
    }
  }
}

TEST(TorqueAnswer, ASilentProgramsArmIsHeldAndComesBackFadedIn) {
  for (const std::uint32_t seed : {1u, 2u, 3u, 4u}) {
    Trial trial({.phase_ns = 300'000, .jitter_ns = 50'000, .seed = seed}, 1.5);
    trial.clocks.run(700);
    while (trial.rig.dq.lpNorm<Eigen::Infinity>() < 0.4) trial.clocks.run(1);
    trial.clocks.program_runs = false;
    // The last torque is kept for 20 ms, not longer.
    trial.clocks.run(15);
    EXPECT_FALSE(trial.answer.is_holding());
    trial.clocks.run(8);
    EXPECT_TRUE(trial.answer.is_holding());
    EXPECT_TRUE(trial.answer.fell_silent());
    const JointVector q = trial.rig.q;
    const double speed = trial.rig.dq.lpNorm<Eigen::Infinity>();
    trial.clocks.run(600);
    EXPECT_TRUE(trial.answer.is_at_rest());
    EXPECT_LT(trial.rig.dq.lpNorm<Eigen::Infinity>(), 0.02);
    EXPECT_LT((trial.rig.q - q).lpNorm<Eigen::Infinity>(), 0.02 * std::max(1.0, speed)) << speed;
    // Later torques do not count before the program was resumed; then they fade in.
    trial.clocks.program_runs = true;
    trial.clocks.run(50);
    EXPECT_TRUE(trial.answer.is_holding());
    trial.answer.resume();
    trial.clocks.run(50);
    EXPECT_TRUE(trial.answer.is_holding());
    trial.clocks.run(100);
    EXPECT_FALSE(trial.answer.is_holding());
    EXPECT_FALSE(trial.reflex);
    EXPECT_LE(trial.step, 1.0);
  }
}

// Without this law: the last torque for ever, or none, on a moving arm.
TEST(TorqueAnswer, NeverZeroOnAMovingArmThatIsLeft) {
  Trial trial({.phase_ns = 300'000, .seed = 5}, 1.5);
  trial.clocks.run(500);
  while (trial.rig.dq.lpNorm<Eigen::Infinity>() < 0.4) trial.clocks.run(1);
  const JointVector q = trial.rig.q, dq = trial.rig.dq;
  trial.answer.hold();
  double braking = 0;
  for (int k = 0; k < 40; ++k) {
    trial.clocks.run(1);
    braking = std::min(braking, trial.sent.dot(trial.rig.dq));
  }
  EXPECT_LT(braking, -0.5);  // [W]
  trial.clocks.run(500);
  EXPECT_TRUE(trial.answer.is_at_rest());
  EXPECT_FALSE(trial.reflex);
  // Its captured posture is that of the call, whatever comes from the program.
  EXPECT_LT((trial.rig.q - q).lpNorm<Eigen::Infinity>(), 0.03 * std::max(1.0, dq.lpNorm<Eigen::Infinity>()));
}

// It holds as the controllet `hold` does, whose test this is: on FR3's bare flange the wrist would turn
// against the spring of its last joint at 600 rad/s, behind motors that bear 110.
class HoldBehindDelay : public testing::TestWithParam<Eigen::Index> {};
INSTANTIATE_TEST_SUITE_P(Periods, HoldBehindDelay, testing::Values(1, 3));

TEST_P(HoldBehindDelay, OfASilentProgramIsStableBehindMotorsThatLag) {
  Draw draw(85);
  for (const bool hand : {true, false}) {
    ArmRig rig("fr3", {}, {}, {}, hand);
    const auto& model = rig.body.shared_model();
    for (int trial = 0; trial < 20; ++trial) {
      const JointVector q = test::pose_within_limits(draw, *model);
      ArmState state = rig.state();
      state.tau_J_d.setZero();
      TorqueAnswer answer(model);
      answer.begin();
      const auto torque = [&](const JointVector& at, const JointVector& dq) -> JointVector {
        state.q = at;
        state.dq = dq;
        return answer.step(state);
      };
      EXPECT_EQ(torque(q, rig.zero()).norm(), 0);  // from here on it holds q
      ASSERT_TRUE(answer.is_holding());
      ModelTerms terms(model);
      terms.update(state);
      EXPECT_LT(test::growth_behind_motors(torque, q, terms.M(), GetParam()), 1.0) << q.transpose();
    }
  }
}

// Where it is: a posture beyond the end of a range is left by a command only.
TEST(TorqueAnswer, AnArmBeyondTheEndOfARangeStaysThere) {
  ArmRig rig("fr3");
  ArmState state = rig.state();
  state.q[0] = rig.body.model().limits().q_max[0] + 0.1;
  state.dq.setZero();
  TorqueAnswer answer(rig.body.shared_model());
  answer.begin();
  for (int k = 0; k < 2000; ++k) ASSERT_LT(answer.step(state).norm(), 1e-9) << k;
}

TEST(TorqueAnswer, TorquesThatASceneTightensAreKept) {
  ArmRig rig("fer", Draw(3).pose(1));
  ArmLimits scene = rig.body.shared_model()->limits();
  scene.tau_max[2] = 4;
  scene.tau_rate_max[2] = 100;
  scene.tau_max[3] *= 3;  // looser: does not count
  TorqueAnswer answer(rig.body.shared_model(), 0, &scene);
  answer.begin();
  double most = 0, step = 0, before = 0, joint4 = 0;
  ArmState state = rig.state();
  for (int k = 0; k < 400; ++k) {
    answer.take(joint_constant(7, 500));
    const JointVector tau = answer.step(state);
    state.tau_J_d = tau;
    most = std::max(most, std::abs(tau[2]));
    step = std::max(step, std::abs(tau[2] - before));
    before = tau[2];
    joint4 = std::max(joint4, std::abs(tau[3]));
  }
  EXPECT_EQ(most, 4);
  EXPECT_LE(step, 0.1);
  EXPECT_EQ(joint4, rig.body.shared_model()->limits().tau_max[3]);
}

TEST(TorqueAnswer, NeverAllocatesOrLocks) {
  if (!kLoopGuardWorks) GTEST_SKIP() << "sanitizers replace malloc themselves";
  ArmRig rig("fr3");
  TorqueAnswer answer(rig.body.shared_model(), 100);
  answer.begin();
  LoopGuard::arm();
  for (int k = 0; k < 200; ++k) {
    if (k < 50 || k > 100) answer.take(rig.now);
    if (k == 110) answer.resume();
    (void)answer.step(rig.state());
  }
  const LoopGuardCounts counts = LoopGuard::disarm();
  EXPECT_EQ(counts.heap_calls, 0u);
  EXPECT_EQ(counts.lock_calls, 0u);
}

}  // namespace
}  // namespace multipanda::torque_answer_test
