#include <numbers>
#include <set>

#include <Eigen/SVD>
#include <gtest/gtest.h>

#include "core/testing/test_arm.hpp"
#include "core/types/arm_set.hpp"
#include "core/types/codes.hpp"
#include "core/types/joint_range.hpp"
#include "core/types/rotation_between.hpp"
#include "core/types/spatial.hpp"
#include "core/types/time.hpp"

namespace multipanda::types_test {
namespace {

constexpr double kPi = std::numbers::pi;

TEST(Rotation, ExponentialAgreesWithAngleAxis) {
  test::Draw draw(1);
  for (int i = 0; i < 1000; ++i) {
    const Vector3 axis = draw.rotation().col(0);
    const double angle = i < 100 ? std::pow(10.0, -draw.uniform(0, 12)) : draw.uniform(0, 2 * kPi);
    const Matrix3 expected = Eigen::AngleAxisd(angle, axis).toRotationMatrix();
    EXPECT_LT((exp_rotation(angle * axis) - expected).norm(), 1e-14);
  }
  EXPECT_EQ(exp_rotation(Vector3::Zero()), Matrix3::Identity());
}

TEST(Rotation, BetweenTwoDirectionsIsTheShortest) {
  test::Draw draw(2);
  for (int i = 0; i < 1000; ++i) {
    const Vector3 from = draw.vector3(2),
                  near_opposite = -from + draw.vector3(std::pow(10.0, -draw.uniform(1, 14)));
    const Vector3 to = i % 3 == 0 ? near_opposite : i % 3 == 1 ? Vector3(-from) : draw.vector3(2);
    const Quaternion q = rotation_between(from, to);
    EXPECT_NEAR(q.norm(), 1, 1e-9);
    EXPECT_LT((q * from.normalized() - to.normalized()).norm(), 2e-6)
        << from.transpose() << " to " << to.transpose();
    const double angle = std::atan2(from.cross(to).norm(), from.dot(to));
    EXPECT_NEAR(q.angularDistance(Quaternion::Identity()), angle, 2e-6);
  }
}

// Of what was rounded to four digits remains the rotation that was meant, to the digits; singular values say
// how far it is from one.
TEST(Rotation, TheNearestOfARoundedOneIsOrthonormal) {
  test::Draw draw(4);
  for (int i = 0; i < 200; ++i) {
    const Matrix3 R = draw.rotation();
    const Matrix3 rounded = (1e4 * R).array().round() / 1e4;
    const Pose X = with_proper_rotation({rounded, Vector3(1, 2, 3)});
    EXPECT_LT((X.rotation.transpose() * X.rotation - Matrix3::Identity()).norm(), 1e-14);
    EXPECT_LT((X.rotation - R).norm(), 2e-4);
    const Eigen::JacobiSVD<Matrix3> svd(rounded, Eigen::ComputeFullU | Eigen::ComputeFullV);
    EXPECT_LT((X.rotation - svd.matrixU() * svd.matrixV().transpose()).norm(), 1e-12);
    EXPECT_EQ(X.position, Vector3(1, 2, 3));
  }
  EXPECT_EQ(with_proper_rotation({}).rotation, Matrix3::Identity());
}

TEST(JointRange, NamesTheFirstJointThatIsOutsideWithItsUnit) {
  const JointRange range{
      .min = Eigen::Vector3d(0, -1, -1), .max = Eigen::Vector3d(0.4, 1.2, 1), .prismatic = 1};
  const auto refusal = [&](double a, double b, double c) { return range.refusal(std::array{a, b, c}); };
  EXPECT_EQ(refusal(0, 1.2, -1), "");
  EXPECT_EQ(refusal(0.4 + 0.9e-6, -1 - 0.9e-6, 0), "") << "rounded on their way";
  EXPECT_EQ(refusal(0.4 + 1.1e-6, 0, 0), "joint1: 0.400001 m is outside of 0 to 0.4 m");
  EXPECT_EQ(refusal(-3, 0, 0), "joint1: -3 m is outside of 0 to 0.4 m");
  EXPECT_EQ(refusal(300, 5, 0), "joint1: 300 m is outside of 0 to 0.4 m (this looks like millimeters)");
  EXPECT_EQ(refusal(0, 5, 9), "joint2: 5 rad is outside of -1 to 1.2 rad");
  EXPECT_EQ(refusal(0, 60, 0), "joint2: 60 rad is outside of -1 to 1.2 rad (this looks like degrees)");
  EXPECT_EQ(refusal(0, 200, 0), "joint2: 200 rad is outside of -1 to 1.2 rad") << "nor in degrees";
  EXPECT_EQ(refusal(0, 0, std::nan("")), "joint3: nan rad is outside of -1 to 1 rad");
  EXPECT_EQ(range.first_outside(std::array{0.1, 0.2, -2.0}), 2u);
  EXPECT_EQ(range.first_outside(std::array{0.1, 0.2, 0.3}), 3u);
}

TEST(Rotation, LogarithmInvertsTheExponential) {
  test::Draw draw(2);
  for (int i = 0; i < 1000; ++i) {
    const Vector3 axis = draw.rotation().col(1);
    const double angle = i < 200 ? std::pow(10.0, -draw.uniform(0, 14)) : draw.uniform(0, kPi - 1e-9);
    EXPECT_LT((log_rotation(exp_rotation(angle * axis)) - angle * axis).norm(), 1e-12) << angle;
  }
  EXPECT_EQ(log_rotation(Matrix3::Identity()), Vector3::Zero());
}

TEST(Rotation, LogarithmAtAndAroundPi) {
  test::Draw draw(3);
  for (int i = 0; i < 300; ++i) {
    const Vector3 axis = draw.rotation().col(2);
    for (const double off : {0.0, 1e-12, -1e-12, 1e-9, -1e-7, 1e-6}) {
      const Matrix3 R = Eigen::AngleAxisd(kPi + off, axis).toRotationMatrix();
      const Vector3 r = log_rotation(R);
      EXPECT_LE(r.norm(), kPi + 1e-12);
      EXPECT_LT((exp_rotation(r) - R).norm(), 1e-12) << off;
    }
  }
}

TEST(Rotation, LeftJacobianAgainstFiniteDifferences) {
  test::Draw draw(4);
  constexpr double h = 1e-5;
  for (int i = 0; i < 500; ++i) {
    const Vector3 r =
        (i < 100 ? std::pow(10.0, -draw.uniform(2, 9)) : draw.uniform(0, 3)) * draw.rotation().col(0);
    const Vector3 dr = draw.vector3(1);
    const Matrix3 R_dot = (exp_rotation(r + h * dr) - exp_rotation(r - h * dr)) / (2 * h);
    const Matrix3 S = R_dot * exp_rotation(r).transpose();
    const Vector3 omega(S(2, 1), S(0, 2), S(1, 0));
    EXPECT_LT((left_jacobian(r) * dr - omega).norm(), 1e-9);
  }
}

TEST(Rotation, RollPitchYawIsUrdfs) {
  const Matrix3 R = rotation_from_rpy({0.1, 0.2, 0.3});
  const Matrix3 expected = exp_rotation({0, 0, 0.3}) * exp_rotation({0, 0.2, 0}) * exp_rotation({0.1, 0, 0});
  EXPECT_LT((R - expected).norm(), 1e-15);
}

TEST(Rotation, RollPitchYawComeBack) {
  test::Draw draw(14);
  for (int k = 0; k < 200; ++k) {
    const Vector3 rpy(draw.uniform(-3, 3), k % 10 == 0 ? kPi / 2 : draw.uniform(-1.5, 1.5),
                      draw.uniform(-3, 3));
    const Matrix3 R = rotation_from_rpy(rpy);
    EXPECT_LT((rotation_from_rpy(rpy_of(R)) - R).norm(), 1e-14) << rpy.transpose();
    if (k % 10 != 0) {
      EXPECT_LT((rpy_of(R) - rpy).norm(), 1e-12);
    }
  }
}

TEST(Pose, AsNumbers) {
  test::Draw draw(15);
  const Pose X = draw.pose(1);
  const std::array<double, 16> T = column_major(X);
  for (std::size_t row = 0; row < 4; ++row) {
    for (std::size_t column = 0; column < 4; ++column) {
      const auto r = static_cast<Eigen::Index>(row), c = static_cast<Eigen::Index>(column);
      const double expected = row == 3 ? column == 3 : column == 3 ? X.position[r] : X.rotation(r, c);
      EXPECT_EQ(T[row + 4 * column], expected);
    }
  }
  EXPECT_EQ(pose_of(T).rotation, X.rotation);
  EXPECT_EQ(pose_of(T).position, X.position);
}

TEST(Pose, ProductInverseAndError) {
  test::Draw draw(5);
  for (int i = 0; i < 100; ++i) {
    const Pose X_AB = draw.pose(1), X_BC = draw.pose(1);
    const Vector3 p = draw.vector3(1);
    EXPECT_LT((X_AB * X_BC * p - X_AB * (X_BC * p)).norm(), 1e-14);
    EXPECT_LT((X_AB.inverse() * (X_AB * p) - p).norm(), 1e-14);
    // The error moves the actual pose onto the desired one, in world axes, wherever the world's origin is.
    const Vector6 e = pose_error(X_AB, X_BC);
    EXPECT_LT((X_BC.position + e.head<3>() - X_AB.position).norm(), 1e-14);
    EXPECT_LT((exp_rotation(e.tail<3>()) * X_BC.rotation - X_AB.rotation).norm(), 1e-12);
  }
}

TEST(Wrench, DoesTheSameWorkAfterAShift) {
  test::Draw draw(6);
  for (int i = 0; i < 100; ++i) {
    Wrench F_A;
    F_A.vector << draw.vector3(10), draw.vector3(10);
    Twist V_A;
    V_A.vector << draw.vector3(1), draw.vector3(1);
    const Vector3 p_BA = draw.vector3(1);  // from B to A
    Twist V_B = V_A;
    V_B.linear() += V_A.angular().cross(-p_BA);
    EXPECT_NEAR(shifted(F_A, p_BA).vector.dot(V_B.vector), F_A.vector.dot(V_A.vector), 1e-12);
  }
}

TEST(ArmSet, IsASet) {
  const ArmSet all = ArmSet::all(4), two = ArmSet::of(2);
  EXPECT_EQ(all.size(), 4u);
  EXPECT_EQ(ArmSet::all(kMaxArms).size(), kMaxArms);
  EXPECT_TRUE(ArmSet().empty());
  EXPECT_TRUE(all.contains(two));
  EXPECT_FALSE(two.contains(all));
  EXPECT_TRUE(all.contains(3));
  EXPECT_FALSE(all.contains(4));
  EXPECT_EQ((all - two).size(), 3u);
  EXPECT_FALSE((all - two).overlaps(two));
  EXPECT_EQ((ArmSet::of(1) | two).first(), 1u);
  EXPECT_EQ((all & two), two);
}

TEST(Codes, EveryCodeHasItsOwnText) {
  std::set<std::string_view> texts;
  for (int i = 0; i < static_cast<int>(Intervention::count_); ++i) {
    texts.insert(to_string(static_cast<Intervention>(i)));
  }
  EXPECT_EQ(texts.size(), static_cast<std::size_t>(Intervention::count_));
  texts.clear();
  for (int i = 0; i < static_cast<int>(Verdict::count_); ++i)
    texts.insert(to_string(static_cast<Verdict>(i)));
  EXPECT_EQ(texts.size(), static_cast<std::size_t>(Verdict::count_));
  EXPECT_EQ(texts.count(""), 0u);
  EXPECT_EQ(to_string(Verdict::count_), "unknown code");
}

TEST(Time, RoundsAndSubtracts) {
  EXPECT_EQ(LoopTime::from_seconds(0.001).ns, 1'000'000);
  EXPECT_EQ(LoopTime::from_seconds(-0.0010000004).ns, -1'000'000);
  EXPECT_EQ((LoopTime{3} - LoopTime{5}).count(), -2);
}

}  // namespace
}  // namespace multipanda::types_test
