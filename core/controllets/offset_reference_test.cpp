#include "core/controllets/offset_reference.hpp"

#include <gtest/gtest.h>

#include "core/controllets/builtins.hpp"
#include "core/testing/controllet_rig.hpp"
#include "core/testing/test_arm.hpp"

namespace multipanda::offset_reference_test {
namespace {

using namespace test;

const Pose kFirstBase{rotation_from_rpy({0.1, 0, 0.4}), Vector3(0, 0.4, 0)};
const Pose kSecondBase{rotation_from_rpy({0, 0.2, -0.5}), Vector3(0.1, -0.4, 0)};

// Both set-points, while the arms stand still: the output is the set-point minus a constant.
struct Moved {
  double fastest = 0, hardest = 0;  // [m/s], [m/s^2]
  Vector3 way = Vector3::Zero();
};

Moved change(const ControlletType& type, const char* parameter, std::vector<double> value,
             const char* output) {
  ControlletRig rig(type, {TestArm::make(7).model(kFirstBase), TestArm::make(6, 2).model(kSecondBase)});
  EXPECT_EQ(rig.start(), LawResult::ok);
  const auto error = [&] {
    const auto e = rig.output(output);
    return Vector3(e[0], e[1], e[2]);
  };
  for (int k = 0; k < 100; ++k) EXPECT_EQ(rig.tick(0.001), LawResult::ok);
  const Vector3 start = error();
  rig.approach(parameter, std::move(value));
  Vector3 p = start, v = Vector3::Zero();
  Moved moved;
  for (int k = 0; k < 9000; ++k) {
    EXPECT_EQ(rig.tick(0.001), LawResult::ok);
    const Vector3 v_now = (error() - p) / 0.001;
    moved.fastest = std::max(moved.fastest, v_now.norm());
    moved.hardest = std::max(moved.hardest, (v_now - v).norm() / 0.001);
    v = v_now;
    p = error();
  }
  moved.way = p - start;
  return moved;
}

// A ramp of 0.2 s would move each set-point by 0.85 m at 4.25 m/s.
TEST(OffsetOfCommonPose, IsApproachedWithinTheLimitsOfTheReference) {
  const Moved moved =
      change(dual_cartesian_impedance_controllet(), "offset_m", {0, 1.0, 0}, "first_position_error_m");
  EXPECT_LT(moved.fastest, 0.25 * 1.002);  // half of 0.5 m/s
  EXPECT_GT(moved.fastest, 0.2);
  EXPECT_LT(moved.hardest, 4.1);
  EXPECT_NEAR(moved.way.norm(), 0.85, 1e-9);
}

TEST(RelativeOffset, IsApproachedWithinTheLimitsOfTheReference) {
  const Moved moved = change(coupled_dual_cartesian_impedance_controllet(), "relative_offset_m", {0, 0.1, 0},
                             "relative_position_error_m");
  EXPECT_LT(moved.fastest, 0.25 * 1.002);
  EXPECT_LT(moved.hardest, 4.1);
  EXPECT_NEAR((moved.way - Vector3(0, 0.1, 0)).norm(), 0, 1e-9);
}

// What is left for the rest of the hand's speed: half of it while the offset changes, all of it at rest.
TEST(OffsetReference, NeedsItsShareOfTheSpeedOnlyWhileItMoves) {
  OffsetReference offset;
  offset.start({0.1, 0, -0.2});
  EXPECT_EQ(offset.top_speed(0.3), 0);
  offset.advance({0.1, 0, -0.2}, 0.3, 0.001);
  EXPECT_EQ(offset.top_speed(0.3), 0);
  offset.advance({0.1, 0.1, -0.2}, 0.3, 0.001);
  EXPECT_NEAR(offset.top_speed(0.3), 0.15, 1e-12);
  for (int k = 0; k < 3000; ++k) offset.advance({0.1, 0.1, -0.2}, 0.3, 0.001);
  EXPECT_EQ(offset.top_speed(0.3), 0);
}

// New values on the way do not interrupt it, and the speed limit is that of the input.
TEST(OffsetReference, ChangesItsGoalSmoothly) {
  OffsetReference offset;
  offset.start({0.1, 0, -0.2});
  Vector3 p = offset.position(), v = Vector3::Zero();
  for (int k = 0; k < 6000; ++k) {
    const Vector3 goal = k < 400   ? Vector3(0.5, 0.1, 0)
                         : k < 900 ? Vector3(-0.4, 0, 0.3)
                                   : Vector3(0, 0.2, 0);
    offset.advance(goal, 0.3, 0.001);
    EXPECT_NEAR((offset.position() - p - 0.0005 * (v + offset.velocity())).norm(), 0, 1e-7);
    EXPECT_LT((offset.velocity() - v).norm(), 4.1e-3);
    EXPECT_LT(offset.velocity().norm(), 0.5 * 0.3 * 1.34);  // by a third more where a goal reverses the last
    p = offset.position();
    v = offset.velocity();
  }
  EXPECT_NEAR((p - Vector3(0, 0.2, 0)).norm(), 0, 1e-12);
}

}  // namespace
}  // namespace multipanda::offset_reference_test
