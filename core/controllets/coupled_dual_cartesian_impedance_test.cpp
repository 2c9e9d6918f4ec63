#include <gtest/gtest.h>

#include "core/controllets/builtins.hpp"
#include "core/controllets/cooperative_frame.hpp"
#include "core/controllets/task_spring.hpp"
#include "core/testing/controllet_rig.hpp"
#include "core/testing/dense_algebra.hpp"
#include "core/testing/plain_arm.hpp"

namespace multipanda::coupled_dual_cartesian_impedance_test {
namespace {

using namespace test;
using Eigen::VectorXd;

struct Bench {
  explicit Bench(const Pose& X = {})
      : X_WB{X * Pose{rotation_from_rpy({0.1, 0, 0.4}), Vector3(0, 0.4, 0)},
             X * Pose{rotation_from_rpy({0, 0.2, -2.5}), Vector3(0.1, -0.4, 0)}},
        plain{PlainArm(TestArm::make(7), X_WB[0]), PlainArm(TestArm::make(6), X_WB[1])},
        rig(coupled_dual_cartesian_impedance_controllet(),
            {with_motors(7, X_WB[0]), with_motors(6, X_WB[1])}) {}
  // That bear all gains as they are.
  static std::shared_ptr<const ArmModel> with_motors(std::size_t joints, const Pose& X_WB) {
    ArmModelSource source = TestArm::make(joints).source(X_WB);
    source.motor_inertia = joint_constant(joints, 1);
    return std::make_shared<const ArmModel>(std::move(source));
  }
  void place(const JointVector& q_1, const JointVector& q_2) {
    rig.place(0, q_1, joint_constant(7, 0));
    rig.place(1, q_2, joint_constant(6, 0));
  }
  void move(Draw& draw, double q, double dq) {
    rig.place(0, bent(7) + draw.joints(7, q), draw.joints(7, dq));
    rig.place(1, bent(6) + draw.joints(6, q), draw.joints(6, dq));
  }
  // Until the offset, which is approached within speed limits, has arrived; the arms stand still.
  void settle() {
    for (int i = 0; i < 3000; ++i) ASSERT_EQ(rig.tick(0.001), LawResult::ok);
  }
  Pose X_WB[2];
  PlainArm plain[2];
  ControlletRig rig;
};

TEST(CoupledDualCartesianImpedance, BeginsAtTheSharedFrameWithoutTorque) {
  Bench bench;
  ASSERT_EQ(bench.rig.start(), LawResult::ok);
  const Vector3 midway =
      0.5 * (bench.plain[0].end_effector(bent(7)).position + bench.plain[1].end_effector(bent(6)).position);
  EXPECT_NEAR((bench.rig.input("pose").pose().position - midway).norm(), 0, 1e-12);
  EXPECT_NEAR((bench.rig.input("pose").pose().rotation - Matrix3::Identity()).norm(), 0, 1e-12);
  ASSERT_EQ(bench.rig.update(), LawResult::ok);
  EXPECT_NEAR(bench.rig.tau(0).norm() + bench.rig.tau(1).norm(), 0, 1e-9);
}

// Minus the gradient, over the joints of both arms, of the energy in the absolute and the relative spring,
// written here with axis and angle.
TEST(CoupledDualCartesianImpedance, SpringsAreTheGradientOfTheirEnergy) {
  Draw draw(71);
  for (int trial = 0; trial < 10; ++trial) {
    Bench bench;
    bench.rig.set("nullspace_stiffness_nm_per_rad", {0});
    bench.rig.set("translational_stiffness_n_per_m", {300, 500, 200});
    bench.rig.set("rotational_stiffness_nm_per_rad", {30, 10, 20});
    bench.rig.set("relative_translational_stiffness_n_per_m", {700, 100, 400});
    bench.rig.set("relative_rotational_stiffness_nm_per_rad", {15, 25, 5});
    bench.rig.set("relative_offset_m", {0.01, 0.05, -0.02});
    bench.rig.set("stiffness_axes", {1});
    ASSERT_EQ(bench.rig.start(), LawResult::ok);
    bench.settle();
    const Pose X_WA0 = bench.rig.input("pose").pose();
    const Pose X_EA[2] = {bench.plain[0].end_effector(bent(7)).inverse() * X_WA0,
                          bench.plain[1].end_effector(bent(6)).inverse() * X_WA0};
    const Pose X_d = X_WA0 * draw.pose(0.05);
    bench.rig.input("pose").start(X_d);
    const VectorXd q_1 = bent(7) + draw.joints(7, 0.2), q_2 = bent(6) + draw.joints(6, 0.2);
    bench.place(q_1, q_2);
    ASSERT_EQ(bench.rig.update(), LawResult::ok);

    const auto energy = [&](const VectorXd& a, const VectorXd& b) {
      const Pose A1 = bench.plain[0].end_effector(a) * X_EA[0], A2 = bench.plain[1].end_effector(b) * X_EA[1];
      const Eigen::AngleAxisd phi(A2.rotation * A1.rotation.transpose());
      const Matrix3 R_a = Eigen::AngleAxisd(0.5 * phi.angle(), phi.axis()) * A1.rotation;
      const Eigen::AngleAxisd turn(X_d.rotation * R_a.transpose());
      const Matrix3 axes = X_d.rotation.transpose();  // energies are taken in the set-point's axes
      const Vector3 p_a = axes * (X_d.position - 0.5 * (A1.position + A2.position));
      const Vector3 r_a = axes * FadedRotation(turn.angle() * turn.axis()).value;
      const Vector3 p_r = axes * (A2.position - A1.position) - Vector3(0.01, 0.05, -0.02);
      const Vector3 r_r = phi.angle() * (axes * phi.axis());
      return 0.5 * (Vector3(300, 500, 200).dot(p_a.cwiseAbs2()) + Vector3(30, 10, 20).dot(r_a.cwiseAbs2()) +
                    Vector3(700, 100, 400).dot(p_r.cwiseAbs2()) + Vector3(15, 25, 5).dot(r_r.cwiseAbs2()));
    };
    constexpr double h = 1e-6;
    for (Eigen::Index i = 0; i < 13; ++i) {
      VectorXd a = VectorXd::Zero(7), b = VectorXd::Zero(6);
      (i < 7 ? a[i] : b[i - 7]) = h;
      const double slope = (energy(q_1 + a, q_2 + b) - energy(q_1 - a, q_2 - b)) / (2 * h);
      EXPECT_NEAR(i < 7 ? bench.rig.tau(0)[i] : bench.rig.tau(1)[i - 7], -slope, 1e-4) << "joint " << i;
    }
  }
}

TEST(CoupledDualCartesianImpedance, DampingNeverSuppliesEnergy) {
  Draw draw(72);
  for (int trial = 0; trial < 50; ++trial) {
    Bench bench;
    bench.rig.set("relative_translational_stiffness_n_per_m", {0, 3000, 100});
    ASSERT_EQ(bench.rig.start(), LawResult::ok);
    bench.rig.place(0, bent(7), draw.joints(7, 1));
    bench.rig.place(1, bent(6), draw.joints(6, 1));
    ASSERT_EQ(bench.rig.update(), LawResult::ok);
    double power = 0;
    for (std::size_t arm = 0; arm < 2; ++arm) {
      power += bench.rig.state(arm).dq.dot(bench.rig.tau(arm) - bench.rig.terms(arm).c());
    }
    EXPECT_LT(power, 0);
  }
}

// With end-effector axes uneven stiffness may rotate along; A begins with the world's axes, so the set-point
// is transformed explicitly.
TEST(CoupledDualCartesianImpedance, IsInvariantToThePoseOfTheWorld) {
  const Pose X = Draw(73).pose(2);
  Bench here, there(X);
  for (auto* bench : {&here, &there}) {
    Draw draw(74);
    ASSERT_EQ(bench->rig.start(), LawResult::ok);
    // The offsets X_EiA differ by the turn of A's axes; equal stiffness is not affected.
    const Pose A = bench->rig.input("pose").pose();
    const Matrix3 turn = bench == &here ? Matrix3(Matrix3::Identity()) : X.rotation;
    bench->rig.input("pose").start(Pose{turn * exp_rotation({0.3, -0.2, 0.4}) * turn.transpose() * A.rotation,
                                        A.position + turn * Vector3(0.1, 0.02, 0.05)});
    bench->move(draw, 0.1, 0.5);
    ASSERT_EQ(bench->rig.update(), LawResult::ok);
  }
  EXPECT_GT(here.rig.tau(0).norm(), 1);
  EXPECT_NEAR((here.rig.tau(0) - there.rig.tau(0)).norm(), 0, 1e-8);
  EXPECT_NEAR((here.rig.tau(1) - there.rig.tau(1)).norm(), 0, 1e-8);
}

// The pose of A and the squeeze of the hands are independent: an offset squeezes with equal and
// opposite forces, K times the offset.
TEST(CoupledDualCartesianImpedance, OffsetSqueezesWithEqualAndOppositeForces) {
  Bench bench;
  bench.rig.set("nullspace_stiffness_nm_per_rad", {0});
  bench.rig.set("relative_translational_stiffness_n_per_m", {400, 800, 400});
  ASSERT_EQ(bench.rig.start(), LawResult::ok);
  bench.rig.set("relative_offset_m", {0, 0.025, 0});
  bench.settle();
  ASSERT_EQ(bench.rig.update(), LawResult::ok);
  // The wrench behind each torque, by least squares over the independent Jacobian.
  Vector3 force[2];
  for (int arm = 0; arm < 2; ++arm) {
    const Eigen::MatrixXd J = bench.plain[arm].jacobian(bent(arm == 0 ? 7 : 6));
    const VectorXd tau = bench.rig.tau(static_cast<std::size_t>(arm));
    force[arm] = least_squares(J.transpose(), tau).head(3);
  }
  EXPECT_NEAR((force[1] - Vector3(0, 20, 0)).norm(), 0, 1e-7);
  EXPECT_NEAR((force[0] + force[1]).norm(), 0, 1e-7);
}

TEST(CoupledDualCartesianImpedance, MovesTheSharedFrameAndKeepsTheHandsTogether) {
  // Two arms that stay away from singular poses: where the inertia is floored, settling takes longer.
  const Bench bases;
  ControlletRig rig(coupled_dual_cartesian_impedance_controllet(),
                    {TestArm::make(7).model(bases.X_WB[0]), TestArm::make(7).model(bases.X_WB[1])});
  ASSERT_EQ(rig.start(), LawResult::ok);
  Pose X_d = rig.input("pose").pose();
  X_d.position += Vector3(0.03, 0.02, 0.05);
  X_d.rotation = exp_rotation({0, 0, 0.1}) * X_d.rotation;
  rig.input("pose").set(pose_target(X_d, 1));
  for (int i = 0; i < 4000; ++i) {
    ASSERT_EQ(rig.tick(0.001), LawResult::ok);
    for (const double e : rig.output("relative_position_error_m")) EXPECT_LT(std::abs(e), 5e-3);
    rig.integrate(0.001, {joint_constant(7, 0), joint_constant(7, 0)}, 2);
  }
  for (const double e : rig.output("absolute_position_error_m")) EXPECT_NEAR(e, 0, 2e-4);
  for (const double e : rig.output("absolute_orientation_error_rad")) EXPECT_NEAR(e, 0, 2e-3);
}

TEST(CoupledDualCartesianImpedance, FaultsOnContradictingEstimatesAndNaN) {
  Bench bench;
  ASSERT_EQ(bench.rig.start(), LawResult::ok);
  JointVector q = bent(6);
  q[5] += 2.5;  // the second hand is turned away: the shared frame is lost
  bench.place(bent(7), q);
  EXPECT_EQ(bench.rig.update(), LawResult::fault);
  q[5] = std::nan("");
  bench.place(bent(7), q);
  EXPECT_EQ(bench.rig.update(), LawResult::fault);
}

}  // namespace
}  // namespace multipanda::coupled_dual_cartesian_impedance_test
