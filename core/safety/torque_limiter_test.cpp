#include "core/safety/torque_limiter.hpp"

#include <algorithm>
#include <cmath>
#include <optional>
#include <vector>

#include <gtest/gtest.h>

#include "core/testing/test_arm.hpp"

namespace multipanda::torque_limiter_test {
namespace {

constexpr Eigen::Index kJoints = 7;
constexpr double kRate = 1000, kBound = 80, kStep = kRate * kArmPeriod;

TorqueLimiter limiter(double low_pass_hz = 0) {
  return TorqueLimiter({.tau_max = joint_constant(kJoints, kBound),
                        .tau_rate_max = joint_constant(kJoints, kRate),
                        .period_s = kArmPeriod,
                        .low_pass_hz = low_pass_hz});
}

double step_of(TorqueLimiter& limiter, double in_use, double requested) {
  limiter.observe(joint_constant(kJoints, in_use));
  TorqueLimiter::Cuts cuts;
  return limiter.limit(joint_constant(kJoints, requested), kArmPeriod, cuts)[3];
}

// The answers to packets k, k+1, ... are lost or late while the torque rises: by hand.
TEST(TorqueLimiter, CountsFromWhatIsInUseAndFromWhatWasSent) {
  TorqueLimiter limits = limiter();
  limits.restart(joint_constant(kJoints, 10));
  EXPECT_DOUBLE_EQ(step_of(limits, 10, 50), 11);  // both 10
  EXPECT_DOUBLE_EQ(step_of(limits, 11, 50), 12);  // it arrived
  EXPECT_DOUBLE_EQ(step_of(limits, 11, 50), 12);  // 12 did not: [10, 12] and [11, 13]
  EXPECT_DOUBLE_EQ(step_of(limits, 11, 0), 11);   // nor the second: [10, 12] and [11, 13], downwards
  EXPECT_DOUBLE_EQ(step_of(limits, 11, 0), 10);
  EXPECT_DOUBLE_EQ(step_of(limits, 12, 0), 11);  // the first came late: [9, 11] and [11, 13]
  EXPECT_DOUBLE_EQ(step_of(limits, 14, 0), 13);  // more than two steps apart: by what is in use
  EXPECT_DOUBLE_EQ(step_of(limits, 10, 50), 11);
}

// Sent 12, in use 10, steps of 1: [9, 11] and [11, 13] have one number in common.
TEST(TorqueLimiter, TwoStepsApartOnlyTheMiddleIsAStepFromBoth) {
  for (const double goal : {0.0, 50.0}) {
    TorqueLimiter limits = limiter();
    limits.restart(joint_constant(kJoints, 12));
    EXPECT_DOUBLE_EQ(step_of(limits, 10, goal), 11);
  }
}

// Where it can, the first command of a motion is a step from zero and from what the arm shows.
TEST(TorqueLimiter, AMotionBeginsAtWhatIsShownAndAtZeroIfPossible) {
  const auto first = [](double shown, double requested) {
    TorqueLimiter limits = limiter();
    limits.restart(joint_constant(kJoints, 40));  // of an earlier motion
    limits.begin(joint_constant(kJoints, shown));
    TorqueLimiter::Cuts cuts;
    return limits.limit(joint_constant(kJoints, requested), kArmPeriod, cuts)[3];
  };
  EXPECT_DOUBLE_EQ(first(0, 50), 1);
  EXPECT_DOUBLE_EQ(first(0, -50), -1);
  EXPECT_DOUBLE_EQ(first(1.5, 50), 1);
  EXPECT_DOUBLE_EQ(first(1.5, -50), 0.5);
  EXPECT_DOUBLE_EQ(first(-1.5, 50), -0.5);
  EXPECT_DOUBLE_EQ(first(5, 50), 6);
  EXPECT_DOUBLE_EQ(first(5, -50), 4);
  EXPECT_DOUBLE_EQ(first(std::nan(""), 50), 1);  // says nothing
  EXPECT_DOUBLE_EQ(first(2 * kBound, 50), 1);
}

TEST(TorqueLimiter, TheLimitItselfMayBeInUse) {
  for (const double sign : {1.0, -1.0}) {
    TorqueLimiter limits = limiter();
    limits.restart(joint_constant(kJoints, sign * (kBound - 1)));
    limits.observe(joint_constant(kJoints, sign * kBound));
    EXPECT_EQ(limits.in_use(), joint_constant(kJoints, sign * kBound));
  }
}

// Joints for which there is no number are taken to zero, where they stay.
TEST(TorqueLimiter, WhatIsNotRequestedOrNotKnownIsZero) {
  TorqueLimiter limits = limiter();
  TorqueLimiter::Cuts cuts;
  limits.restart(joint_constant(kJoints, 1.5));
  JointVector requested = joint_constant(4, 1.5);
  requested[0] = std::nan("");
  for (const double left : {0.5, 0.0, 0.0}) {
    const JointVector sent = limits.limit(requested, kArmPeriod, cuts);
    for (const Eigen::Index i : {0, 4, 5, 6}) EXPECT_EQ(sent[i], left) << i;
    for (const Eigen::Index i : {1, 2, 3}) EXPECT_EQ(sent[i], 1.5) << i;
  }
  limits.restart(requested);
  const std::vector<double> known = {0, 1.5, 1.5, 1.5, 0, 0, 0};
  for (Eigen::Index i = 0; i < kJoints; ++i) {
    EXPECT_EQ(limits.sent()[i], known[static_cast<std::size_t>(i)]);
  }
}

// A report is of the first joint that was cut, and of this step.
TEST(TorqueLimiter, ReportsWhatItCut) {
  TorqueLimiter limits = limiter();
  TorqueLimiter::Cuts cuts;
  JointVector requested = joint_constant(kJoints, 0);
  requested[2] = -90;
  requested[5] = 50;
  limits.limit(requested, 0.0005, cuts);
  EXPECT_EQ(cuts.torque.rule, Intervention::torque_clamped);
  EXPECT_EQ(cuts.torque.joint, 2);
  EXPECT_EQ(cuts.torque.value, -90);
  EXPECT_EQ(cuts.torque.limit, kBound);
  EXPECT_EQ(cuts.rate.rule, Intervention::torque_rate_clamped);
  EXPECT_EQ(cuts.rate.joint, 2);
  EXPECT_DOUBLE_EQ(cuts.rate.value, -kBound / 0.0005);
  EXPECT_EQ(cuts.rate.limit, kRate);
  EXPECT_EQ(limits.sent()[2], -0.5);
  EXPECT_EQ(limits.sent()[5], 0.5);
  limits.limit(requested, 0, cuts);
  EXPECT_EQ(cuts.rate.value, 0) << "no time, no rate";
  EXPECT_EQ(limits.sent()[5], 0.5);
  limits.limit(limits.sent(), kArmPeriod, cuts);
  EXPECT_FALSE(cuts.torque);
  EXPECT_FALSE(cuts.rate);
  requested = limits.sent();
  requested[2] = kBound;
  requested[6] = -kBound;
  limits.limit(requested, kArmPeriod, cuts);
  EXPECT_FALSE(cuts.torque) << "the limit itself";
  EXPECT_EQ(cuts.rate.joint, 2);
}

TEST(TorqueLimiter, SinglePrecisionIsNoDifference) {
  test::Draw draw(4);
  for (int k = 0; k < 1000; ++k) {
    TorqueLimiter limits = limiter();
    const double tau = draw.uniform(-70, 70);
    limits.restart(joint_constant(kJoints, tau));
    const double sign = draw.uniform(-1, 1) > 0 ? 1 : -1;
    ASSERT_EQ(step_of(limits, static_cast<double>(static_cast<float>(tau)), sign * 79), tau + sign * kStep);
  }
}

// At rest, 1e-7 N m is the largest difference that rounding explains.
TEST(TorqueLimiter, WhatRoundingExplainsEndsWhereItIsSaidToEnd) {
  for (const double sign : {1.0, -1.0}) {
    TorqueLimiter limits = limiter();
    limits.observe(joint_constant(kJoints, sign * 1e-7));
    EXPECT_EQ(limits.in_use(), limits.sent());
    const JointVector beyond = joint_constant(kJoints, sign * std::nextafter(1e-7, 1.0));
    limits.observe(beyond);
    EXPECT_EQ(limits.in_use(), beyond);
  }
}

TEST(TorqueLimiter, WhatIsNoNumberSaysNothing) {
  TorqueLimiter limits = limiter();
  limits.restart(joint_constant(kJoints, 5));
  limits.observe(joint_constant(kJoints, std::nan("")));
  EXPECT_EQ(limits.in_use(), limits.sent());
  limits.observe({});
  EXPECT_EQ(limits.in_use(), limits.sent());
  limits.observe(joint_constant(3, 7));
  EXPECT_EQ(limits.in_use()[2], 7);
  EXPECT_EQ(limits.in_use()[3], 5);
}

// Whatever an arm says of the torque in use, now or when it takes commands again: no command is beyond the
// limit, and a single wrong number moves the command by no more than a step.
TEST(TorqueLimiter, ATorqueInUseBeyondTheLimitLiftsNoLimit) {
  test::Draw draw(17);
  TorqueLimiter limits = limiter();
  for (const double absurd : {kBound + 1e-3, 2 * kBound, 1e30}) {
    for (const double sign : {-1.0, 1.0}) {
      const double before = draw.uniform(-70, 70), goal = draw.uniform(-70, 70);
      limits.restart(joint_constant(kJoints, before));
      EXPECT_NEAR(step_of(limits, sign * absurd, goal), before, kStep + 1e-12);
      limits.restart(joint_constant(kJoints, sign * absurd));
      EXPECT_DOUBLE_EQ(limits.sent()[3], sign * kBound);
      EXPECT_LE(std::abs(step_of(limits, sign * absurd, sign * 2 * kBound)), kBound);
    }
  }
}

TEST(TorqueLimiter, WithoutALowPassWhatIsAskedForIsSentToTheLastBit) {
  test::Draw draw(23);
  for (int k = 0; k < 1000; ++k) {
    TorqueLimiter limits = limiter();
    const double before = draw.uniform(-0.4, 0.4), asked = draw.uniform(-0.4, 0.4);  // within a step
    limits.restart(joint_constant(kJoints, before));
    ASSERT_EQ(step_of(limits, before, asked), asked);
  }
}

TEST(TorqueLimiter, TheLowPassMovesFromWhatIsInUse) {
  for (const double hz : {100.0, 0.5}) {
    TorqueLimiter limits = limiter(hz);
    limits.restart(joint_constant(kJoints, 1));
    const double gain = 1e-3 / (1e-3 + 1 / (2 * M_PI * hz));
    EXPECT_DOUBLE_EQ(step_of(limits, 1, 2), 1 + gain);
    EXPECT_DOUBLE_EQ(step_of(limits, 0.5, 2), 0.5 + gain * 1.5);
  }
}

// An arm as its manufacturer describes it: it takes the answer to its newest packet only, goes on with the
// last torque if none is in time, compares each command with the torque in use and stops itself at a greater
// step than it allows.
class StrictArm {
 public:
  explicit StrictArm(double at) : in_use_(joint_constant(kJoints, at)) {}
  const JointVector& shown() const { return in_use_; }
  // A period, with the command that arrived in it, if any.
  void period(const std::optional<JointVector>& command) {
    if (!command) return;
    for (Eigen::Index i = 0; i < kJoints; ++i) {
      worst_ = std::max(worst_, std::abs((*command)[i] - in_use_[i]));
    }
    in_use_ = *command;
  }
  double worst_step() const { return worst_; }

