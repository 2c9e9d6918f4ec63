#include "core/controllets/task_spring.hpp"

#include <numbers>

#include <gtest/gtest.h>

#include "core/testing/test_arm.hpp"

namespace multipanda::task_spring_test {
namespace {

using test::Draw;

Vector3 unit(Draw& draw) { return draw.rotation().col(0); }

TaskStiffness uneven(Draw& draw) {
  return TaskStiffness::along(draw.rotation(), Vector3(100, 900, 400), Vector3(5, 40, 15));
}

// Minus the rate of the stored energy when the end effector moves with V, by differences of poses.
double power(const TaskStiffness& K, const Pose& X_d, const Pose& X, const Vector6& V) {
  constexpr double h = 1e-6;
  const auto energy = [&](double t) {
    const Pose moved{exp_rotation(t * V.tail<3>()) * X.rotation, X.position + t * V.head<3>()};
    return spring_energy(K, pose_error(X_d, moved));
  };
  return -(energy(h) - energy(-h)) / (2 * h);
}

TEST(TaskSpring, IsMinusTheGradientOfItsEnergy) {
  Draw draw(21);
  for (int trial = 0; trial < 300; ++trial) {
    const TaskStiffness K = uneven(draw);
    const Pose X_d = draw.pose(0.5);
    // Angles from nothing to nearly half a turn, a third of them where the fading acts.
    const double angle = trial % 3 == 0 ? draw.uniform(FadedRotation::kFadeFrom, 3.14) : draw.uniform(0, 2.6);
    const Pose X{exp_rotation(-angle * unit(draw)) * X_d.rotation, X_d.position + draw.vector3(0.1)};
    const Vector6 F = spring_wrench(K, pose_error(X_d, X));
    for (int i = 0; i < 6; ++i) {
      EXPECT_NEAR(F[i], power(K, X_d, X, Vector6::Unit(i)), 1e-5) << "angle " << angle;
    }
  }
}

TEST(TaskSpring, EqualStiffnessGivesTheUsualLaw) {
  Draw draw(22);
  for (int trial = 0; trial < 100; ++trial) {
    const Vector3 axis = unit(draw);
    const Eigen::AngleAxisd turn(draw.uniform(0, 2.6), axis);
    const Pose X_d = draw.pose(1);
    const Pose X{turn.toRotationMatrix().transpose() * X_d.rotation, X_d.position};
    const Vector6 F =
        spring_wrench({400 * Matrix3::Identity(), 20 * Matrix3::Identity()}, pose_error(X_d, X));
    EXPECT_NEAR((F.tail<3>() - 20 * turn.angle() * turn.axis()).norm(), 0, 1e-9);
  }
}

// Through half a turn, straight and past it: neither jumps nor grows.
TEST(TaskSpring, TorqueIsContinuousThroughHalfATurn) {
  Draw draw(23);
  for (int trial = 0; trial < 50; ++trial) {
    const TaskStiffness K = uneven(draw);
    const Vector3 n = unit(draw);
    const Vector3 aside = n.cross(unit(draw));
    Vector6 before = Vector6::Zero();
    constexpr double kStep = 1e-4;
    for (double angle = std::numbers::pi - 0.02; angle < std::numbers::pi + 0.02; angle += kStep) {
      const Matrix3 R = exp_rotation(1e-3 * aside) * Eigen::AngleAxisd(angle, n).toRotationMatrix();
      Vector6 error = Vector6::Zero();
      error.tail<3>() = log_rotation(R);
      const Vector6 F = spring_wrench(K, error);
      EXPECT_LT(F.norm(), 40 * std::numbers::pi * std::numbers::pi);
      if (angle > std::numbers::pi - 0.02) {
        EXPECT_LT((F - before).norm(), 1000 * kStep) << "at " << angle;
      }
      before = F;
    }
  }
}

TEST(TaskSpring, InverseLeftJacobianInvertsIt) {
  Draw draw(24);
  for (const double angle : {0.0, 1e-9, 1e-5, 0.009, 0.011, 1.0, 3.1, 3.1415}) {
    const Vector3 r = angle * unit(draw);
    EXPECT_NEAR((inverse_left_jacobian(r) * left_jacobian(r) - Matrix3::Identity()).norm(), 0, 1e-9) << angle;
  }
}

}  // namespace
}  // namespace multipanda::task_spring_test
