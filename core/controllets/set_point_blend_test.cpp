// Set-points that are led over to a rule, and beside it: continuous, with the velocity and acceleration of
// their own motion, and the rule's in the end.
#include "core/controllets/set_point_blend.hpp"

#include <gtest/gtest.h>

#include "core/testing/test_arm.hpp"

namespace multipanda::set_point_blend_test {
namespace {

using test::Draw;

constexpr double kDt = 1e-4;

// A rule that accelerates along a line and turns about an axis, ever faster.
struct Rule {
  explicit Rule(Draw& draw)
      : R(draw.rotation()), v(draw.vector3(0.2)), a(draw.vector3(0.3)), axis(draw.rotation().col(0)) {}
  CartesianTarget at(double t) const {
    CartesianTarget rule;
    rule.X_W_d = {exp_rotation((0.3 * t + 0.2 * t * t) * axis) * R, t * v + 0.5 * t * t * a};
    rule.V_d.linear() = v + t * a;
    rule.V_d.angular() = (0.3 + 0.4 * t) * axis;
    rule.A_d.linear() = a;
    rule.A_d.angular() = 0.4 * axis;
    return rule;
  }
  Matrix3 R;
  Vector3 v, a, axis;
};

// Plays the moving rule until the blend is over and checks its rates by differences.
template <typename Blend>
void expect_rates(Blend& blend, const Rule& rule) {
  CartesianTarget before = blend.advance(rule.at(0), kDt);
  int k = 1;
  for (; k < 80000 && !blend.over(); ++k) {
    const CartesianTarget now = blend.advance(rule.at(k * kDt), kDt);
    const Vector3 moved = (now.X_W_d.position - before.X_W_d.position) / kDt;
    const Vector3 turned = log_rotation(now.X_W_d.rotation * before.X_W_d.rotation.transpose()) / kDt;
    const Vector3 faster = (now.V_d.linear() - before.V_d.linear()) / kDt;
    const Vector3 turning = (now.V_d.angular() - before.V_d.angular()) / kDt;
    ASSERT_LT((moved - 0.5 * (now.V_d.linear() + before.V_d.linear())).norm(), 1e-5) << k;
    ASSERT_LT((turned - 0.5 * (now.V_d.angular() + before.V_d.angular())).norm(), 1e-5) << k;
    ASSERT_LT((faster - 0.5 * (now.A_d.linear() + before.A_d.linear())).norm(), 1e-3) << k;
    ASSERT_LT((turning - 0.5 * (now.A_d.angular() + before.A_d.angular())).norm(), 1e-3) << k;
    before = now;
  }
  const CartesianTarget end = blend.advance(rule.at(k * kDt), kDt), expected = rule.at(k * kDt);
  EXPECT_TRUE(blend.over());
  EXPECT_LT((end.X_W_d.position - expected.X_W_d.position).norm(), 1e-12);
  EXPECT_LT((end.X_W_d.rotation - expected.X_W_d.rotation).norm(), 1e-12);
  EXPECT_LT((end.V_d.vector - expected.V_d.vector).norm(), 1e-12);
  EXPECT_LT((end.A_d.vector - expected.A_d.vector).norm(), 1e-12);
}

TEST(SetPointBlend, HasTheRatesOfItsMotionAndEndsAtTheRule) {
  Draw draw(71);
  for (const auto& [way, turn] : {std::pair{0.1, 0.5}, {0.1, 0.0}, {0.0, 0.5}}) {
    const Rule rule(draw);
    const Pose X_rule = rule.at(0).X_W_d;
    const Pose X_now{exp_rotation(turn * draw.rotation().col(0)) * X_rule.rotation,
                     X_rule.position + way * draw.rotation().col(0)};
    SetPointBlend blend;
    blend.capture(X_now, X_rule, 10);
    EXPECT_FALSE(blend.over());
    CartesianTarget rest;  // of a rule at rest: nothing moves
    rest.X_W_d = X_rule;
    for (int k = 0; k < 100; ++k) {
      const CartesianTarget now = blend.advance(rest, kDt);
      EXPECT_LT((now.X_W_d.position - X_now.position).norm(), 1e-12);
      EXPECT_LT((now.X_W_d.rotation - X_now.rotation).norm(), 1e-12);
      EXPECT_EQ(now.V_d.vector.norm(), 0);
    }
    expect_rates(blend, rule);
  }
}

TEST(SetPointBlend, OfNoDifferenceIsOverAtOnce) {
  SetPointBlend blend;
  const Pose X{rotation_from_rpy({0.1, 0.2, 0.3}), {0.1, 0.2, 0.3}};
  blend.capture(X, X, 1);
  EXPECT_TRUE(blend.over());
  EXPECT_EQ(blend.top_speed(), 0);
}

TEST(SetPointShift, HasTheRatesOfItsMotionAndEndsAtTheRule) {
  Draw draw(72);
  for (int trial = 0; trial < 4; ++trial) {
    const Rule rule(draw);
    const Pose X{exp_rotation(draw.vector3(0.3)), draw.vector3(0.1)};
    SetPointShift shift;
    EXPECT_TRUE(shift.over());
    shift.add(X, 10);
    EXPECT_FALSE(shift.over());
    EXPECT_NEAR(shift.lever(), X.position.norm(), 1e-12);
    CartesianTarget rest;
    rest.X_W_d = rule.at(0).X_W_d;
    const Pose expected = rest.X_W_d * X;
    for (int k = 0; k < 100; ++k) {
      const CartesianTarget now = shift.advance(rest, kDt);
      EXPECT_LT((now.X_W_d.position - expected.position).norm(), 1e-12);
      EXPECT_LT((now.X_W_d.rotation - expected.rotation).norm(), 1e-12);
    }
    expect_rates(shift, rule);
  }
}

}  // namespace
}  // namespace multipanda::set_point_blend_test
