#include "core/state/external_force.hpp"

#include <cmath>
#include <numbers>

#include <Eigen/Cholesky>
#include <gtest/gtest.h>

#include "core/model/model_terms.hpp"
#include "core/testing/test_arm.hpp"

// The plant is integrated here, by M ddq = tau + J^T F_on_arm - c - g with Runge-Kutta steps: terms that the
// observer does not use.
namespace multipanda::external_force_test {
namespace {

using test::Draw;
using test::TestArm;

struct Plant {
  explicit Plant(std::shared_ptr<const ArmModel> model) : terms(std::move(model)) {}

  JointVector acceleration(const JointVector& at, const JointVector& rate, const JointVector& tau) {
    terms.update(at, rate);
    const JointVector push = terms.J_V_WE().transpose().lazyProduct(F_on_arm.vector);
    const Eigen::MatrixXd M = terms.M();
    return Eigen::LLT<Eigen::MatrixXd>(M).solve(Eigen::VectorXd(tau + push - terms.c() - terms.g()));
  }

  // One period at constant torque; stores the sensors' values.
  void step(const JointVector& tau, double dt) {
    const JointVector k1 = acceleration(q, dq, tau);
    const JointVector k2 = acceleration(q + 0.5 * dt * dq, dq + 0.5 * dt * k1, tau);
    const JointVector k3 = acceleration(q + 0.5 * dt * dq + 0.25 * dt * dt * k1, dq + 0.5 * dt * k2, tau);
    const JointVector k4 = acceleration(q + dt * dq + 0.5 * dt * dt * k2, dq + dt * k3, tau);
    q += dt * dq + dt * dt / 6 * (k1 + k2 + k3);
    dq += dt / 6 * (k1 + 2 * k2 + 2 * k3 + k4);
    state.q = q;
    state.dq = dq;
    state.tau_J = tau;
    ++state.sequence;
    state.t_robot.ns += static_cast<std::int64_t>(dt * 1e9 + 0.5);
    terms.update(state);
  }

