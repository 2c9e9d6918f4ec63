#include "core/state/force_sensor.hpp"

#include <cmath>
#include <functional>
#include <limits>
#include <vector>

#include <gtest/gtest.h>

#include "core/model/model_terms.hpp"
#include "core/testing/test_arm.hpp"

// Readings are made here from Newton's law for the body that the sensor carries, in world axes.
namespace multipanda::force_sensor_test {
namespace {

using test::Draw;
using test::TestArm;

const Vector3 kGravity(0, 0, -9.81);

// A body of `mass` at `p_WC`, at rest, pushed by `f` at `p` and by the moment `m`: what it does to a sensor.
ForceReading reading_of(const Pose& X_WS, double mass, const Vector3& p_WC, const Vector3& f,
                        const Vector3& p, const Vector3& m, const Vector6& bias) {
  const Vector3 force = f + mass * kGravity;
  const Vector3 moment =
      m + (p - X_WS.position).cross(f) + (p_WC - X_WS.position).cross(Vector3(mass * kGravity));
  ForceReading reading{.records = 1, .age_s = 0.001};
  reading.F_S.force() = X_WS.rotation.transpose() * force;
  reading.F_S.torque() = X_WS.rotation.transpose() * moment;
  reading.F_S.vector += bias;
  reading.mean_S = reading.F_S;
  return reading;
}

// The flange points straight down, 0.3 m above the floor, on a base that is turned and elsewhere.
struct Bench {
  Bench() {
    state.q = state.dq = joint_constant(7, 0);
    mount.X_FS.position = {0, 0, 0.02};
    mount.carried = {.mass = 1, .p_FC = {0, 0, 0.07}};
  }
  SensorFault update(SensedForce& sensor, const ForceReading& reading, double dt = 1e-3) {
    return sensor.update(reading, {.X_WF = X_WF, .p_WK = X_WF * Vector3(0, 0, 0.1), .J_V_WK = J}, dt, state);
  }
  // Gravity along the flange's z, less what the floor takes.
  ForceReading pressed_with(double newton) const {
    ForceReading reading{.records = 1, .age_s = 0};
    reading.F_S.force().z() = reading.mean_S.force().z() = 9.81 - newton;
    return reading;
  }
  Pose X_WF{rotation_from_rpy({M_PI, 0, 0.7}), {0.5, -0.2, 0.3}};
  Jacobian J = Jacobian::Zero(6, 7);
  ForceSensorMount mount;
  ArmState state;
};

TEST(SensedForce, OfAnArmThatPressesOnTheFloorPointsDown) {
  Bench bench;
  SensedForce sensor(bench.mount);
  ASSERT_EQ(bench.update(sensor, bench.pressed_with(0)).rule, Intervention::none);
  EXPECT_LT(bench.state.F_K_W_est.vector.norm(), 1e-12);
  bench.update(sensor, bench.pressed_with(10));
  ASSERT_TRUE(bench.state.has_wrench_estimate);
  EXPECT_LT((bench.state.F_K_W_est.force() - Vector3(0, 0, -10)).norm(), 1e-12);
  EXPECT_LT(bench.state.F_K_W_est.torque().norm(), 1e-12);  // the floor pushes along the axis through K
}

// Bases turned and off the origin, frames of everything elsewhere; a push at any point of the tool. The
// joint torques are those of virtual work: -f dp/dq - m dw/dq, by differences of the point's place.
TEST(SensedForce, IsTheReactionOfAnyPushInAnyFrame) {
  for (std::uint32_t seed = 1; seed <= 20; ++seed) {
    Draw draw(seed);
    ModelTerms terms(TestArm::make(7, seed).model(draw.pose(1)));
    const JointVector q = draw.joints(7, 1), zero = joint_constant(7, 0);
    ArmState state;
    state.q = q;
    state.dq = zero;
    state.frames = {draw.pose(0.1), draw.pose(0.1)};
    state.load = draw.load(0.8);
    const Load tool = draw.load(0.5);
    const ForceSensorMount mount{.X_FS = draw.pose(0.05), .carried = tool};
    SensedForce sensor(mount);
    Vector6 bias;
    bias << draw.vector3(10), draw.vector3(1);
    const Vector3 f = draw.vector3(20), m = draw.vector3(2), p_F = draw.vector3(0.3);

    terms.set_config(state.frames, {}, {});
    terms.update(q, zero);
    const auto read = [&](double share) {
      const double mass = tool.mass + state.load.mass;
      const Vector3 c = (tool.mass * tool.p_FC + state.load.mass * state.load.p_FC) / mass;
      return reading_of(terms.X_WF() * mount.X_FS, mass, terms.X_WF() * c, share * f, terms.X_WF() * p_F,
                        share * m, bias);
    };
    const auto update = [&](const ForceReading& reading) {
      return sensor.update(reading,
                           {.X_WF = terms.X_WF(), .p_WK = terms.X_WK().position, .J_V_WK = terms.J_V_WK()},
                           1e-3, state);
    };
    ASSERT_EQ(update(read(0)).rule, Intervention::none) << seed;
    ASSERT_EQ(update(read(1)).rule, Intervention::none) << seed;
    const Vector3 lever = terms.X_WF() * p_F - terms.X_WK().position;
    EXPECT_LT((Vector3(state.F_K_W_est.force()) + f).norm(), 1e-10);
    EXPECT_LT((Vector3(state.F_K_W_est.torque()) + m + lever.cross(f)).norm(), 1e-10);
    constexpr double kStep = 1e-6;
    const Pose here = terms.X_WF();
    for (Eigen::Index i = 0; i < 7; ++i) {
      JointVector moved = q;
      moved[i] += kStep;
      terms.update(moved, zero);
      const Vector3 dp = (terms.X_WF() * p_F - here * p_F) / kStep;
      const Vector3 dw = log_rotation(terms.X_WF().rotation * here.rotation.transpose()) / kStep;
      EXPECT_NEAR(state.tau_ext_hat[i], -f.dot(dp) - m.dot(dw), 1e-4) << seed << " " << i;
    }
  }
}

// Tared in one orientation, the weight stays compensated in others, and what was not declared shows.
TEST(SensedForce, CompensatesTheWeightOfWhatItCarriesInEveryOrientation) {
  for (const bool declared : {true, false}) {
    Bench bench;
    const double mass = bench.mount.carried.mass;
    const Vector3 p_FC = bench.mount.carried.p_FC;
    if (!declared) bench.mount.carried = {};
    SensedForce sensor(bench.mount);
    const Vector6 bias = (Vector6() << 3, -2, 5, 0.1, 0.2, -0.3).finished();
    for (const Vector3& rpy : {Vector3(M_PI, 0, 0.7), Vector3(M_PI / 2, 0.3, 0), Vector3(0, -1, 2)}) {
      bench.X_WF.rotation = rotation_from_rpy(rpy);
      ASSERT_EQ(bench
                    .update(sensor, reading_of(bench.X_WF * bench.mount.X_FS, mass, bench.X_WF * p_FC,
                                               Vector3::Zero(), Vector3::Zero(), Vector3::Zero(), bias))
                    .rule,
                Intervention::none);
      const double seen = bench.state.F_K_W_est.force().norm();
      if (declared) {
        EXPECT_LT(bench.state.F_K_W_est.vector.norm(), 1e-10);
      }
      if (!declared && rpy.x() != M_PI) {
        EXPECT_GT(seen, 9);
      }
    }
    // The arm takes a declared payload up: its weight is not a force on the environment either.
    bench.state.load = {.mass = 0.5, .p_FC = {0.01, 0, 0.12}};
    const double all = mass + 0.5;
    const Vector3 c = (mass * p_FC + 0.5 * bench.state.load.p_FC) / all;
    bench.update(sensor, reading_of(bench.X_WF * bench.mount.X_FS, all, bench.X_WF * c, Vector3::Zero(),
                                    Vector3::Zero(), Vector3::Zero(), bias));
    if (declared) {
      EXPECT_LT(bench.state.F_K_W_est.vector.norm(), 1e-10);
    }
  }
}

TEST(SensedForce, IsUnknownWithANamedFaultAndReturns) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  struct Case {
    Intervention rule;
    std::function<void(ForceReading&)> spoil;
  };
  for (const Case& wrong : std::vector<Case>{
           {Intervention::force_sensor_silent, [](ForceReading& r) { r.records = 0; }},
           {Intervention::force_sensor_silent, [](ForceReading& r) { r.age_s = 0.0101; }},
           {Intervention::force_sensor_silent, [&](ForceReading& r) { r.age_s = nan; }},
           {Intervention::force_sensor_saturated, [](ForceReading& r) { r.F_S.vector[0] = -1001; }},
           {Intervention::force_sensor_saturated, [](ForceReading& r) { r.F_S.vector[5] = 101; }},
           {Intervention::force_sensor_saturated,
            [](ForceReading& r) { r.fault = Intervention::force_sensor_saturated; }},
           {Intervention::force_sensor_fault,
            [](ForceReading& r) { r.fault = Intervention::force_sensor_fault; }},
           {Intervention::force_sensor_fault, [&](ForceReading& r) { r.F_S.vector[4] = nan; }},
           {Intervention::force_sensor_fault,
            [](ForceReading& r) { r.F_S.vector[1] = -std::numeric_limits<double>::infinity(); }}}) {
    Bench bench;
    SensedForce sensor(bench.mount);
    ASSERT_EQ(bench.update(sensor, bench.pressed_with(0)).rule, Intervention::none);
    ForceReading reading = bench.pressed_with(5);
    wrong.spoil(reading);
    EXPECT_EQ(bench.update(sensor, reading).rule, wrong.rule);
    EXPECT_FALSE(bench.state.has_wrench_estimate);
    EXPECT_FALSE(bench.state.F_K_W_est.vector.allFinite());
    EXPECT_EQ(bench.state.tau_ext_hat.size(), 7);
    EXPECT_FALSE(bench.state.tau_ext_hat.allFinite());
    EXPECT_EQ(bench.update(sensor, bench.pressed_with(5)).rule, Intervention::none);
    EXPECT_NEAR(bench.state.F_K_W_est.force().z(), -5, 1e-12);
  }
}

TEST(SensedForce, IsTaredAtRestAndFreeOnly) {
  Bench bench;
  SensedForce sensor(bench.mount);
  const auto rule = [&](const ForceReading& reading) { return bench.update(sensor, reading).rule; };
  bench.state.dq[3] = 0.1;
  EXPECT_EQ(rule(bench.pressed_with(2)), Intervention::force_sensor_not_tared);
  EXPECT_FALSE(bench.state.has_wrench_estimate);
  bench.state.dq[3] = 0;  // the mean must have begun at rest: two of its windows
  int steps = 0;
  while (rule(bench.pressed_with(31)) == Intervention::force_sensor_not_tared && steps < 1000) ++steps;
  EXPECT_EQ(steps, 1000);  // more than a bias
  EXPECT_EQ(rule(bench.pressed_with(29)), Intervention::none);
  EXPECT_NEAR(bench.state.F_K_W_est.force().z(), 0, 1e-12);
  rule(bench.pressed_with(0));  // let go: the tare stays
  EXPECT_NEAR(bench.state.F_K_W_est.force().z(), 29, 1e-12);

  SensedForce waits(bench.mount);
  bench.state.dq[3] = 0.1;
  (void)bench.update(waits, bench.pressed_with(0));
  bench.state.dq[3] = 0;
  for (steps = 0; steps < 1000 && bench.update(waits, bench.pressed_with(0)).rule != Intervention::none;)
    ++steps;
  EXPECT_NEAR(steps * 1e-3, 2 * SensedForce::kTareTime, 2e-3);
}

// The joints of the bench feel a force along z at levers of 0.5 m (the first) and none.
struct Felt : Bench {
  Felt() {
    J(5, 0) = 1;
    J(2, 0) = 0.5;
  }
  SensorFault update(SensedForce& sensor, double shown_n, double felt_nm, double dt = 1e-3) {
    state.tau_ext_hat = joint_constant(7, 0);
    state.tau_ext_hat[0] = felt_nm;
    return Bench::update(sensor, pressed_with(shown_n), dt);
  }
};

// A run that begins while the tool presses with 20 N must not call that a bias: every press would be 20 N
// harder than it says.
TEST(SensedForce, IsNotTaredWhileTheArmItselfFeelsAContact) {
  Felt bench;
  SensedForce sensor(bench.mount);
  const SensorFault fault = bench.update(sensor, 20, -10);
  EXPECT_EQ(fault.rule, Intervention::force_sensor_not_tared);
  EXPECT_EQ(fault.value, 10);
  EXPECT_FALSE(bench.state.has_wrench_estimate);
  EXPECT_EQ(bench.update(sensor, 0, -0.75).rule, Intervention::none);  // its own bias
  bench.update(sensor, 10, -5);
  EXPECT_NEAR(bench.state.F_K_W_est.force().z(), -10, 1e-12);
}

// Mounted upside down, in pounds, of another arm, frozen, or tared by somebody else: it contradicts the arm.
TEST(SensedForce, IsUnknownIfTheArmFeelsSomethingElse) {
  for (const double share : {1.0, -1.0, 0.0, 1 / 4.448}) {
    Felt bench;
    SensedForce sensor(bench.mount);
    ASSERT_EQ(bench.update(sensor, 0, 0).rule, Intervention::none);
    double pressed = 0;  // rises by 100 N/s
    SensorFault fault;
    for (; pressed < 60 && fault.rule == Intervention::none; pressed += 0.1)
      fault = bench.update(sensor, share * pressed, -0.5 * pressed);
    if (share == 1) {
      EXPECT_EQ(fault.rule, Intervention::none);
      continue;
    }
    EXPECT_EQ(fault.rule, Intervention::force_sensor_contradicted) << share;
    EXPECT_FALSE(bench.state.tau_ext_hat.allFinite());
    EXPECT_LT(pressed, 50) << share;
    EXPECT_NEAR(pressed, 20 / (1 - share) + 100 * SensedForce::kDoubt, 1) << share;
    EXPECT_EQ(bench.update(sensor, 0, 0).rule, Intervention::none);
  }
  // A touch, or joints that slide, do not count; nor an arm that has no estimate.
  Felt bench;
  SensedForce sensor(bench.mount);
  ASSERT_EQ(bench.update(sensor, 0, 0).rule, Intervention::none);
  for (int k = 0; k < 150; ++k) EXPECT_EQ(bench.update(sensor, 0, 15).rule, Intervention::none);
  EXPECT_EQ(bench.update(sensor, 0, 0).rule, Intervention::none);
  bench.J(5, 0) = 0;
  for (int k = 0; k < 500; ++k) EXPECT_EQ(bench.update(sensor, 0, 15).rule, Intervention::none);
  bench.state.tau_ext_hat.resize(0);
  EXPECT_EQ(bench.Bench::update(sensor, bench.pressed_with(0)).rule, Intervention::none);
}

TEST(SensedForce, RefusesAnImpossibleMount) {
  const auto refused = [](const auto& change) {
    ForceSensorMount mount;
    change(mount);
    EXPECT_THROW(SensedForce{mount}, std::invalid_argument);
  };
  EXPECT_NO_THROW(SensedForce{ForceSensorMount{}});
  refused([](auto& m) { m.X_FS.position.x() = std::nan(""); });
  refused([](auto& m) { m.X_FS.rotation *= 2; });
  refused([](auto& m) { m.carried.mass = -0.1; });
  refused([](auto& m) { m.carried.mass = std::nan(""); });
  refused([](auto& m) { m.range_n = 0; });
  refused([](auto& m) { m.max_age_s = std::nan(""); });
}

}  // namespace
}  // namespace multipanda::force_sensor_test
