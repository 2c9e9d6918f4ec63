// A held carriage: it resists with the bound for contact, and is led back with no more.
#include <cmath>

#include <gtest/gtest.h>

#include "core/controllets/builtins.hpp"
#include "core/testing/carriage.hpp"
#include "core/testing/controllet_rig.hpp"

namespace multipanda::prismatic_hold_test {
namespace {

using namespace test;

// A hold leads a carriage back from beyond its limit with no more than the bounds for contact allow.
TEST(PrismaticHold, AreLedBackWithinTheBoundForContact) {
  for (const auto& [bound, most] : {std::pair{30.0, 30.0}, {60.0, 60.0}, {1000.0, 60.0}}) {
    ControlletRig rig(hold_controllet(), {axis(25)});
    rig.bound({.hand_speed = 0.25, .spring_force = bound, .spring_moment = 15});
    rig.place(0, one(0.9), one(0));
    ASSERT_EQ(rig.start(), LawResult::ok);
    for (int k = 0; k < 2000; ++k) {
      ASSERT_EQ(rig.tick(0.001), LawResult::ok);
      ASSERT_LE(-rig.tau(0)[0], most + 10000 * 1e-4 + 1e-9);  // one step of the way beyond it
    }
    EXPECT_GT(-rig.tau(0)[0], most - 1.1);
  }
}

// A held carriage resists with the bound for contact and stays where it was put: with K times the way, 25 kg
// would come back with 400 N. Its damping is whole, and a joint that turns is held as ever.
TEST(PrismaticHold, AreHeldWithinTheBoundForContactAndStayWhereTheyArePut) {
  const double m = 25, K = 10000, D = 2 * std::sqrt(K * m);
  for (const auto& [bound, most] : {std::pair{30.0, 30.0}, {60.0, 60.0}, {1e9, 60.0}}) {
    for (const double sign : {1.0, -1.0}) {
      ControlletRig rig(hold_controllet(), {axis(m)});
      rig.bound({.hand_speed = 0.25, .spring_force = bound, .spring_moment = 15});
      rig.place(0, one(0.1), one(0));
      ASSERT_EQ(rig.start(), LawResult::ok);
      ASSERT_EQ(rig.tick(0.001), LawResult::ok);
      const double shoved = 0.1 + sign * 0.04;
      rig.place(0, one(shoved), one(sign * 0.1));
      ASSERT_EQ(rig.tick(0.001), LawResult::ok);
      EXPECT_NEAR(rig.tau(0)[0], -sign * (most + D * 0.1), 1e-9);
      // Let go, a critically damped mass: it comes back by most / K, at most at omega x / e.
      rig.place(0, one(shoved), one(0));
      double fastest = 0;
      for (int k = 0; k < 3000; ++k) {
        ASSERT_EQ(rig.tick(0.001), LawResult::ok);
        ASSERT_LE(std::abs(rig.tau(0)[0]), most + 1e-9);
        rig.integrate(0.001, {one(0)}, 2);
        fastest = std::max(fastest, std::abs(rig.state(0).dq[0]));
      }
      EXPECT_NEAR(rig.state(0).q[0], shoved - sign * most / K, 1e-6);
      EXPECT_LT(fastest, 1.05 * std::sqrt(K / m) * most / K / std::exp(1.0));
    }
  }
  // Pushed with less it stands by push / K, with more it goes on with the rest over D.
  for (const double push : {59.0, 70.0}) {
    ControlletRig rig(hold_controllet(), {axis(m)});
    ASSERT_EQ(rig.start(), LawResult::ok);
    for (int k = 0; k < 2000; ++k) {
      ASSERT_EQ(rig.tick(0.001), LawResult::ok);
      rig.integrate(0.001, {one(push)}, 2);
    }
    EXPECT_NEAR(rig.state(0).dq[0], push > 60 ? 10 / D : 0, 1e-6) << push;
  }
  ControlletRig rig(hold_controllet(), {axis(m, true)});
  const double stiffness = rig.parameters().target(rig.parameters().find("stiffness_nm_per_rad"))[0];
  JointVector q(2);
  q << 0.1, 0.2;
  rig.place(0, q, JointVector::Zero(2));
  ASSERT_EQ(rig.start(), LawResult::ok);
  ASSERT_EQ(rig.tick(0.001), LawResult::ok);
  q << 0.1 - 120 / stiffness, 0.5;
  rig.place(0, q, JointVector::Zero(2));
  for (int k = 0; k < 2; ++k) {
    ASSERT_EQ(rig.tick(0.001), LawResult::ok);
    EXPECT_NEAR(rig.tau(0)[0], 60, 1e-9);
    EXPECT_NEAR(rig.tau(0)[1], -300 * 0.3, 1e-9);
  }
}

// A carriage bears no load that would throw it: its spring has the stiffness of now, and its force grows.
TEST(PrismaticHold, TheirSetPointsStayWhileTheirStiffnessRises) {
  ControlletRig rig(hold_controllet(), {axis(25)});
  rig.set("stiffness_nm_per_rad", {5000});
  rig.place(0, one(0.1), one(0));
  ASSERT_EQ(rig.start(), LawResult::ok);
  ASSERT_EQ(rig.tick(0.001), LawResult::ok);
  rig.place(0, one(0.104), one(0));
  rig.approach("stiffness_nm_per_rad", {10000});
  for (int k = 1; k <= 250; ++k) {
    ASSERT_EQ(rig.tick(0.001), LawResult::ok);
    ASSERT_NEAR(rig.tau(0)[0], -0.004 * std::min(10000.0, 5000 + 25.0 * k), 1e-9);
  }
}

// Shoved out of its range, it goes back to the limit, and not to where it was.
TEST(PrismaticHold, AreLedBackToTheLimitBeyondWhichTheyWereShoved) {
  ControlletRig rig(hold_controllet(), {axis(25)});
  rig.place(0, one(0.6), one(0));
  ASSERT_EQ(rig.start(), LawResult::ok);
  ASSERT_EQ(rig.tick(0.001), LawResult::ok);
  rig.place(0, one(0.78), one(0));
  for (int k = 0; k < 5000; ++k) {
    ASSERT_EQ(rig.tick(0.001), LawResult::ok);
    ASSERT_LE(std::abs(rig.tau(0)[0]), 60 + 1e-9);
    rig.integrate(0.001, {one(0)}, 2);
  }
  EXPECT_NEAR(rig.state(0).q[0], 0.7, 1e-4);
}

}  // namespace
}  // namespace multipanda::prismatic_hold_test
