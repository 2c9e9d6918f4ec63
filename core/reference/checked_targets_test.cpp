// What post() refuses: every number of a target is looked at, each bound is where it is said to be.
#include <cmath>
#include <limits>
#include <numbers>
#include <utility>

#include <gtest/gtest.h>

#include "core/reference/harmonic.hpp"
#include "core/reference/reference.hpp"

namespace multipanda::checked_targets_test {
namespace {

constexpr double kNoNumber = std::numeric_limits<double>::quiet_NaN();
constexpr double kInfinite = std::numeric_limits<double>::infinity();
constexpr Quantity kAll[] = {Quantity::pose, Quantity::twist, Quantity::wrench, Quantity::joints,
                             Quantity::scalar};

Reference reference_of(Quantity quantity) { return Reference({.name = "input", .quantity = quantity}, 7); }

Target goal_of(Quantity quantity) {
  if (quantity == Quantity::pose) return pose_target({rotation_from_rpy({0.3, 0.2, 0.1}), {0.4, 0.1, 0.3}});
  Target target;
  target.size = static_cast<std::uint8_t>(value_count(quantity, 7));
  return target;
}

Target motion_of(Quantity quantity, std::size_t harmonics) {
  Target target;
  target.delivery = Delivery::motion;
  target.size = static_cast<std::uint8_t>(motion_count(quantity, 7));
  target.period_s = 4;
  target.cycles = 2;
  target.ramp_s = 0.5;
  target.harmonic_count = static_cast<std::uint8_t>(harmonics);
  for (std::size_t i = 0; i < target.size; ++i) target.values[i] = target.sine[i] = 0.01;
  return target;
}

void expect_each_number_matters(const Reference& reference, const Target& good,
                                const std::vector<double*>& numbers, Target& changed) {
  ASSERT_EQ(reference.check(good), Verdict::accepted);
  for (std::size_t i = 0; i < numbers.size(); ++i) {
    for (const double bad : {kNoNumber, kInfinite, -kInfinite}) {
      const double kept = *numbers[i];
      *numbers[i] = bad;
      EXPECT_EQ(reference.check(changed), Verdict::not_finite) << "number " << i << " is " << bad;
      *numbers[i] = kept;
    }
  }
}

// A motion that would rise to 1e6 m in 1e7 s is slow.
TEST(CheckedTargets, MotionsThatNoArmMakesAreRefused) {
  for (const Quantity quantity : kAll) {
    const Reference reference = reference_of(quantity);
    Target motion;
    motion.delivery = Delivery::motion;
    motion.size = static_cast<std::uint8_t>(motion_count(quantity, 7));
    motion.period_s = 86400;
    motion.harmonic_count = 2;
    ASSERT_EQ(reference.check(motion), Verdict::accepted);
    for (double* number : {&motion.values[0], &motion.sine[motion.size - 1u], &motion.harmonics[0].rise[0],
                           &motion.harmonics[1].sine[0]}) {
      for (const double sign : {-1.0, 1.0}) {
        *number = sign * 1000;
        EXPECT_EQ(reference.check(motion), Verdict::accepted) << to_string(quantity);
        *number = sign * 1001;
        EXPECT_EQ(reference.check(motion), Verdict::out_of_bounds) << to_string(quantity);
        *number = 0;
      }
    }
    for (const auto& [number, most] : {std::pair{&motion.period_s, 86400.0}, {&motion.cycles, 1e6}}) {
      const double kept = std::exchange(*number, most);
      EXPECT_EQ(reference.check(motion), Verdict::accepted);
      *number = 1.01 * most;
      EXPECT_EQ(reference.check(motion), Verdict::out_of_bounds);
      *number = kept;
    }
  }
}

// A force of 1e300 N is finite: each quantity has a largest number, and a goal a longest duration.
TEST(CheckedTargets, NumbersThatNoArmReachesAreRefused) {
  for (const Quantity quantity : kAll) {
    const Reference reference = reference_of(quantity);
    const std::size_t numbers = quantity == Quantity::pose ? 3 : goal_of(quantity).size;
    for (std::size_t i = 0; i < numbers; ++i) {
      for (const double sign : {-1.0, 1.0}) {
        Target target = goal_of(quantity);
        target.values[i] = sign * Reference::kGreatest;
        EXPECT_EQ(reference.check(target), Verdict::accepted);
        EXPECT_EQ(reference.refusal(target), "");
        for (const double large : {1001.0, 1e300}) {
          target.values[i] = sign * large;
          EXPECT_EQ(reference.check(target), Verdict::out_of_bounds);
          EXPECT_NE(reference.refusal(target).find("expected at most 1000, in SI units"), std::string::npos);
        }
      }
    }
    Target target = goal_of(quantity);
    target.duration_s = 86400;
    EXPECT_EQ(reference.check(target), Verdict::accepted);
    target.duration_s = 86401;
    EXPECT_EQ(reference.check(target), Verdict::out_of_bounds);
    EXPECT_EQ(reference.refusal(target), "the duration is 86401 s; expected 0 to 86400 s");
  }
}

TEST(CheckedTargets, JointsStayInTheirRange) {
  const JointRange range{.min = JointVector::Constant(7, -1), .max = JointVector::LinSpaced(7, 1, 1.6)};
  Reference reference({.name = "input", .quantity = Quantity::joints}, 7, range);
  Target target = goal_of(Quantity::joints);
  for (std::size_t i = 0; i < 7; ++i) {
    target = goal_of(Quantity::joints);
    target.values[i] = range.max[static_cast<Eigen::Index>(i)];
    EXPECT_EQ(reference.post(target), Verdict::accepted);
    target.values[i] += 0.001;
    EXPECT_EQ(reference.post(target), Verdict::out_of_bounds);
    EXPECT_EQ(reference.refusal(target), range.refusal(std::span(target.values).first(7)));
    Chunk chunk{.size = 7, .count = 2};
    chunk.times_s[1] = 0.01;
    chunk.values[1] = target.values;
    EXPECT_EQ(reference.check(chunk), Verdict::out_of_bounds);
  }
  EXPECT_EQ(reference_of(Quantity::joints).check(target), Verdict::accepted) << "no range is known";
}

TEST(CheckedTargets, NoNumberOfAGoalMayBeInfinite) {
  for (const Quantity quantity : kAll) {
    const Reference reference = reference_of(quantity);
    Target target = goal_of(quantity);
    std::vector<double*> numbers{&target.duration_s};
    for (std::size_t i = 0; i < target.size; ++i) numbers.push_back(&target.values[i]);
    expect_each_number_matters(reference, target, numbers, target);
    target.values[target.size] = kNoNumber;  // not used
    EXPECT_EQ(reference.check(target), Verdict::accepted);
  }
}

TEST(CheckedTargets, NoNumberOfAMotionMayBeInfinite) {
  for (const Quantity quantity : kAll) {
    const Reference reference = reference_of(quantity);
    for (std::size_t harmonics = 0; harmonics <= kMaxHarmonics; ++harmonics) {
      Target target = motion_of(quantity, harmonics);
      std::vector<double*> numbers{&target.period_s, &target.cycles, &target.ramp_s};
      for (std::size_t i = 0; i < target.size; ++i) {
        numbers.insert(numbers.end(), {&target.values[i], &target.sine[i]});
        for (std::size_t k = 0; k < harmonics; ++k)
          numbers.insert(numbers.end(), {&target.harmonics[k].sine[i], &target.harmonics[k].rise[i]});
      }
      expect_each_number_matters(reference, target, numbers, target);
      if (harmonics < kMaxHarmonics) target.harmonics[harmonics].sine[0] = kNoNumber;  // not used
      target.values[target.size] = kNoNumber;
      EXPECT_EQ(reference.check(target), Verdict::accepted);
    }
    EXPECT_EQ(reference.check(motion_of(quantity, kMaxHarmonics + 1)), Verdict::wrong_size);
  }
}

TEST(CheckedTargets, SizesAreThoseOfTheQuantity) {
  for (const Quantity quantity : kAll) {
    const Reference reference = reference_of(quantity);
    for (const int by : {-1, 1}) {
      Target goal = goal_of(quantity), motion = motion_of(quantity, 0);
      goal.size = static_cast<std::uint8_t>(goal.size + by);
      motion.size = static_cast<std::uint8_t>(motion.size + by);
      EXPECT_EQ(reference.check(goal), Verdict::wrong_size);
      EXPECT_EQ(reference.check(motion), Verdict::wrong_size);
    }
  }
}

TEST(CheckedTargets, TimesAreNotNegativeAndRampsFitIntoTheMotion) {
  const Reference reference = reference_of(Quantity::joints);
  Target goal = goal_of(Quantity::joints);
  goal.duration_s = -1e-9;
  EXPECT_EQ(reference.check(goal), Verdict::out_of_bounds);
  const auto verdict = [&](double period_s, double cycles, double ramp_s) {
    Target motion = motion_of(Quantity::joints, 0);
    motion.period_s = period_s;
    motion.cycles = cycles;
    motion.ramp_s = ramp_s;
    return reference.check(motion);
  };
  EXPECT_EQ(verdict(0, 2, 0.5), Verdict::out_of_bounds);
  EXPECT_EQ(verdict(4, 0, 0.5), Verdict::out_of_bounds);
  EXPECT_EQ(verdict(4, 2, -1e-9), Verdict::out_of_bounds);
  EXPECT_EQ(verdict(4, 2, 0), Verdict::accepted);
  EXPECT_EQ(verdict(4, 2, 8), Verdict::accepted);  // as long as the motion
  EXPECT_EQ(verdict(4, 2, 8.001), Verdict::out_of_bounds);
  EXPECT_EQ(verdict(1, 0.09, 0), Verdict::out_of_bounds);  // the least ramp, 0.1 s, does not fit
}

TEST(CheckedTargets, QuaternionsAreOfUnitLengthWithinAHundredth) {
  const Reference reference = reference_of(Quantity::pose);
  for (const auto& [length, verdict] : {std::pair{0.991, Verdict::accepted},
                                        {1.009, Verdict::accepted},
                                        {0.989, Verdict::out_of_bounds},
                                        {1.011, Verdict::out_of_bounds},
                                        {0.0, Verdict::out_of_bounds}}) {
    Target target = goal_of(Quantity::pose);
    for (std::size_t i = 3; i < 7; ++i) target.values[i] *= length;
    EXPECT_EQ(reference.check(target), verdict) << length;
  }
}

// A motion along one axis, x = a sin, is fastest at 2 pi a / period. The speed of a pose is that of its
// vector, of joints that of each.
TEST(CheckedTargets, MotionsKeepToTheSpeedLimit) {
  for (const Quantity quantity : kAll) {
    const Reference reference = reference_of(quantity);
    const double a = reference.spec().max_speed * 4 / (2 * std::numbers::pi);
    Target all = motion_of(quantity, 0);
    for (std::size_t i = 0; i < all.size; ++i) all.values[i] = 0, all.sine[i] = 0.99 * a;
    const bool vector = quantity == Quantity::pose;
    EXPECT_EQ(reference.check(all), vector ? Verdict::out_of_bounds : Verdict::accepted);
    for (std::size_t i = 0; i < all.size; ++i) {
      Target one = all;
      one.sine = {};
      one.sine[i] = 0.99 * a;
      EXPECT_EQ(reference.check(one), Verdict::accepted);
      one.sine[i] = 1.01 * a;
      EXPECT_EQ(reference.check(one), Verdict::out_of_bounds) << i;
    }
  }
}

}  // namespace
}  // namespace multipanda::checked_targets_test
