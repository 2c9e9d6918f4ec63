#include <cmath>
#include <numbers>

#include <gtest/gtest.h>

#include "core/reference/reference.hpp"
#include "core/testing/test_arm.hpp"

namespace multipanda::motion_test {
namespace {

using test::Draw;
constexpr double kDt = 0.001;

Reference pose_reference(const Pose& at, double max_speed = 1) {
  InputSpec spec{.name = "pose", .quantity = Quantity::pose};
  spec.max_speed = max_speed;
  Reference reference(spec, 7);
  reference.start(at);
  return reference;
}

Target motion(std::size_t size, double period_s, double cycles, double ramp_s) {
  Target target;
  target.delivery = Delivery::motion;
  target.size = static_cast<std::uint8_t>(size);
  target.period_s = period_s;
  target.cycles = cycles;
  target.ramp_s = ramp_s;
  return target;
}

// On the circle throughout, one turn per period between the ramps, and at rest again at the start.
TEST(Motion, OfAPoseIsACircle) {
  Draw draw(1);
  for (int k = 0; k < 10; ++k) {
    const Pose X_0 = draw.pose(1);
    const Matrix3 R = draw.rotation();
    const double radius = 0.1, period = 4, ramp = 0.7, cycles = 2;
    const Vector3 outwards = R.col(0), ahead = R.col(1), center = X_0.position - radius * outwards;
    Reference reference = pose_reference(X_0);
    Target circle = motion(3, period, cycles, ramp);
    for (std::size_t i = 0; i < 3; ++i) {
      circle.values[i] = -2 * radius * outwards[static_cast<Eigen::Index>(i)];
      circle.sine[i] = radius * ahead[static_cast<Eigen::Index>(i)];
    }
    ASSERT_EQ(reference.post(circle), Verdict::accepted);
    const double total = period * cycles + ramp;
    double traveled = 0;
    Vector3 before = X_0.position;
    for (double t = kDt; t < total + 0.05; t += kDt) {
      reference.advance(kDt, t);
      const Vector3 from_center = reference.pose().position - center;
      ASSERT_NEAR(from_center.norm(), radius, 1e-12);
      ASSERT_NEAR(from_center.dot(R.col(2)), 0, 1e-12);
      ASSERT_LT((reference.pose().rotation - X_0.rotation).norm(), 1e-12);
      const double speed = reference.twist().linear().norm();
      if (t > ramp && t < total - ramp) {
        ASSERT_NEAR(speed, 2 * std::numbers::pi * radius / period, 1e-9);
      }
      traveled += (reference.pose().position - before).norm();
      before = reference.pose().position;
    }
    EXPECT_NEAR(traveled, 2 * std::numbers::pi * radius * cycles, 1e-4);
    EXPECT_LT((reference.pose().position - X_0.position).norm(), 1e-9);
    EXPECT_LT(reference.twist().vector.norm(), 1e-12);
  }
}

// No jump in value, rate or acceleration, for any state at the start and any end of the motion.
TEST(Motion, BeginsAndEndsWithoutJumps) {
  Draw draw(2);
  for (int k = 0; k < 20; ++k) {
    Reference reference = pose_reference(draw.pose(0.3), 5);
    reference.set(pose_target(draw.pose(0.3)));
    Target wave = motion(3, 1, 3, 0.3);
    for (std::size_t i = 0; i < 3; ++i) {
      wave.values[i] = draw.uniform(-0.1, 0.1);
      wave.sine[i] = draw.uniform(-0.1, 0.1);
    }
    const int begins = 50 + static_cast<int>(draw.index(400)),
              ends = begins + 200 + static_cast<int>(draw.index(900));
    Pose X = reference.pose();
    Vector6 V = reference.twist().vector, A = reference.acceleration().vector;
    for (int step = 0; step < 8000; ++step) {
      if (step == begins) reference.set(wave);
      if (step == ends && k % 2 == 0) reference.set(pose_target(draw.pose(0.3)));
      reference.advance(kDt, step * kDt);
      const Vector6& V1 = reference.twist().vector;
      const Vector6& A1 = reference.acceleration().vector;
      const Vector3 moved = reference.pose().position - X.position;
      ASSERT_LT((moved - 0.5 * kDt * (V + V1).head<3>()).norm(), 5e-6);
      ASSERT_LT((V1 - V - 0.5 * kDt * (A + A1)).norm(), 5e-3);
      X = reference.pose();
      V = V1;
      A = A1;
    }
    EXPECT_LT(V.norm(), 1e-9);
  }
}

// A force that rises to 30 N and falls again, once in ten seconds.
TEST(Motion, OfAWrenchRisesAndFalls) {
  InputSpec spec{.name = "force", .quantity = Quantity::wrench};
  spec.max_speed = 100;
  Reference reference(spec, 7);
  reference.start_constant(0);
  Target wave = motion(6, 10, 1, 0);
  wave.values[2] = -30;
  ASSERT_EQ(reference.post(wave), Verdict::accepted);
  double least = 0;
  for (int k = 1; k <= 10200; ++k) {
    reference.advance(kDt, k * kDt);
    least = std::min(least, reference.vector()[2]);
    if (k == 2550) {
      EXPECT_NEAR(reference.vector()[2], -15, 0.05);  // a quarter, less half the ramp
    }
    EXPECT_EQ(reference.vector()[0], 0);
  }
  EXPECT_NEAR(least, -30, 1e-4);
  EXPECT_NEAR(reference.vector()[2], 0, 1e-9);
}

// A Fourier series per joint: each part is the same motion, n times as fast, so the sum of motions of one
// part each is the whole. Begins and ends at rest where it began.
TEST(Motion, WithHarmonicsIsAFourierSeries) {
  Draw draw(3);
  const auto joints_reference = [](double max_speed) {
    InputSpec spec{.name = "joints", .quantity = Quantity::joints};
    spec.max_speed = max_speed;
    Reference reference(spec, 7);
    reference.start(JointVector(JointVector::Constant(7, 0.5)));
    return reference;
  };
  Target series = motion(7, 2, 3, 0.5);
  series.harmonic_count = 4;
  const auto amplitudes = [&](auto& sines, auto& rises) {
    for (std::size_t i = 0; i < 7; ++i) {
      sines[i] = draw.uniform(-0.1, 0.1);
      rises[i] = draw.uniform(-0.1, 0.1);
    }
  };
  amplitudes(series.sine, series.values);
  for (std::size_t k = 0; k < 4; ++k) amplitudes(series.harmonics[k].sine, series.harmonics[k].rise);

  Reference whole = joints_reference(10);
  whole.set(series);
  double fastest = 0;
  for (int step = 1; step <= 6600; ++step) {
    const double t = step * kDt;
    const JointVector q = whole.joints(), dq = whole.joint_velocity(), ddq = whole.joint_acceleration();
    whole.advance(kDt, t);
    fastest = std::max(fastest, whole.joint_velocity().cwiseAbs().maxCoeff());
    ASSERT_LT((whole.joints() - q - 0.5 * kDt * (dq + whole.joint_velocity())).norm(), 1e-6);
    ASSERT_LT((whole.joint_velocity() - dq - 0.5 * kDt * (ddq + whole.joint_acceleration())).norm(), 1e-4);
    if (t < 0.5 || t > 6) continue;
    const double theta = std::numbers::pi * (t - 0.25);
    for (std::size_t i = 0; i < 7; ++i) {
      double expected = 0.5 + series.sine[i] * std::sin(theta) + series.values[i] / 2 * (1 - std::cos(theta));
      for (std::size_t k = 0; k < 4; ++k) {
        const double angle = theta * static_cast<double>(k + 2);
        expected += series.harmonics[k].sine[i] * std::sin(angle) +
                    series.harmonics[k].rise[i] / 2 * (1 - std::cos(angle));
      }
      ASSERT_NEAR(whole.joints()[static_cast<Eigen::Index>(i)], expected, 1e-12);
    }
  }
  EXPECT_LT((whole.joints() - JointVector::Constant(7, 0.5)).norm(), 1e-12);
  EXPECT_EQ(whole.joint_velocity().norm(), 0);
  // Refused by its true top speed: not at the limit, but slightly above it.
  EXPECT_EQ(joints_reference(fastest * 0.999).check(series), Verdict::out_of_bounds);
  EXPECT_EQ(joints_reference(fastest * 1.001).check(series), Verdict::accepted);
  series.harmonics[3].rise[6] = std::nan("");
  EXPECT_EQ(whole.check(series), Verdict::not_finite);
  series.harmonic_count = kMaxHarmonics + 1;
  EXPECT_EQ(whole.check(series), Verdict::wrong_size);
}

// Half a turn ends on the other side, at rest, and stays there.
TEST(Motion, OfHalfATurnEndsOnTheOtherSide) {
  const Pose X_0{rotation_from_rpy({0.1, 0.2, 0.3}), {0.3, 0.1, 0.2}};
  Reference reference = pose_reference(X_0);
  Target half = motion(3, 2, 0.5, 0.3);
  half.values = {0.1, -0.05, 0.02};
  half.sine = {0, 0.04, 0};
  ASSERT_EQ(reference.post(half), Verdict::accepted);
  const Vector3 other_side = X_0.position + Vector3(0.1, -0.05, 0.02);
  for (int k = 1; k < 3000; ++k) {
    const Vector3 before = reference.pose().position;
    reference.advance(kDt, k * kDt);
    ASSERT_LT((reference.pose().position - before).norm(), 1e-3);
    if (k > 1310) {
      ASSERT_LT((reference.pose().position - other_side).norm(), 1e-12);
      ASSERT_EQ(reference.twist().vector.norm(), 0);
    }
  }
}

TEST(Motion, IsRefusedIfImpossible) {
  Reference reference = pose_reference({}, 0.5);
  Target circle = motion(3, 2, 1, 0.2);
  circle.sine[0] = 0.15;
  EXPECT_EQ(reference.check(circle), Verdict::accepted);  // 0.47 m/s
  circle.sine[0] = 0.17;
  EXPECT_EQ(reference.check(circle), Verdict::out_of_bounds);  // 0.53 m/s
  circle.sine[0] = 0.11;
  circle.sine[1] = 0.11;
  EXPECT_EQ(reference.check(circle), Verdict::accepted);  // along the diagonal 0.49 m/s
  circle.values[1] = 0.2;
  EXPECT_EQ(reference.check(circle), Verdict::out_of_bounds);  // the ellipse's long axis
  circle = motion(7, 2, 1, 0.2);
  EXPECT_EQ(reference.check(circle), Verdict::wrong_size);
  circle = motion(3, 0, 1, 0.2);
  EXPECT_EQ(reference.check(circle), Verdict::out_of_bounds);
  circle = motion(3, 2, 1, 3);
  EXPECT_EQ(reference.check(circle), Verdict::out_of_bounds);
  circle = motion(3, 2, std::nan(""), 0.1);
  EXPECT_EQ(reference.check(circle), Verdict::not_finite);
}

}  // namespace
}  // namespace multipanda::motion_test
