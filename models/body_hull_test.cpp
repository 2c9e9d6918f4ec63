// Polytopes around points: containment by brute force, sizes by closed forms.
#include <algorithm>
#include <cmath>
#include <random>

#include <gtest/gtest.h>

#include "models/capsule_fit.hpp"
#include "models/testing/hull_faces.hpp"

namespace multipanda::body_hull_test {
namespace {

using test::HullFaces;
using Points = std::vector<Vector3>;

class Draw {
 public:
  explicit Draw(unsigned seed) : engine_(seed) {}
  double uniform(double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(engine_);
  }
  Vector3 vector(double size) { return {uniform(-size, size), uniform(-size, size), uniform(-size, size)}; }
  Pose pose() {
    return {Eigen::AngleAxisd(uniform(0, 3), vector(1).normalized()).toRotationMatrix(), vector(1)};
  }

 private:
  std::mt19937 engine_;
};

Points placed(const Points& points, const Pose& X) {
  Points result;
  for (const auto& p : points) result.push_back(X * p);
  return result;
}

TEST(BodyHull, ContainsAllPoints) {
  Draw draw(5);
  for (int trial = 0; trial < 40; ++trial) {
    // Round, long, flat and as thin as a plate or a wire.
    const Vector3 size(draw.uniform(0.05, 1), trial % 3 == 0 ? 0.0 : draw.uniform(0.05, 1),
                       trial % 4 == 0 ? 0.0 : draw.uniform(0.05, 1));
    const Pose X = trial % 2 == 0 ? draw.pose() : Pose{Matrix3::Identity(), draw.vector(1)};
    Points points;
    for (int k = 0; k < 300; ++k) points.push_back(X * draw.vector(1).cwiseProduct(size));
    const FittedHull hull = fit_hull(points);
    EXPECT_GE(hull.corners.size(), 4u);
    EXPECT_LE(hull.corners.size(), 32u);
    const HullFaces faces(hull.corners);
    ASSERT_GE(faces.size(), 4u);
    double worst = -1;
    for (const auto& p : points) worst = std::max(worst, faces.outside(p));
    EXPECT_LT(worst, 1e-7);
    // It says how far it reaches beyond them: in directions of its own, at most 0.1 rad beside those.
    for (int k = 0; k < 200; ++k) {
      const Vector3 d = draw.vector(1).normalized();
      double inner = -1e9, outer = -1e9;
      for (const auto& p : points) inner = std::max(inner, d.dot(p));
      for (const auto& p : hull.corners) outer = std::max(outer, d.dot(p));
      EXPECT_LT(outer - inner, hull.excess + 0.1 * size.norm());
    }
  }
}

TEST(BodyHull, OfABoxIsTheBoxAndOfABallATightOne) {
  const Pose X{Matrix3::Identity(), {1, 2, 3}};
  const FittedHull box = fit_hull(placed(box_points({0.4, 0.6, 1.2}), X));
  EXPECT_EQ(box.corners.size(), 8u);
  EXPECT_NEAR(box.excess, 0, 1e-12);
  // No polytope of 18 faces around a ball has all corners nearer than 1.15 R; these are at most at 1.35 R.
  const double R = 0.5;
  const FittedHull ball = fit_hull(placed(sphere_points(R), X));
  EXPECT_EQ(ball.corners.size(), 32u);
  for (const auto& p : ball.corners) EXPECT_LT((p - X.position).norm(), 1.35 * R);
  EXPECT_GT(ball.excess, 0.15 * R);
  EXPECT_LT(ball.excess, 0.35 * R);
}

TEST(BodyHull, ManyShapesShareFewHulls) {
  Draw draw(6);
  std::vector<Points> shapes;
  Points all;
  for (int k = 0; k < 9; ++k) {  // three clusters, 2 m apart
    const Points box = placed(box_points({0.1, 0.2, 0.3}), draw.pose());
    shapes.push_back({});
    for (const auto& p : box) shapes.back().push_back(0.2 * p + Vector3(2 * (k % 3), 0, 0));
    all.insert(all.end(), shapes.back().begin(), shapes.back().end());
  }
  const auto hulls = fit_hulls(shapes, 3);
  ASSERT_EQ(hulls.size(), 3u);
  std::vector<HullFaces> faces;
  for (const auto& hull : hulls) faces.emplace_back(hull.corners);
  for (const auto& p : all) {
    EXPECT_TRUE(
        std::any_of(faces.begin(), faces.end(), [&](const HullFaces& f) { return f.outside(p) < 1e-7; }));
  }
  for (const auto& hull : hulls) {
    for (const auto& p : hull.corners) EXPECT_LT((p - hull.corners[0]).norm(), 1.5);  // a cluster each
  }
  EXPECT_EQ(fit_hulls(shapes, 20).size(), 9u);
}

// Beside a box the distance of a capsule is known.
TEST(BodyHull, OverlapsACapsuleThatReachesIt) {
  Draw draw(7);
  const Points box = box_points({0.4, 0.6, 1.2});
  const Vector3 corner(0.2, 0.3, 0.6), out = Vector3(1, 1, 1).normalized();
  for (int trial = 0; trial < 20; ++trial) {
    const Pose X = draw.pose();
    const Points corners = placed(box, X);
    const auto meets = [&](const Vector3& from, const Vector3& to, double radius) {
      return hull_overlaps(corners, X * from, X * to, radius);
    };
    const Vector3 from(0.5, -0.1, 0.2), to(0.9, 0.1, -0.3);  // 0.3 m beside the face at x = 0.2
    EXPECT_FALSE(meets(from, to, 0.299));
    EXPECT_TRUE(meets(from, to, 0.301));
    EXPECT_TRUE(meets(to, from, 0.301));
    EXPECT_FALSE(meets(corner + 0.2 * out, corner + out, 0.199));
    EXPECT_TRUE(meets(corner + 0.2 * out, corner + out, 0.201));
    // Past the edge at x = 0.2, y = 0.3, across it.
    const Vector3 beside(0.3, 0.4, 0), across(0.1, -0.1, 1);
    EXPECT_FALSE(meets(beside - across, beside + across, 0.1 * std::sqrt(2) - 1e-3));
    EXPECT_TRUE(meets(beside - across, beside + across, 0.1 * std::sqrt(2) + 1e-3));
    EXPECT_TRUE(meets({-1, 0, 0}, {1, 0, 0}, 0.01));
  }
}

}  // namespace
}  // namespace multipanda::body_hull_test
