// Goals take as long as the tightest of their limits requires, by the closed form of the minimum-jerk motion:
// its peaks are 15/8 d / T and 10 / 3^1/2 d / T^2. No longer, and no shorter.
#include <cmath>
#include <limits>

#include <gtest/gtest.h>

#include "core/model/arm_model.hpp"
#include "core/reference/reference.hpp"

namespace multipanda::goal_duration_test {
namespace {

constexpr double kDt = 1e-4;

double by_speed(double distance, double speed) { return 1.875 * distance / speed; }
double by_acceleration(double distance, double limit) {
  return std::sqrt(10 / std::sqrt(3.0) * distance / limit);
}

// When the set-point is at the goal for the first time and stays there; its values before the arrival.
template <typename AtGoal>
double arrival(Reference& reference, AtGoal&& at_goal) {
  double t = 0;
  while (t < 60 && !at_goal()) reference.advance(kDt, t += kDt);
  return t;
}

Target values(std::size_t size, double value, std::size_t only = kMaxTargetValues) {
  Target target;
  target.size = static_cast<std::uint8_t>(size);
  for (std::size_t i = 0; i < size; ++i) target.values[i] = only == kMaxTargetValues || only == i ? value : 0;
  return target;
}

TEST(GoalDuration, OfAPositionIsThatOfSpeedOrAcceleration) {
  for (int axis = 0; axis < 3; ++axis) {
    for (const double d : {0.8, -0.8, 0.02, 0.001}) {
      Reference reference({.name = "pose"}, 7);
      reference.start(Pose{rotation_from_rpy({0.3, 0.2, 0.1}), {0.1, 0.2, 0.3}});
      Pose goal = reference.pose();
      goal.position[axis] += d;
      ASSERT_EQ(reference.post(pose_target(goal)), Verdict::accepted);
      const double expected = std::max({by_speed(std::abs(d), 0.5), by_acceleration(std::abs(d), 4), 0.1});
      EXPECT_NEAR(arrival(reference, [&] { return reference.pose().position == goal.position; }), expected,
                  2 * kDt)
          << d << " along " << axis;
    }
  }
}

TEST(GoalDuration, OfARotationIsThatOfItsOwnLimits) {
  for (int axis = 0; axis < 3; ++axis) {
    for (const double angle : {1.5, -1.5, 0.1, 0.001}) {
      Reference reference({.name = "pose"}, 7);
      reference.start(Pose{rotation_from_rpy({0.3, 0.2, 0.1}), {0.1, 0.2, 0.3}});
      Pose goal = reference.pose();
      goal.rotation = exp_rotation(angle * Vector3::Unit(axis)) * goal.rotation;
      ASSERT_EQ(reference.post(pose_target(goal)), Verdict::accepted);
      const double expected =
          std::max({by_speed(std::abs(angle), 1), by_acceleration(std::abs(angle), 8), 0.1});
      bool moved = false;
      EXPECT_NEAR(arrival(reference,
                          [&] {
                            const bool at_rest = reference.twist().vector.norm() == 0;
                            moved |= !at_rest;
                            return moved && at_rest;
                          }),
                  expected, 2 * kDt)
          << angle << " about " << axis;
    }
  }
}

TEST(GoalDuration, OfJointsIsThatOfTheFarthest) {
  for (std::size_t joint = 0; joint < 7; ++joint) {
    for (const double d : {1.0, -1.0, 0.05, 0.001}) {
      Reference reference({.name = "joints", .quantity = Quantity::joints}, 7);
      reference.start(joint_constant(7, 0));
      Target target = values(7, 0.9 * d);
      target.values[joint] = d;
      ASSERT_EQ(reference.post(target), Verdict::accepted);
      const double expected = std::max({by_speed(std::abs(d), 0.5), by_acceleration(std::abs(d), 5), 0.1});
      const auto k = static_cast<Eigen::Index>(joint);
      EXPECT_NEAR(arrival(reference, [&] { return reference.joints()[k] == d; }), expected, 2 * kDt)
          << d << ", joint " << joint;
    }
  }
}

// Forces and numbers do not accelerate a mass.
TEST(GoalDuration, OfOthersIsThatOfTheirRate) {
  for (const Quantity quantity : {Quantity::twist, Quantity::wrench, Quantity::scalar}) {
    for (const double d : {2.0, 0.1}) {
      Reference reference({.name = "input", .quantity = quantity}, 7);
      for (std::size_t i = 0; i < reference.size(); ++i) {
        reference.start_constant(0);
        ASSERT_EQ(reference.post(values(reference.size(), d, i)), Verdict::accepted);
        const auto at_goal = [&] {
          return (quantity == Quantity::scalar ? reference.scalar()
                                               : reference.vector()[static_cast<Eigen::Index>(i)]) == d;
        };
        EXPECT_NEAR(arrival(reference, at_goal), by_speed(d, 0.5), 2 * kDt) << to_string(quantity) << i;
      }
    }
  }
}

// A pose that carries hands: |v| + |omega| lever.
TEST(GoalDuration, OfAPoseKeepsItsHandsWithinTheirSpeed) {
  constexpr double kGreatest = 0.1, kLever = 0.4;
  for (int axis = 0; axis < 3; ++axis) {
    for (const auto& [way, angle] : {std::pair{0.2, 0.0}, {0.0, 0.5}, {0.1, -0.25}}) {
      Reference reference({.name = "pose"}, 7);
      reference.start(Pose{rotation_from_rpy({0.3, 0.2, 0.1}), {0.1, 0.2, 0.3}});
      Pose goal = reference.pose();
      goal.position += way * Vector3::Unit(axis);
      goal.rotation = exp_rotation(angle * Vector3::Unit((axis + 1) % 3)) * goal.rotation;
      ASSERT_EQ(reference.post(pose_target(goal)), Verdict::accepted);
      double t = 0, fastest = 0;
      bool moved = false;
      while (t < 60 && !(moved && reference.twist().vector.norm() == 0)) {
        reference.bound_hand_speed(kGreatest, kLever);
        reference.advance(kDt, t += kDt);
        moved |= reference.twist().vector.norm() > 0;
        fastest = std::max(fastest,
                           reference.twist().linear().norm() + kLever * reference.twist().angular().norm());
      }
      EXPECT_NEAR(t, by_speed(way + kLever * std::abs(angle), kGreatest), 2 * kDt) << axis;
      EXPECT_NEAR(fastest, kGreatest, 1e-5) << axis;
      EXPECT_LT((reference.pose().position - goal.position).norm(), 1e-12);
    }
  }
}

// Joints whose hand has a lever of its own for each: |J dq|.
TEST(GoalDuration, OfJointsKeepsTheHandWithinItsSpeed) {
  constexpr double kGreatest = 0.1;
  for (Eigen::Index joint = 0; joint < 3; ++joint) {
    Reference reference({.name = "joints", .quantity = Quantity::joints}, 3);
    reference.start(joint_constant(3, 0));
    Jacobian J = Jacobian::Zero(6, 3);
    J.row(5).setOnes();
    for (Eigen::Index i = 0; i < 3; ++i) J(i, i) = 0.2 + 0.3 * static_cast<double>(i);
    ASSERT_EQ(reference.post(values(3, 0.8, static_cast<std::size_t>(joint))), Verdict::accepted);
    const double t = arrival(reference, [&] {
      reference.bound_hand_speed(kGreatest, J);
      return reference.joints()[joint] == 0.8;
    });
    EXPECT_NEAR(t, std::max(by_speed(0.8, 0.5), by_speed(0.8 * J(joint, joint), kGreatest)), 2 * kDt)
        << joint;
  }
}

// A requested time counts if it is longer than the limits require.
TEST(GoalDuration, IsTheRequestedOneIfThatIsLonger) {
  for (const double requested : {0.2, 1.0, 3.0, 5.0}) {
    Reference reference({.name = "pose"}, 7);
    reference.start(Pose{});
    Pose goal;
    goal.position = {0.3, 0.4, 0};
    ASSERT_EQ(reference.post(pose_target(goal, requested)), Verdict::accepted);
    EXPECT_NEAR(arrival(reference, [&] { return reference.pose().position == goal.position; }),
                std::max(requested, by_speed(0.5, 0.5)), 2 * kDt);
  }
}

}  // namespace
}  // namespace multipanda::goal_duration_test
