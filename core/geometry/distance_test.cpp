#include <vector>

#include <coal/distance.h>
#include <coal/shape/geometric_shapes.h>
#include <gtest/gtest.h>

#include "core/geometry/shape.hpp"
#include "core/testing/test_arm.hpp"

namespace multipanda::distance_test {
namespace {

using test::Draw;
using Kind = ConvexShape::Kind;

coal::Transform3s transform(const Pose& X) { return {X.rotation, X.position}; }

// A capsule in coal's convention: along z about its own center.
struct CoalCapsule {
  CoalCapsule(const Vector3& p0, const Vector3& p1, double radius) : shape(radius, (p1 - p0).norm()) {
    X = {Quaternion::FromTwoVectors(Vector3::UnitZ(), p1 - p0).toRotationMatrix(), 0.5 * (p0 + p1)};
  }
  coal::Capsule shape;
  Pose X;
};

double coal_distance(const coal::ShapeBase& a, const Pose& X_A, const coal::ShapeBase& b, const Pose& X_B) {
  coal::DistanceRequest request;
  request.gjk_tolerance = 1e-12;
  request.epa_tolerance = 1e-10;
  request.gjk_max_iterations = 1000;
  request.epa_max_iterations = 1000;
  coal::DistanceResult result;
  return coal::distance(&a, transform(X_A), &b, transform(X_B), request, result);
}

// Properties of every result.
void expect_consistent(const Closest& c) {
  EXPECT_NEAR(c.normal.norm(), 1, 1e-12);
  EXPECT_LT((c.p_A - c.p_B - c.distance * c.normal).norm(), 1e-8) << c.distance;
}

Vector3 direction(Draw& draw) { return draw.rotation().col(0); }

struct Segment {
  Vector3 p0, p1;
};

enum class Lie { anywhere, parallel, touching, far, collinear, crossing };

// Two segments in the named relative position, moved together by a random rigid motion.
std::pair<Segment, Segment> segments(Draw& draw, Lie lie, double radii) {
  const Vector3 along = direction(draw) * draw.uniform(0.02, 0.4);
  Segment a{Vector3::Zero(), along}, b;
  const Vector3 other = direction(draw) * draw.uniform(0.02, 0.4);
  const Vector3 side = along.cross(direction(draw)).normalized();
  switch (lie) {
    case Lie::anywhere:
      b = {draw.vector3(0.3), draw.vector3(0.3)};
      break;
    case Lie::parallel: {
      const Vector3 at = side * draw.uniform(0.01, 0.3) + along * draw.uniform(-1.5, 1.5);
      // Exactly parallel, opposite, or nearly so.
      const Vector3 tilt = draw.coin() ? Vector3(Vector3::Zero()) : Vector3(draw.vector3(1e-9));
      b = {at, at + (draw.coin() ? 1.0 : -1.0) * draw.uniform(0.2, 2) * along + tilt};
      break;
    }
    case Lie::touching: {
      const Vector3 at = along * draw.uniform(0, 1) + side * radii;
      const Vector3 flat = other - side * other.dot(side);
      b = {at - draw.uniform(0, 1) * flat, at + draw.uniform(0, 1) * flat};
      break;
    }
    case Lie::far:
      b = {draw.vector3(1) + Vector3(5, 0, 0), draw.vector3(1) + Vector3(5, 0, 0)};
      break;
    case Lie::collinear: {
      const double from = draw.uniform(-3, 3);
      b = {from * along, (from + draw.uniform(-2, 2)) * along};
      break;
    }
    case Lie::crossing: {
      const Vector3 at = along * draw.uniform(0.1, 0.9);
      b = {at - draw.uniform(0.1, 1) * other, at + draw.uniform(0.1, 1) * other};
      break;
    }
  }
  const Pose X = draw.pose(1);
  return {{X * a.p0, X * a.p1}, {X * b.p0, X * b.p1}};
}

TEST(CapsuleDistance, AgreesWithCoal) {
  Draw draw(11);
  for (const Lie lie : {Lie::anywhere, Lie::parallel, Lie::touching, Lie::far, Lie::collinear}) {
    for (int trial = 0; trial < 2000; ++trial) {
      const double ra = draw.uniform(0.01, 0.1), rb = draw.uniform(0.01, 0.1);
      const auto [a, b] = segments(draw, lie, ra + rb);
      const CoalCapsule ca(a.p0, a.p1, ra), cb(b.p0, b.p1, rb);
      const Closest c = closest_capsules(a.p0, a.p1, ra, b.p0, b.p1, rb);
      expect_consistent(c);
      // Coal's own closed form of two capsules; where its segments meet, it stops at the radii, as this one
      // does. For nearly parallel ones it may be slightly too large; this result is attained by its points.
      const double theirs = coal_distance(ca.shape, ca.X, cb.shape, cb.X);
      if (lie == Lie::parallel) {
        EXPECT_LE(c.distance, theirs + 1e-9) << trial;
        EXPECT_NEAR(c.distance, theirs, 5e-9) << trial;
        continue;
      }
      EXPECT_NEAR(c.distance, theirs, 1e-9) << static_cast<int>(lie) << " " << trial;
      EXPECT_TRUE(lie != Lie::touching || std::abs(c.distance) < 1e-9) << c.distance;
      const Closest swapped = closest_capsules(b.p0, b.p1, rb, a.p0, a.p1, ra);
      EXPECT_NEAR(swapped.distance, c.distance, 1e-12);
    }
  }
}

// No other pair of points on the segments is nearer: a condition that needs no second implementation.
TEST(CapsuleDistance, NoOtherPairOfPointsIsNearer) {
  Draw draw(12);
  for (const Lie lie : {Lie::anywhere, Lie::parallel, Lie::far, Lie::collinear, Lie::crossing}) {
    for (int trial = 0; trial < 300; ++trial) {
      const auto [a, b] = segments(draw, lie, 0);
      const double d = closest_capsules(a.p0, a.p1, 0, b.p0, b.p1, 0).distance;
      for (int k = 0; k < 100; ++k) {
        const Vector3 p = a.p0 + draw.uniform(0, 1) * (a.p1 - a.p0);
        const Vector3 q = b.p0 + draw.uniform(0, 1) * (b.p1 - b.p0);
        EXPECT_GE((p - q).norm(), d - 1e-12);
      }
    }
  }
}

TEST(CapsuleDistance, SegmentsThatArePointsOrCross) {
  Draw draw(13);
  for (int trial = 0; trial < 500; ++trial) {
    const auto [a, b] = segments(draw, Lie::crossing, 0);
    const Closest c = closest_capsules(a.p0, a.p1, 0.03, b.p0, b.p1, 0.02);
    expect_consistent(c);
    EXPECT_NEAR(c.distance, -0.05, 1e-9);
    // The separation is perpendicular to both.
    EXPECT_NEAR(c.normal.dot((a.p1 - a.p0).normalized()), 0, 1e-6);
    EXPECT_NEAR(c.normal.dot((b.p1 - b.p0).normalized()), 0, 1e-6);

    const Vector3 point = draw.vector3(1);
    const double d = closest_capsules(point, point, 0.01, b.p0, b.p1, 0.02).distance;
    const Vector3 along = b.p1 - b.p0;
    const double foot = std::clamp((point - b.p0).dot(along) / along.squaredNorm(), 0.0, 1.0);
    EXPECT_NEAR(d, (point - b.p0 - foot * along).norm() - 0.03, 1e-12);
    EXPECT_NEAR(d, closest_capsules(b.p0, b.p1, 0.02, point, point, 0.01).distance, 1e-12);
    EXPECT_NEAR(closest_capsules(point, point, 0.01, b.p0, b.p0, 0.02).distance, (point - b.p0).norm() - 0.03,
                1e-12);
  }
  const Closest same = closest_capsules({1, 2, 3}, {1, 2, 3}, 0.1, {1, 2, 3}, {1, 2, 3}, 0.2);
  expect_consistent(same);
  EXPECT_NEAR(same.distance, -0.3, 1e-15);
}

TEST(HalfSpace, DistanceIsThatOfTheLowestPoint) {
  Draw draw(14);
  for (int trial = 0; trial < 300; ++trial) {
    const Pose X_WP = draw.pose(1), X_WS = draw.pose(1);
    std::vector<Vector3> vertices;
    for (int i = 0; i < 8; ++i) vertices.push_back(draw.vector3(0.2));
    const auto hull = ConvexShape::hull(vertices, 0.02);
    double lowest = 1e9;
    for (const auto& v : vertices) lowest = std::min(lowest, (X_WP.inverse() * (X_WS * v)).z());
    const Closest c = closest_points(hull, X_WS, ConvexShape::half_space(), X_WP);
    expect_consistent(c);
    EXPECT_NEAR(c.distance, lowest - 0.02, 1e-12);
    EXPECT_LT((c.normal - X_WP.rotation.col(2)).norm(), 1e-12);
    EXPECT_NEAR((X_WP.inverse() * c.p_B).z(), 0, 1e-12);
    const Closest mirrored = closest_points(ConvexShape::half_space(), X_WP, hull, X_WS);
    EXPECT_LT((mirrored.p_B - c.p_A).norm() + (mirrored.normal + c.normal).norm(), 1e-12);

    const auto capsule = ConvexShape::capsule(vertices[0], vertices[1], 0.03);
    const Closest closed = closest_capsule_half_space(X_WS * vertices[0], X_WS * vertices[1], 0.03,
                                                      X_WP.position, X_WP.rotation.col(2));
    const Closest general = closest_points(capsule, X_WS, ConvexShape::half_space(), X_WP);
    EXPECT_NEAR(closed.distance, general.distance, 1e-12);
    EXPECT_LT((closed.p_A - general.p_A).norm(), 1e-12);
  }
}

// The same shape for both libraries.
struct Twin {
  ConvexShape ours;
  std::shared_ptr<coal::ShapeBase> theirs;
  Pose X_SC;  // coal's frame in the frame of `ours`
};

Twin draw_twin(Draw& draw) {
  const double r = draw.uniform(0.02, 0.15), l = draw.uniform(0.05, 0.4);
  Vector3 size;
  for (int i = 2; i >= 0; --i) size[i] = draw.uniform(0.02, 0.4);
  switch (draw.index(5)) {
    case 0:
      return {ConvexShape::box(size), std::make_shared<coal::Box>(size), {}};
    case 1:
      return {ConvexShape::cylinder(r, l), std::make_shared<coal::Cylinder>(r, l), {}};
    case 2: {
      const Vector3 p = draw.vector3(0.2);
      return {ConvexShape::sphere(p, r), std::make_shared<coal::Sphere>(r), {Matrix3::Identity(), p}};
    }
    case 3: {  // a box by its corners
      std::vector<Vector3> corners;
      for (int i = 0; i < 8; ++i) {
        corners.push_back(0.5 * size.cwiseProduct(Vector3((i & 1) != 0 ? 1 : -1, (i & 2) != 0 ? 1 : -1,
                                                          (i & 4) != 0 ? 1 : -1)));
      }
      return {ConvexShape::hull(corners), std::make_shared<coal::Box>(size), {}};
    }
    default: {
      const Vector3 p0 = draw.vector3(0.2), p1 = draw.vector3(0.2);
      const CoalCapsule capsule(p0, p1, r);
      return {ConvexShape::capsule(p0, p1, r), std::make_shared<coal::Capsule>(capsule.shape), capsule.X};
    }
  }
}

TEST(ConvexDistance, AgreesWithCoalNearFarAndTouching) {
  Draw draw(15);
  int apart = 0, overlapping = 0;
  for (int trial = 0; trial < 6000; ++trial) {
    const Twin a = draw_twin(draw), b = draw_twin(draw);
    const double spread = std::array{0.15, 0.5, 3.0}[draw.index(3)];
    const Pose X_WA = draw.pose(spread);
    Pose X_WB = draw.pose(spread);
    Closest c = closest_points(a.ours, X_WA, b.ours, X_WB);
    if (trial % 3 == 0) {  // bring them very close together
      const double gap = std::array{1e-3, 1e-6, 1e-8}[draw.index(3)];
      X_WB.position += (c.distance - gap) * c.normal;
      c = closest_points(a.ours, X_WA, b.ours, X_WB);
    }
    expect_consistent(c);
    const double theirs = coal_distance(*a.theirs, X_WA * a.X_SC, *b.theirs, X_WB * b.X_SC);
    if (c.distance > 1e-9) {
      ++apart;
      EXPECT_NEAR(c.distance, theirs, 1e-6) << trial;
    } else {
      ++overlapping;
      EXPECT_LE(theirs, 1e-6) << trial;
    }
  }
  EXPECT_GT(apart, 2000);
  EXPECT_GT(overlapping, 300);
}

// Bounds from both sides that need no other library: the points found lie in the bodies, and the plane across
// the normal separates them by exactly the distance found.
TEST(ConvexDistance, NormalSeparatesByTheDistance) {
  Draw draw(16);
  for (int trial = 0; trial < 3000; ++trial) {
    const Twin a = draw_twin(draw), b = draw_twin(draw);
    const Pose X_WA = draw.pose(0.3), X_WB = draw.pose(0.3);
    const Closest c = closest_points(a.ours, X_WA, b.ours, X_WB);
    const auto extent = [](const ConvexShape& s, const Pose& X, const Vector3& n) {
      return n.dot(X * s.support(X.rotation.transpose() * n)) + s.radius;
    };
    const double gap = -extent(a.ours, X_WA, -c.normal) - extent(b.ours, X_WB, c.normal);
    EXPECT_NEAR(gap, c.distance, 2e-8) << trial << ", " << c.distance;
  }
}

// Overlap: the translation found separates the bodies, and none of many other directions is shorter.
TEST(ConvexDistance, OverlapIsTheShortestSeparation) {
  Draw draw(17);
  int deep = 0;
  for (int trial = 0; trial < 1500; ++trial) {
    const Twin a = draw_twin(draw), b = draw_twin(draw);
    const Pose X_WA = draw.pose(0.1);
    Pose X_WB = draw.pose(0.1);
    const Closest c = closest_points(a.ours, X_WA, b.ours, X_WB);
    if (c.distance > -1e-6) continue;
    if (a.ours.radius > 0 && b.ours.radius > 0) continue;  // capsules: the closed form's own convention
    ++deep;
    const auto extent = [](const ConvexShape& s, const Pose& X, const Vector3& n) {
      return n.dot(X * s.support(X.rotation.transpose() * n)) + s.radius;
    };
    for (int k = 0; k < 50; ++k) {
      const Vector3 n = direction(draw);
      EXPECT_GE(extent(a.ours, X_WA, -n) + extent(b.ours, X_WB, n), -c.distance - 1e-6);
    }
    X_WB.position += (c.distance - 1e-4) * c.normal;
    EXPECT_NEAR(closest_points(a.ours, X_WA, b.ours, X_WB).distance, 1e-4, 1e-6) << trial;
  }
  EXPECT_GT(deep, 300);
}

// Moving one body through another by small steps changes the distance by no more than the step: no jump where
// cores begin to overlap.
TEST(ConvexDistance, IsContinuousThroughContactAndCores) {
  Draw draw(18);
  for (int trial = 0; trial < 100; ++trial) {
    const Twin a = draw_twin(draw), b = draw_twin(draw);
    const Pose X_WA = draw.pose(0.05);
    Pose X_WB = draw.pose(0.05);
    const Vector3 way = direction(draw);
    X_WB.position -= 0.6 * way;
    double before = closest_points(a.ours, X_WA, b.ours, X_WB).distance;
    for (int k = 0; k < 1200; ++k) {
      X_WB.position += 1e-3 * way;
      const double d = closest_points(a.ours, X_WA, b.ours, X_WB).distance;
      EXPECT_LE(std::abs(d - before), 1e-3 + 1e-6) << trial << " " << k;
      before = d;
    }
  }
}

TEST(ConvexShape, BoundingSphereContainsTheShape) {
  Draw draw(19);
  for (int trial = 0; trial < 500; ++trial) {
    const Twin a = draw_twin(draw);
    const BoundingSphere sphere = bounding_sphere(a.ours);
    for (int k = 0; k < 50; ++k) {
      const Vector3 n = direction(draw);
      const Vector3 p = a.ours.support(n) + a.ours.radius * n;
      EXPECT_LE((p - sphere.center).norm(), sphere.radius + 1e-12);
    }
  }
}

TEST(ConvexShape, RefusesInvalidShapes) {
  EXPECT_THROW(ConvexShape::sphere({0, 0, 0}, -1), std::invalid_argument);
  EXPECT_THROW(ConvexShape::sphere({0, NAN, 0}, 1), std::invalid_argument);
  EXPECT_THROW(ConvexShape::box({1, INFINITY, 1}), std::invalid_argument);
  EXPECT_THROW(ConvexShape::cylinder(NAN, 1), std::invalid_argument);
  EXPECT_THROW(ConvexShape::hull({}), std::invalid_argument);
  const std::vector<Vector3> many(kMaxShapeVertices + 1, Vector3::Zero());
  EXPECT_THROW(ConvexShape::hull(many), std::invalid_argument);
}

}  // namespace
}  // namespace multipanda::distance_test
