// Checks and contact detection of the simulated arm: every flag is raised just beyond its limit, not inside.
#include <gtest/gtest.h>

#include "backends/simulated_arm/testing/arm_rig.hpp"
#include "core/testing/test_arm.hpp"

namespace multipanda::simulated_arm_checks_test {
namespace {

using test::ArmRig;
using test::Draw;
using test::thresholds_of;

TEST(Errors, NamesAndSentences) {
  EXPECT_EQ(kArmErrorCount, 41u);
  EXPECT_EQ(static_cast<int>(ArmError::controller_torque_discontinuity), 32);
  EXPECT_EQ(static_cast<int>(ArmError::base_acceleration_invalid_reading), 40);
  EXPECT_EQ(to_string(ArmError::tau_j_range_violation), "tau_J_range_violation");
  EXPECT_EQ(to_string(ArmError::cartesian_position_motion_generator_invalid_frame),
            "cartesian_position_motion_generator_invalid_frame_flag");
  for (std::size_t i = 0; i < kArmErrorCount; ++i) {
    const auto error = static_cast<ArmError>(i);
    EXPECT_EQ(arm_error_from(to_string(error)), error);
    EXPECT_EQ(explain(error).back(), '.') << i;
    EXPECT_GT(explain(error).size(), 20u) << i;
  }
  EXPECT_EQ(error_names(error_bit(ArmError::joint_reflex) | error_bit(ArmError::power_limit_violation)),
            "joint_reflex, power_limit_violation");
  EXPECT_EQ(describe({ArmError::joint_reflex, 2, -21.5, 20}),
            "The external torque on a joint exceeded its upper collision threshold. "
            "(joint 3: -21.5, limit 20 N m)");
}

// --- Torque rate ---

TEST(TorqueRate, JustBeyondAndJustInside) {
  for (const std::string& robot : {std::string("fer"), std::string("fr3"), test::kSixAxes}) {
    ArmRig rig(robot, Draw(1).pose(1));
    const auto& limits = rig.body.model().limits();
    for (Eigen::Index i = 0; i < rig.q.size(); ++i) {
      for (const double sign : {-1.0, 1.0}) {
        const double step = limits.tau_rate_max[i] * ArmRig::dt;
        JointVector tau = rig.zero();
        ASSERT_EQ(rig.arm.start_motion({}), MotionStart::started);
        for (int k = 0; k < 3; ++k) {
          tau[i] += sign * step;
          rig.tau_on_arm = -tau;  // the arm is held: a light joint would be too fast at once
          rig.command({.tau_J_d = tau});
          ASSERT_EQ(rig.arm.mode(), ArmMode::move) << robot << i << " from 0, then by exactly the limit";
        }
        tau[i] += sign * step * (1 + 1e-4);
        rig.command({.tau_J_d = tau});
        EXPECT_EQ(rig.face().mode, ArmMode::reflex);
        EXPECT_EQ(rig.face().errors, error_bit(ArmError::controller_torque_discontinuity));
        EXPECT_EQ(rig.arm.reflex_detail().index, i);
        EXPECT_NEAR(rig.arm.reflex_detail().value, limits.tau_rate_max[i] * (1 + 1e-4), 1e-3);
        EXPECT_EQ(rig.arm.reflex_detail().limit, limits.tau_rate_max[i]);
        EXPECT_EQ(rig.arm.apply(RecoverFromError{}), ArmReply::done);
        rig.tau_on_arm.setZero();
        rig.steps(300);
      }
    }
  }
}

// Franka's limiter knows the torque as published in single precision; its margin is 1e-3 N m/s. And a
// program that limits by its own exact numbers.
TEST(TorqueRate, NeitherFrankasLimiterNorAnExactProgramTrips) {
  constexpr double kMaximum = 1000, kEps = 1e-3, dt = 1e-3;
  for (const bool single_precision : {true, false}) {
    TorqueRateCheck check(joint_constant(7, kMaximum), dt);
    check.begin();
    Draw draw(2);
    JointVector last = joint_constant(7, 0), requested = last;
    bool trips_from_doubles = false;
    for (int k = 0; k < 100000; ++k) {
      if (k % 200 == 0) requested = draw.joints(7, 87);
      const JointVector seen = single_precision ? JointVector(last.cast<float>().cast<double>()) : last;
      const double step = (single_precision ? kMaximum - kEps : kMaximum) * dt;
      const JointVector tau = seen + (requested - seen).cwiseMax(-step).cwiseMin(step);
      ASSERT_FALSE(check.check(tau)) << single_precision << " " << k;
      trips_from_doubles |= (tau - last).cwiseAbs().maxCoeff() > kMaximum * dt;
      check.accept(tau);
      check.publish(tau);
      last = tau;
    }
    // The difference matters: against doubles alone and without slack Franka's limiter would have tripped.
    if (single_precision) {
      EXPECT_TRUE(trips_from_doubles);
    }
  }
}

// Published late, as with a delay: both programs still pass.
TEST(TorqueRate, MayBeginAtAGivenTorqueAlone) {
  TorqueRateCheck check(joint_constant(6, 500), 1e-3);
  check.publish(joint_constant(6, 30));
  check.begin(joint_constant(6, 30));
  EXPECT_FALSE(check.check(joint_constant(6, 30.4)));
  EXPECT_TRUE(check.check(joint_constant(6, 0)));
}

TEST(TorqueRate, BeginsAtZeroOrAtThePublishedTorque) {
  TorqueRateCheck check(joint_constant(6, 500), 1e-3);
  JointVector held = joint_constant(6, 0);
  held[2] = 30;
  check.publish(held);
  check.begin();
  EXPECT_FALSE(check.check(joint_constant(6, 0.4)));
  held[2] = 30.4;
  EXPECT_FALSE(check.check(held));
  held[2] = 15;
  const ReflexDetail jump = check.check(held);
  EXPECT_EQ(jump.index, 2);
  EXPECT_NEAR(jump.value, 15000, 1e-9);
}

TEST(TorqueRate, NaNIsRefused) {
  for (const double bad : {std::nan(""), std::numeric_limits<double>::infinity()}) {
    ArmRig rig("fer");
    JointVector tau = rig.zero();
    tau[4] = bad;
    rig.arm.start_motion({});
    rig.command({.tau_J_d = tau});
    EXPECT_EQ(rig.face().errors, error_bit(ArmError::controller_torque_discontinuity));
    EXPECT_EQ(rig.arm.reflex_detail().index, 4);
    EXPECT_EQ(rig.arm.motion_end(), MotionEnd::input_error);
    EXPECT_TRUE(rig.q.allFinite());
  }
}

// --- Measured limits ---

struct Sample {
  JointVector q, dq, tau_J;
  Vector3 p = Vector3::Zero();
  Vector6 V = Vector6::Zero();
  bool cartesian = true;
  ReflexDetail in(MeasuredLimits& limits) const { return limits.check({q, dq, tau_J, p, V, cartesian}); }
};

void expect_detail(const ReflexDetail& d, ArmError error, int index, double value, double limit) {
  EXPECT_EQ(d.error, error) << to_string(error);
  EXPECT_EQ(d.index, index) << to_string(error);
  EXPECT_NEAR(d.value, value, 1e-12) << to_string(error);
  EXPECT_NEAR(d.limit, limit, 1e-12) << to_string(error);
}

TEST(MeasuredLimits, EveryRuleJustBeyondAndJustInside) {
  for (const std::string& name : {std::string("fer"), std::string("fr3"), test::kSixAxes}) {
    const RobotDescription robot = load_robot(name);
    const MotionLimits limits = MotionLimits::of(robot);
    const WorkspaceBox box{Vector3(-0.5, -0.6, 0.1), Vector3(0.7, 0.6, 0.9)};
    MeasuredLimits watch(limits, robot.limits.tau_max, box);
    const auto n = robot.q_home.size();
    const Sample calm{
        .q = robot.q_home, .dq = JointVector::Zero(n), .tau_J = JointVector::Zero(n), .p = {0.3, 0, 0.5}};
    ASSERT_FALSE(calm.in(watch));
    constexpr double eps = 1e-9;
    for (Eigen::Index i = 0; i < n; ++i) {
      const int k = static_cast<int>(i);
      for (const double side : {-1.0, 1.0}) {
        const double q_end = side > 0 ? limits.q_max[i] : limits.q_min[i];
        Sample s = calm;
        s.q[i] = q_end - side * eps;
        EXPECT_FALSE(s.in(watch));
        s.q[i] = q_end + side * eps;
        expect_detail(s.in(watch), ArmError::joint_position_limits_violation, k, s.q[i], q_end);
        const double dq_end = 1.1 * limits.dq_max[i];
        s = calm;
        s.dq[i] = side * (dq_end - eps);
        EXPECT_FALSE(s.in(watch));
        s.dq[i] = side * (dq_end + eps);
        expect_detail(s.in(watch), ArmError::joint_velocity_violation, k, s.dq[i], dq_end);
        const double tau_end = robot.limits.tau_max[i];
        s = calm;
        s.tau_J[i] = side * (tau_end - eps);
        EXPECT_FALSE(s.in(watch));
        s.tau_J[i] = side * (tau_end + eps);
        expect_detail(s.in(watch), ArmError::tau_j_range_violation, k, s.tau_J[i], tau_end);
      }
    }
    double power = 0;
    for (Eigen::Index i = 0; i < n; ++i) power += 0.5 * robot.limits.tau_max[i] * limits.dq_max[i];
    Sample s = calm;
    s.tau_J = (1 - eps) * 0.8 * robot.limits.tau_max;
    s.dq = -0.625 * limits.dq_max;  // against the torque: brakes are power, too
    EXPECT_FALSE(s.in(watch));
    s.tau_J *= 1 + 2 * eps;
    const ReflexDetail over = s.in(watch);
    EXPECT_EQ(over.error, ArmError::power_limit_violation);
    EXPECT_NEAR(over.limit, power, 1e-9);
    EXPECT_GT(over.value, over.limit);
    for (int k = 0; k < 3; ++k) {
      for (const bool up : {false, true}) {
        s = calm;
        s.p[k] = up ? box.max[k] - eps : box.min[k] + eps;
        EXPECT_FALSE(s.in(watch));
        s.p[k] = up ? box.max[k] + eps : box.min[k] - eps;
        expect_detail(s.in(watch), ArmError::cartesian_position_limits_violation, k, s.p[k],
                      up ? box.max[k] : box.min[k]);
      }
    }
    Draw draw(3);
    for (const int part : {0, 3}) {
      const double end = 1.1 * (part == 0 ? limits.cartesian.velocity : limits.cartesian.rotation_velocity);
      const Vector3 along = draw.vector3(1).normalized();
      s = calm;
      s.V.segment<3>(part) = (end - eps) * along;
      EXPECT_FALSE(s.in(watch));
      s.V.segment<3>(part) = (end + eps) * along;
      const ReflexDetail fast = s.in(watch);
      EXPECT_EQ(fast.error, ArmError::cartesian_velocity_violation);
      EXPECT_EQ(fast.index, part);
      EXPECT_NEAR(fast.limit, end, 1e-12);
      s.cartesian = false;
      EXPECT_FALSE(s.in(watch)) << "joint 7 may turn faster than a hand";
    }
  }
}

TEST(MeasuredLimits, JointsBeyondALimitMayReturn) {
  const RobotDescription robot = load_robot("fer");
  const MotionLimits limits = MotionLimits::of(robot);
  MeasuredLimits watch(limits, robot.limits.tau_max, {});
  const JointVector zero = JointVector::Zero(7);
  JointVector q = robot.q_home;
  const auto check = [&] { return watch.check({q, zero, zero, Vector3::Zero(), Vector6::Zero(), false}); };
  q[1] = limits.q_max[1] + 0.1;
  EXPECT_TRUE(check());
  watch.stand_at(q);
  EXPECT_FALSE(check());
  q[1] += 0.019;
  EXPECT_FALSE(check());
  q[1] += 0.002;
  EXPECT_TRUE(check()) << "not farther out";
  q[1] = limits.q_max[1] - 0.001;
  EXPECT_FALSE(check());
  q[1] = limits.q_max[1] + 0.001;
  EXPECT_TRUE(check()) << "once inside, the limit is back";
}

TEST(MeasuredLimits, StopTheArmThatMoves) {
  ArmRig rig("fer", Draw(4).pose(1));
  JointVector tau = rig.zero();
  tau[0] = 12;
  rig.lead_to(tau);
  while (rig.arm.mode() == ArmMode::move) rig.torque(tau);
  expect_detail(rig.arm.reflex_detail(), ArmError::joint_velocity_violation, 0, rig.state().dq[0],
                1.1 * 2.175);
  EXPECT_NEAR(rig.state().dq[0], 1.1 * 2.175, 0.05);
  EXPECT_EQ(rig.face().mode, ArmMode::reflex);
  EXPECT_EQ(rig.face().errors, error_bit(ArmError::joint_velocity_violation));
  rig.steps(400);
  EXPECT_LT(rig.dq.norm(), 0.02);
}

// Compared with every pair's convex distance, computed separately.
TEST(SelfCollision, IsTheNearestPairOfTheModel) {
  Draw draw(5);
  int near = 0, far = 0;
  for (const char* name : {"fer", "fr3"}) {
    const auto model =
        std::make_shared<const ArmModel>(arm_model_source(load_robot(name), draw.pose(1), true));
    SelfCollision check(*model);
    ModelTerms terms(model);
    const auto& limits = model->limits();
    for (int trial = 0; trial < 400; ++trial) {
      JointVector q = limits.q_min;
      for (Eigen::Index i = 0; i < 7; ++i) q[i] = draw.uniform(limits.q_min[i], limits.q_max[i]);
      terms.update(q, JointVector::Zero(7));
      double nearest = 1;
      const auto place = [&](const CollisionShape& s) {
        return (s.joint < 0 ? model->X_WB() : terms.X_WJ(static_cast<std::size_t>(s.joint))) * s.X_JS;
      };
      for (const auto& [a, b] : model->self_pairs()) {
        const auto &A = model->collision_shapes()[a], &B = model->collision_shapes()[b];
        nearest = std::min(nearest, closest_points(A.shape, place(A), B.shape, place(B)).distance);
      }
      const ReflexDetail found = check.check(terms);
      ++(nearest < SelfCollision::kMargin ? near : far);
      EXPECT_EQ(static_cast<bool>(found), nearest < SelfCollision::kMargin) << nearest;
      if (!found) continue;
      expect_detail(found, ArmError::self_collision_avoidance_violation, -1, nearest, SelfCollision::kMargin);
      check.stand_at(terms);
      EXPECT_FALSE(check.check(terms)) << "they may part";
      terms.update(model->q_home(), JointVector::Zero(7));
      EXPECT_FALSE(check.check(terms)) << "the ready pose is free";
    }
  }
  EXPECT_GT(near, 20);
  EXPECT_GT(far, 20);
}

// --- Contact ---

// A known push at K of an arm that a program holds: F = -push, about K in K and about the base's origin in B,
// for any base and K.
TEST(Contact, IsFeltInKBetweenLowerAndUpper) {
  Draw draw(6);
  for (const std::string& name : {std::string("fer"), std::string("fr3"), test::kSixAxes}) {
    SimulatedArmConfig config = ArmRig::config_of(name, draw.pose(1), {}, {}, true);
    config.frames.X_EK = {draw.rotation(), draw.vector3(0.02)};
    const std::size_t n = config.model->joint_count();
    config.thresholds = thresholds_of(n, 1000, 1000, 10, 20);
    ArmRig rig(config);
    const JointVector q_0 = rig.q;
    rig.hold_by_torque(q_0, 10);
    rig.body.update(rig.q, rig.dq);
    const Matrix3 R_WK = rig.body.X_WK().rotation, R_WB = config.model->X_WB().rotation;
    rig.push_while_held(q_0, R_WK * Vector3(0, -15, 2), rig.zero(), 500);
    rig.hold_by_torque(q_0, 1500);
    ASSERT_EQ(rig.arm.mode(), ArmMode::move) << describe(rig.arm.reflex_detail());
    rig.body.update(rig.q, rig.dq);
    const Vector3 F_K = -rig.body.X_WK().rotation.transpose() * rig.F_K_W_on_arm.force();
    EXPECT_LT((F_K - Vector3(0, 15, -2)).norm(), 2) << "the arm gave way a little";
    EXPECT_LT((Vector3(rig.face().F_K_K.force()) - F_K).norm(), 0.1) << name;
    EXPECT_LT(rig.face().F_K_K.torque().norm(), 0.02);
    const Vector3 F_B = -R_WB.transpose() * rig.F_K_W_on_arm.force();
    EXPECT_LT((Vector3(rig.face().F_B_B.force()) - F_B).norm(), 0.2);
    const Vector3 p_BK = config.model->X_WB().inverse() * rig.body.X_WK().position;
    EXPECT_LT((Vector3(rig.face().F_B_B.torque()) - p_BK.cross(F_B)).norm(), 0.1) << name;
    const JointVector tau_ext = -(rig.body.J_V_WK().transpose() * rig.F_K_W_on_arm.vector);
    EXPECT_LT((rig.face().tau_ext_hat - tau_ext).cwiseAbs().maxCoeff(), 0.02);
    Vector6 contact = Vector6::Zero();
    contact[1] = 1;
    EXPECT_EQ(rig.face().cartesian_contact, contact);
    EXPECT_EQ(rig.face().cartesian_collision, Vector6(Vector6::Zero()));
    EXPECT_EQ(rig.face().joint_contact, rig.zero());
    // Beyond the upper threshold: a reflex, latched until recovery; then contact ends with the push.
    rig.push_while_held(q_0, R_WK * Vector3(0, -24, 2), rig.zero(), 200);
    rig.hold_by_torque(q_0, 100);
    ASSERT_EQ(rig.face().mode, ArmMode::reflex);
    EXPECT_EQ(rig.face().errors, error_bit(ArmError::cartesian_reflex));
    EXPECT_EQ(rig.face().reflex_reason, rig.face().errors);
    EXPECT_EQ(rig.arm.reflex_detail().index, 1);
    EXPECT_EQ(rig.arm.reflex_detail().limit, 20);
    EXPECT_GT(rig.arm.reflex_detail().value, 20);
    EXPECT_LT(rig.arm.reflex_detail().value, 24);
    EXPECT_EQ(rig.face().cartesian_collision, contact);
    rig.F_K_W_on_arm = {};
    rig.steps(500);
    EXPECT_EQ(rig.face().cartesian_contact, Vector6(Vector6::Zero())) << "active now";
    EXPECT_EQ(rig.face().cartesian_collision, contact) << "latched";
    rig.arm.apply(RecoverFromError{});
    rig.step();
    EXPECT_EQ(rig.face().cartesian_collision, Vector6(Vector6::Zero()));
  }
}

TEST(Contact, JointsJustBeyondAndJustInside) {
  Draw draw(7);
  for (Eigen::Index i = 0; i < 7; ++i) {
    SetCollisionThresholds thresholds = thresholds_of(7, 3, 6, 1000, 1000);
    ArmRig rig("fr3", draw.pose(1), {}, thresholds);
    const JointVector q_0 = rig.q;
    rig.hold_by_torque(q_0, 10);
    JointVector push = rig.zero();
    push[i] = 5.9;
    rig.push_while_held(q_0, Vector3::Zero(), push, 500);
    rig.hold_by_torque(q_0, 1500);
    ASSERT_EQ(rig.arm.mode(), ArmMode::move) << i << describe(rig.arm.reflex_detail());
    EXPECT_NEAR(rig.face().tau_ext_hat[i], -5.9, 0.05);
    JointVector contact = rig.zero();
    contact[i] = 1;
    EXPECT_EQ(rig.face().joint_contact, contact);
    push[i] = 6.1;
    rig.push_while_held(q_0, Vector3::Zero(), push, 100);
    rig.hold_by_torque(q_0, 300);
    EXPECT_EQ(rig.face().errors, error_bit(ArmError::joint_reflex));
    EXPECT_EQ(rig.arm.reflex_detail().index, i);
    EXPECT_EQ(rig.arm.reflex_detail().limit, 6);
    EXPECT_LT(rig.arm.reflex_detail().value, -6);
    EXPECT_EQ(rig.face().joint_collision, contact);
  }
}

TEST(Contact, WhileAcceleratingTheOtherThresholdsHold) {
  SetCollisionThresholds thresholds = thresholds_of(7, 3, 6, 1000, 1000);
  thresholds.acceleration = thresholds_of(7, 9, 12, 1000, 1000).nominal;
  ArmRig rig("fer");
  ContactMonitor monitor(7);
  ArmState state = rig.state();
  state.tau_J[2] += 7;  // as if something pushed
  const JointVector still = joint_constant(7, 0);
  JointVector moving = still;
  moving[5] = -1;
  ModelTerms& terms = rig.body;
  terms.update(state.q, state.dq);
  const auto update = [&](const JointVector& ddq_d) {
    state.t_robot.ns += 1'000'000;
    monitor.update(terms, state, ddq_d, 0.001, thresholds);
  };
  for (int k = 0; k < 300; ++k) update(moving);
  EXPECT_NEAR(monitor.tau_ext_hat()[2], 7, 0.01);
  EXPECT_TRUE(monitor.accelerating());
  EXPECT_FALSE(monitor.collision());
  EXPECT_EQ(monitor.joint_contact().sum(), 0);
  update(still);
  EXPECT_FALSE(monitor.accelerating());
  EXPECT_EQ(monitor.collision().error, ArmError::joint_reflex);
  EXPECT_EQ(monitor.collision().index, 2);
  // Without desired motion: by the measurement, 2 rad/s^2 after the filter.
  for (int k = 0; k < 200; ++k) {
    state.dq[1] += 0.002;
    terms.update(state.q, state.dq);
    update({});
  }
  EXPECT_TRUE(monitor.accelerating());
  for (int k = 0; k < 200; ++k) update({});
  EXPECT_FALSE(monitor.accelerating());
}

TEST(Contact, NoWrenchNearASingularPose) {
  ArmRig rig("fer");
  ContactMonitor monitor(7);
  ArmState state = rig.state();
  state.q << 0, 0.3, 0, -0.467, 0, 1.6, 0.8;  // stretched: the wrist cannot move along the arm
  rig.body.update(state.q, state.dq);
  state.tau_J = rig.body.g();
  state.tau_J[1] += 10;
  for (int k = 0; k < 300; ++k) {
    state.t_robot.ns += 1'000'000;
    monitor.update(rig.body, state, {}, 0.001, rig.arm.settings().thresholds);
  }
  EXPECT_NEAR(monitor.tau_ext_hat()[1], 10, 0.01);
  EXPECT_EQ(monitor.F_K_W().vector, Vector6(Vector6::Zero()));
  state.q = rig.q;
  rig.body.update(state.q, state.dq);
  state.tau_J = rig.body.g();
  state.tau_J[1] += 10;
  for (int k = 0; k < 300; ++k) {
    state.t_robot.ns += 1'000'000;
    monitor.update(rig.body, state, {}, 0.001, rig.arm.settings().thresholds);
  }
  EXPECT_GT(monitor.F_K_W().vector.norm(), 1);
}

// Behind slow motors, delay, friction and noise a program that moves the arm detects no contact.
TEST(Contact, FreeMotionOfARealisticArmIsNoContact) {
  ArmRig rig("fer", Draw(8).pose(1), PlantFidelity::realistic(), thresholds_of(7, 2, 3, 10, 15));
  const JointVector q_0 = rig.q;
  for (int k = 0; k < 3000; ++k) {
    const JointVector goal = q_0.array() + 0.3 * (1 - std::cos(2 * M_PI * k * 0.001 / 3));
    rig.hold_by_torque(goal, 1);
    ASSERT_EQ(rig.arm.mode(), ArmMode::move) << k << " " << describe(rig.arm.reflex_detail());
  }
}

TEST(Watching, CanBeSwitchedOffForTests) {
  ArmRig rig("fer");
  rig.arm.watch(false);
  rig.arm.start_motion({});
  rig.command({.tau_J_d = joint_constant(7, 5)});
  EXPECT_EQ(rig.arm.mode(), ArmMode::move);
}

}  // namespace
}  // namespace multipanda::simulated_arm_checks_test
