// Stiffnesses that rise while their springs are stretched: no force changes by a rise, and what the springs
// see comes back within its limits.
#include "core/controllets/raised_spring.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include <gtest/gtest.h>

#include "core/controllets/builtins.hpp"
#include "core/controllets/cooperative_frame.hpp"
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

// Beyond what the arm bears, more before or more after: the stiffnesses that act count, min(K, K') e = K' e'.
TEST(RaisedSpring, TheForceOfASoftenedSpringStays) {
  for (const auto& [k, k_next] : {std::pair{100.0, 20e3}, std::pair{20e3, 100.0}}) {
    Hand hand;
    const CartesianTarget rule = hand.at(error_of({0.05, -0.1, 0.1}, {0.2, 0.1, -0.1}));
    ImpedanceGains was = gains(Vector3::Constant(k), 300), is = gains(Vector3::Constant(k_next), 300);
    RaisedSpring raised;
    raised.follow(was, rule, hand.terms, kDt);
    const Vector6 e = hand.error(rule), e_seen = hand.error(raised.follow(is, rule, hand.terms, kDt));
    EXPECT_LT(was.soften(rule.X_W_d.rotation, hand.terms), 1);
    EXPECT_LT(is.soften(rule.X_W_d.rotation, hand.terms), 1);
    Vector6 K_was, K_is;
    K_was << was.translational_stiffness, was.rotational_stiffness;
    K_is << is.translational_stiffness, is.rotational_stiffness;
    EXPECT_LT((K_is.cwiseProduct(e_seen) - K_was.cwiseMin(K_is).cwiseProduct(e)).norm(), 1e-9) << k;
    EXPECT_LT(e_seen.tail<3>().norm(), k < 1e3 ? 1 : 0.9 * e.tail<3>().norm()) << "it rises";
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
  EXPECT_NEAR(kDt * k, 0.3 / 0.1 + 0.35 + 0.5, 0.35);  // the longer way, its ends, the feed-forward
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

// A hand on a lever about the frame, [m]: what the rule moves it by, its return and its turn keep to 0.8 of
// its greatest speed together, in this order. Expected numbers by hand.
TEST(RaisedSpring, OfAFrameSharesTheSpeedOfAHandBesideIt) {
  struct Case {
    double slides, turns, hand_speed, lever, expected, turning;  // the rule [m/s], [rad/s]
  };
  for (const Case& c : {Case{0, 0, 0.25, 0.5, 0.1, (0.2 - 0.1) / 0.5},  //
                        Case{0, 0.3, 0.25, 0.5, 0.05, 0},               //
                        Case{0.1, 0, 0.25, 0.2, 0.1, (0.2 - 0.1 * M_SQRT2) / 0.2},
                        Case{0.1, 0.2, 0.25, 0.2, 0.1, (0.16 - 0.1 * M_SQRT2) / 0.2},
                        Case{0, 0.4, 0.25, 0.5, 0, 0}, Case{0, 0, 0.1, 0, 0.04, 0.2},
                        Case{0, 0, 0.1, 0.1, 0.04, 0.2}, Case{5, 5, INFINITY, 0.5, 0.1, 0.5}}) {
    RaisedSpring raised;
    raised.put(error_of({0.3, 0, 0}, {0, 0, 1}));
    for (int k = 0; k < 600; ++k)
      raised.come_back(error_of({0, c.slides, 0}, {c.turns, 0, 0}), c.hand_speed, c.lever, kDt);
    EXPECT_LT((raised.velocity() - error_of({-c.expected, 0, 0}, {0, 0, -c.turning})).norm(), 2e-3)
        << c.slides << " " << c.turns << " " << c.lever;
    const Vector6 there = raised.offset();
    raised.come_back(Vector6::Zero(), c.hand_speed, c.lever, kDt);
    EXPECT_LT((raised.offset() - there - kDt * raised.velocity()).norm(), 1e-12);
    const Vector6 elsewhere = error_of({0.1, 0.2, 0.3}, {0.3, 0.2, 0.1});
    raised.put(elsewhere);
    EXPECT_LT((raised.offset() - elsewhere).norm(), 1e-15);
  }
}

// A rule that is faster by itself, such as a stream, is left ahead: what is seen has 0.8 of the hand's speed.
TEST(RaisedSpring, LeavesAFastRuleAhead) {
  for (const auto& [slides, turns] : {std::pair{0.25, 0.0}, {0.5, 0.0}, {0.0, 0.5}, {0.15, 0.4}}) {
    RaisedSpring raised;
    raised.put(error_of({0.01, 0, 0}, {0.01, 0, 0}));
    const CartesianTarget rule{{}, Twist{error_of({slides, 0, 0}, {turns, 0, 0})}, {}};
    for (int k = 0; k < 600; ++k) raised.come_back(rule.V_d.vector, 0.25, 0.5, kDt);
    const double share = 0.2 / (slides + 0.5 * turns);
    EXPECT_LT((raised.seen(rule).V_d.vector - share * rule.V_d.vector).norm(), 1e-3) << slides << turns;
  }
}

// An axis that had no stiffness saw a set-point at rest. That sets off from there, with 2 m/s^2 at most, and
// its acceleration is fed forward again within 0.5 s after its return.
TEST(RaisedSpring, AnAxisThatHadNoStiffnessSetsOffSlowly) {
  Hand hand;
  RaisedSpring raised;
  CartesianTarget rule = hand.at(error_of({0.02, 0, 0}, {0, 0, 0}));
  rule.V_d.linear() = Vector3(0.15, 0, 0);
  rule.A_d.linear() = Vector3(1, 0, 0);
  raised.follow(gains(Vector3::Zero(), 10), rule, hand.terms, kDt);
  CartesianTarget before = raised.follow(gains(Vector3::Constant(200), 10), rule, hand.terms, kDt);
  EXPECT_EQ(before.V_d.vector.norm(), 0);
  EXPECT_EQ(before.A_d.vector.norm(), 0);
  int fed = 0;
  for (int k = 0; !raised.none(); ++k) {
    ASSERT_LT(k, 5000);
    const CartesianTarget now = raised.follow(gains(Vector3::Constant(200), 10), rule, hand.terms, kDt);
    EXPECT_LT((now.V_d.linear() - before.V_d.linear()).norm(), 2.01 * kDt) << k;
    EXPECT_LT((now.A_d.linear() - before.A_d.linear()).norm(), 2.01 * kDt) << k;
    if (now.A_d.vector.norm() > 0) ++fed;
    before = now;
  }
  EXPECT_NEAR(fed, 500, 2);
  EXPECT_EQ(before.A_d.linear().x(), 1);
}

// Between hands on a lever of 0.5 m, each of which moves with half of it: twice what the rule leaves of their
// speed, 2 (0.25 - v - 0.5 w).
TEST(RaisedSpring, BetweenHandsReturnsWithWhatTheFrameLeavesThem) {
  Hand hand;
  std::array<OwnedArm, 2> arms{OwnedArm{.terms = &hand.terms}, OwnedArm{.terms = &hand.terms}};
  const ControlContext context{.dt = kDt, .arms = arms, .contact = {}};
  CartesianTarget rule = hand.at(error_of({0, 0.3, 0.4}, {0, 0, 0}));
  struct Case {
    double slides, turns, expected, turning;
  };
  for (const Case& c : {Case{0, 0, 0.1, 0.5}, Case{0.2, 0, 0.04, (0.08 - 0.04) / 0.5},
                        Case{0.1, 0.1, 0.08, (0.16 - 0.08) / 0.5}, Case{0.1, 0.4, 0, 0}}) {
    rule.V_d.vector = error_of({0, c.slides, 0}, {c.turns, 0, 0});
    RaisedSpring absolute, relative;
    relative.put(error_of({0.3, 0, 0}, {0, 0, 1}));
    for (int k = 0; k < 600; ++k)
      EXPECT_EQ(come_back(absolute, relative, rule, context).V_d.vector, rule.V_d.vector);
    EXPECT_LT((relative.velocity() - error_of({-c.expected, 0, 0}, {0, 0, -c.turning})).norm(), 2e-3)
        << c.slides << " " << c.turns;
  }
}

// The rule slides, and turns faster and faster; the feed-forward of its acceleration ends within 0.5 s.
TEST(RaisedSpring, WhatIsSeenMovesAsItsVelocityAndAccelerationSay) {
  RaisedSpring raised;
  raised.put(error_of({0.3, 0, 0}, {0.2, 0, 1}));
  CartesianTarget before;
  for (int k = 0; k < 400; ++k) {
    const double t = kDt * k;
    const Vector6 V = error_of({0.05, 0.1, 0}, {0.5 + 2 * t, 0, 0}), A = error_of({0, 0, 0}, {2, 0, 0});
    const CartesianTarget rule{{exp_rotation(Vector3((0.5 + t) * t, 0, 0)), t * V.head<3>()}, Twist{V}, {A}};
    raised.come_back(V, INFINITY, 0, kDt);
    const CartesianTarget now = raised.seen(rule);
    if (k > 0) {
      EXPECT_LT((pose_error(now.X_W_d, before.X_W_d) / kDt - now.V_d.vector).norm(), 5e-3) << k;
      const double fed = 1 - (t + kDt) / 0.5;
      EXPECT_LT((fed * (now.V_d.vector - before.V_d.vector) / kDt - now.A_d.vector).norm(), 1) << k;
    }
    before = now;
  }
}

// K' e' = K e along axes that turn with the set-point; the error is a vector, and what it is ahead adds up.
TEST(RaisedSpring, OfAVectorKeepsTheForceOfEachRise) {
  Draw draw(5);
  const Matrix3 R = draw.rotation();
  const auto in_axes = [&](const Vector6& e) {
    return error_of(R.transpose() * e.head<3>(), R.transpose() * e.tail<3>());
  };
  const auto of = [](const Vector3& k, double rotation) {
    return gains(k, rotation, StiffnessAxes::end_effector);
  };
  const Vector6 error = error_of(draw.vector3(0.2), draw.vector3(0.5)), e = in_axes(error);
  RaisedSpring raised;
  const Vector6 once = raised.raise(of({0, 100, 300}, 5), of({50, 200, 100}, 20), R, error);
  EXPECT_LT((in_axes(once) - error_of({0, e[1] / 2, e[2]}, e.tail<3>() / 4)).norm(), 1e-12);
  const Vector6 twice = raised.raise(of({50, 200, 100}, 20), of({100, 250, 300}, 20), R, once);
  EXPECT_LT((in_axes(twice) - error_of({0, e[1] / 2.5, e[2] / 3}, e.tail<3>() / 4)).norm(), 1e-12);
  EXPECT_LT((raised.offset() - (twice - error)).norm(), 1e-12);
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
  for (int k = 0; k < 3; ++k) {  // once
    const Pose seen = raised.follow(gains(Vector3::Constant(200), 10), carried, hand.terms, 1e-9).X_W_d;
    EXPECT_LT(pose_error(seen, before * X).norm(), 1e-6);
  }
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

// From no stiffness, half a radian away: back with 0.5 rad/s, or 0.1 m/s of the hand, and within 0.8 of the
// greatest speed of the hand together with a rule that moves the same joint; a faster one is left ahead.
TEST(RaisedJoints, ComesBackWithinTheSpeedOfTheHand) {
  Hand hand;
  ArmState state{.q = bent(7), .dq = joint_constant(7, 0)};
  OwnedArm arm{.state = &state, .terms = &hand.terms};
  for (Eigen::Index i = 0; i < 7; ++i) {
    const double reach = hand.terms.J_V_WE().col(i).head<3>().norm();
    for (const double ruled : {0.0, 0.15, 0.3}) {  // of the hand [m/s]
      const JointVector along = JointVector::Unit(7, i);
      const JointTarget rule{state.q + 0.5 * along, ruled / reach * along, joint_constant(7, 0)};
      RaisedJoints raised;
      raised.follow(joint_constant(7, 0), rule, {}, arm, kDt);
      JointVector back(7);
      for (int k = 0; k < 700; ++k)
        back = raised.follow(joint_constant(7, 1), rule, {}, arm, kDt).dq_d - rule.dq_d;
      const double expected = std::min({0.5, 0.1 / reach, (0.2 - ruled) / reach});
      EXPECT_LT((back - expected * along).norm(), 2e-3) << i << " " << ruled;
    }
  }
}

// Every law with a spring, its hands held off its set-point, all stiffnesses doubled: no torque
// changes, and in the end it is that of a law that began with them.
TEST(RaisedLaws, ARiseChangesNoTorqueAndEndsAsIfThereHadBeenNone) {
  for (const ControlletType& type :
       {hold_controllet(), joint_impedance_controllet(), cartesian_impedance_controllet(),
        dual_cartesian_impedance_controllet(), coupled_dual_cartesian_impedance_controllet(),
        pose_follower_controllet(), force_controllet(), hybrid_force_controllet(), ufic_controllet(),
        coupled_ufic_controllet()}) {
    SCOPED_TRACE(type.descriptor.type);
    const std::size_t arms = type.descriptor.arms + type.descriptor.observes;
    const auto run = [&](bool rises) {
      ArmModelSource source = TestArm::make().source();
      source.motor_inertia = joint_constant(7, 1);  // bears all gains as they are
      Models models{std::make_shared<const ArmModel>(source)};
      source.X_WB.position.y() = 1;
      if (arms == 2) models.push_back(std::make_shared<const ArmModel>(std::move(source)));
      ControlletRig rig(type, models);
      const auto stiffness = [&](double share) {
        for (std::size_t i = 0; i < rig.parameters().size(); ++i) {
          const ParameterSpec& spec = rig.parameters().spec(i);
          if (spec.name.find("stiffness_n") != spec.name.npos &&
              spec.name.find("nullspace") == spec.name.npos)
            rig.set(spec.name, {share * std::max(spec.min, 0.01 * spec.max)});
        }
      };
      stiffness(rises ? 1 : 2);
      for (std::size_t i = 0; i < arms; ++i) {
        rig.state(i).has_wrench_estimate = true;
        rig.state(i).tau_J_d = joint_constant(7, 0);
      }
      EXPECT_EQ(rig.start(), LawResult::ok);
      Draw draw(6);
      for (std::size_t i = 0; i < type.descriptor.arms; ++i)
        rig.place(i, bent(7) + draw.joints(7, 0.05), joint_constant(7, 0));
      EXPECT_EQ(rig.tick(kDt), LawResult::ok);
      std::vector<JointVector> before;
      for (std::size_t i = 0; i < type.descriptor.arms; ++i) before.push_back(rig.tau(i));
      stiffness(2);
      EXPECT_EQ(rig.update(), LawResult::ok);
      for (std::size_t i = 0; i < type.descriptor.arms; ++i) {
        EXPECT_GT(before[i].norm(), 0.1);
        EXPECT_LT((rig.tau(i) - before[i]).norm(), 1e-6 * before[i].norm()) << i;
      }
      for (int k = 0; k < 3000; ++k) EXPECT_EQ(rig.tick(kDt), LawResult::ok);
      std::vector<JointVector> after;
      for (std::size_t i = 0; i < type.descriptor.arms; ++i) after.push_back(rig.tau(i));
      return after;
    };
    const auto raised = run(true), never = run(false);
    for (std::size_t i = 0; i < never.size(); ++i)
      EXPECT_LT((raised[i] - never[i]).norm(), 1e-6 * never[i].norm()) << i;
  }
}

// The hold of a load that nobody declared: stiffnesses that go up and down let it sink no farther.
TEST(RaisedLaws, AHoldBearsTheSameAfterEachRise) {
  ControlletRig rig(hold_controllet(), {TestArm::make().model()});
  rig.set("stiffness_nm_per_rad", {20});
  ASSERT_EQ(rig.start(), LawResult::ok);
  rig.place(0, bent(7) + joint_constant(7, 0.05), joint_constant(7, 0));
  ASSERT_EQ(rig.tick(kDt), LawResult::ok);
  const JointVector bears = rig.tau(0);
  EXPECT_GT(bears.norm(), 0.5);
  ControlletRig mixed(hold_controllet(), {TestArm::make().model()});  // one falls while the others rise
  mixed.set("stiffness_nm_per_rad", {20, 40, 20, 20, 20, 20, 20});
  ASSERT_EQ(mixed.start(), LawResult::ok);
  mixed.place(0, rig.state(0).q, joint_constant(7, 0));
  ASSERT_EQ(mixed.tick(kDt), LawResult::ok);
  mixed.set("stiffness_nm_per_rad", {40, 20, 40, 40, 40, 40, 40});
  ASSERT_EQ(mixed.update(), LawResult::ok);
  EXPECT_LT((mixed.tau(0) - bears).norm(), 1e-6);
  for (int k = 0; k < 5; ++k) {
    for (const double stiffness : {25.0, 40.0, 20.0}) {
      rig.set("stiffness_nm_per_rad", {stiffness});
      ASSERT_EQ(rig.update(), LawResult::ok);
      const double share = stiffness < 40 && (k > 0 || stiffness < 25) ? stiffness / 40 : 1;
      EXPECT_LT((rig.tau(0) - share * bears).norm(), 1e-6) << k << " " << stiffness;
    }
  }
}

}  // namespace
}  // namespace multipanda::raised_spring_test
