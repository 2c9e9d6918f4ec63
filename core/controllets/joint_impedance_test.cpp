#include <gtest/gtest.h>

#include "core/controllets/builtins.hpp"
#include "core/testing/controllet_rig.hpp"
#include "core/testing/dense_algebra.hpp"
#include "core/testing/plain_arm.hpp"

namespace multipanda::joint_impedance_test {
namespace {

using namespace test;

struct Bench {
  explicit Bench(std::size_t joints, const Pose& X_WB = {})
      : arm(TestArm::make(joints)),
        plain(arm, X_WB),
        rig(joint_impedance_controllet(), {with_motors(arm.source(X_WB), joints)}) {}
  // That bear all gains as they are.
  static std::shared_ptr<const ArmModel> with_motors(ArmModelSource source, std::size_t joints) {
    source.motor_inertia = joint_constant(joints, 1);
    return std::make_shared<const ArmModel>(std::move(source));
  }
  TestArm arm;
  PlainArm plain;
  ControlletRig rig;
};

Target joints_target(const JointVector& q, double duration) {
  Target target;
  target.size = static_cast<std::uint8_t>(q.size());
  target.duration_s = duration;
  std::copy(q.begin(), q.end(), target.values.begin());
  return target;
}

TEST(JointImpedance, TorqueIsTheStatedLaw) {
  Draw draw(41);
  for (const std::size_t n : {std::size_t{6}, std::size_t{7}}) {
    for (const double design : {0.0, 1.0, 2.0}) {  // coupled, diagonal, given
      Bench bench(n, draw.pose(1));
      bench.rig.set("damping_ratio", {0.8});
      bench.rig.set("damping_design", {design});
      std::vector<double> given{7, 6.5, 8, 6.2, 4, 1.7, 0.7};
      given.resize(n);
      bench.rig.set("damping_nms_per_rad", given);
      ASSERT_EQ(bench.rig.start(), LawResult::ok);
      Reference& input = bench.rig.input("joints");
      input.set(joints_target(bent(n) + draw.joints(n, 0.3), 1.0));
      for (int i = 0; i < 300; ++i) ASSERT_EQ(bench.rig.tick(0.001), LawResult::ok);
      EXPECT_GT(input.joint_acceleration().norm(), 1e-3);  // in motion: every term is nonzero

      const JointVector q = bent(n) + draw.joints(n, 0.5), dq = draw.joints(n, 0.7);
      bench.rig.place(0, q, dq);
      ASSERT_EQ(bench.rig.update(), LawResult::ok);
      Eigen::VectorXd K(7);
      K << 600, 600, 600, 600, 250, 150, 50;
      K.conservativeResize(static_cast<Eigen::Index>(n));
      const Eigen::MatrixXd M = bench.plain.mass(q);
      Eigen::MatrixXd D = modal_damping(M, K.asDiagonal(), 0.8);
      if (design == 1) D = (1.6 * (K.array() * M.diagonal().array()).sqrt()).matrix().asDiagonal();
      if (design == 2) {
        D = Eigen::Map<const Eigen::VectorXd>(given.data(), static_cast<Eigen::Index>(n)).asDiagonal();
      }
      const Eigen::VectorXd expected = K.asDiagonal() * (input.joints() - q) +
                                       D * (input.joint_velocity() - dq) + bench.plain.coriolis(q, dq) +
                                       M * input.joint_acceleration();
      EXPECT_NEAR((bench.rig.tau(0) - expected).norm(), 0, 1e-5);

      bench.rig.set("acceleration_feedforward", {0});
      ASSERT_EQ(bench.rig.update(), LawResult::ok);
      EXPECT_NEAR((bench.rig.tau(0) - expected + M * input.joint_acceleration()).norm(), 0, 1e-5);
    }
  }
}

// A step of 5 mrad is made in 0.1 s with a jerk of 300 rad/s^3. What is fed forward, the difference to the
// law without it, moves straight to M ddq_d, in all joints together, by at most a quarter of the torque rate.
TEST(JointImpedance, FeedsForwardAtAQuarterOfTheTorqueRate) {
  constexpr double kMost = 0.25 * 1000 * 0.001;  // [N m] in a period
  ArmModelSource source = TestArm::make(7).source({});
  source.limits.tau_rate_max = joint_constant(7, 1000);
  const Models models{Bench::with_motors(source, 7)};
  ControlletRig with(joint_impedance_controllet(), models), without(joint_impedance_controllet(), models);
  without.set("acceleration_feedforward", {0});
  for (ControlletRig* rig : {&with, &without}) {
    rig->place(0, bent(7), joint_constant(7, 0));
    ASSERT_EQ(rig->start(), LawResult::ok);
    rig->input("joints").set(joints_target(bent(7) + joint_constant(7, 0.005), 0));
  }
  const Eigen::MatrixXd M = with.terms(0).M();
  Eigen::VectorXd fed = Eigen::VectorXd::Zero(7), demand = fed;
  double fastest = 0;
  for (int k = 0; k < 300; ++k) {
    ASSERT_EQ(with.tick(0.001), LawResult::ok);
    ASSERT_EQ(without.tick(0.001), LawResult::ok);
    const Eigen::VectorXd now = with.tau(0) - without.tau(0), step = now - fed;
    const Eigen::VectorXd asked = M * with.input("joints").joint_acceleration(), way = asked - fed;
    EXPECT_LE(step.lpNorm<Eigen::Infinity>(), kMost + 1e-9);
    EXPECT_NEAR((step * way.norm() - way * step.norm()).norm(), 0, 1e-9);
    EXPECT_TRUE(step.lpNorm<Eigen::Infinity>() > kMost - 1e-9 || (now - asked).norm() < 1e-9) << k;
    fastest = std::max(fastest, (asked - demand).lpNorm<Eigen::Infinity>());
    fed = now;
    demand = asked;
  }
  EXPECT_GT(fastest, 2 * kMost);
  EXPECT_NEAR(fed.norm(), 0, 1e-9);
}

TEST(JointImpedance, IsZeroAtRestOnTheSetPoint) {
  Bench bench(7);
  ASSERT_EQ(bench.rig.start(), LawResult::ok);
  ASSERT_EQ(bench.rig.update(), LawResult::ok);
  EXPECT_EQ(bench.rig.tau(0).norm(), 0);
}

TEST(JointImpedance, BaseDoesNotMatter) {
  Draw draw(42);
  Bench here(7), there(7, draw.pose(2));
  const JointVector q = bent(7) + draw.joints(7, 0.3), dq = draw.joints(7, 1);
  for (auto* bench : {&here, &there}) {
    ASSERT_EQ(bench->rig.start(), LawResult::ok);
    bench->rig.place(0, q, dq);
    ASSERT_EQ(bench->rig.update(), LawResult::ok);
  }
  EXPECT_NEAR((here.rig.tau(0) - there.rig.tau(0)).norm(), 0, 1e-9);
}

TEST(JointImpedance, SettlesAndYieldsToAPushByTorqueOverStiffness) {
  Draw draw(43);
  Bench bench(7);
  ASSERT_EQ(bench.rig.start(), LawResult::ok);
  const JointVector push = draw.joints(7, 3);
  for (int i = 0; i < 2000; ++i) {
    ASSERT_EQ(bench.rig.tick(0.001), LawResult::ok);
    bench.rig.integrate(0.001, {push});
  }
  Eigen::VectorXd K(7);
  K << 600, 600, 600, 600, 250, 150, 50;
  const JointVector deflection = bench.rig.state(0).q - bent(7);
  EXPECT_NEAR((deflection - push.cwiseQuotient(K)).norm(), 0, 1e-5);
}

TEST(JointImpedance, EnergyDoesNotGrowWhileTheSetPointRests) {
  Draw draw(44);
  Bench bench(7);
  bench.rig.set("damping_ratio", {0.1});
  ASSERT_EQ(bench.rig.start(), LawResult::ok);
  Eigen::VectorXd K(7);
  K << 600, 600, 600, 600, 250, 150, 50;
  bench.rig.place(0, bent(7) + draw.joints(7, 0.05), draw.joints(7, 0.2));
  const auto energy = [&] {
    const JointVector e = bent(7) - bench.rig.state(0).q;
    return bench.rig.kinetic_energy(0) + 0.5 * e.dot(K.asDiagonal() * e);
  };
  // The torque is held for a millisecond, so single samples may increase a little, but not the trend.
  const double start = energy();
  double before = start;
  for (int i = 0; i < 1000; ++i) {
    ASSERT_EQ(bench.rig.tick(0.001), LawResult::ok);
    bench.rig.integrate(0.001, {joint_constant(7, 0)});
    ASSERT_LT(energy(), before + 1e-2 * start) << "tick " << i;
    before = energy();
  }
  EXPECT_LT(before, 0.05 * start);
}

TEST(JointImpedance, NotANumberIsAFault) {
  for (const double bad : {std::nan(""), std::numeric_limits<double>::infinity()}) {
    for (const bool velocity : {false, true}) {
      Bench bench(7);
      ASSERT_EQ(bench.rig.start(), LawResult::ok);
      JointVector q = bent(7), dq = joint_constant(7, 0);
      (velocity ? dq : q)[3] = bad;
      bench.rig.place(0, q, dq);
      EXPECT_EQ(bench.rig.update(), LawResult::fault);
    }
  }
}

// Joints without stiffness are braked and not led, whatever the design of their damping.
TEST(JointImpedance, JointsWithoutStiffnessAreBrakedAndNotLed) {
  Draw draw(45);
  for (const double design : {0.0, 1.0, 2.0}) {
    Bench bench(7);
    bench.rig.set("stiffness_nm_per_rad", {0});
    bench.rig.set("damping_design", {design});
    bench.rig.set("damping_nms_per_rad", {0});
    ASSERT_EQ(bench.rig.start(), LawResult::ok);
    bench.rig.input("joints").set(joints_target(bent(7) + draw.joints(7, 0.3), 1.0));
    for (int k = 0; k < 300; ++k) ASSERT_EQ(bench.rig.tick(0.001), LawResult::ok);
    EXPECT_LT((bench.rig.tau(0) - bench.rig.terms(0).c()).norm(), 1e-9);
    const JointVector dq = draw.joints(7, 0.7);
    bench.rig.place(0, bent(7), dq);
    ASSERT_EQ(bench.rig.update(), LawResult::ok);
    const Eigen::VectorXd brake = -2 * bench.plain.mass(bent(7)) * Eigen::VectorXd(dq);
    EXPECT_LT((bench.rig.tau(0) - bench.rig.terms(0).c() - JointVector(brake)).norm(), 1e-6);
  }
}

}  // namespace
}  // namespace multipanda::joint_impedance_test