  ModelTerms terms;
  JointVector q, dq;
  Wrench F_on_arm;  // at E, world axes
  ArmState state;
};

void observe(ExternalForceObserver& observer, Plant& plant) {
  observer.update({plant.terms.momentum(), plant.terms.momentum_drift(), plant.terms.J_V_WK()}, plant.state);
}

Plant some_plant(std::uint32_t seed, std::size_t joints) {
  Draw draw(seed);
  Plant plant(TestArm::make(joints, seed).model(draw.pose(1)));
  plant.q = draw.joints(joints, 1);
  plant.dq = joint_constant(joints, 0);
  return plant;
}

// Held still against a constant push: the estimate is its opposite, at K, and approaches it like a low-pass.
TEST(ExternalForce, OfAPushOnAnArmAtRestIsItsReaction) {
  for (std::uint32_t seed = 1; seed <= 20; ++seed) {
    for (const std::size_t joints : {std::size_t{6}, std::size_t{7}}) {
      Draw draw(seed + 100);
      Plant plant = some_plant(seed, joints);
      plant.state.frames.X_EK = draw.pose(0.1);
      plant.state.frames.X_FE = draw.pose(0.1);
      plant.F_on_arm.vector << draw.vector3(20), draw.vector3(3);
      ExternalForceObserver observer(joints);
      plant.state.q = plant.q;
      plant.state.dq = plant.dq;
      plant.terms.update(plant.state);
      const Jacobian J = plant.terms.J_V_WE();
      const JointVector push = J.transpose().lazyProduct(plant.F_on_arm.vector);
      const JointVector tau = plant.terms.g() - push;  // the torque that holds the arm at rest
      for (int k = 0; k <= 200; ++k) {
        plant.state.tau_J = tau;
        plant.state.t_robot.ns = 1'000'000 * k;
        observe(observer, plant);
        const double K = 2 * std::numbers::pi * ExternalForceObserver::kBandwidth;
        const double share = 1 - std::pow(1 + K * 1e-3, -k);  // of backward Euler
        EXPECT_LT((plant.state.tau_ext_hat + share * push).norm(), 1e-9 * push.norm() + 1e-12);
      }
      ASSERT_TRUE(plant.state.has_wrench_estimate);
      if (plant.terms.manipulability() < 0.02) continue;  // eps bounds the wrench there
      const Vector3 p_EK_W = plant.terms.X_WK().position - plant.terms.X_WE().position;
      const Wrench at_K = shifted(plant.F_on_arm, -p_EK_W);
      EXPECT_LT((plant.state.F_K_W_est.vector + at_K.vector).norm(), 0.01 * at_K.vector.norm());
    }
  }
}

// Moved through a strong motion, with and without a push that comes and goes: the residual follows the push's
// joint torques through the same low-pass, whatever the motion.
TEST(ExternalForce, IsNotAffectedByMotion) {
  for (std::uint32_t seed = 1; seed <= 5; ++seed) {
    Draw draw(seed);
    Plant plant = some_plant(seed, 7);
    ExternalForceObserver observer(7);
    const double K = 2 * std::numbers::pi * ExternalForceObserver::kBandwidth, dt = 1e-3;
    const JointVector amplitude = draw.joints(7, 3);
    JointVector expected = joint_constant(7, 0), before = expected;
    double worst = 0, fastest = 0;
    for (int k = 0; k < 1500; ++k) {
      const double t = k * dt;
      if (k == 500) plant.F_on_arm.vector << draw.vector3(10), draw.vector3(2);
      if (k == 1000) plant.F_on_arm = {};
      plant.terms.update(plant.q, plant.dq);
      JointVector tau = plant.terms.g() + std::sin(3 * t) * amplitude - 1.0 * plant.dq;
      before = plant.terms.J_V_WE().transpose().lazyProduct(plant.F_on_arm.vector);
      plant.step(tau, dt);
      observe(observer, plant);
      const JointVector push = plant.terms.J_V_WE().transpose().lazyProduct(plant.F_on_arm.vector);
      if (k == 0) continue;  // the first packet has none before it
      expected = (expected + K * dt * 0.5 * (push + before)) / (1 + K * dt);
      worst = std::max(worst, (plant.state.tau_ext_hat + expected).lpNorm<Eigen::Infinity>());
      fastest = std::max(fastest, plant.dq.lpNorm<Eigen::Infinity>());
    }
    EXPECT_GT(fastest, 0.5);
    EXPECT_LT(worst, 2e-3);  // trapezoids of 1 ms
  }
}

TEST(ExternalForce, ADeclaredLoadIsNoForceAndItsDeclarationCausesNone) {
  Draw draw(5);
  Plant plant = some_plant(5, 7);
  ExternalForceObserver observer(7);
  const Load load = draw.load(1.5);
  plant.state.q = plant.q;
  plant.state.dq = draw.joints(7, 0.1);
  plant.state.load = load;
  plant.state.config_version = 1;
  plant.terms.update(plant.state);
  const JointVector tau_with = plant.terms.g();
  plant.state.load = {};
  plant.state.config_version = 2;
  plant.terms.update(plant.state);
  const JointVector weight = tau_with - plant.terms.g();
  plant.state.dq.setZero();
  const auto run = [&](int steps) {
    for (int k = 0; k < steps; ++k) {
      plant.state.tau_J = tau_with;
      plant.state.t_robot.ns += 1'000'000;
      plant.terms.update(plant.state);
      observe(observer, plant);
    }
  };
  run(300);
  EXPECT_LT((plant.state.tau_ext_hat - weight).norm(), 1e-6);  // the arm carries it
  plant.state.load = load;
  plant.state.config_version = 3;
  run(1);
  EXPECT_LT((plant.state.tau_ext_hat - weight).norm(), 1e-6);  // no jump
  run(300);
  EXPECT_LT(plant.state.tau_ext_hat.norm(), 1e-6);
}

TEST(ExternalForce, SurvivesGapsAndStatesThatAreNotFinite) {
  Plant plant = some_plant(6, 7);
  ExternalForceObserver observer(7);
  plant.terms.update(plant.q, plant.dq);
  const JointVector hold = plant.terms.g();
  for (int k = 0; k < 100; ++k) {
    plant.step(hold, 1e-3);
    if (k == 50) plant.state.tau_J[3] = std::nan("");
    if (k == 60) plant.state.t_robot.ns += 500'000'000;
    observe(observer, plant);
    EXPECT_TRUE(plant.state.tau_ext_hat.allFinite());
    EXPECT_LT(plant.state.tau_ext_hat.norm(), 1e-3);
  }
}

// A gap of 20 periods is bridged as one long step; a longer one, an old packet or a second one of the same
// time leave the estimate as it was, and the next step begins at the newest packet.
TEST(ExternalForce, StepsOverGapsOfUpToTwentyPeriods) {
  const double K = 2 * std::numbers::pi * ExternalForceObserver::kBandwidth;
  const Jacobian J = Jacobian::Identity(6, 6);
  const JointVector drift = joint_constant(6, 0);
  ArmState state;
  state.tau_J = joint_constant(6, 0);
  ExternalForceObserver observer(6);
  const auto estimate_at = [&](std::int64_t ns, double momentum) {
    state.t_robot.ns = ns;
    observer.update({joint_constant(6, momentum), drift, J}, state);
    return -state.tau_ext_hat[5];
  };
  EXPECT_EQ(estimate_at(0, 1), 0);
  const double after_gap = K * 2 / (1 + K * 0.02);
  EXPECT_DOUBLE_EQ(estimate_at(20'000'000, 3), after_gap);
  EXPECT_EQ(estimate_at(20'000'000, 9), after_gap) << "of the same time";
  EXPECT_DOUBLE_EQ(estimate_at(21'000'000, 4), (after_gap + K * 1) / (1 + K * 0.001));
  const double before = (after_gap + K) / (1 + K * 0.001);
  EXPECT_DOUBLE_EQ(estimate_at(41'000'001, 7), before) << "longer";
  EXPECT_DOUBLE_EQ(estimate_at(40'000'000, 2), before) << "an old one";
  EXPECT_DOUBLE_EQ(estimate_at(41'000'000, 2), before / (1 + K * 0.001));
  observer.reset();
  EXPECT_EQ(estimate_at(42'000'000, 50), 0);
  EXPECT_DOUBLE_EQ(estimate_at(43'000'000, 51), K / (1 + K * 0.001));
}

// In a stretched pose no wrench is infinite.
TEST(ExternalForce, WrenchIsBoundedInSingularPoses) {
  Jacobian J = Jacobian::Zero(6, 7);
  J(0, 0) = 1e-7;
  const Wrench F = wrench_of(J, joint_constant(7, 1));
  EXPECT_TRUE(F.vector.allFinite());
  EXPECT_LE(F.vector.norm(), 500 * joint_constant(7, 1).norm());
}

// J with orthonormal columns: J J^T is the identity, so the wrench is J tau, less a millionth.
TEST(ExternalForce, TheWrenchTakesEveryJointIntoAccount) {
  const Jacobian J = Jacobian::Identity(6, 6);
  for (Eigen::Index i = 0; i < 6; ++i) {
    JointVector tau = joint_constant(6, 0);
    tau[i] = 2;
    const Wrench F = wrench_of(J, tau);
    EXPECT_LT((F.vector - Vector6(tau)).norm(), 1e-5) << i;
  }
}

TEST(ExternalForce, AnyTermThatIsNotFiniteLeavesTheEstimateAsItWas) {
  const double K = 2 * std::numbers::pi * ExternalForceObserver::kBandwidth;
  const Jacobian J = Jacobian::Identity(6, 6);
  for (int wrong = 0; wrong < 3; ++wrong) {
    ArmState state;
    ExternalForceObserver observer(6);
    const auto estimate_at = [&](int ms, double momentum, bool tampered) {
      JointVector p = joint_constant(6, momentum), drift = joint_constant(6, 0);
      state.tau_J = joint_constant(6, 0);
      if (tampered) (wrong == 0 ? p : wrong == 1 ? drift : state.tau_J)[2] = std::nan("");
      state.t_robot.ns = 1'000'000LL * ms;
      state.has_wrench_estimate = false;
      observer.update({p, drift, J}, state);
      EXPECT_NE(state.has_wrench_estimate, tampered);
      return -state.tau_ext_hat[2];
    };
    EXPECT_EQ(estimate_at(0, 1, false), 0);
    const double first = K * 2 / (1 + K * 0.001);
    EXPECT_DOUBLE_EQ(estimate_at(1, 3, false), first);
    EXPECT_DOUBLE_EQ(estimate_at(2, 5, true), first) << wrong;
    EXPECT_DOUBLE_EQ(estimate_at(3, 4, false), (first + K * 1) / (1 + K * 0.002)) << "one step of 2 ms";
  }
}

}  // namespace
}  // namespace multipanda::external_force_test
