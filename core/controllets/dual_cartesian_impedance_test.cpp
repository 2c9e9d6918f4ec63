#include <algorithm>
#include <array>

#include <gtest/gtest.h>

#include "core/controllets/builtins.hpp"
#include "core/testing/controllet_rig.hpp"
#include "core/testing/test_arm.hpp"

namespace multipanda::dual_cartesian_impedance_test {
namespace {

using namespace test;

const Pose kFirstBase{rotation_from_rpy({0.1, 0, 0.4}), Vector3(0, 0.4, 0)};
const Pose kSecondBase{rotation_from_rpy({0, 0.2, -0.5}), Vector3(0.1, -0.4, 0)};

// Two different arms: seven joints and six.
struct Bench {
  Bench()
      : models{TestArm::make(7).model(kFirstBase), TestArm::make(6, 2).model(kSecondBase)},
        rig(dual_cartesian_impedance_controllet(), models) {}
  Pose hand(std::size_t arm) { return rig.terms(arm).X_WE(); }
  Models models;
  ControlletRig rig;
};

// Each arm gets exactly the torque of its own Cartesian impedance.
TEST(DualCartesianImpedance, IsTwoIndependentImpedances) {
  Draw draw(61);
  Bench bench;
  bench.rig.set("goals", {1});
  ASSERT_EQ(bench.rig.start(), LawResult::ok);
  const Pose first = bench.hand(0) * draw.pose(0.05), second = bench.hand(1) * draw.pose(0.05);
  bench.rig.input("first_pose").set(pose_target(first, 1));
  bench.rig.input("second_pose").set(pose_target(second, 1));
  for (std::size_t arm = 0; arm < 2; ++arm) {
    ControlletRig single(cartesian_impedance_controllet(), {bench.models[arm]});
    ASSERT_EQ(single.start(), LawResult::ok);
    single.input("pose").set(pose_target(arm == 0 ? first : second, 1));
    for (int i = 0; i < 300; ++i) ASSERT_EQ(single.tick(0.001), LawResult::ok);
    if (arm == 0) {
      for (int i = 0; i < 300; ++i) ASSERT_EQ(bench.rig.tick(0.001), LawResult::ok);
    }
    EXPECT_GT(single.tau(0).norm(), 0.1);
    EXPECT_NEAR((bench.rig.tau(arm) - single.tau(0)).norm(), 0, 1e-12);
    // The laws must also agree in motion.
    const std::size_t n = bench.models[arm]->joint_count();
    const JointVector q = bent(n) + draw.joints(n, 0.2), dq = draw.joints(n, 0.4);
    single.place(0, q, dq);
    bench.rig.place(arm, q, dq);
    ASSERT_EQ(single.update(), LawResult::ok);
    ASSERT_EQ(bench.rig.update(), LawResult::ok);
    EXPECT_NEAR((bench.rig.tau(arm) - single.tau(0)).norm(), 0, 1e-6);
  }
}

TEST(DualCartesianImpedance, NothingMovesUntilACommonTargetComes) {
  Bench bench;
  ASSERT_EQ(bench.rig.start(), LawResult::ok);
  for (int i = 0; i < 100; ++i) {
    ASSERT_EQ(bench.rig.tick(0.001), LawResult::ok);
    EXPECT_NEAR(bench.rig.tau(0).norm() + bench.rig.tau(1).norm(), 0, 1e-9);
  }
}

// Towards common target + offset and - offset, without a step in the set-point and within the stated speed.
TEST(DualCartesianImpedance, CommonTargetPlusAndMinusOffset) {
  Draw draw(62);
  Bench bench;
  const Vector3 offset(0.05, 0.2, -0.1);
  bench.rig.set("offset_m", {offset.x(), offset.y(), offset.z()});
  ASSERT_EQ(bench.rig.start(), LawResult::ok);
  const Pose X_d{draw.rotation(), Vector3(0.4, 0.1, 0.6)};
  bench.rig.input("common_pose").set(pose_target(X_d, 1));
  const Pose hands[2] = {bench.hand(0), bench.hand(1)};
  // The test keeps the arms at rest, so the outputs show the set-point relative to the start.
  std::vector<double> before;
  for (int i = 0; i < 15000; ++i) {
    ASSERT_EQ(bench.rig.tick(0.001), LawResult::ok);
    auto error = bench.rig.output("first_position_error_m");
    for (std::size_t k = 0; k < 3 && i > 0; ++k) EXPECT_LT(std::abs(error[k] - before[k]), 1.0e-3);
    before = error;
  }
  for (std::size_t arm = 0; arm < 2; ++arm) {
    const Vector3 p_expected = X_d.position + (arm == 0 ? offset : Vector3(-offset));
    const auto p = bench.rig.output(arm == 0 ? "first_position_error_m" : "second_position_error_m");
    const auto r =
        bench.rig.output(arm == 0 ? "first_orientation_error_rad" : "second_orientation_error_rad");
    const Vector6 expected = pose_error({X_d.rotation, p_expected}, hands[arm]);
    for (int k = 0; k < 3; ++k) {
      EXPECT_NEAR(p[static_cast<std::size_t>(k)], expected[k], 1e-9);
      EXPECT_NEAR(r[static_cast<std::size_t>(k)], expected[3 + k], 1e-7);
    }
  }
}

TEST(DualCartesianImpedance, ChangingGoalsMakesNoStep) {
  Bench bench;
  ASSERT_EQ(bench.rig.start(), LawResult::ok);
  Pose X_d = bench.rig.input("common_pose").pose();
  X_d.position.z() += 0.05;
  bench.rig.input("common_pose").set(pose_target(X_d, 1));
  for (int i = 0; i < 8000; ++i) ASSERT_EQ(bench.rig.tick(0.001), LawResult::ok);
  const JointVector first = bench.rig.tau(0), second = bench.rig.tau(1);
  EXPECT_GT(first.norm(), 0.1);
  bench.rig.set("goals", {1});
  for (int i = 0; i < 100; ++i) {
    ASSERT_EQ(bench.rig.tick(0.001), LawResult::ok);
    EXPECT_NEAR((bench.rig.tau(0) - first).norm() + (bench.rig.tau(1) - second).norm(), 0, 1e-6);
  }
}

// What moves a hand at once, its reference, the way from one set of goals to the other, a changed offset and
// a redefined end effector, keeps to the hand's speed in sum, also in a reduced run; goals in quick
// succession and streams included.
TEST(DualCartesianImpedance, AllThatMovesAHandKeepsToItsSpeedTogether) {
  for (const double most : {0.25, 0.1}) {
    for (const int way : {0, 1, 2}) {  // one goal, many goals, a stream
      SCOPED_TRACE(testing::Message() << most << " m/s, " << way);
      Bench bench;
      bench.rig.bound({.hand_speed = most, .spring_force = 1e6, .spring_moment = 1e6});
      ASSERT_EQ(bench.rig.start(), LawResult::ok);
      Reference& pose = bench.rig.input("common_pose");
      Pose goal = pose.pose();
      const Vector3 start = goal.position;
      const double scale = most / 0.25;  // all ways, so that they take as long
      const Vector3 offset = scale * Vector3(0.1, 0.4, -0.1);
      goal.position += scale * Vector3(0.3, -0.5, 0.4);
      if (way != 2) goal.rotation = exp_rotation({0.3, -0.5, 0.4}) * goal.rotation;
      double fastest = 0, reference_alone = 0;
      std::array<Vector3, 2> before;
      for (int k = 0; k < 25000; ++k) {
        if (way == 0 ? k == 0 : way == 1 && k % 7 == 0) pose.set(pose_target(goal));
        if (way == 2 && k % 4 == 0) {
          Pose sample = goal;
          sample.position = start + std::min(1.0, 0.3 * k * 1e-3) * (goal.position - start);
          ASSERT_EQ(pose.post(pose_target(sample, 0, Delivery::stream)), Verdict::accepted);
        }
        if (k == 400) bench.rig.approach("offset_m", {offset.x(), offset.y(), offset.z()});
        if (k == 700) {
          for (const std::size_t arm : {0u, 1u})
            bench.rig.redefine(arm, {exp_rotation({0, 0.2, 0}), scale * Vector3(0, 0.02, 0.1)});
        }
        ASSERT_EQ(bench.rig.tick(0.001), LawResult::ok);
        reference_alone = std::max(reference_alone, pose.twist().linear().norm());
        for (const std::size_t arm : {0u, 1u}) {  // the arms stand still: their errors show the set-points
          const auto e = bench.rig.output(arm == 0 ? "first_position_error_m" : "second_position_error_m");
          const Vector3 p = bench.hand(arm).position + Vector3(e[0], e[1], e[2]);
          if (k > 0 && k != 700) fastest = std::max(fastest, (p - before[arm]).norm() / 1e-3);
          before[arm] = p;
        }
      }
      EXPECT_LT(fastest, 1.06 * most);  // a stream may exceed it by 5 %
      EXPECT_GT(fastest, 0.5 * most);
      EXPECT_GT(reference_alone, 0.3 * most);
      EXPECT_LT((pose.pose().position - goal.position).norm(), 1e-6);  // and everything arrives
      if (most < 0.25) continue;  // the way from where the hands began takes a minute
      for (const std::size_t arm : {0u, 1u}) {
        EXPECT_LT((before[arm] - goal.position - (arm == 0 ? offset : Vector3(-offset))).norm(), 1e-6);
      }
    }
  }
}

TEST(DualCartesianImpedance, NotANumberOfEitherArmIsAFault) {
  for (std::size_t arm = 0; arm < 2; ++arm) {
    Bench bench;
    ASSERT_EQ(bench.rig.start(), LawResult::ok);
    JointVector q = bench.rig.state(arm).q;
    q[1] = std::nan("");
    bench.rig.place(arm, q, bench.rig.state(arm).dq);
    EXPECT_EQ(bench.rig.update(), LawResult::fault);
  }
}

}  // namespace
}  // namespace multipanda::dual_cartesian_impedance_test
