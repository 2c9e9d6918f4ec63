#include <limits>
#include <numbers>
#include <random>

#include <gtest/gtest.h>

#include "commission/fits.hpp"
#include "core/testing/full_series.hpp"

namespace multipanda::commission {
namespace {

struct Draw {
  std::mt19937_64 random;
  double uniform(double low, double high) { return std::uniform_real_distribution(low, high)(random); }
  double normal(double sigma) { return std::normal_distribution(0.0, sigma)(random); }
  Vector3 point(double size) { return {uniform(-size, size), uniform(-size, size), uniform(-size, size)}; }
  Pose pose() {
    Vector3 axis = Vector3(normal(1), normal(1), normal(1)).normalized();
    return {exp_rotation(axis * uniform(0, std::numbers::pi)), point(2)};
  }
};

TEST(RigidFit, FindsAKnownTransformExactly) {
  Draw draw{std::mt19937_64(11)};
  const int series = test::full_series() ? 2000 : 200;
  for (int k = 0; k < series; ++k) {
    const Pose X_AB = draw.pose();
    std::vector<Vector3> a, b;
    const int count = 3 + k % 6;
    for (int i = 0; i < count; ++i) {
      b.push_back(draw.point(0.4) + Vector3(1, -2, 0.5));
      a.push_back(X_AB * b.back());
    }
    const RigidFit fit = fit_rigid(a, b);
    EXPECT_LT(fit.rms_m, 1e-12);
    // Nearly collinear triples amplify rounding.
    if (fit.width_m < 0.05) continue;
    EXPECT_LT(pose_error(X_AB, fit.X_AB).norm(), 1e-10) << k;
    EXPECT_NEAR(fit.X_AB.rotation.determinant(), 1, 1e-12);
  }
}

// No other transform is better: the residual grows along every small change (a property of the minimum, found
// without singular values).
TEST(RigidFit, NoNeighborIsBetter) {
  Draw draw{std::mt19937_64(12)};
  const int series = test::full_series() ? 300 : 30;
  for (int k = 0; k < series; ++k) {
    const Pose X_AB = draw.pose();
    std::vector<Vector3> a, b;
    for (int i = 0; i < 5; ++i) {
      b.push_back(draw.point(0.3));
      a.push_back(X_AB * b.back() + Vector3(draw.normal(2e-3), draw.normal(2e-3), draw.normal(2e-3)));
    }
    const RigidFit fit = fit_rigid(a, b);
    const auto cost = [&](const Pose& X) {
      double sum = 0;
      for (std::size_t i = 0; i < a.size(); ++i) sum += (a[i] - X * b[i]).squaredNorm();
      return sum;
    };
    const double best = cost(fit.X_AB);
    EXPECT_NEAR(best, 5 * fit.rms_m * fit.rms_m, 1e-12);
    for (int i = 0; i < 6; ++i) {
      for (const double step : {-1e-4, 1e-4}) {
        Pose other = fit.X_AB;
        if (i < 3)
          other.position[i] += step;
        else
          other.rotation = exp_rotation(step * Vector3::Unit(i - 3)) * other.rotation;
        EXPECT_GT(cost(other), best) << i;
      }
    }
  }
}

// The error of the fitted base is that of the points, divided by the root of their number: 2 mm of noise give
// about 1 mm with four points. The stated angle is that of the draws.
TEST(RigidFit, NoiseGivesTheStatedError) {
  Draw draw{std::mt19937_64(13)};
  const std::vector<Vector3> b{{0.3, 0, 0}, {0.6, 0, 0}, {0.3, 0.3, 0}, {0.6, 0.3, 0}};
  const int series = 2000;
  const double sigma = 2e-3;
  double center = 0, about_x = 0, stated = 0;
  for (int k = 0; k < series; ++k) {
    const Pose X_AB = draw.pose();
    std::vector<Vector3> a;
    for (const auto& p : b)
      a.push_back(X_AB * p + Vector3(draw.normal(sigma), draw.normal(sigma), draw.normal(sigma)));
    const RigidFit fit = fit_rigid(a, b);
    const Vector3 middle(0.45, 0.15, 0);
    center += (X_AB * middle - fit.X_AB * middle).squaredNorm() / series;
    const double turned = log_rotation(X_AB.rotation.transpose() * fit.X_AB.rotation).x();
    about_x += turned * turned / series;
    stated += fit.angle_rad * fit.angle_rad / series;
  }
  EXPECT_NEAR(std::sqrt(center), sigma * std::sqrt(3.0 / 4), 0.03e-3);
  // About x the points are 0.15 m from their middle line: sigma / (0.15 m * 2).
  EXPECT_NEAR(std::sqrt(about_x), sigma / 0.3, 0.05 * sigma / 0.3);
  EXPECT_NEAR(std::sqrt(stated), sigma / 0.3, 0.05 * sigma / 0.3);
}

TEST(RigidFit, PointsOnALineHaveNoWidth) {
  std::vector<Vector3> b;
  for (int i = 0; i < 5; ++i) b.emplace_back(0.1 * i, 0.2 * i, -0.05 * i);
  const RigidFit fit = fit_rigid(b, b);
  EXPECT_LT(fit.width_m, 1e-7);
  EXPECT_LT(fit.rms_m, 1e-12);
  b[2] += Vector3(0, 0, 0.1);
  EXPECT_GT(fit_rigid(b, b).width_m, 0.02);
}

TEST(RigidFit, MirroredPointsGiveARotation) {
  const std::vector<Vector3> b{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
  std::vector<Vector3> a = b;
  for (auto& p : a) p.x() = -p.x();
  const RigidFit fit = fit_rigid(a, b);
  EXPECT_NEAR(fit.X_AB.rotation.determinant(), 1, 1e-12);
  EXPECT_GT(fit.rms_m, 0.1);  // swapped points are seen
}

TEST(RigidFit, RefusesWhatItCannotFit) {
  const std::vector<Vector3> two(2, Vector3::Zero()), three(3, Vector3::Zero());
  EXPECT_THROW(fit_rigid(two, two), std::invalid_argument);
  EXPECT_THROW(fit_rigid(two, three), std::invalid_argument);
  std::vector<Vector3> broken = three;
  broken[1].y() = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THROW(fit_rigid(three, broken), std::invalid_argument);
}

}  // namespace
}  // namespace multipanda::commission