 private:
  JointVector in_use_;
  double worst_ = 0;
};

enum class Fault { lost, late_by_one, loop_asleep };

// 1 to 19 answers in a row that are lost, or arrive in the next period, or are never sent since the loop is
// asleep, at full slew and at switches of the request: no step of the arm is greater than one period's,
// whatever the arm's state and wherever the gap begins. (Late answers are taken in one variant of the arm,
// dropped in the other: what real ones do is not published.)
TEST(TorqueLimiter, NoGapMakesAnArmStopItself) {
  test::Draw draw(11);
  for (int trial = 0; trial < 3000; ++trial) {
    const auto fault = static_cast<Fault>(trial % 3);
    const int missing = 1 + trial / 3 % 19, first = static_cast<int>(draw.uniform(0, 60));
    StrictArm arm(0);
    TorqueLimiter limits = limiter();
    limits.restart(arm.shown());
    JointVector goal = draw.joints(kJoints, 75);
    std::optional<JointVector> underway;
    for (int k = 0; k < 150; ++k) {
      if (k % 23 == 0) goal = draw.joints(kJoints, 75);  // a switch of the law: full slew
      const bool in_gap = k >= first && k < first + missing;
      if (in_gap && fault == Fault::loop_asleep) {
        arm.period({});
        continue;
      }
      limits.observe(arm.shown().cast<float>().cast<double>());
      TorqueLimiter::Cuts cuts;
      const double asleep = fault == Fault::loop_asleep && k == first + missing ? missing : 0;
      const JointVector answer = limits.limit(goal, (1 + asleep) * kArmPeriod, cuts);
      if (!in_gap) {
        arm.period(answer);
        underway.reset();
      } else if (fault == Fault::late_by_one) {
        arm.period(underway);
        underway = answer;
      } else {
        arm.period({});
      }
      ASSERT_LE(answer.cwiseAbs().maxCoeff(), kBound);
    }
    ASSERT_LE(arm.worst_step(), kStep + 2e-5) << "trial " << trial << ", " << missing << " missing";
    // It is not a brake either: once all arrives again, the torque reaches the goal.
    for (int k = 0; k < 160; ++k) {
      limits.observe(arm.shown());
      TorqueLimiter::Cuts cuts;
      arm.period(limits.limit(goal, kArmPeriod, cuts));
    }
    ASSERT_LT((arm.shown() - goal).cwiseAbs().maxCoeff(), 1e-12);
  }
}

}  // namespace
}  // namespace multipanda::torque_limiter_test
