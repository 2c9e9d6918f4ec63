// The outputs of the motion laws against the motion and the torques that they describe: errors by textbook
// kinematics, wrenches by the dynamically consistent inverse of the torques and by the power that they take.
#include <Eigen/Geometry>
#include <gtest/gtest.h>

#include "core/controllets/builtins.hpp"
#include "core/testing/moving_law.hpp"

namespace multipanda::law_outputs_test {
namespace {

using namespace test;
using Vector12 = Eigen::Matrix<double, 12, 1>;

void expect_near(const Vector6& is, const Vector6& expected) {
  EXPECT_LT((is - expected).norm(), 1e-6 * (1 + expected.norm()));
  EXPECT_GT(expected.norm(), 1);
}

void expect_hand(MovingLaw& moving, std::size_t arm, const std::string& prefix, const Pose& X_WE_d) {
  const Pose X = moving.X_WE(arm);
  EXPECT_LT((moving.shown(prefix + "position_error_m") - (X_WE_d.position - X.position)).norm(), 1e-9);
  const Matrix3 turned = exp_rotation(moving.shown(prefix + "orientation_error_rad")) * X.rotation;
  EXPECT_LT((turned - X_WE_d.rotation).norm(), 1e-9);
  expect_near(moving.shown_wrench(prefix), moving.wrench(arm));
}

TEST(LawOutputs, CartesianImpedanceShowsErrorAndWrench) {
  for (std::uint32_t seed : {11u, 12u, 13u}) {
    for (const bool bounded : {false, true}) {
      MovingLaw moving(cartesian_impedance_controllet(), 1, seed);
      if (bounded) moving.rig.bound({.hand_speed = 0.25, .spring_force = 5, .spring_moment = 2});
      moving.place();
      ASSERT_EQ(moving.rig.start(), LawResult::ok);
      moving.run("pose");
      expect_hand(moving, 0, "", moving.rig.input("pose").pose());
    }
  }
}

TEST(LawOutputs, DualCartesianImpedanceShowsErrorAndWrenchOfBothHands) {
  MovingLaw moving(dual_cartesian_impedance_controllet(), 2, 21);
  moving.rig.set("goals", {1});
  moving.place();
  ASSERT_EQ(moving.rig.start(), LawResult::ok);
  moving.run("first_pose");
  moving.run("second_pose");
  expect_hand(moving, 0, "first_", moving.rig.input("first_pose").pose());
  expect_hand(moving, 1, "second_", moving.rig.input("second_pose").pose());
}

// Mean and difference of two estimates of the shared frame A; minus another pair: the way between them.
struct Shared {
  Shared(const Pose& X_1, const Pose& X_2)
      : p_a(0.5 * (X_1.position + X_2.position)),
        R_a(Eigen::Quaterniond(X_1.rotation).slerp(0.5, Eigen::Quaterniond(X_2.rotation))),
        p_r(X_2.position - X_1.position) {
    const Eigen::AngleAxisd turn(Matrix3(X_2.rotation * X_1.rotation.transpose()));
    phi = turn.angle() * turn.axis();
  }
  Vector12 operator-(const Shared& other) const {
    const Eigen::AngleAxisd turn(R_a * other.R_a.inverse());
    Vector12 way;
    way << p_a - other.p_a, turn.angle() * turn.axis(), p_r - other.p_r, phi - other.phi;
    return way;
  }
  Vector3 p_a;
  Eigen::Quaterniond R_a;
  Vector3 p_r, phi;
};

// In the coupled law the wrenches are generalized forces: a small motion of a hand changes mean and
// difference of the two estimates, and the forces take the same power by these rates as the hand's wrench by
// its own.
TEST(LawOutputs, CoupledDualCartesianImpedanceShowsErrorsAndGeneralizedForces) {
  for (std::uint32_t seed : {31u, 32u, 33u}) {
    MovingLaw moving(coupled_dual_cartesian_impedance_controllet(), 2, seed);
    moving.place();
    ASSERT_EQ(moving.rig.start(), LawResult::ok);
    Pose X_EA[2];
    const Vector3 p_WA = 0.5 * (moving.X_WE(0).position + moving.X_WE(1).position);
    for (std::size_t i = 0; i < 2; ++i) X_EA[i] = moving.X_WE(i).inverse() * Pose{Matrix3::Identity(), p_WA};
    moving.run("pose");
    Pose X_WA[2];
    for (std::size_t i = 0; i < 2; ++i) X_WA[i] = moving.X_WE(i) * X_EA[i];

    const Pose X_d = moving.rig.input("pose").pose();
    const Vector3 mean = 0.5 * (X_WA[0].position + X_WA[1].position);
    EXPECT_LT((moving.shown("absolute_position_error_m") - (X_d.position - mean)).norm(), 1e-9);
    EXPECT_LT((moving.shown("relative_position_error_m") - (X_WA[0].position - X_WA[1].position)).norm(),
              1e-9);
    const Matrix3 R_WA =
        exp_rotation(moving.shown("absolute_orientation_error_rad")).transpose() * X_d.rotation;
    EXPECT_LT((R_WA * X_WA[0].rotation.transpose() - X_WA[1].rotation * R_WA.transpose()).norm(), 1e-9);
    const Matrix3 back = exp_rotation(moving.shown("relative_orientation_error_rad"));
    EXPECT_LT((back * X_WA[1].rotation - X_WA[0].rotation).norm(), 1e-9);

    const Vector6 F_a = moving.shown_wrench("absolute_"), F_r = moving.shown_wrench("relative_");
    for (int k = 0; k < 12; ++k) {
      const auto moved = [&](double by) {
        Pose X[2] = {X_WA[0], X_WA[1]};
        const int hand = k / 6, axis = k % 6;
        const Vector3 step = by * Vector3::Unit(axis % 3);
        if (axis < 3) {
          X[hand].position += step;
        } else {
          const Vector3 p_WE = moving.X_WE(static_cast<std::size_t>(hand)).position;
          X[hand] = {exp_rotation(step) * X[hand].rotation,
                     p_WE + exp_rotation(step) * (X[hand].position - p_WE)};
        }
        return Shared(X[0], X[1]);
      };
      const double h = 1e-4;
      const Vector12 rate = (moved(h) - moved(-h)) / (2 * h);
      EXPECT_NEAR(F_a.dot(rate.head<6>()) + F_r.dot(rate.tail<6>()),
                  moving.wrench(static_cast<std::size_t>(k / 6))[k % 6],
                  1e-6 * (1 + F_a.norm() + F_r.norm()));
    }
  }
}

TEST(LawOutputs, JointImpedanceShowsTheLargestErrorAndTorque) {
  for (std::uint32_t seed : {41u, 42u, 43u, 44u, 45u, 46u}) {
    MovingLaw moving(joint_impedance_controllet(), 1, seed);
    moving.place();
    ASSERT_EQ(moving.rig.start(), LawResult::ok);
    moving.run("joints");
    double error = 0, torque = 0;
    for (int i = 0; i < 7; ++i) {
      error = std::max(error, std::abs(moving.rig.input("joints").joints()[i] - moving.q[0][i]));
      torque = std::max(torque, std::abs(moving.rig.tau(0)[i]));
    }
    EXPECT_EQ(moving.rig.output("largest_error_rad"), std::vector{error});
    EXPECT_EQ(moving.rig.output("largest_torque_nm"), std::vector{torque});
  }
}

}  // namespace
}  // namespace multipanda::law_outputs_test
