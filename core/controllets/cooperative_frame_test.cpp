#include "core/controllets/cooperative_frame.hpp"

#include <numbers>

#include <gtest/gtest.h>

#include "core/testing/test_arm.hpp"

namespace multipanda::cooperative_frame_test {
namespace {

using test::Draw;

struct Hands {
  Pose X_WE1, X_WE2, X_E1A, X_E2A;
  CooperativeFrame frame() const { return {X_WE1, X_E1A, X_WE2, X_E2A}; }
  Hands moved(const Vector6& V_1, const Vector6& V_2, double t) const {
    Hands other = *this;
    const auto move = [&](Pose& X, const Vector6& V) {
      X = {exp_rotation(t * V.tail<3>()) * X.rotation, X.position + t * V.head<3>()};
    };
    move(other.X_WE1, V_1);
    move(other.X_WE2, V_2);
    return other;
  }
};

// Two hands whose estimates of A differ by the given angle and a few centimeters.
Hands some_hands(Draw& draw, double angle) {
  Hands hands;
  hands.X_WE1 = draw.pose(1);
  hands.X_WE2 = draw.pose(1);
  hands.X_E1A = draw.pose(0.3);
  const Pose X_WA1 = hands.X_WE1 * hands.X_E1A;
  const Pose X_WA2{exp_rotation(angle * draw.rotation().col(0)) * X_WA1.rotation,
                   X_WA1.position + draw.vector3(0.05)};
  hands.X_E2A = hands.X_WE2.inverse() * X_WA2;
  return hands;
}

Vector6 some_vector(Draw& draw) {
  return Vector6::NullaryExpr([&] { return draw.uniform(-1, 1); });
}

TEST(CooperativeFrame, JacobianAgreesWithDifferencesOfTheCoordinates) {
  Draw draw(31);
  constexpr double h = 1e-5;
  for (int trial = 0; trial < 200; ++trial) {
    const Hands hands = some_hands(draw, draw.uniform(0, 2.0));
    const Vector6 V_1 = some_vector(draw), V_2 = some_vector(draw);
    const CooperativeFrame now = hands.frame();
    const CooperativeFrame after = hands.moved(V_1, V_2, h).frame();
    const CooperativeFrame before = hands.moved(V_1, V_2, -h).frame();
    const Vector6 V_a = pose_error(after.X_WA, before.X_WA) / (2 * h);
    const Vector6 V_r = (after.relative - before.relative) / (2 * h);
    EXPECT_NEAR((now.absolute_velocity(V_1, V_2) - V_a).norm(), 0, 1e-7);
    EXPECT_NEAR((now.relative_velocity(V_1, V_2) - V_r).norm(), 0, 1e-7);
  }
}

TEST(CooperativeFrame, ConservesPower) {
  Draw draw(32);
  for (int trial = 0; trial < 200; ++trial) {
    const CooperativeFrame frame = some_hands(draw, draw.uniform(0, 2.0)).frame();
    const Vector6 V_1 = some_vector(draw), V_2 = some_vector(draw);
    const Vector6 F_a = some_vector(draw), F_r = some_vector(draw);
    const double cooperative =
        F_a.dot(frame.absolute_velocity(V_1, V_2)) + F_r.dot(frame.relative_velocity(V_1, V_2));
    const double hands = frame.first_wrench(F_a, F_r).dot(V_1) + frame.second_wrench(F_a, F_r).dot(V_2);
    EXPECT_NEAR(cooperative, hands, 1e-12);
  }
}

// Hands that face each other are half a turn apart. A does not depend on it, and nothing jumps when a hand
// turns farther.
TEST(CooperativeFrame, HandsFacingEachOther) {
  Draw draw(33);
  Hands hands;
  hands.X_WE1 = draw.pose(0.5);
  const Pose X_WA{draw.rotation(), hands.X_WE1.position + Vector3(0, 0.2, 0)};
  hands.X_WE2 = {
      Eigen::AngleAxisd(std::numbers::pi, Vector3::UnitX()).toRotationMatrix() * hands.X_WE1.rotation,
      X_WA.position + Vector3(0, 0.2, 0)};
  hands.X_E1A = hands.X_WE1.inverse() * X_WA;
  hands.X_E2A = hands.X_WE2.inverse() * X_WA;
  EXPECT_NEAR(hands.frame().relative.norm(), 0, 1e-12);
  EXPECT_NEAR(pose_error(hands.frame().X_WA, X_WA).norm(), 0, 1e-12);

  Vector6 V_2 = Vector6::Zero();
  V_2.tail<3>() = Vector3::UnitX();
  for (double t = -0.1; t <= 0.1; t += 0.01) {  // the hands' own angle passes pi at t = 0
    const CooperativeFrame frame = hands.moved(Vector6::Zero(), V_2, t).frame();
    EXPECT_NEAR((frame.relative.tail<3>() - t * Vector3::UnitX()).norm(), 0, 1e-12);
    EXPECT_NEAR((pose_error(frame.X_WA, X_WA).tail<3>() - 0.5 * t * Vector3::UnitX()).norm(), 0, 1e-12);
  }
}

TEST(CooperativeFrame, RelativeForceSqueezes) {
  Draw draw(34);
  const CooperativeFrame frame = some_hands(draw, 0.3).frame();
  const Vector6 F_r = some_vector(draw);
  const Vector6 F_1 = frame.first_wrench(Vector6::Zero(), F_r);
  const Vector6 F_2 = frame.second_wrench(Vector6::Zero(), F_r);
  EXPECT_NEAR((F_1.head<3>() + F_2.head<3>()).norm(), 0, 1e-12);
  EXPECT_NEAR((F_2.head<3>() - F_r.head<3>()).norm(), 0, 1e-12);
}

}  // namespace
}  // namespace multipanda::cooperative_frame_test
