// Motion of the set-points of the law for two hands, as its outputs show them: whatever is asked for at once,
// they do not jump, keep within the bound on their speed, and the law knows their velocity and acceleration.
#include <gtest/gtest.h>

#include "core/controllets/builtins.hpp"
#include "core/testing/moving_law.hpp"

namespace multipanda::dual_motion_test {
namespace {

using namespace test;

struct DualLaw : MovingLaw {
  explicit DualLaw(std::uint32_t seed) : MovingLaw(dual_cartesian_impedance_controllet(), 2, seed) {
    for (std::size_t i = 0; i < 2; ++i) {
      q[i] = bent(7) + draw.joints(7, 0.1);
      dq[i] = JointVector::Zero(7);
      rig.place(i, q[i], dq[i]);
    }
  }

  Pose hand(std::size_t i) { return X_WE(i) * rig.state(i).frames.X_FE; }
  Pose set_point(std::size_t i) {
    const std::string prefix = i == 0 ? "first_" : "second_";
    const Pose X = hand(i);
    return {exp_rotation(shown(prefix + "orientation_error_rad")) * X.rotation,
            X.position + shown(prefix + "position_error_m")};
  }
};

TEST(DualMotion, TheCommonPoseBeginsMidway) {
  DualLaw law(81);
  ASSERT_EQ(law.rig.start(), LawResult::ok);
  const Pose X = law.rig.input("common_pose").pose(), X_1 = law.hand(0), X_2 = law.hand(1);
  EXPECT_LT((X.position - 0.5 * (X_1.position + X_2.position)).norm(), 1e-12);
  EXPECT_LT((X.rotation * X_1.rotation.transpose() - X_2.rotation * X.rotation.transpose()).norm(), 1e-12);
}

TEST(DualMotion, SetPointsNeitherJumpNorExceedTheBoundOnTheirSpeed) {
  constexpr double kMost = 0.2, kDt = 0.001;
  double fastest = 0;
  for (std::uint32_t seed = 82; seed < 90; ++seed) {
    DualLaw law(seed);
    law.rig.bound({.hand_speed = kMost, .spring_force = 1e6, .spring_moment = 1e6});  // nothing waits
    ASSERT_EQ(law.rig.start(), LawResult::ok);
    ASSERT_EQ(law.rig.tick(kDt), LawResult::ok);
    Pose before[2] = {law.hand(0), law.hand(1)};
    double goals = 0;
    for (int t = 0; t < 12000; ++t) {
      if (t % 500 == 250) {
        switch (law.draw.index(6)) {
          case 0:
            law.rig.set("goals", {goals = 1 - goals});
            break;
          case 1:
            law.rig.approach("offset_m", {law.draw.uniform(-0.1, 0.1), 0.1, -0.1});
            break;
          case 2:
            law.rig.input("common_pose").set(pose_target({law.draw.rotation(), law.draw.vector3(0.5)}, 0));
            break;
          case 3:
            law.rig.input("first_pose").set(pose_target({law.draw.rotation(), law.draw.vector3(0.5)}, 0));
            break;
          case 4:
            law.rig.input("second_pose").set(pose_target({law.draw.rotation(), law.draw.vector3(0.5)}, 0));
            break;
          default: {
            const auto arm = law.draw.index(2);
            const Pose X{exp_rotation(law.draw.vector3(0.2)), law.draw.vector3(0.05)};
            law.rig.redefine(arm, X);
            before[arm] = before[arm] * X;  // carried along
          }
        }
      }
      ASSERT_EQ(law.rig.tick(kDt), LawResult::ok);
      for (std::size_t i = 0; i < 2; ++i) {
        const Pose now = law.set_point(i);
        const double speed = (now.position - before[i].position).norm() / kDt;
        EXPECT_LE(speed, 1.01 * kMost) << "seed " << seed << ", hand " << i << ", " << t << " ms";
        EXPECT_LE(log_rotation(now.rotation * before[i].rotation.transpose()).norm() / kDt, 6);
        fastest = std::max(fastest, speed);
        before[i] = now;
      }
    }
  }
  EXPECT_GE(fastest, 0.8 * kMost);
}

// Hands that move as their set-points do feel the springs and what their inertia needs, nothing else.
TEST(DualMotion, TheLawKnowsHowItsSetPointsMove) {
  constexpr double kDt = 0.001;
  for (int phase = 0; phase < 3; ++phase) {
    const auto under_way = [&] {
      auto law = std::make_unique<DualLaw>(91 + static_cast<std::uint32_t>(phase));
      EXPECT_EQ(law->rig.start(), LawResult::ok);
      law->rig.approach("offset_m", {0.05, -0.06, 0.08});
      law->aim("common_pose", law->draw);
      law->aim("first_pose", law->draw);
      law->aim("second_pose", law->draw);
      for (int t = 0; t < 300; ++t) EXPECT_EQ(law->rig.tick(kDt), LawResult::ok);
      if (phase > 0) law->rig.set("goals", {1});
      for (int t = 0; t < 150; ++t) EXPECT_EQ(law->rig.tick(kDt), LawResult::ok);
      if (phase > 1) law->rig.set("goals", {0});
      for (int t = 0; t < 50; ++t) EXPECT_EQ(law->rig.tick(kDt), LawResult::ok);
      return law;
    };
    auto still = under_way(), moving = under_way();
    Pose X[3][2];
    for (auto& at : X) {
      for (std::size_t i = 0; i < 2; ++i) at[i] = still->set_point(i);
      ASSERT_EQ(still->rig.tick(kDt), LawResult::ok);
    }
    const auto rate = [&](int from, int to, std::size_t i) {
      Vector6 way;
      way << X[to][i].position - X[from][i].position,
          log_rotation(X[to][i].rotation * X[from][i].rotation.transpose());
      return Vector6(way / (kDt * (to - from)));
    };
    for (std::size_t i = 0; i < 2; ++i) {
      moving->dq[i] =
          moving->plain[i].jacobian(moving->q[i]).completeOrthogonalDecomposition().solve(rate(0, 2, i));
      moving->rig.place(i, moving->q[i], moving->dq[i]);
    }
    ASSERT_EQ(moving->rig.tick(kDt), LawResult::ok);
    for (std::size_t i = 0; i < 2; ++i) {
      const std::string prefix = i == 0 ? "first_" : "second_";
      const Vector6 A = (rate(1, 2, i) - rate(0, 1, i)) / kDt;
      const Eigen::MatrixXd J = moving->plain[i].jacobian(moving->q[i]),
                            M = moving->plain[i].mass(moving->q[i]);
      const Vector6 inertial = task_inertia(J, M) * A;
      const Vector3 spring = 400 * moving->shown(prefix + "position_error_m");
      const Vector3 is = moving->shown(prefix + "force_n");
      EXPECT_GT(inertial.head<3>().norm(), 0.02);
      EXPECT_LT((is - spring - inertial.head<3>()).norm(), 0.02 * inertial.norm() + 0.01)
          << "phase " << phase << ", hand " << i;
    }
  }
}

}  // namespace
}  // namespace multipanda::dual_motion_test
