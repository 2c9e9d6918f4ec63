// Stiffnesses that rise while their springs are stretched: no force changes by a rise, and what the springs
// see comes back within its limits.
#include "core/controllets/raised_spring.hpp"

#include <gtest/gtest.h>

#include "core/testing/controllet_rig.hpp"
#include "core/testing/test_arm.hpp"

namespace multipanda::raised_spring_test {
namespace {

using namespace test;

constexpr double kDt = 0.001;

ImpedanceGains gains(const Vector3& translation, double rotation, StiffnessAxes axes = StiffnessAxes::world) {
  ImpedanceGains gains{translation, Vector3::Constant(rotation)};
  gains.axes = axes;
  gains.contact = {};
  return gains;
}

struct Hand {
  Hand() : terms(TestArm::make(7).model()) { terms.update(bent(7), joint_constant(7, 0)); }
  // The set-point that is this far from the hand.
  CartesianTarget at(const Vector6& error) {
    const Pose& X = terms.X_WE();
    return {{exp_rotation(error.tail<3>()) * X.rotation, X.position + error.head<3>()}, {}, {}};
  }
  Vector6 error(const CartesianTarget& seen) { return pose_error(seen.X_W_d, terms.X_WE()); }
  ModelTerms terms;
};

Vector6 error_of(const Vector3& p, const Vector3& r) {
  Vector6 e;
  e << p, r;
  return e;
}

TEST(RaisedSpring, WithoutARiseTheRuleIsSeenBitForBit) {
  Hand hand;
  RaisedSpring raised;
  Draw draw(1);
  for (int k = 0; k < 20; ++k) {
    CartesianTarget rule = hand.at(error_of(draw.vector3(0.3), draw.vector3(0.5)));
    rule.V_d.vector = error_of(draw.vector3(0.2), draw.vector3(0.5));
    const double share = 1 - 0.05 * k;  // they fall
    const CartesianTarget seen =
        raised.follow(gains(share * Vector3(300, 200, 100), share * 20), rule, hand.terms, kDt);
    EXPECT_EQ(seen.X_W_d.position, rule.X_W_d.position);
    EXPECT_EQ(seen.X_W_d.rotation, rule.X_W_d.rotation);
    EXPECT_EQ(seen.V_d.vector, rule.V_d.vector);
  }
}

// At rest, along whatever axes: K' e' = K e where it rises, e' = e where it falls, nothing without stiffness.
TEST(RaisedSpring, TheForceOfTheSpringStays) {
  Draw draw(2);
  for (int trial = 0; trial < 40; ++trial) {
    Hand hand;
    const auto axes = trial % 2 == 0 ? StiffnessAxes::world : StiffnessAxes::end_effector;
    const CartesianTarget rule = hand.at(error_of(draw.vector3(0.2), draw.vector3(0.6)));
    const Matrix3 R = axes == StiffnessAxes::world ? Matrix3(Matrix3::Identity()) : rule.X_W_d.rotation;
    const Vector3 before(draw.uniform(10, 100), trial % 3 == 0 ? 0 : 50, draw.uniform(100, 200));
    const Vector3 now(draw.uniform(100, 200), draw.uniform(60, 200), draw.uniform(10, 100));
    RaisedSpring raised;
    raised.follow(gains(before, trial % 4 == 0 ? 0 : 4, axes), rule, hand.terms, kDt);
    const CartesianTarget seen = raised.follow(gains(now, 12, axes), rule, hand.terms, kDt);
    const Vector3 e = R.transpose() * hand.error(rule).head<3>();
    const Vector3 e_seen = R.transpose() * hand.error(seen).head<3>();
    EXPECT_NEAR(now.x() * e_seen.x(), before.x() * e.x(), 1e-9);
    EXPECT_NEAR(now.y() * e_seen.y(), before.y() * e.y(), 1e-9);
    EXPECT_NEAR(e_seen.z(), e.z(), 1e-9);
    const Vector3 r = hand.error(rule).tail<3>(), r_seen = hand.error(seen).tail<3>();
    EXPECT_LT((12 * r_seen - (trial % 4 == 0 ? 0 : 4) * r).norm(), 1e-9);
    EXPECT_EQ(seen.V_d.vector, rule.V_d.vector);
  }
}

// From nothing, 0.3 m and 1 rad away: back within 0.1 m/s, 0.5 rad/s, with continuous velocity, to the rule.
TEST(RaisedSpring, ComesBackWithinItsLimits) {
  Hand hand;
  RaisedSpring raised;
  const CartesianTarget rule = hand.at(error_of({0.1, -0.2, 0.2}, {0.6, 0.8, 0}));
  raised.follow(gains(Vector3::Zero(), 0), rule, hand.terms, kDt);
  CartesianTarget before = raised.follow(gains(Vector3::Constant(200), 10), rule, hand.terms, kDt);
  EXPECT_LT(hand.error(before).norm(), 1e-12);
  int k = 0;
  double fastest = 0, turning = 0;
  for (; k < 10000 && !raised.none(); ++k) {
    const CartesianTarget now = raised.follow(gains(Vector3::Constant(200), 10), rule, hand.terms, kDt);
    const Vector6 moved = pose_error(now.X_W_d, before.X_W_d) / kDt;
    EXPECT_LT((moved - now.V_d.vector).norm(), 1e-3) << k;
    EXPECT_LT((now.V_d.linear() - before.V_d.linear()).norm(), 4.01 * kDt) << k;
    EXPECT_LT((now.V_d.angular() - before.V_d.angular()).norm(), 8.01 * kDt) << k;
    fastest = std::max(fastest, now.V_d.linear().norm());
    turning = std::max(turning, now.V_d.angular().norm());
    before = now;
  }
  EXPECT_LT(fastest, 0.1001);
  EXPECT_LT(turning, 0.5005);
  EXPECT_NEAR(kDt * k, 0.3 / 0.1 + 0.35, 0.35);  // the longer way, and its ends
  EXPECT_LT(pose_error(rule.X_W_d, before.X_W_d).norm(), 1e-5);
}

// A rule that takes the whole of a hand's speed leaves none, along the same way; across it, what is left.
TEST(RaisedSpring, SharesTheSpeedOfTheHand) {
  for (const double cosine : {1.0, 0.6, 0.0, -1.0}) {
    Hand hand;
    RaisedSpring raised;
    CartesianTarget rule = hand.at(error_of({0.2, 0, 0}, {0, 0, 0}));
    raised.follow(gains(Vector3::Zero(), 10), rule, hand.terms, kDt);
    raised.follow(gains(Vector3::Constant(200), 10), rule, hand.terms, kDt);
    rule.V_d.linear() = 0.15 * Vector3(cosine, std::sqrt(1 - cosine * cosine), 0);
    CartesianTarget seen = rule;
    for (int k = 0; k < 500; ++k) {
      seen = raised.follow(gains(Vector3::Constant(200), 10), rule, hand.terms, kDt);
      EXPECT_LT(seen.V_d.linear().norm(), 0.2 + 1e-4);  // a cycle's change of direction
    }
    // |(0.15 c + s, 0.15 sqrt(1 - c^2))| = 0.8 * 0.25, s at most 0.1.
    const double most = std::sqrt(0.04 - 0.0225 * (1 - cosine * cosine)) - 0.15 * cosine;
    EXPECT_NEAR((seen.V_d.linear() - rule.V_d.linear()).x(), std::min(0.1, most), 1e-3) << cosine;
  }
}

TEST(RaisedSpring, WaitsForAHandThatCannotFollow) {
  Hand hand;
  RaisedSpring raised;
  const CartesianTarget rule = hand.at(error_of({0.2, 0, 0}, {0, 0, 1}));
  raised.follow(gains(Vector3::Zero(), 0), rule, hand.terms, kDt);
  const auto step = [&](double share) {
    const CartesianTarget seen = raised.follow(gains(Vector3::Constant(200), 10), rule, hand.terms, kDt);
    raised.resist(error_of({60, 0, 0}, {0, 0, 15}), share, share, kDt);
    return seen.V_d.vector;
  };
  for (int k = 0; k < 500; ++k) step(1);
  EXPECT_LT(step(1).norm(), 1e-3);
  for (int k = 0; k < 500; ++k) step(0);
  EXPECT_NEAR(step(0).norm(), std::hypot(0.1, 0.5), 0.01);
}

// E_new = E_old X: what is seen moves along with the hand.
TEST(RaisedSpring, ARedefinedEndEffectorCarriesWhatIsSeen) {
  Hand hand;
  RaisedSpring raised;
  const CartesianTarget rule = hand.at(error_of({0.2, 0, 0.1}, {0.3, 0, 1}));
  raised.follow(gains(Vector3::Zero(), 0), rule, hand.terms, kDt);
  raised.follow(gains(Vector3::Constant(200), 10), rule, hand.terms, kDt);
  const Pose before = raised.follow(gains(Vector3::Constant(200), 10), rule, hand.terms, 1e-9).X_W_d;
  Draw draw(4);
  const Pose X = draw.pose(0.1);
  hand.terms.set_config({X, {}}, {}, {});
  hand.terms.update(bent(7), joint_constant(7, 0));
  const CartesianTarget carried{rule.X_W_d * X, {}, {}};
  const Pose seen = raised.follow(gains(Vector3::Constant(200), 10), carried, hand.terms, 1e-9).X_W_d;
  EXPECT_LT(pose_error(seen, before * X).norm(), 1e-6);
}

// Some joints' stiffnesses rise, others fall, beyond what the arm bears: the torque is that of the law whose
// stiffnesses only fall.
TEST(RaisedJoints, TheTorqueOfTheSpringsStays) {
  Draw draw(3);
  for (int trial = 0; trial < 20; ++trial) {
    Hand hand;
    ArmState state;
    state.q = bent(7);
    state.dq = joint_constant(7, 0);
    JointVector tau, before(7), now(7);
    OwnedArm arm{.state = &state, .terms = &hand.terms, .tau = &tau};
    for (Eigen::Index i = 0; i < 7; ++i) {
      before[i] = draw.uniform(0, 300);
      now[i] = draw.coin() ? draw.uniform(300, 1000) : draw.uniform(0, before[i]);
    }
    if (trial % 3 == 0) before[2] = 0;
    const JointTarget target{state.q + draw.joints(7, 0.3), joint_constant(7, 0), joint_constant(7, 0)};
    const auto law = [&](const JointVector& K, RaisedJoints& raised) {
      JointPull pull;
      EXPECT_EQ(joint_impedance_law({.stiffness = K}, target, state.dq, ContactBounds::lifted(), arm, kDt,
                                    raised, pull),
                LawResult::ok);
      return tau;
    };
    RaisedJoints never, raised;
    const JointVector expected = law(before.cwiseMin(now), never);
    law(before, raised);
    const JointVector after = law(now, raised);
    EXPECT_LT((after - expected).norm(), 1e-5 * (1 + expected.norm())) << trial;
    // It comes back in the end, as if the stiffness had never been another one.
    for (int k = 0; k < 8000; ++k) law(now, raised);
    RaisedJoints other;
    EXPECT_EQ(law(now, raised), law(now, other)) << trial;
  }
}

}  // namespace
}  // namespace multipanda::raised_spring_test
