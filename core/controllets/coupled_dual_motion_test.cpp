// Motion of the coupled law's set-points: hands that move exactly as the set-points do feel no damping, and
// no hand's set-point is faster than the bound for contact.
#include <gtest/gtest.h>

#include "core/controllets/builtins.hpp"
#include "core/testing/moving_law.hpp"

namespace multipanda::coupled_dual_motion_test {
namespace {

using namespace test;

// Relative velocity and offset in the law's axes follow from what the law shows; the absolute velocity from
// the input. So nothing here knows how the set-points are made.
TEST(CoupledDualMotion, HandsThatMoveWithTheSetPointsFeelOnlyTheSprings) {
  for (std::uint32_t seed : {51u, 52u, 53u}) {
    const auto under_way = [&] {
      auto law = std::make_unique<MovingLaw>(coupled_dual_cartesian_impedance_controllet(), 2, seed);
      law->rig.set("acceleration_feedforward", {0});
      for (std::size_t i = 0; i < 2; ++i) {
        law->q[i] = bent(7) + law->draw.joints(7, 0.1);
        law->dq[i] = JointVector::Zero(7);
        law->rig.place(i, law->q[i], law->dq[i]);
      }
      EXPECT_EQ(law->rig.start(), LawResult::ok);
      const Pose X = law->rig.input("pose").pose();
      law->rig.input("pose").set(pose_target(
          {exp_rotation(law->draw.vector3(0.6)) * X.rotation, X.position + Vector3(0.1, 0, 0.1)}, 1));
      law->rig.approach("relative_offset_m", {0.04, -0.06, 0.02});
      return law;
    };
    const double dt = 0.001;
    auto still = under_way(), moving = under_way();
    const auto tick = [&](MovingLaw& law) { ASSERT_EQ(law.rig.tick(dt), LawResult::ok); };
    for (int t = 0; t < 300; ++t) {
      tick(*still);
      tick(*moving);
    }
    const Pose X_WA{Matrix3::Identity(), 0.5 * (still->X_WE(0).position + still->X_WE(1).position)};
    const Pose X_before = still->rig.input("pose").pose();
    const Vector3 r_before = still->shown("relative_position_error_m");
    tick(*still);
    const Vector3 r_now = still->shown("relative_position_error_m");
    tick(*still);
    const Pose X_after = still->rig.input("pose").pose();
    const Vector3 r_after = still->shown("relative_position_error_m");
    Vector6 V_a, V_r = Vector6::Zero();
    V_a << (X_after.position - X_before.position) / (2 * dt),
        log_rotation(X_after.rotation * X_before.rotation.transpose()) / (2 * dt);
    V_r.head<3>() = (r_after - r_before) / (2 * dt);
    EXPECT_GT(V_a.tail<3>().norm(), 0.1);
    EXPECT_GT(V_r.head<3>().norm(), 0.01);

    for (std::size_t i = 0; i < 2; ++i) {
      Vector6 V = V_a;
      V.head<3>() += (i == 0 ? -0.5 : 0.5) * V_r.head<3>();
      const Vector3 r = X_WA.position - moving->X_WE(i).position;  // both hold A where it began
      V.head<3>() -= V.tail<3>().cross(r);
      moving->dq[i] = moving->plain[i].jacobian(moving->q[i]).completeOrthogonalDecomposition().solve(V);
      moving->rig.place(i, moving->q[i], moving->dq[i]);
    }
    tick(*moving);
    // The springs: their translational stiffness is the same along all axes, and nothing is turned between
    // the hands yet.
    const Vector3 f_a = moving->shown("absolute_force_n"), f_r = moving->shown("relative_force_n");
    const Vector3 p_d = moving->rig.input("pose").pose().position;
    const double K = 400 * moving->rig.output("absolute_stiffness_share")[0];  // what so light wrists bear
    EXPECT_LT((f_r - K * r_now).norm(), 1e-3 * f_r.norm());
    const Vector3 spring = K * (p_d - X_WA.position);
    EXPECT_LT((f_a - spring).norm(), 1e-3 * f_a.norm());
    EXPECT_LT(moving->shown("relative_moment_nm").norm(), 1e-3 * f_r.norm());
  }
}

TEST(CoupledDualMotion, NoHandsSetPointIsFasterThanTheBound) {
  for (const double most : {0.1, 0.2}) {
    for (const Vector3& turn : {Vector3(0, 0, 0), Vector3(0, 0, 2.5), Vector3(1.5, -1.5, 0)}) {
      MovingLaw law(coupled_dual_cartesian_impedance_controllet(), 2, 61);
      law.rig.bound({.hand_speed = most, .spring_force = 1e6, .spring_moment = 1e6});  // nothing waits
      for (std::size_t i = 0; i < 2; ++i) {
        law.q[i] = bent(7);
        law.dq[i] = JointVector::Zero(7);
        law.rig.place(i, law.q[i], law.dq[i]);
      }
      ASSERT_EQ(law.rig.start(), LawResult::ok);
      Reference& pose = law.rig.input("pose");
      const Pose X_0 = pose.pose();
      Vector3 from_A[2];
      for (std::size_t i = 0; i < 2; ++i) from_A[i] = law.X_WE(i).position - X_0.position;
      pose.set(pose_target({exp_rotation(turn) * X_0.rotation, X_0.position + Vector3(0.5, 0, 0.2)}, 0));
      law.rig.approach("relative_offset_m", {0.1, 0.1, 0.1});
      Vector3 before[2];
      double fastest = 0;
      for (int t = 0; t < 8000; ++t) {
        ASSERT_EQ(law.rig.tick(0.001), LawResult::ok);
        const Pose X = pose.pose();
        const Vector3 p_r = law.shown("relative_position_error_m");  // the hands stand still: p_r = 0
        for (std::size_t i = 0; i < 2; ++i) {
          const Vector3 p = X.position + (i == 0 ? -0.5 : 0.5) * p_r + X.rotation * from_A[i];
          if (t > 0) fastest = std::max(fastest, (p - before[i]).norm() / 0.001);
          before[i] = p;
        }
      }
      EXPECT_LE(fastest, most * 1.001) << most << " " << turn.transpose();
      EXPECT_GE(fastest, 0.4 * most) << most << " " << turn.transpose();
    }
  }
}

}  // namespace
}  // namespace multipanda::coupled_dual_motion_test
