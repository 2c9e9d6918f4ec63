// Capsules around shapes: everything is inside, and they are no larger than closed forms allow.
#include "models/capsule_fit.hpp"

#include <algorithm>
#include <cmath>
#include <fstream>
#include <random>

#include <gtest/gtest.h>

#include "models/from_urdf.hpp"

namespace multipanda::capsule_fit_test {
namespace {

using Points = std::vector<Vector3>;

class Random {
 public:
  explicit Random(unsigned seed) : engine_(seed) {}
  double between(double low, double high) { return low + (high - low) * uniform_(engine_); }
  Vector3 vector(double size) { return {between(-size, size), between(-size, size), between(-size, size)}; }
  Vector3 direction() {
    for (;;) {
      const Vector3 v = vector(1);
      if (v.norm() > 0.1 && v.norm() < 1) return v.normalized();
    }
  }
  Pose pose() { return {Eigen::AngleAxisd(between(-3, 3), direction()).toRotationMatrix(), vector(1)}; }

 private:
  std::mt19937 engine_;
  std::uniform_real_distribution<double> uniform_;
};

// Distance of a point from a segment, by its parameter.
double distance(const Vector3& p, const FittedCapsule& capsule) {
  const Vector3 along = capsule.to - capsule.from;
  const double t = along.squaredNorm() > 0 ? along.dot(p - capsule.from) / along.squaredNorm() : 0;
  return (p - capsule.from - std::min(1.0, std::max(0.0, t)) * along).norm();
}

void expect_inside(const Points& points, const FittedCapsule& capsule) {
  for (const auto& p : points) EXPECT_LE(distance(p, capsule), capsule.radius + 1e-9);
}

TEST(CapsuleFit, ContainsEveryPoint) {
  Random random(7);
  for (int k = 0; k < 30; ++k) {
    const Pose X = random.pose();
    const Vector3 size{random.between(0.01, 0.5), random.between(0.01, 0.2), random.between(0.01, 0.1)};
    Points points;
    for (int i = 0; i < 300; ++i) points.push_back(X * random.vector(1).cwiseProduct(size));
    const FittedCapsule capsule = fit_capsule(points);
    expect_inside(points, capsule);
    // Never larger than a ball around the box that they were drawn in.
    EXPECT_LT(capsule.volume(), 4.0 / 3.0 * M_PI * std::pow(size.norm(), 3));
  }
}

TEST(CapsuleFit, FindsACapsule) {
  Random random(8);
  for (int k = 0; k < 10; ++k) {
    const Pose X = random.pose();
    const double radius = random.between(0.02, 0.1), half = random.between(0.05, 0.3);
    Points points;
    for (int i = 0; i < 4000; ++i) {
      const Vector3 d = random.direction();
      points.push_back(X * Vector3(radius * d + Vector3(0, 0, d.z() > 0 ? half : -half)));
    }
    const FittedCapsule capsule = fit_capsule(points);
    EXPECT_NEAR(capsule.radius, radius, 0.02 * radius);
    EXPECT_NEAR((capsule.to - capsule.from).norm(), 2 * half, 0.03 * (half + radius));
    const Vector3 axis = (capsule.to - capsule.from).normalized();
    EXPECT_GT(std::abs(axis.dot(X.rotation.col(2))), std::cos(0.02));
    EXPECT_LT(capsule.excess, 0.02 * (radius + half));
  }
}

TEST(CapsuleFit, IsNoLargerThanTheObviousOne) {
  Random random(9);
  for (int k = 0; k < 10; ++k) {
    const Vector3 size{random.between(0.2, 0.5), random.between(0.05, 0.15), random.between(0.05, 0.15)};
    const Pose X = random.pose();
    Points points;
    for (const auto& p : box_points(size)) points.push_back(X * p);
    const FittedCapsule capsule = fit_capsule(points);
    expect_inside(points, capsule);
    // Along the longest edge: the radius is half a diagonal across, the segment as long as the box.
    const double r = 0.5 * std::hypot(size.y(), size.z());
    EXPECT_LE(capsule.volume(), 1.001 * M_PI * r * r * (size.x() + 4.0 / 3.0 * r));
    // The corners touch, so the surface is farthest from the box beyond its faces: at most the radius.
    EXPECT_GT(capsule.excess, 0);
    EXPECT_LE(capsule.excess, capsule.radius);
  }
}

TEST(CapsuleFit, RoundShapesAreContainedAndBarelyLarger) {
  Random random(10);
  const FittedCapsule ball = fit_capsule(sphere_points(0.1));
  EXPECT_GE(ball.radius, 0.1);
  EXPECT_LT(ball.radius + 0.5 * (ball.to - ball.from).norm(), 0.1 * 1.012);
  const FittedCapsule tube = fit_capsule(cylinder_points(0.05, 0.4));
  for (int k = 0; k < 1000; ++k) {
    const double angle = random.between(-M_PI, M_PI);
    const Vector3 edge{0.05 * std::cos(angle), 0.05 * std::sin(angle),
                       random.between(0, 1) < 0.5 ? -0.2 : 0.2};
    EXPECT_LE(distance(edge, tube), tube.radius);
    EXPECT_LE(distance(0.1 * random.direction(), ball), ball.radius);
  }
}

TEST(CapsuleFit, ManyShapesShareFewCapsules) {
  Random random(11);
  std::vector<Points> shapes;
  Points all;
  for (int k = 0; k < 9; ++k) {  // three clusters of three small boxes
    const Vector3 place = 0.5 * (k / 3) * Vector3::UnitX() + random.vector(0.03);
    Points points;
    for (const auto& p : box_points({0.02, 0.03, 0.01})) points.push_back(place + p);
    all.insert(all.end(), points.begin(), points.end());
    shapes.push_back(points);
  }
  const auto capsules = fit_capsules(shapes, 3);
  ASSERT_EQ(capsules.size(), 3u);
  for (const auto& p : all) {
    EXPECT_TRUE(std::any_of(capsules.begin(), capsules.end(),
                            [&](const auto& c) { return distance(p, c) <= c.radius + 1e-9; }));
  }
  for (const auto& c : capsules) EXPECT_LT(c.radius + (c.to - c.from).norm(), 0.2);  // a cluster each
}

TEST(CapsuleFit, MeshesAreReadAsTheyAreWritten) {
  const std::filesystem::path file = std::filesystem::path(testing::TempDir()) / "capsule_fit_test.obj";
  {
    std::ofstream out(file);
    for (const auto& p : box_points({1, 2, 3})) out << "v " << p.x() << " " << p.y() << " " << p.z() << "\n";
    out << "f 1 2 3\nf 2 3 4\nf 5 6 7\nf 6 7 8\nf 1 2 5\n";
  }
  Vector3 low = Vector3::Constant(9), high = -low;
  for (const auto& p : mesh_points(file, {0.1, -0.1, 1})) {
    low = low.cwiseMin(p);
    high = high.cwiseMax(p);
  }
  EXPECT_TRUE(low.isApprox(Vector3(-0.05, -0.1, -1.5), 1e-6)) << low.transpose();
  EXPECT_TRUE(high.isApprox(Vector3(0.05, 0.1, 1.5), 1e-6)) << high.transpose();
  std::filesystem::remove(file);
  EXPECT_THROW(mesh_points(file, Vector3::Ones()), std::invalid_argument);
}

}  // namespace
}  // namespace multipanda::capsule_fit_test
