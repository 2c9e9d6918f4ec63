// No axis and no joint is treated unlike the others: with axes x, y, z renamed, or joints in reverse order,
// the set-point is the same, renamed.
#include <cmath>

#include <gtest/gtest.h>

#include "core/reference/reference.hpp"
#include "core/testing/test_arm.hpp"

namespace multipanda::symmetric_reference_test {
namespace {

using test::Draw;

constexpr double kDt = 0.001;

// What both references get, in the names of the first.
struct Course {
  explicit Course(std::uint32_t seed) : draw(seed) {}

  // The targets of step k, at most one; times of a slow stream are uneven.
  bool sends(int k) {
    if (k == 10 || k == 500 || k == 1400) return true;
    if (k >= 3500 && k < 6000 && k == next) {
      next += 30 + static_cast<int>(draw.index(40));
      return true;
    }
    return k >= 6000 && k < 7000 && k % 3 == 0;
  }
  static Delivery delivery(int k) {
    return k == 1400 ? Delivery::motion : k < 3500 ? Delivery::goal : Delivery::stream;
  }
  // Of one axis or joint: a smooth path whose parts differ.
  static double path(int k, double phase) {
    const double t = k * kDt;
    return 0.1 * std::sin(1.3 * t + phase) + 0.05 * std::cos((2 + 0.1 * phase) * t);
  }
  static bool pulls(int k) { return k > 700 && k < 900; }

  Draw draw;
  int next = 3500;
};

Vector3 path3(int k, double phase) {
  return {Course::path(k, phase), Course::path(k, phase + 1), Course::path(k, phase + 2.5)};
}

TEST(SymmetricReference, AxesOfAPoseAreAlike) {
  Matrix3 P;  // x is called y, y z, and z x
  P << 0, 0, 1, 1, 0, 0, 0, 1, 0;
  const auto renamed = [&](const Pose& X) { return Pose{P * X.rotation * P.transpose(), P * X.position}; };
  for (const Matrix3& names : {P, Matrix3(P * P)}) {
    P = names;
    Course course(61);
    Reference ours({.name = "pose", .max_speed = 0.3, .max_angular_speed = 0.6}, 7);
    Reference theirs({.name = "pose", .max_speed = 0.3, .max_angular_speed = 0.6}, 7);
    const Pose start{course.draw.rotation(), {0.2, -0.1, 0.4}};
    ours.start(start);
    theirs.start(renamed(start));
    double moved = 0;
    for (int k = 0; k < 8000; ++k) {
      if (course.sends(k)) {
        const Delivery delivery = Course::delivery(k);
        Target one, other;
        if (delivery == Delivery::motion) {
          one.delivery = other.delivery = delivery;
          one.size = other.size = 3;
          one.period_s = other.period_s = 1.2;
          const Vector3 rise = path3(1, 0), sine = path3(2, 1);
          Eigen::Map<Vector3>(one.values.data()) = 0.15 * rise;
          Eigen::Map<Vector3>(other.values.data()) = 0.15 * P * rise;
          Eigen::Map<Vector3>(one.sine.data()) = 0.15 * sine;
          Eigen::Map<Vector3>(other.sine.data()) = 0.15 * P * sine;
        } else {
          const Pose X{exp_rotation(2.5 * path3(k, 3)) * start.rotation, start.position + path3(k, 0)};
          one = pose_target(X, 0, delivery);
          other = pose_target(renamed(X), 0, delivery);
        }
        ASSERT_EQ(ours.post(one), Verdict::accepted);
        ASSERT_EQ(theirs.post(other), Verdict::accepted);
      }
      if (Course::pulls(k)) {
        Vector6 pull, same;
        pull << path3(k, 5), path3(k, 6);
        same << P * pull.head<3>(), P * pull.tail<3>();
        ours.resist(pull, 0.9, 0.95);
        theirs.resist(same, 0.9, 0.95);
      }
      if (k >= 2000) {
        ours.bound_hand_speed(0.2, 0.3);
        theirs.bound_hand_speed(0.2, 0.3);
      }
      ours.advance(kDt, k * kDt);
      theirs.advance(kDt, k * kDt);
      moved += ours.twist().vector.norm() * kDt;
      const Pose expected = renamed(ours.pose());
      ASSERT_LT((theirs.pose().position - expected.position).norm(), 1e-9) << k;
      ASSERT_LT((theirs.pose().rotation - expected.rotation).norm(), 1e-9) << k;
    }
    EXPECT_GT(moved, 1);
  }
}

TEST(SymmetricReference, JointsAreAlike) {
  constexpr Eigen::Index n = 7;
  Course course(62);
  Reference ours({.name = "joints", .quantity = Quantity::joints, .max_speed = 0.4}, n);
  Reference theirs({.name = "joints", .quantity = Quantity::joints, .max_speed = 0.4}, n);
  JointVector start = course.draw.joints(n, 1);
  Jacobian J = Jacobian::Zero(6, n), J_reversed = Jacobian::Zero(6, n);
  J.row(5).setOnes();
  for (Eigen::Index i = 0; i < n; ++i) J.col(i).head<3>() = course.draw.vector3(0.4);
  for (Eigen::Index i = 0; i < n; ++i) J_reversed.col(i) = J.col(n - 1 - i);
  ours.start(start);
  theirs.start(JointVector(start.reverse()));
  double moved = 0;
  for (int k = 0; k < 8000; ++k) {
    if (course.sends(k)) {
      Target one;
      one.delivery = Course::delivery(k);
      one.size = n;
      for (Eigen::Index i = 0; i < n; ++i) {
        const auto at = static_cast<std::size_t>(i);
        one.values[at] = Course::path(k, 0.9 * static_cast<double>(i));
        if (one.delivery != Delivery::motion) {
          one.values[at] += start[i];
          continue;
        }
        one.values[at] *= 0.3;
        one.sine[at] = 0.2 * Course::path(k, 0.8 * static_cast<double>(i));
        one.period_s = 1.2;
      }
      Target other = one;
      std::reverse(other.values.begin(), other.values.begin() + n);
      std::reverse(other.sine.begin(), other.sine.begin() + n);
      ASSERT_EQ(ours.post(one), Verdict::accepted);
      ASSERT_EQ(theirs.post(other), Verdict::accepted);
    }
    if (Course::pulls(k)) {
      JointVector pull(n);
      for (Eigen::Index i = 0; i < n; ++i) pull[i] = Course::path(k, 4 + static_cast<double>(i));
      ours.resist(pull, 0.95);
      theirs.resist(JointVector(pull.reverse()), 0.95);
    }
    if (k >= 2000) {
      ours.bound_hand_speed(0.2, J);
      theirs.bound_hand_speed(0.2, J_reversed);
    }
    ours.advance(kDt, k * kDt);
    theirs.advance(kDt, k * kDt);
    moved += ours.joint_velocity().norm() * kDt;
    ASSERT_LT((theirs.joints() - ours.joints().reverse()).norm(), 1e-9) << k;
  }
  EXPECT_GT(moved, 1);
}

}  // namespace
}  // namespace multipanda::symmetric_reference_test
