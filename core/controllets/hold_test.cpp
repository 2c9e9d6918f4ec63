#include "core/controllets/hold.hpp"

#include <gtest/gtest.h>

#include "core/controllets/gravity_compensation.hpp"
#include "core/test_support/controllet_rig.hpp"
#include "core/test_support/plain_arm.hpp"
#include "models/arm_source.hpp"

namespace multipanda {
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
    const Eigen::VectorXd D = 1.4 * (K.array() * plain.mass(q).diagonal().array()).sqrt();
    const Eigen::VectorXd expected = K.cwiseProduct(bent(7) - q) - D.cwiseProduct(dq) + plain.coriolis(q, dq);
    EXPECT_NEAR((rig.tau(0) - expected).norm(), 0, 1e-6);
  }
}

// 1 kg that nobody declared, at the hand: it sinks less than 3 cm and stays.
TEST(Hold, UndeclaredKilogramSinksLessThanThreeCentimetres) {
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
}  // namespace multipanda
