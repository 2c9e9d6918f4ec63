#include "core/controllets/hold.hpp"

#include <cmath>
#include <numbers>

#include <gtest/gtest.h>

#include "core/controllets/gravity_compensation.hpp"
#include "core/testing/controllet_rig.hpp"
#include "core/testing/dense_algebra.hpp"
#include "core/testing/plain_arm.hpp"
#include "models/arm_source.hpp"

namespace multipanda::hold_test {
namespace {

using namespace test;

std::shared_ptr<const ArmModel> panda() {
  return std::make_shared<ArmModel>(arm_model_source(load_robot("fer"), {}, true));
}

TEST(Hold, TorqueIsTheStatedLaw) {
  Draw draw(81);
  const TestArm arm = TestArm::make();
  const PlainArm plain(arm, {});
  ControlletRig rig(hold_controllet(), {arm.model()});
  rig.set("damping_ratio", {0.7});
  ASSERT_EQ(rig.start(), LawResult::ok);
  Eigen::VectorXd K(7);
  K << 300, 300, 300, 300, 120, 80, 40;
  for (int trial = 0; trial < 20; ++trial) {
    const JointVector q = bent(7) + draw.joints(7, 0.2), dq = draw.joints(7, 0.5);
    rig.place(0, q, dq);
    ASSERT_EQ(rig.update(), LawResult::ok);
    // Modes of M x'' + D x' + K x: D = 2 zeta R sqrt(R^-1 K R^-1) R, R the symmetric root of M.
    const Eigen::MatrixXd R = symmetric_square_root(plain.mass(q)), R_inverse = inverse(R);
    const Eigen::MatrixXd A = R_inverse * K.asDiagonal() * R_inverse;
    const Eigen::MatrixXd D = 1.4 * R * symmetric_square_root(A) * R;
    const Eigen::VectorXd expected = K.cwiseProduct(bent(7) - q) - D * dq + plain.coriolis(q, dq);
    EXPECT_NEAR((rig.tau(0) - expected).norm(), 0, 1e-6);
  }
}

// An undeclared load of 1 kg at the hand sinks less than 3 cm and stays there.
TEST(Hold, UndeclaredKilogramSinksLessThanThreeCentimeters) {
  const auto model = panda();
  ControlletRig rig(hold_controllet(), {model});
  rig.place(0, model->q_home(), joint_constant(7, 0));
  ASSERT_EQ(rig.start(), LawResult::ok);
  const double height = rig.terms(0).X_WE().position.z();
  Vector6 weight = Vector6::Zero();
  weight[2] = -9.81;
  double lowest = height;
  for (int i = 0; i < 2000; ++i) {
    ASSERT_EQ(rig.tick(0.001), LawResult::ok);
    rig.integrate(0.001, {rig.terms(0).J_V_WE().transpose() * weight}, 2);
    lowest = std::min(lowest, rig.terms(0).X_WE().position.z());
  }
  EXPECT_LT(height - lowest, 0.03);
  EXPECT_GT(height - lowest, 0.001);  // a spring, not a rock
  EXPECT_LT(rig.state(0).dq.norm(), 1e-3);
}

TEST(Hold, BringsAMovingArmToRest) {
  Draw draw(82);
  const auto model = panda();
  ControlletRig rig(hold_controllet(), {model});
  rig.place(0, model->q_home(), draw.joints(7, 0.3));
  ASSERT_EQ(rig.start(), LawResult::ok);
  for (int i = 0; i < 3000; ++i) {
    ASSERT_EQ(rig.tick(0.001), LawResult::ok);
    rig.integrate(0.001, {joint_constant(7, 0)}, 2);
  }
  EXPECT_LT((rig.state(0).q - model->q_home()).norm(), 1e-3);
}

// Motors of 50 Hz behind a delay of a period, as the realistic plant has them: the hold does not oscillate in
// any pose. The linearized loop, cycle by cycle; its eigenvalues stay inside the unit circle.
TEST(Hold, IsStableBehindMotorsThatLag) {
  Draw draw(84);
  const auto model = panda();
  ControlletRig rig(hold_controllet(), {model});
  constexpr int kSteps = 10;
  constexpr double kStep = 0.001 / kSteps;
  const double fade = std::exp(-2 * std::numbers::pi * 50 * kStep);
  for (int trial = 0; trial < 50; ++trial) {
    JointVector q = draw.joints(7, 1.0);
    for (Eigen::Index i = 0; i < 7; ++i) {
      const double low = model->limits().q_min[i], high = model->limits().q_max[i];
      q[i] = 0.5 * (low + high) + 0.45 * q[i] * (high - low);
    }
    if (trial == 0) q << -0.0738, -0.2, -0.149, -2.35, -0.047, 2.1, 0.5848;  // low before the base
    rig.place(0, q, joint_constant(7, 0));
    ASSERT_EQ(rig.start(), LawResult::ok);
    const Eigen::MatrixXd M_inverse = inverse(rig.terms(0).M());
    Eigen::MatrixXd damping(7, 7), stiffness(7, 7);
    constexpr double kSmall = 1e-5;
    for (Eigen::Index i = 0; i < 7; ++i) {
      JointVector dq = joint_constant(7, 0), moved = q;
      dq[i] = kSmall;
      moved[i] += kSmall;
      rig.place(0, q, dq);
      ASSERT_EQ(rig.update(), LawResult::ok);
      damping.col(i) = -rig.tau(0) / kSmall;
      rig.place(0, moved, joint_constant(7, 0));
      ASSERT_EQ(rig.update(), LawResult::ok);
      stiffness.col(i) = -rig.tau(0) / kSmall;
    }
    Eigen::MatrixXd cycle(28, 28);  // of position, velocity, motor torque, torque in the delay line
    for (Eigen::Index i = 0; i < 28; ++i) {
      Eigen::VectorXd x = Eigen::VectorXd::Unit(28, i);
      const Eigen::VectorXd command = -stiffness * x.segment(0, 7) - damping * x.segment(7, 7);
      for (int k = 0; k < kSteps; ++k) {
        x.segment(14, 7) = (fade * x.segment(14, 7) + (1 - fade) * x.segment(21, 7)).eval();
        x.segment(7, 7) += kStep * M_inverse * x.segment(14, 7);
        x.segment(0, 7) += kStep * x.segment(7, 7);
      }
      x.segment(21, 7) = command;
      cycle.col(i) = x;
    }
    EXPECT_LT(eigenvalues(cycle).cwiseAbs().maxCoeff(), 1.0) << q.transpose();
  }
}

TEST(GravityCompensation, GivesCoriolisAndALittleDamping) {
  Draw draw(83);
  const TestArm arm = TestArm::make();
  const PlainArm plain(arm, {});
  ControlletRig rig(gravity_compensation_controllet(), {arm.model()});
  ASSERT_EQ(rig.start(), LawResult::ok);
  const JointVector q = bent(7) + draw.joints(7, 0.5), dq = draw.joints(7, 1);
  rig.place(0, q, dq);
  ASSERT_EQ(rig.update(), LawResult::ok);
  EXPECT_NEAR((rig.tau(0) - JointVector(plain.coriolis(q, dq) - 0.1 * dq)).norm(), 0, 1e-6);
  rig.place(0, q, joint_constant(7, 0));
  ASSERT_EQ(rig.update(), LawResult::ok);
  EXPECT_EQ(rig.tau(0).norm(), 0);
}

}  // namespace
}  // namespace multipanda::hold_test
