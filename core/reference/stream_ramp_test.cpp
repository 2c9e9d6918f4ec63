// Streams whose samples lie on a straight line, in value and in rotation: the set-point moves on the same
// line, one period late, at any rate; a stream that is faster than a limit is followed at the limit.
#include <cmath>
#include <limits>
#include <numbers>
#include <random>

#include <gtest/gtest.h>

#include "core/reference/reference.hpp"
#include "core/testing/test_arm.hpp"

namespace multipanda::stream_ramp_test {
namespace {

using test::Draw;

constexpr double kDt = 0.001;
constexpr Quantity kAll[] = {Quantity::pose, Quantity::twist, Quantity::wrench, Quantity::joints,
                             Quantity::scalar};

struct Line {
  Quantity quantity;
  JointVector v;                    // of each value; of a pose: of its position, and omega
  Matrix3 R = Matrix3::Identity();  // at t = 0

  Target at(double t) const {
    if (quantity == Quantity::pose) return pose_target(pose(t), 0, Delivery::stream);
    Target target;
    target.delivery = Delivery::stream;
    target.size = static_cast<std::uint8_t>(v.size());
    for (std::size_t i = 0; i < target.size; ++i) target.values[i] = way(t) * v[static_cast<Eigen::Index>(i)];
    return target;
  }
  Pose pose(double t) const {
    return {exp_rotation(way(t) * Vector3(v.tail<3>())) * R, way(t) * Vector3(v.head<3>())};
  }
  static double way(double t) { return t < 1 ? 0.5 * t * t : t - 0.5; }  // up to full speed within a second
  // How far a reference is from the place at time t.
  double distance(const Reference& reference, double t) const {
    if (quantity == Quantity::pose) {
      const Pose X = pose(t);
      return (reference.pose().position - X.position).norm() +
             log_rotation(reference.pose().rotation * X.rotation.transpose()).norm();
    }
    if (quantity == Quantity::joints) return (reference.joints() - way(t) * v).norm();
    if (quantity == Quantity::scalar) return std::abs(reference.scalar() - way(t) * v[0]);
    return (reference.vector() - way(t) * Vector6(v)).norm();
  }
};

Line line(Quantity quantity, Draw& draw) {
  Line made{quantity, draw.joints(quantity == Quantity::pose ? 6 : value_count(quantity, 7), 0.4)};
  if (quantity == Quantity::pose) {
    made.R = draw.rotation();
    made.v << 0.3 * draw.rotation().col(0), 0.6 * draw.rotation().col(0);
  }
  return made;
}

Reference started(const Line& line, double max_speed = 0.5, double max_angular_speed = 1) {
  Reference reference({.name = "input",
                       .quantity = line.quantity,
                       .timeout_s = 0.5,
                       .max_speed = max_speed,
                       .max_angular_speed = max_angular_speed},
                      static_cast<std::size_t>(line.v.size()));
  if (line.quantity == Quantity::pose)
    reference.start(line.pose(0));
  else if (line.quantity == Quantity::joints)
    reference.start(JointVector(0 * line.v));
  else
    reference.start_constant(0);
  return reference;
}

TEST(StreamRamp, IsFollowedOnePeriodLate) {
  Draw draw(51);
  for (const Quantity quantity : kAll) {
    for (const int period : {1, 2, 4, 10, 50, 100}) {  // [ms]
      const Line along = line(quantity, draw);
      Reference reference = started(along);
      for (int k = 0; k < 5000; ++k) {
        if (k % period == 0) {
          ASSERT_EQ(reference.post(along.at(k * kDt)), Verdict::accepted);
        }
        reference.advance(kDt, k * kDt);
        if (k > 4000) {
          ASSERT_NEAR(along.distance(reference, (k + 1 - period) * kDt), 0, 2e-5)
              << to_string(quantity) << " every " << period << " ms, at " << k;
        }
      }
    }
  }
}

// Slow streams of set-points bridge two lost samples; fast ones, too, and nobody numbers samples that
// never arrived.
TEST(StreamRamp, OfPosesAndJointsGoesOnWhereTwoSamplesAreLost) {
  Draw draw(52);
  for (const Quantity quantity : {Quantity::pose, Quantity::joints}) {
    for (const int period : {10, 25, 50}) {
      const Line along = line(quantity, draw);
      Reference reference = started(along);
      for (int k = 0; k < 6000; ++k) {
        const int sample = k / period;
        if (k % period == 0 && (sample < 40 || sample % 11 > 1)) {
          ASSERT_EQ(reference.post(along.at(k * kDt)), Verdict::accepted);
        }
        reference.advance(kDt, k * kDt);
        if (k > 4000) {
          ASSERT_NEAR(along.distance(reference, (k + 1 - period) * kDt), 0, 2e-5)
              << to_string(quantity) << " every " << period << " ms, at " << k;
        }
      }
    }
  }
}

// A fast stream of joints whose hand moves at nine tenths of its bound.
TEST(StreamRamp, CloseToTheHandsSpeedIsFollowedOnePeriodLate) {
  const Line along{Quantity::joints, JointVector(Vector3(0.2, -0.4, 0.3))};
  Jacobian J = Jacobian::Zero(6, 3);
  J.row(5).setOnes();
  J.topRows<3>() << 0.5, 0.2, 0, 0, -0.6, 0.3, 0.1, 0, 0.4;
  const double hand = Vector3(J.topRows<3>() * along.v).norm();
  for (const int period : {1, 2, 4, 10}) {
    Reference reference = started(along);
    for (int k = 0; k < 3000; ++k) {
      if (k % period == 0) {
        ASSERT_EQ(reference.post(along.at(k * kDt)), Verdict::accepted);
      }
      reference.bound_hand_speed(hand / 0.9, J);
      reference.advance(kDt, k * kDt);
      if (k > 2000) {
        ASSERT_NEAR(along.distance(reference, (k + 1 - period) * kDt), 0, 2e-5) << period;
      }
    }
  }
}

// The largest and the mean speed after a start, while samples run ahead; after the series stops, the
// set-point comes to the last sample.
struct Speeds {
  double fastest = 0, mean = 0;
};

template <typename Speed, typename Bound>
Speeds follow_too_fast(Reference& reference, const Line& along, int period, Speed&& speed, Bound&& bound) {
  Speeds speeds;
  for (int k = 0; k < 4000; ++k) {
    if (k % period == 0) {
      EXPECT_EQ(reference.post(along.at(k * kDt)), Verdict::accepted);
    }
    bound();
    reference.advance(kDt, k * kDt);
    speeds.fastest = std::max(speeds.fastest, speed());
    if (k >= 1000) speeds.mean += speed() / 3000;
  }
  for (int k = 4000; k < 20000; ++k) {
    if (k % period == 0) {
      EXPECT_EQ(reference.post(along.at(4)), Verdict::accepted);
    }
    bound();
    reference.advance(kDt, k * kDt);
    speeds.fastest = std::max(speeds.fastest, speed());
  }
  EXPECT_LT(along.distance(reference, 4), 1e-5) << period;
  return speeds;
}

TEST(StreamRamp, AboveTheSpeedLimitIsFollowedAtTheLimit) {
  for (const int period : {1, 4, 10}) {
    for (const bool turns : {false, true}) {
      Line along{Quantity::pose, joint_constant(6, 0)};
      along.v[turns ? 4 : 1] = 0.4;
      Reference reference = started(along, turns ? 10 : 0.2, turns ? 0.2 : 10);
      const auto speed = [&] { return reference.twist().vector.norm(); };
      const Speeds found = follow_too_fast(reference, along, period, speed, [] {});
      EXPECT_LE(found.fastest, 0.2 * 1.12) << period << turns;
      EXPECT_GE(found.mean, 0.2 * 0.85) << period << turns;
    }
    for (const Eigen::Index joint : {0, 2, 6}) {
      Line along{Quantity::joints, joint_constant(7, 0.1)};
      along.v[joint] = 0.4;
      Reference reference = started(along, 0.2);
      const auto speed = [&] { return reference.joint_velocity().cwiseAbs().maxCoeff(); };
      const Speeds found = follow_too_fast(reference, along, period, speed, [] {});
      EXPECT_LE(found.fastest, 0.2 * 1.12) << period << ", joint " << joint;
      EXPECT_GE(found.mean, 0.2 * 0.85) << period << ", joint " << joint;
    }
  }
}

TEST(StreamRamp, ThatMovesTheHandTooFastIsFollowedAtTheHandsSpeed) {
  constexpr double kGreatest = 0.2, kLever = 0.5;
  for (const int period : {1, 4, 10}) {
    Line joints{Quantity::joints, JointVector(Vector3(0.2, -0.4, 0.3))};
    Jacobian J = Jacobian::Zero(6, 3);
    J.row(5).setOnes();
    J.topRows<3>() << 0.5, 0.2, 0, 0, -0.6, 0.3, 0.1, 0, 0.4;  // |J dq| = 0.35 m/s
    {
      Reference reference = started(joints, 10);
      const auto speed = [&] { return Vector3(J.topRows<3>() * reference.joint_velocity()).norm(); };
      const Speeds found = follow_too_fast(reference, joints, period, speed,
                                           [&] { reference.bound_hand_speed(kGreatest, J); });
      EXPECT_LE(found.fastest, kGreatest * 1.12) << period;
      EXPECT_GE(found.mean, kGreatest * 0.85) << period;
    }
    for (const bool turns : {false, true}) {
      Line pose{Quantity::pose, joint_constant(6, 0)};
      pose.v[turns ? 5 : 2] = turns ? 0.8 : 0.4;
      Reference reference = started(pose, 10, 10);
      const auto speed = [&] {
        return reference.twist().linear().norm() + kLever * reference.twist().angular().norm();
      };
      const Speeds found = follow_too_fast(reference, pose, period, speed,
                                           [&] { reference.bound_hand_speed(kGreatest, kLever); });
      EXPECT_LE(found.fastest, kGreatest * 1.12) << period << turns;
      EXPECT_GE(found.mean, kGreatest * 0.85) << period << turns;
    }
  }
}

// A series of speed v whose samples stop: the set-point goes on as far as it was planned, and brakes over
// half of v times 0.1 s. Set-points of arms are planned over 3.5 periods (two lost samples), at least 0.08 s,
// but no farther than 0.15 s beyond the next sample; other inputs over one and a half periods.
TEST(StreamRamp, ThatStopsIsContinuedAsFarAsPlanned) {
  Draw draw(54);
  for (const Quantity quantity : kAll) {
    const bool moves = quantity == Quantity::pose || quantity == Quantity::joints;
    for (const int period : {10, 50, 100}) {
      const double T = period * kDt;
      const Line along = line(quantity, draw);
      Reference reference = started(along);
      for (int k = 0; k < 6000; ++k) {
        if (k % period == 0 && k <= 5000) {
          ASSERT_EQ(reference.post(along.at(k * kDt)), Verdict::accepted);
        }
        reference.advance(kDt, k * kDt);
      }
      const double horizon = moves ? std::min(std::max(3.5 * T, 0.08), T + 0.15) : 1.5 * T;
      EXPECT_NEAR(along.distance(reference, 5 + horizon - T + 0.05), 0, 2e-3 * along.v.norm())
          << to_string(quantity) << " every " << period << " ms";
      EXPECT_TRUE(reference.stale());
    }
  }
}

// An error of d in the times of samples is one of d v in place. A quintic takes it up within h with a jerk of
// 60 d v / h^3, which shall be v / (0.2 s)^2.
TEST(StreamRamp, ThatIsUnevenIsPlannedFarther) {
  constexpr double kPeriod = 0.05, kError = 0.0045, kSpeed = 0.1;
  const double d = std::sqrt(2 / std::numbers::pi) * kError, h = std::cbrt(60 * d * 0.04);
  ASSERT_GT(h, 3.6 * kPeriod);
  double mean = 0;
  constexpr int kTrials = 60;
  for (int trial = 0; trial < kTrials; ++trial) {
    std::mt19937 engine(static_cast<std::uint32_t>(trial));
    std::normal_distribution<double> error(0, kError);
    Reference reference({.name = "joints", .quantity = Quantity::joints, .timeout_s = 0.5}, 1);
    reference.start(joint_constant(1, 0));
    for (int k = 0; k < 5000; ++k) {
      if (k % 50 == 0 && k <= 4000) {
        Target target;
        target.delivery = Delivery::stream;
        target.size = 1;
        target.values[0] = kSpeed * (k * kDt + error(engine));
        ASSERT_EQ(reference.post(target), Verdict::accepted);
      }
      reference.advance(kDt, k * kDt);
    }
    mean += reference.joints()[0] / kSpeed / kTrials;  // as a time
  }
  EXPECT_NEAR(mean, 4 + h - kPeriod + 0.05, 0.01);
}

// A stream whose hand was blocked knows nothing of its period when it goes on, and learns it at once.
TEST(StreamRamp, IsFollowedAgainAfterTheHandWasBlocked) {
  Reference reference({.name = "pose"}, 7);
  reference.start(Pose{});
  for (int k = 0; k < 1500; ++k) {
    if (k % 10 == 0) {
      Pose X;
      X.position.x() = 0.1 * k * kDt;
      ASSERT_EQ(reference.post(pose_target(X, 0, Delivery::stream)), Verdict::accepted);
    }
    if (k < 200) reference.resist(Vector6::Unit(0), 2, 0);
    reference.advance(kDt, k * kDt);
    if (k < 200) {
      EXPECT_LT(reference.pose().position.x(), 1e-3);
    }
    if (k > 600) {
      ASSERT_NEAR(reference.pose().position.x(), 0.1 * (k + 1 - 10) * kDt, 2e-4) << k;
    }
  }
}

// A stream keeps nothing of an earlier one, not even its period.
TEST(StreamRamp, AfterAGoalIsThatOfANewReference) {
  Draw draw(53);
  for (const Quantity quantity : kAll) {
    const Line along = line(quantity, draw);
    Reference used = started(along), fresh = started(along);
    int k = 0;
    for (; k < 2000; ++k) {  // at 10 Hz; then back to the beginning
      if (k % 100 == 0) {
        ASSERT_EQ(used.post(along.at(k * kDt)), Verdict::accepted);
      }
      used.advance(kDt, k * kDt);
    }
    Target home = along.at(0);
    home.delivery = Delivery::goal;
    ASSERT_EQ(used.post(home), Verdict::accepted);
    for (; k < 14000; ++k) used.advance(kDt, k * kDt);
    ASSERT_LT(along.distance(used, 0), 1e-12);
    for (int i = 0; i < 500; ++i, ++k) {
      if (i % 20 == 0) {
        ASSERT_EQ(used.post(along.at(i * kDt)), Verdict::accepted);
        ASSERT_EQ(fresh.post(along.at(i * kDt)), Verdict::accepted);
      }
      used.advance(kDt, k * kDt);
      fresh.advance(kDt, i * kDt);
      double ours[kMaxTargetValues]{}, theirs[kMaxTargetValues]{}, rates[kMaxTargetValues]{};
      used.record(ours, rates);
      fresh.record(theirs, rates);
      for (std::size_t j = 0; j < used.size(); ++j)
        ASSERT_NEAR(ours[j], theirs[j], 1e-9) << to_string(quantity);
    }
  }
}

}  // namespace
}  // namespace multipanda::stream_ramp_test
