#include "core/state/load_ramp.hpp"

#include <Eigen/Eigenvalues>
#include <gtest/gtest.h>

#include "core/testing/test_arm.hpp"

namespace multipanda::load_ramp_test {
namespace {

// Second moments about the flange of a cloud of points: how a body's mass is spread, whatever its frame.
Eigen::Matrix4d moments(const Load& load) {
  const Matrix3 spread = 0.5 * load.inertia_C.trace() * Matrix3::Identity() - load.inertia_C;
  Eigen::Matrix4d all;
  all << spread + load.mass * load.p_FC * load.p_FC.transpose(), load.mass * load.p_FC,
      load.mass * load.p_FC.transpose(), load.mass;
  return all;
}

Load body(test::Draw& draw) {
  const Matrix3 R = draw.rotation();
  const Vector3 spread(draw.uniform(1e-3, 1e-2), draw.uniform(1e-3, 1e-2), draw.uniform(1e-3, 1e-2));
  const Vector3 principal(spread.y() + spread.z(), spread.z() + spread.x(), spread.x() + spread.y());
  return {draw.uniform(0.2, 3), draw.vector3(0.2), R * principal.asDiagonal() * R.transpose()};
}

// Mass, first and second moments are each the mean of the two, weighted by the time; the body stays one that
// can exist.
TEST(LoadRamp, MixesTheBodies) {
  test::Draw draw(5);
  for (int i = 0; i < 50; ++i) {
    const Load a = i % 3 == 0 ? Load{} : body(draw), b = i % 3 == 1 ? Load{} : body(draw);
    LoadRamp ramp(a);
    EXPECT_FALSE(ramp.advance(0.001));
    ramp.aim(b);
    EXPECT_EQ(ramp.now().mass, a.mass) << "not at once";
    for (int k = 1; k < 1000; ++k) {
      ASSERT_TRUE(ramp.advance(0.001));
      const double share = 0.001 * k;
      ASSERT_LT((moments(ramp.now()) - (1 - share) * moments(a) - share * moments(b)).norm(), 1e-12);
      ASSERT_GT(Eigen::SelfAdjointEigenSolver<Eigen::Matrix4d>(moments(ramp.now())).eigenvalues()[0], -1e-12);
    }
    EXPECT_TRUE(ramp.advance(0.0011));
    EXPECT_EQ(ramp.now().mass, b.mass);
    EXPECT_EQ(ramp.now().p_FC, b.p_FC);
    EXPECT_EQ(ramp.now().inertia_C, b.inertia_C);
    EXPECT_FALSE(ramp.advance(0.001));
  }
}

TEST(LoadRamp, GoesOnFromWhatItIsWhenAnotherLoadComes) {
  LoadRamp ramp;
  ramp.aim({.mass = 2});
  for (int k = 0; k < 500; ++k) ramp.advance(0.001);
  EXPECT_NEAR(ramp.now().mass, 1, 1e-9);
  ramp.aim({});
  ramp.advance(0.25);
  EXPECT_NEAR(ramp.now().mass, 0.75, 1e-9);
  ramp.advance(10);
  EXPECT_EQ(ramp.now().mass, 0);
}

}  // namespace
}  // namespace multipanda::load_ramp_test
