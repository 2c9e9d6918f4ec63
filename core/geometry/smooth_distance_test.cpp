#include <array>
#include <cmath>

#include <gtest/gtest.h>

#include "core/geometry/shape.hpp"
#include "core/testing/smooth_reference.hpp"
#include "core/testing/test_arm.hpp"

namespace multipanda::smooth_distance_test {
namespace {

using test::Draw;
using Kind = ConvexShape::Kind;

ConvexShape some_shape(Draw& draw, Kind kind) {
  switch (kind) {
    case Kind::sphere:
      return ConvexShape::sphere(draw.vector3(0.1), draw.uniform(0.01, 0.1));
    case Kind::capsule:
      return ConvexShape::capsule(draw.vector3(0.1), draw.vector3(0.1), draw.uniform(0.01, 0.1));
    case Kind::box:
      return ConvexShape::box({draw.uniform(0.02, 0.3), draw.uniform(0.02, 0.3), draw.uniform(0.02, 0.3)},
                              draw.coin() ? 0.01 : 0);
    case Kind::cylinder:
      return ConvexShape::cylinder(draw.uniform(0.02, 0.1), draw.uniform(0.05, 0.3));
    case Kind::vertices: {
      std::array<Vector3, 6> corners;
      for (auto& corner : corners) corner = draw.vector3(0.15);
      return ConvexShape::hull(corners, 0.01);
    }
    case Kind::half_space:
      break;
  }
  return ConvexShape::half_space();
}

constexpr std::array kKinds{Kind::sphere,   Kind::capsule,  Kind::box,
                            Kind::cylinder, Kind::vertices, Kind::half_space};

struct Near {
  ConvexShape A, B;
  Pose X_WA, X_WB;
  Closest exact() const { return closest_points(A, X_WA, B, X_WB); }
  Closest smooth() const { return smooth_points(A, X_WA, B, X_WB, exact()); }
};

// Two bodies at the distance `apart`, turned as they come; every third time A's core lies along B's face.
Near some_pair(Draw& draw, Kind a, Kind b, double apart) {
  Near pair{some_shape(draw, a), some_shape(draw, b), draw.pose(0.4), draw.pose(0.4)};
  if (a == Kind::capsule && draw.index(3) == 0) {
    const Vector3 along = pair.A.p1 - pair.A.p0;
    const Vector3 axis = pair.X_WB.rotation.col(static_cast<Eigen::Index>(draw.index(2)));
    pair.X_WA.rotation = Quaternion::FromTwoVectors(along, axis + draw.vector3(0.05)).toRotationMatrix();
  }
  for (int round = 0; round < 20; ++round) {
    const Closest c = pair.exact();
    pair.X_WA.position += (apart - c.distance) * c.normal;
  }
  return pair;
}

TEST(SmoothDistance, IsTheMinimumOfItsDefinition) {
  Draw draw(141);
  int ends = 0, inside = 0;
  for (const Kind a : kKinds) {
    for (const Kind b : kKinds) {
      if (a == Kind::half_space && b == Kind::half_space) continue;
      for (int trial = 0; trial < 12; ++trial) {
        const Near pair = some_pair(draw, a, b, draw.uniform(-0.004, 0.08));
        const double exact = pair.exact().distance;
        const Closest smooth = pair.smooth();
        const double searched = test::smooth_reference(pair.A, pair.X_WA, pair.B, pair.X_WB);
        ASSERT_NEAR(smooth.distance, searched, 1e-7)
            << static_cast<int>(a) << " " << static_cast<int>(b) << " " << trial;
        ASSERT_LE(smooth.distance, exact + 1e-8);
        ASSERT_GE(smooth.distance, exact - 3 * kEven);
        ASSERT_NEAR(smooth.normal.norm(), 1, 1e-9);
        (std::abs(smooth.distance - exact) < 1e-7 ? ends : inside) += 1;
      }
    }
  }
  EXPECT_GT(ends, 100);
  EXPECT_GT(inside, 25);
}

// Moving a body by a small screw changes the distance by the normal's share of what the point does.
TEST(SmoothDistance, ChangesAsItsPointsMove) {
  Draw draw(142);
  for (const Kind b : {Kind::capsule, Kind::half_space, Kind::box, Kind::vertices, Kind::sphere}) {
    for (int trial = 0; trial < 60; ++trial) {
      const Near pair =
          some_pair(draw, trial % 4 == 0 ? Kind::box : Kind::capsule, b, draw.uniform(0.005, 0.05));
      if (pair.A.kind == Kind::box && b != Kind::half_space && b != Kind::capsule) continue;
      const Closest c = pair.smooth();
      const Vector3 v = draw.vector3(1), w = draw.vector3(3);
      constexpr double h = 1e-6;
      const auto moved = [&](double t) {
        Near other = pair;
        const double angle = w.norm() * t;
        other.X_WA = Pose{Eigen::AngleAxisd(angle, w.normalized()).toRotationMatrix(), t * v} * pair.X_WA;
        return other.smooth().distance;
      };
      const double rate = (moved(h) - moved(-h)) / (2 * h);
      EXPECT_NEAR(rate, c.normal.dot(v + w.cross(c.p_A)), 2e-5) << static_cast<int>(b) << " " << trial;
    }
  }
}

// A capsule rocks above a plane, a box and another capsule. Its closest point jumps from end to end; the
// smooth one moves by at most h (h / 2e) per radian, and the distance changes nowhere faster.
TEST(SmoothDistance, PointsMoveContinuously) {
  Draw draw(143);
  constexpr double h = 0.05, step = 1e-4;
  const ConvexShape rod = ConvexShape::capsule({-h, 0, 0}, {h, 0, 0}, 0.02);
  const std::array floors{ConvexShape::half_space(), ConvexShape::box({1, 1, 0.1}),
                          ConvexShape::capsule({-0.3, 0, 0}, {0.3, 0, 0}, 0.05)};
  const std::array tops{0.0, 0.05, 0.05};
  for (std::size_t k = 0; k < floors.size(); ++k) {
    const Pose X = draw.pose(1);
    double jump = 0, moved = 0;
    Closest last;
    Vector3 last_exact = Vector3::Zero();
    for (int i = -2000; i <= 2000; ++i) {
      const Pose X_FA{rotation_from_rpy({0, i * step, 0}), {0, 0, tops[k] + 0.02 + 0.03}};
      const Closest exact = closest_points(rod, X * X_FA, floors[k], X);
      const Closest smooth = smooth_points(rod, X * X_FA, floors[k], X, exact);
      if (i > -2000) {
        jump = std::max(jump, (exact.p_A - last_exact).norm());
        moved = std::max(moved, (smooth.p_A - last.p_A).norm());
        EXPECT_LT(std::abs(smooth.distance - last.distance), 1.1 * h * step);
      }
      last = smooth;
      last_exact = exact.p_A;
    }
    EXPECT_GT(jump, 0.9 * h) << k;
    EXPECT_LT(moved, 1.2 * (h * h / (2 * kEven) + 0.1) * step) << k;
  }
}

TEST(SmoothDistance, OfCoresThatOverlapIsTheExactOne) {
  const ConvexShape rod = ConvexShape::capsule({-0.1, 0, 0}, {0.1, 0, 0}, 0.02);
  const Pose across{rotation_from_rpy({0, 0, 1}), {0.01, 0, 0}};
  const Closest exact = closest_points(rod, {}, rod, across);
  EXPECT_EQ(smooth_points(rod, {}, rod, across, exact).distance, exact.distance);
  const ConvexShape box = ConvexShape::box({0.3, 0.3, 0.3});
  const Closest inside = closest_points(rod, across, box, {});
  EXPECT_EQ(smooth_points(rod, across, box, {}, inside).distance, inside.distance);
}

}  // namespace
}  // namespace multipanda::smooth_distance_test
