#include <gtest/gtest.h>

#include "core/geometry/shape.hpp"
#include "core/rt/guard/loop_guard.hpp"
#include "core/testing/test_arm.hpp"

namespace multipanda::geometry_guard_test {
namespace {

// Every kind of shape against every other, apart and overlapping: distances never allocate nor lock.
TEST(GeometryGuard, DistancesNeverAllocate) {
  if (!kLoopGuardWorks) GTEST_SKIP() << "a sanitizer has replaced malloc";
  test::Draw draw(21);
  const std::array<Vector3, 5> corners{draw.vector3(0.2), draw.vector3(0.2), draw.vector3(0.2),
                                       draw.vector3(0.2), draw.vector3(0.2)};
  const std::array shapes{
      ConvexShape::sphere({0.1, 0, 0}, 0.1), ConvexShape::capsule(corners[0], corners[1], 0.05),
      ConvexShape::box({0.2, 0.3, 0.1}),     ConvexShape::cylinder(0.1, 0.3),
      ConvexShape::hull(corners, 0.01),      ConvexShape::half_space()};
  std::vector<Pose> poses;
  for (int k = 0; k < 60; ++k) poses.push_back(draw.pose(k % 2 == 0 ? 0.1 : 1.0));
  int near = 0;
  LoopGuard::arm();
  for (const auto& A : shapes) {
    for (const auto& B : shapes) {
      for (std::size_t k = 0; k + 1 < poses.size(); ++k) {
        if (closest_points(A, poses[k], B, poses[k + 1]).distance < 0) ++near;
      }
    }
  }
  const LoopGuardCounts counts = LoopGuard::disarm();
  EXPECT_EQ(counts.heap_calls, 0u);
  EXPECT_EQ(counts.lock_calls, 0u);
  EXPECT_GT(near, 100);
}

}  // namespace
}  // namespace multipanda::geometry_guard_test
