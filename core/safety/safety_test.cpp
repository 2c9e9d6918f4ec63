#include "core/safety/safety.hpp"

#include <cmath>
#include <limits>

#include <gtest/gtest.h>

#include "core/testing/test_arm.hpp"

namespace multipanda::safety_test {
namespace {

struct Rig {
  std::shared_ptr<const ArmModel> model =
      test::TestArm::make().model({rotation_from_rpy({0.3, 0.2, 1}), {1, 2, 3}});
  ModelTerms terms{model};
  SafetyLimits limits = SafetyLimits::of(*model);
  ArmState state;
  Rig() {
    state.q = joint_constant(7, 0.1);
    state.dq = joint_constant(7, 0);
    state.mode = ArmMode::move;
  }
  ArmCondition condition() const {
    ArmCondition condition;
    condition.usable = takes_commands(state.mode);
    condition.age_s = state.age_s;
    return condition;
  }
  Finding found() {
    terms.update(state);
    return SafetyStage({limits}).inspect(0, condition(), state, terms);
  }
  Intervention verdict() { return found().rule; }
};

TEST(Inspect, EachRule) {
  Rig rig;
  EXPECT_EQ(rig.verdict(), Intervention::none);
  for (const auto mode :
       {ArmMode::other, ArmMode::guiding, ArmMode::reflex, ArmMode::user_stopped, ArmMode::recovering}) {
    rig.state.mode = mode;
    EXPECT_EQ(rig.verdict(), Intervention::arm_not_ready);
  }
  rig.state.mode = ArmMode::idle;
  EXPECT_EQ(rig.verdict(), Intervention::none);
  rig.state.age_s = 0.0021;
  EXPECT_EQ(rig.verdict(), Intervention::state_old);
  rig.terms.update(rig.state);
  const SafetyStage stage({rig.limits});  // a single arm gets the time that the arm itself waits
  EXPECT_FALSE(stage.inspect(0, rig.condition(), rig.state, rig.terms, true));
  rig.state.age_s = 0.0201;
  EXPECT_EQ(stage.inspect(0, rig.condition(), rig.state, rig.terms, true).rule, Intervention::state_old);
  rig.state.age_s = 0.002;
  EXPECT_EQ(rig.verdict(), Intervention::none);
  rig.state.dq[6] = std::nan("");
  EXPECT_EQ(rig.verdict(), Intervention::state_not_finite);
  rig.state.dq[6] = -2.6;
  EXPECT_EQ(rig.verdict(), Intervention::joint_velocity_limit);
  rig.state.dq[6] = 0;
  rig.state.q[2] = std::numeric_limits<double>::infinity();
  EXPECT_EQ(rig.verdict(), Intervention::state_not_finite);
}

double next_above(double x) { return std::nextafter(x, std::numeric_limits<double>::infinity()); }

void expect_finding(const Finding& found, Intervention rule, Eigen::Index joint, double value, double limit) {
  EXPECT_EQ(found.rule, rule);
  EXPECT_EQ(static_cast<Eigen::Index>(found.joint), joint);
  EXPECT_EQ(found.value, value);
  EXPECT_EQ(found.limit, limit);
}

// At any joint and to either side: the limit itself is allowed, the next number is not and is named.
TEST(Inspect, ALimitItselfIsAllowedAtEveryJoint) {
  for (Eigen::Index i = 0; i < 7; ++i) {
    for (const double side : {1.0, -1.0}) {
      Rig rig;
      rig.limits.joints.q_max[i] = side > 0 ? 0 : 1;  // the limit on this side is 0: no rounding below
      rig.limits.joints.q_min[i] = side > 0 ? -1 : 0;
      double &q = rig.state.q[i], &dq = rig.state.dq[i];
      const double fastest = rig.limits.joints.dq_max[i];
      q = -side * 0.5;
      dq = side * fastest;
      EXPECT_EQ(rig.verdict(), Intervention::none);
      dq = side * next_above(fastest);
      expect_finding(rig.found(), Intervention::joint_velocity_limit, i, dq, fastest);
      q = 0;
      dq = side * 0.02;
      EXPECT_EQ(rig.verdict(), Intervention::none);
      q = side * 1e-9;
      expect_finding(rig.found(), Intervention::joint_position_limit, i, q, 0);
      dq = side * 0.01;
      EXPECT_EQ(rig.verdict(), Intervention::none);
      dq = side * next_above(0.01);
      EXPECT_EQ(rig.verdict(), Intervention::joint_position_limit);
      dq = 0;
      q = side * 0.02;
      EXPECT_EQ(rig.verdict(), Intervention::none);
      q = side * next_above(0.02);
      EXPECT_EQ(rig.verdict(), Intervention::joint_position_limit);
      // Held there, the joint may stay there.
      SafetyStage stage({rig.limits});
      rig.terms.update(rig.state);
      stage.track_limits(0, rig.state, rig.terms, true);
      EXPECT_FALSE(stage.inspect(0, rig.condition(), rig.state, rig.terms));
    }
  }
}

TEST(Inspect, AgesGapsAndBoxesAreNamedInTheFinding) {
  Rig rig;
  rig.state.age_s = 0.0025;
  expect_finding(rig.found(), Intervention::state_old, 0xFFFF, 0.0025, 0.002);
  rig.limits.own_clock_slack_s = 0.0005;
  EXPECT_EQ(rig.verdict(), Intervention::none);
  rig.state.age_s = 0;
  const SafetyStage stage({rig.limits});
  ArmCondition condition = rig.condition();
  condition.gap_s = 0.02;
  EXPECT_FALSE(stage.inspect(0, condition, rig.state, rig.terms));
  condition.gap_s = next_above(0.02);
  expect_finding(stage.inspect(0, condition, rig.state, rig.terms), Intervention::state_old, 0xFFFF,
                 condition.gap_s, 0.02);
  rig.limits.period_s = 0.0125;  // a slow loop may miss two of its periods
  EXPECT_DOUBLE_EQ(rig.limits.longest_gap_s(), 0.0375);
  rig.terms.update(rig.state);
  const Vector3 p = rig.terms.X_WE().position;
  for (Eigen::Index k = 0; k < 3; ++k) {
    for (const double side : {1.0, -1.0}) {
      WorkspaceBox box{p - Vector3(1, 1, 1), p + Vector3(1, 1, 1)};
      double& bound = (side > 0 ? box.max : box.min)[k];
      bound = p[k] - side * 0.1;
      rig.limits.workspace = box;
      expect_finding(rig.found(), Intervention::workspace_limit, 0xFFFF, p[k], bound);
    }
  }
}

TEST(Inspect, LimitsActOnOutwardMotionOnly) {
  Rig rig;
  for (const double side : {1.0, -1.0}) {
    rig.state.q[4] = 2.81 * side;
    rig.state.dq[4] = 0;
    EXPECT_EQ(rig.verdict(), Intervention::none);
    rig.state.dq[4] = 0.02 * side;
    EXPECT_EQ(rig.verdict(), Intervention::joint_position_limit);
    rig.state.dq[4] = -0.02 * side;
    EXPECT_EQ(rig.verdict(), Intervention::none);
  }
}

// Slower than what counts as outwards, for as long as it likes: the rule acts on where the joint is, then.
TEST(Inspect, NoJointCreepsOut) {
  constexpr double kLimit = 2.8, kMargin = 0.02;
  for (const double side : {1.0, -1.0}) {
    Rig rig;
    SafetyStage stage({rig.limits});
    const auto verdict = [&](double beyond, double outwards, bool held) {
      rig.state.q[4] = side * (kLimit + beyond);
      rig.state.dq[4] = side * outwards;
      rig.terms.update(rig.state);
      stage.track_limits(0, rig.state, rig.terms, held);
      return stage.inspect(0, rig.condition(), rig.state, rig.terms).rule;
    };
    double beyond = -0.05;
    while (verdict(beyond, 0.009, false) == Intervention::none && beyond < 1) beyond += 0.009 * 0.01;
    EXPECT_NEAR(beyond, kMargin, 1e-4);
    EXPECT_EQ(verdict(kMargin + 1e-6, 0, false), Intervention::joint_position_limit);
    EXPECT_EQ(verdict(kMargin - 1e-6, 0, false), Intervention::none);
    EXPECT_EQ(verdict(0.5, -1e-6, false), Intervention::none);  // on its way back
    EXPECT_EQ(verdict(0.5, 0, false), Intervention::joint_position_limit);
    // Held there, it may be moved back from there, but not out again.
    EXPECT_EQ(verdict(0.5, 0, true), Intervention::none);
    EXPECT_EQ(verdict(0.5, 0.005, false), Intervention::none);
    EXPECT_EQ(verdict(0.5, 0.02, false), Intervention::joint_position_limit);
    EXPECT_EQ(verdict(0.3, -0.1, false), Intervention::none);
    EXPECT_EQ(verdict(0.3 + kMargin - 1e-6, 0.005, false), Intervention::none);
    EXPECT_EQ(verdict(0.3 + kMargin + 1e-6, 0.005, false), Intervention::joint_position_limit);
    EXPECT_EQ(verdict(-0.1, 0, false), Intervention::none);
    EXPECT_EQ(verdict(kMargin + 1e-6, 0, false), Intervention::joint_position_limit);
  }
}

TEST(Inspect, NoHandCreepsOutOfTheWorkspace) {
  constexpr double kMargin = 0.005;
  Rig rig;
  rig.terms.update(rig.state);
  const Vector3 p = rig.terms.X_WE().position;
  for (Eigen::Index k = 0; k < 3; ++k) {
    for (const double side : {1.0, -1.0}) {
      // The box moves, not the arm: its side lies `beyond` before the hand.
      const auto stage_at = [&](double beyond) {
        WorkspaceBox box{p - Vector3(1, 1, 1), p + Vector3(1, 1, 1)};
        (side > 0 ? box.max : box.min)[k] = p[k] - side * beyond;
        rig.limits.workspace = box;
        return SafetyStage({rig.limits});
      };
      const auto verdict = [&](SafetyStage& stage, bool held = false) {
        rig.terms.update(rig.state);
        stage.track_limits(0, rig.state, rig.terms, held);
        return stage.inspect(0, rig.condition(), rig.state, rig.terms).rule;
      };
      SafetyStage inside = stage_at(kMargin - 1e-6), outside = stage_at(kMargin + 1e-6);
      rig.state.dq = joint_constant(7, 0);
      EXPECT_EQ(verdict(inside), Intervention::none);
      EXPECT_EQ(verdict(outside), Intervention::workspace_limit);
      rig.state.dq = joint_constant(7, 1e-4);  // slow, in or out along this axis
      rig.terms.update(rig.state);
      const bool outwards = side * rig.terms.V_WE().linear()[k] > 0;
      EXPECT_EQ(verdict(outside), outwards ? Intervention::workspace_limit : Intervention::none);
      rig.state.dq *= -1;
      EXPECT_EQ(verdict(outside), outwards ? Intervention::none : Intervention::workspace_limit);
      EXPECT_EQ(verdict(outside, true), Intervention::none);  // held here: the next owner may start here
      rig.state.dq *= -1;
      EXPECT_EQ(verdict(outside), Intervention::none);
    }
  }
}

// Slower than what counts as outwards, with a hold after each try: by the margin in all, not by each.
TEST(Inspect, NoJointCreepsOutByManyStarts) {
  constexpr double kLimit = 2.8, kMargin = 0.02, kFirst = 0.004;
  for (const double side : {1.0, -1.0}) {
    Rig rig;
    SafetyStage stage({rig.limits});
    double beyond = kFirst;
    const auto verdict = [&](double outwards, bool held) {
      rig.state.q[4] = side * (kLimit + beyond);
      rig.state.dq[4] = side * outwards;
      rig.terms.update(rig.state);
      stage.track_limits(0, rig.state, rig.terms, held);
      return stage.inspect(0, rig.condition(), rig.state, rig.terms).rule;
    };
    beyond = -0.1;
    verdict(0, false);
    beyond = kFirst;
    EXPECT_EQ(verdict(0.05, false), Intervention::joint_position_limit);  // it is held there
    for (int start = 0; start < 100; ++start) {
      (void)verdict(0, true);
      if (verdict(0, false) != Intervention::none) break;
      beyond += 0.0006;
    }
    EXPECT_NEAR(beyond, kFirst + kMargin, 0.0006 + 1e-9);
    (void)verdict(0, true);
    EXPECT_EQ(verdict(-0.001, false), Intervention::none);    // the way back
    stage.track_limits(0, rig.state, rig.terms, true, true);  // somebody else has moved it
    EXPECT_EQ(verdict(0, false), Intervention::none);
  }
}

// A resume lets an arm start where it stands, but only the first one farther out than before.
TEST(Inspect, NoJointCreepsOutByManyResumes) {
  constexpr double kLimit = 2.8, kMargin = 0.02;
  for (const double side : {1.0, -1.0}) {
    Rig rig;
    SafetyStage stage({rig.limits});
    double beyond = -0.1;
    const auto starts = [&] {
      for (const bool held : {true, false}) {
        rig.state.q[4] = side * (kLimit + beyond);
        rig.terms.update(rig.state);
        stage.track_limits(0, rig.state, rig.terms, held);
      }
      return stage.inspect(0, rig.condition(), rig.state, rig.terms).rule == Intervention::none;
    };
    const auto creep = [&] {
      for (int start = 0; start < 100 && starts(); ++start) beyond += 0.0006;
    };
    EXPECT_TRUE(starts());
    beyond = 0.004;
    creep();
    EXPECT_NEAR(beyond, 0.004 + kMargin, 0.0006 + 1e-9);
    stage.release_limits(0);
    EXPECT_TRUE(starts());
    creep();
    EXPECT_NEAR(beyond, 0.004 + 2 * kMargin, 2 * 0.0006 + 1e-9);
    stage.release_limits(0);
    EXPECT_FALSE(starts());
    beyond = 0;  // led back inside, all begins again
    EXPECT_TRUE(starts());
  }
}

// A box that only one of them leaves: the finding is its coordinate.
TEST(Inspect, FlangeAndToolMustNotLeaveTheWorkspaceEither) {
  ArmModelSource source = test::TestArm::make().source({rotation_from_rpy({0.3, 0.2, 1}), {1, 2, 3}});
  source.tool_end = Vector3(0.2, -0.1, 0.3);
  const auto model = std::make_shared<const ArmModel>(source);
  const Pose X_FE{rotation_from_rpy({0.1, 0.2, 0.3}), {-0.15, 0.25, -0.2}};
  Rig rig;
  ModelTerms terms(model);
  rig.state.frames.X_FE = X_FE;
  rig.state.config_version = 1;
  rig.state.dq = joint_constant(7, 0.2);
  const auto places = [&](double after_s) {
    ModelTerms at(model);
    at.update(rig.state.q + after_s * rig.state.dq, rig.state.dq);
    const Pose X = at.X_WF();
    return std::array<Vector3, 3>{X * X_FE.position, X.position, X * source.tool_end};
  };
  const auto now = places(0), next = places(1e-6);
  int findings = 0;
  for (std::size_t n = 0; n < 3; ++n) {
    for (Eigen::Index k = 0; k < 3; ++k) {
      const double speed = (next[n][k] - now[n][k]) / 1e-6;
      if (std::abs(speed) < 0.02) continue;
      const double side = speed > 0 ? 1 : -1;
      bool outermost = true;
      for (const Vector3& other : now) outermost = outermost && side * (now[n][k] - other[k]) >= 0;
      if (!outermost) continue;
      WorkspaceBox box{now[n] - Vector3(9, 9, 9), now[n] + Vector3(9, 9, 9)};
      double& bound = (side > 0 ? box.max : box.min)[k];
      bound = now[n][k] - side * 1e-4;
      rig.limits.workspace = box;
      terms.update(rig.state);
      const Finding found = SafetyStage({rig.limits}).inspect(0, rig.condition(), rig.state, terms);
      EXPECT_EQ(found.rule, Intervention::workspace_limit) << n << k;
      EXPECT_NEAR(found.value, now[n][k], 1e-12);
      EXPECT_EQ(found.limit, bound);
      ++findings;
    }
  }
  EXPECT_GE(findings, 3);
}

// As a joint: where the hand was held, and a margin more, the next owner may keep it. Arms on shifted bases
// have the hand in that place without any other difference.
TEST(Inspect, AHandHeldOutsideTheWorkspaceMayStayThereButNotGoFurther) {
  constexpr double kMargin = 0.005, kHeld = 0.1;
  Rig rig;
  rig.terms.update(rig.state);
  const Vector3 p = rig.terms.X_WE().position;
  for (Eigen::Index k = 0; k < 3; ++k) {
    for (const double side : {1.0, -1.0}) {
      WorkspaceBox box{p - Vector3(0.3, 0.4, 0.5), p + Vector3(0.6, 0.7, 0.8)};
      const double bound = (side > 0 ? box.max : box.min)[k];
      rig.limits.workspace = box;
      SafetyStage stage({rig.limits});
      const auto verdict = [&](double beyond, bool held) {
        Vector3 base(1, 2, 3);  // as of the other model
        base[k] += bound + side * beyond - p[k];
        ModelTerms terms{test::TestArm::make().model({rotation_from_rpy({0.3, 0.2, 1}), base})};
        terms.update(rig.state);
        stage.track_limits(0, rig.state, terms, held);
        return stage.inspect(0, rig.condition(), rig.state, terms).rule;
      };
      EXPECT_EQ(verdict(kHeld, true), Intervention::none);
      EXPECT_EQ(verdict(kHeld + kMargin - 1e-6, false), Intervention::none);
      EXPECT_EQ(verdict(kHeld + kMargin + 1e-6, false), Intervention::workspace_limit);
    }
  }
}

// The speed at which the stage acts, found by bisection, is where the braking distance (v + offset)^2 / (2 a)
// meets the distance from the end.
TEST(Inspect, VelocityTiedToPosition) {
  Rig rig;
  test::Draw draw(29);
  const double fastest = rig.limits.joints.dq_max[3];
  PositionBasedVelocity law{joint_constant(7, -2.9), joint_constant(7, 3.1), joint_constant(7, 0.25),
                            joint_constant(7, 3.5)};
  rig.limits.joints.velocity_by_position = law;
  int tied = 0, free = 0;
  for (int trial = 0; trial < 400; ++trial) {
    const double side = trial % 2 == 0 ? 1.0 : -1.0;
    const double q = rig.state.q[3] = trial % 4 < 2 ? draw.uniform(-2.8, 2.8) : side * draw.uniform(2.5, 2.8);
    const double d = side > 0 ? 3.1 - q : q + 2.9;
    double allowed = 0, refused = 10;
    while (refused - allowed > 1e-9) {
      const double middle = 0.5 * (allowed + refused);
      rig.state.dq[3] = side * middle;
      (rig.verdict() == Intervention::joint_velocity_limit ? refused : allowed) = middle;
    }
    if (allowed < fastest - 1e-6) {
      EXPECT_NEAR((allowed + 0.25) * (allowed + 0.25) / (2 * 3.5), d, 1e-7) << q;
      ++tied;
    } else {
      EXPECT_NEAR(allowed, fastest, 1e-6);
      EXPECT_LE((fastest + 0.25) * (fastest + 0.25) / (2 * 3.5), d);
      ++free;
    }
    rig.state.dq[3] = 0;
  }
  EXPECT_GT(tied, 100);
  EXPECT_GT(free, 50);
  // Where the formula ends in zero, noise at rest is no finding.
  law.q_max = joint_constant(7, 2.8);
  rig.limits.joints.velocity_by_position = law;
  rig.state.q[3] = 2.7999;
  rig.state.dq[3] = 0.0099;
  EXPECT_EQ(rig.verdict(), Intervention::none);
  rig.state.dq[3] = 0.0101;
  EXPECT_EQ(rig.verdict(), Intervention::joint_velocity_limit);
  rig.state.dq[3] = -1;
  EXPECT_EQ(rig.verdict(), Intervention::none);
}

TEST(Inspect, WorkspaceIsInTheWorldAndAboutOutwardMotion) {
  Rig rig;
  rig.terms.update(rig.state);
  const Vector3 p = rig.terms.X_WE().position;
  rig.limits.workspace = WorkspaceBox{p - Vector3(1, 1, 1), p + Vector3(1, 1, 1)};
  rig.state.dq = joint_constant(7, 0.2);
  EXPECT_EQ(rig.verdict(), Intervention::none);
  rig.terms.update(rig.state);
  const Vector3 v = rig.terms.V_WE().linear();
  for (Eigen::Index k = 0; k < 3; ++k) {
    ASSERT_GT(std::abs(v[k]), 0.011);
    WorkspaceBox box{p - Vector3(1, 1, 1), p + Vector3(1, 1, 1)};
    (v[k] > 0 ? box.max : box.min)[k] = p[k] - std::copysign(0.001, v[k]);
    rig.limits.workspace = box;
    EXPECT_EQ(rig.verdict(), Intervention::workspace_limit);
    rig.state.dq *= -1;
    EXPECT_EQ(rig.verdict(), Intervention::none);
    rig.state.dq *= -1;
  }
}

TEST(Judge, OnlyNumbersOfTheRightSizeAndOrderAreTorques) {
  Rig rig;
  const SafetyStage safety({rig.limits});
  JointVector tau = joint_constant(7, 799);
  EXPECT_FALSE(safety.judge(0, tau));
  tau[3] = -801;
  EXPECT_EQ(safety.judge(0, tau).rule, Intervention::torque_implausible);
  EXPECT_EQ(safety.judge(0, tau).joint, 3);
  tau[1] = std::nan("");
  EXPECT_EQ(safety.judge(0, tau).rule, Intervention::torque_not_finite);
  EXPECT_EQ(safety.judge(0, joint_constant(6, 0)).rule, Intervention::torque_implausible);
  EXPECT_EQ(safety.judge(0, joint_constant(7, 500), joint_constant(7, 500)).rule,
            Intervention::torque_implausible);
  EXPECT_EQ(safety.judge(0, joint_constant(7, 0), joint_constant(8, 0)).rule,
            Intervention::torque_implausible);
}

TEST(Judge, TenTimesTheLimitItselfIsPlausibleAtEveryJoint) {
  Rig rig;
  const SafetyStage safety({rig.limits});
  for (Eigen::Index i = 0; i < 7; ++i) {
    JointVector tau = joint_constant(7, 0);
    for (const double side : {1.0, -1.0}) {
      tau[i] = side * 800;
      EXPECT_FALSE(safety.judge(0, tau));
      tau[i] = side * next_above(800);
      expect_finding(safety.judge(0, tau), Intervention::torque_implausible, i, tau[i], 800);
    }
    tau[i] = std::numeric_limits<double>::infinity();
    expect_finding(safety.judge(0, tau), Intervention::torque_not_finite, i, tau[i], 80);
  }
  expect_finding(safety.judge(0, joint_constant(6, 0)), Intervention::torque_implausible, 0xFFFF, 6, 7);
}

// Of two rules that act, the torque limit is the one that is reported; both are counted.
TEST(Limit, EachRuleIsCountedAndTheFirstIsReported) {
  Rig rig;
  SafetyStage safety({rig.limits});
  Finding cut;
  (void)safety.limit(0, joint_constant(7, 0.5), 0.001, cut);
  EXPECT_FALSE(cut);
  EXPECT_EQ(safety.counted(0), 0u);
  (void)safety.limit(0, joint_constant(7, 30), 0.001, cut);
  expect_finding(cut, Intervention::torque_rate_clamped, 0, 29.5 / 0.001, 1000);
  EXPECT_EQ(safety.counted(0), 1u);
  (void)safety.limit(0, joint_constant(7, 100), 0.001, cut);
  expect_finding(cut, Intervention::torque_clamped, 0, 100, 80);
  EXPECT_EQ(safety.counted(0, Intervention::torque_clamped), 1u);
  EXPECT_EQ(safety.counted(0, Intervention::torque_rate_clamped), 2u);
  EXPECT_EQ(safety.counted(0), 3u);
}

TEST(Limit, RateIsPerSecondWhateverTheStep) {
  Rig rig;
  rig.limits.joints.tau_rate_max = joint_constant(7, 400);
  for (const double dt : {0.00025, 0.0005, 0.001}) {
    SafetyStage safety({rig.limits});
    Finding cut;
    const JointVector requested = joint_constant(7, 30);
    double t = 0;
    for (int k = 1; k * dt * 400 < 29; ++k) {
      t += dt;
      const JointVector& tau = safety.limit(0, requested, dt, cut);
      ASSERT_NEAR(tau[2], 400 * t, 1e-9);
      ASSERT_EQ(cut.rule, Intervention::torque_rate_clamped);
    }
    EXPECT_GT(safety.counted(0, Intervention::torque_rate_clamped), 10u);
  }
}

TEST(Limit, ALongGapIsNoLicenseForALargeStep) {
  Rig rig;
  SafetyStage safety({rig.limits});
  Finding cut;
  EXPECT_NEAR(safety.limit(0, joint_constant(7, 50), 3.0, cut)[0], 1.0, 1e-12);
  EXPECT_NEAR(safety.limit(0, joint_constant(7, 50), -1.0, cut)[0], 1.0, 1e-12);
}

TEST(Limit, TorqueStaysWithinItsLimit) {
  Rig rig;
  SafetyStage safety({rig.limits});
  test::Draw draw(3);
  JointVector last = joint_constant(7, 0);
  for (int k = 0; k < 5000; ++k) {
    Finding cut;
    const double dt = draw.uniform(0, 0.002);
    const JointVector requested = draw.joints(7, 300);
    const JointVector tau = safety.limit(0, requested, dt, cut);
    for (Eigen::Index i = 0; i < 7; ++i) {
      ASSERT_LE(std::abs(tau[i]), 80.0);
      ASSERT_LE(std::abs(tau[i] - last[i]), 1000 * std::min(dt, 0.001) + 1e-9);
    }
    last = tau;
  }
  EXPECT_GT(safety.counted(0, Intervention::torque_clamped), 1000u);
}

TEST(Limit, NonFiniteGoesTowardsZero) {
  Rig rig;
  SafetyStage safety({rig.limits});
  safety.set_last_command(0, joint_constant(7, 10));
  Finding cut;
  JointVector requested = joint_constant(7, 10);
  requested[5] = std::nan("");
  EXPECT_NEAR(safety.limit(0, requested, 0.001, cut)[5], 9, 1e-12);
  EXPECT_EQ(safety.last_command(0)[4], 10);
  requested[5] = 10;
  safety.set_last_command(0,
                          requested * std::nan(""));  // the rate limit must not start from an invalid value
  EXPECT_NEAR(safety.limit(0, requested, 0.001, cut)[5], 1, 1e-12);
}

}  // namespace
}  // namespace multipanda::safety_test
