#include <gtest/gtest.h>

#include "core/controllets/builtins.hpp"
#include "core/controllets/cartesian_law.hpp"
#include "core/testing/controllet_rig.hpp"
#include "core/testing/dense_algebra.hpp"
#include "core/testing/plain_arm.hpp"

namespace multipanda::cartesian_impedance_test {
namespace {

using namespace test;
using Eigen::MatrixXd;
using Eigen::VectorXd;

const Pose kTool{rotation_from_rpy({0.3, -0.2, 0.5}), Vector3(0.02, -0.01, 0.1)};

struct Bench {
  explicit Bench(std::size_t joints, const Pose& X_WB = {})
      : arm(TestArm::make(joints)),
        plain(arm, X_WB, kTool),
        rig(cartesian_impedance_controllet(), {arm.model(X_WB)}) {
    rig.frames(0, {kTool, {}});
    rig.place(0, bent(joints), joint_constant(joints, 0));
  }
  void stiffness(const Vector3& translation, const Vector3& rotation) {
    rig.set("translational_stiffness_n_per_m", {translation.x(), translation.y(), translation.z()});
    rig.set("rotational_stiffness_nm_per_rad", {rotation.x(), rotation.y(), rotation.z()});
  }
  TestArm arm;
  PlainArm plain;
  ControlletRig rig;
};

// The stated law with explicit inverses, the square root of Lambda^-1 K by unsymmetric eigenvectors and the
// gradient of the spring's energy by differences.
struct PlainLaw {
  VectorXd K = VectorXd::Zero(6);  // along world axes
  double zeta = 1, K_N = 0;
  bool paper_projector = false, feedforward = true;

  static VectorXd spring(const VectorXd& k, const Pose& X_d, const Pose& X) {
    const auto energy = [&](const Vector3& p, const Matrix3& R) {
      const Eigen::AngleAxisd turn(X_d.rotation * R.transpose());
      const Vector3 e = X_d.position - p, r = turn.angle() * turn.axis();
      return 0.5 * (k.head(3).dot(e.cwiseAbs2()) + k.tail(3).dot(r.cwiseAbs2()));
    };
    constexpr double h = 1e-5;
    VectorXd F(6);
    for (int i = 0; i < 3; ++i) {
      const Vector3 u = Vector3::Unit(i);
      const Matrix3 plus = Eigen::AngleAxisd(h, u).toRotationMatrix() * X.rotation;
      const Matrix3 minus = Eigen::AngleAxisd(-h, u).toRotationMatrix() * X.rotation;
      F[i] = -(energy(X.position + h * u, X.rotation) - energy(X.position - h * u, X.rotation)) / (2 * h);
      F[3 + i] = -(energy(X.position, plus) - energy(X.position, minus)) / (2 * h);
    }
    return F;
  }

  VectorXd torque(const PlainArm& arm, const VectorXd& q, const VectorXd& dq, const VectorXd& q_N,
                  const Reference& target) const {
    const MatrixXd J = arm.jacobian(q), M = arm.mass(q);
    const MatrixXd Lambda = task_inertia(J, M);
    const MatrixXd D = modal_damping(Lambda, K.asDiagonal(), zeta);
    VectorXd F = spring(K, target.pose(), arm.end_effector(q)) + D * (target.twist().vector - J * dq);
    if (feedforward) F += Lambda * target.acceleration().vector;

    const MatrixXd I = MatrixXd::Identity(q.size(), q.size());
    const MatrixXd N = null_space_projector(J, paper_projector ? I : M);
    const VectorXd D_N = 2 * zeta * (K_N * M.diagonal().array()).sqrt();
    const VectorXd null = N * (K_N * (q_N - q) - D_N.asDiagonal() * N.transpose() * dq);
    return J.transpose() * F + null + arm.coriolis(q, dq);
  }
};

TEST(CartesianImpedance, TorqueIsTheStatedLaw) {
  Draw draw(51);
  int checked = 0;
  for (int trial = 0; trial < 24; ++trial) {
    const std::size_t n = trial % 2 == 0 ? 7 : 6;
    Bench bench(n, draw.pose(1));
    PlainLaw law;
    law.K << 300, 500, 200, 30, 12, 20;
    law.zeta = 0.7;
    law.K_N = 8;
    law.paper_projector = trial % 4 < 2;
    law.feedforward = trial % 3 != 0;
    bench.stiffness({300, 500, 200}, {30, 12, 20});
    bench.rig.set("damping_ratio", {law.zeta});
    bench.rig.set("nullspace_stiffness_nm_per_rad", {law.K_N});
    bench.rig.set("projector", {law.paper_projector ? 1.0 : 0.0});
    bench.rig.set("acceleration_feedforward", {law.feedforward ? 1.0 : 0.0});
    ASSERT_EQ(bench.rig.start(), LawResult::ok);

    Reference& pose = bench.rig.input("pose");
    const Pose start = pose.pose();
    pose.set(pose_target(
        {exp_rotation(draw.vector3(0.3)) * start.rotation, start.position + draw.vector3(0.2)}, 1.0));
    for (int i = 0; i < 300; ++i) ASSERT_EQ(bench.rig.tick(0.001), LawResult::ok);
    ASSERT_GT(pose.acceleration().vector.norm(), 1e-3);

    const JointVector q = bent(n) + draw.joints(n, 0.3), dq = draw.joints(n, 0.7);
    bench.rig.place(0, q, dq);
    ASSERT_EQ(bench.rig.update(), LawResult::ok);
    if (bench.rig.terms(0).task().floored) continue;  // another law there, see the singular test
    ++checked;
    const VectorXd expected = law.torque(bench.plain, q, dq, bent(n), pose);
    EXPECT_NEAR((bench.rig.tau(0) - expected).norm(), 0, 1e-5 * (1 + expected.norm())) << "trial " << trial;
  }
  EXPECT_GE(checked, 16);
}

TEST(CartesianImpedance, IsZeroAtRestOnTheSetPoint) {
  Bench bench(7);
  ASSERT_EQ(bench.rig.start(), LawResult::ok);
  ASSERT_EQ(bench.rig.update(), LawResult::ok);
  EXPECT_NEAR(bench.rig.tau(0).norm(), 0, 1e-9);
}

// The world is moved by one rigid motion: the same torque. With end-effector axes the stiffness may be
// uneven; with world axes it may not, because these do not move.
TEST(CartesianImpedance, IsInvariantToThePoseOfTheWorld) {
  Draw draw(52);
  for (const bool end_effector_axes : {true, false}) {
    const Pose X = draw.pose(2), X_WB = draw.pose(1);
    Bench here(7, X_WB), there(7, X * X_WB);
    const JointVector q = bent(7) + draw.joints(7, 0.2), dq = draw.joints(7, 0.5);
    const Pose X_d = here.plain.end_effector(bent(7)) * draw.pose(0.05);
    for (auto* bench : {&here, &there}) {
      bench->rig.set("stiffness_axes", {end_effector_axes ? 1.0 : 0.0});
      if (end_effector_axes) bench->stiffness({100, 900, 400}, {5, 40, 15});
      ASSERT_EQ(bench->rig.start(), LawResult::ok);
      bench->rig.input("pose").start(bench == &here ? X_d : X * X_d);
      bench->rig.place(0, q, dq);
      ASSERT_EQ(bench->rig.update(), LawResult::ok);
    }
    EXPECT_GT(here.rig.tau(0).norm(), 1);
    EXPECT_NEAR((here.rig.tau(0) - there.rig.tau(0)).norm(), 0, 1e-8);
  }
}

TEST(CartesianImpedance, SpringIsTheGradientOfItsEnergyOverTheJoints) {
  Draw draw(53);
  for (const bool end_effector_axes : {true, false}) {
    Bench bench(7, draw.pose(1));
    const Vector3 K_t(100, 900, 400), K_r(5, 40, 15);
    bench.stiffness(K_t, K_r);
    bench.rig.set("stiffness_axes", {end_effector_axes ? 1.0 : 0.0});
    bench.rig.set("nullspace_stiffness_nm_per_rad", {0});
    ASSERT_EQ(bench.rig.start(), LawResult::ok);
    const Pose X_d = bench.plain.end_effector(bent(7)) * draw.pose(0.1);  // any angle
    bench.rig.input("pose").start(X_d);
    const JointVector q = bent(7) + draw.joints(7, 0.3);
    bench.rig.place(0, q, joint_constant(7, 0));
    ASSERT_EQ(bench.rig.update(), LawResult::ok);
    const TaskStiffness K =
        TaskStiffness::along(end_effector_axes ? X_d.rotation : Matrix3(Matrix3::Identity()), K_t, K_r);
    constexpr double h = 1e-6;
    for (Eigen::Index i = 0; i < 7; ++i) {
      VectorXd plus = q, minus = q;
      plus[i] += h;
      minus[i] -= h;
      const double slope = (spring_energy(K, pose_error(X_d, bench.plain.end_effector(plus))) -
                            spring_energy(K, pose_error(X_d, bench.plain.end_effector(minus)))) /
                           (2 * h);
      EXPECT_NEAR(bench.rig.tau(0)[i], -slope, 1e-4);
    }
  }
}

// On the set-point and the posture, moving: apart from C dq only damping remains, and it dissipates energy.
// Also in singular poses (five joints cannot move in six directions).
TEST(CartesianImpedance, DampingNeverSuppliesEnergy) {
  Draw draw(54);
  for (const std::size_t n : {std::size_t{5}, std::size_t{7}}) {
    for (int trial = 0; trial < 100; ++trial) {
      Bench bench(n);
      bench.rig.set("projector", {trial % 2 == 0 ? 0.0 : 1.0});
      bench.rig.set("nullspace_stiffness_nm_per_rad", {draw.uniform(0, 200)});
      bench.rig.set("translational_stiffness_n_per_m", {trial % 3 == 0 ? 0.0 : draw.uniform(0, 2000)});
      const JointVector q = draw.joints(n, 2), dq = draw.joints(n, 2);
      bench.rig.place(0, q, joint_constant(n, 0));
      ASSERT_EQ(bench.rig.start(), LawResult::ok);
      bench.rig.place(0, q, dq);
      ASSERT_EQ(bench.rig.update(), LawResult::ok);
      EXPECT_LE(dq.dot(bench.rig.tau(0) - bench.rig.terms(0).c()), 1e-9);
    }
  }
}

TEST(CartesianImpedance, PostureDoesNotAccelerateTheEndEffector) {
  Draw draw(55);
  int checked = 0;
  for (int trial = 0; trial < 40; ++trial) {
    Bench bench(7);
    ASSERT_EQ(bench.rig.start(), LawResult::ok);
    const JointVector q = bent(7) + draw.joints(7, 0.4);
    bench.rig.place(0, q, joint_constant(7, 0));
    bench.rig.input("pose").start(bench.plain.end_effector(q));
    ASSERT_EQ(bench.rig.update(), LawResult::ok);
    if (bench.rig.terms(0).task().floored) continue;
    ++checked;
    EXPECT_GT(bench.rig.tau(0).norm(), 1e-3);
    const VectorXd ddq = inverse(bench.plain.mass(q)) * bench.rig.tau(0);
    const VectorXd acceleration = bench.plain.jacobian(q) * ddq;
    EXPECT_NEAR(acceleration.norm(), 0, 1e-8);
  }
  EXPECT_GE(checked, 20);
}

TEST(CartesianImpedance, BoundedAndContinuousInSingularPoses) {
  Draw draw(56);
  for (const std::size_t n : {std::size_t{1}, std::size_t{5}, std::size_t{7}}) {
    for (int trial = 0; trial < 50; ++trial) {
      Bench bench(n);
      bench.rig.set("projector", {trial % 2 == 0 ? 0.0 : 1.0});
      ASSERT_EQ(bench.rig.start(), LawResult::ok);
      // Seven joints: stretched as far as the twisted axes allow, all joints but the first near zero.
      const JointVector q = n == 7 ? draw.joints(n, 0.02) : draw.joints(n, 2);
      const JointVector dq = draw.joints(n, 0.5);
      bench.rig.place(0, q, dq);
      bench.rig.input("pose").start(bench.plain.end_effector(q) *
                                    Pose{exp_rotation({1, 0, 2}), Vector3(0.05, 0, 0)});
      ASSERT_EQ(bench.rig.update(), LawResult::ok);
      const JointVector tau = bench.rig.tau(0);
      EXPECT_LT(tau.norm(), 1000);
      bench.rig.place(0, q + draw.joints(n, 1e-7), dq);
      ASSERT_EQ(bench.rig.update(), LawResult::ok);
      EXPECT_LT((bench.rig.tau(0) - tau).norm(), 1e-2);
    }
  }
}

// The same rotation reached as q and as -q is one rotation: the set-point has no memory of the sign.
TEST(CartesianImpedance, SignOfTheQuaternionDoesNotMatter) {
  Bench bench(7);
  ASSERT_EQ(bench.rig.start(), LawResult::ok);
  Reference& pose = bench.rig.input("pose");
  Target target =
      pose_target({exp_rotation({0.2, 0.1, -0.3}) * pose.pose().rotation, pose.pose().position}, 0.2);
  std::vector<JointVector> tau;
  for (const double sign : {1.0, -1.0}) {
    bench.rig.start();
    for (std::size_t i = 3; i < 7; ++i) target.values[i] *= sign;
    pose.set(target);
    for (int i = 0; i < 500; ++i) bench.rig.tick(0.001);
    tau.push_back(bench.rig.tau(0));
  }
  EXPECT_GT(tau[0].norm(), 0.1);
  EXPECT_NEAR((tau[0] - tau[1]).norm(), 0, 1e-9);
}

TEST(CartesianImpedance, NotANumberIsAFault) {
  for (const double bad : {std::nan(""), std::numeric_limits<double>::infinity()}) {
    for (int where = 0; where < 3; ++where) {
      Bench bench(7);
      ASSERT_EQ(bench.rig.start(), LawResult::ok);
      JointVector q = bent(7), dq = joint_constant(7, 0);
      if (where == 0) q[2] = bad;
      if (where == 1) dq[2] = bad;
      if (where == 2) bench.rig.input("pose").start(Pose{Matrix3::Identity(), Vector3(bad, 0, 0)});
      bench.rig.place(0, q, dq);
      EXPECT_EQ(bench.rig.update(), LawResult::fault) << where;
    }
  }
}

TEST(CartesianImpedance, DeflectsUnderAPushByForceOverStiffness) {
  for (const bool paper : {false, true}) {
    Bench bench(7);
    bench.rig.set("nullspace_stiffness_nm_per_rad", {paper ? 0.0 : 10.0});
    bench.rig.set("projector", {paper ? 1.0 : 0.0});
    ASSERT_EQ(bench.rig.start(), LawResult::ok);
    const Pose X_d = bench.rig.terms(0).X_WE();
    Vector6 push;
    push << 6, -4, 8, 0.2, 0.1, -0.3;
    for (int i = 0; i < 3000; ++i) {
      ASSERT_EQ(bench.rig.tick(0.001), LawResult::ok);
      bench.rig.integrate(0.001, {bench.rig.terms(0).J_V_WE().transpose() * push}, 2);
    }
    const Vector6 moved = -pose_error(X_d, bench.rig.terms(0).X_WE());
    EXPECT_NEAR((moved.head<3>() - push.head<3>() / 400).norm(), 0, 3e-4);
    EXPECT_NEAR((moved.tail<3>() - push.tail<3>() / 20).norm(), 0, 3e-4);
  }
}

TEST(CartesianImpedance, EnergyDoesNotGrowWhileTheTargetIsAtRest) {
  Draw draw(57);
  Bench bench(7);
  bench.rig.set("damping_ratio", {0.2});
  bench.rig.set("nullspace_stiffness_nm_per_rad", {0});
  ASSERT_EQ(bench.rig.start(), LawResult::ok);
  const Pose X_d = bench.rig.terms(0).X_WE();
  bench.rig.place(0, bent(7) + draw.joints(7, 0.1), draw.joints(7, 0.1));
  const TaskStiffness K{400 * Matrix3::Identity(), 20 * Matrix3::Identity()};
  const auto energy = [&] {
    return bench.rig.kinetic_energy(0) + spring_energy(K, pose_error(X_d, bench.rig.terms(0).X_WE()));
  };
  const double start = energy();
  double before = start;
  for (int i = 0; i < 1000; ++i) {
    ASSERT_EQ(bench.rig.tick(0.001), LawResult::ok);
    bench.rig.integrate(0.001, {joint_constant(7, 0)});
    ASSERT_LT(energy(), before + 2e-3 * start) << "tick " << i;  // the torque is held for a millisecond
    before = energy();
  }
  EXPECT_LT(before, 0.5 * start);
}

TEST(CartesianImpedance, PostureIsApproachedWithoutAStep) {
  Bench bench(7);
  ASSERT_EQ(bench.rig.start(), LawResult::ok);
  ASSERT_EQ(bench.rig.tick(0.001), LawResult::ok);
  std::vector<double> posture(7, 0.0);
  bench.rig.set("nullspace_posture_rad", posture);
  bench.rig.set("nullspace_posture", {2});
  JointVector before = bench.rig.tau(0);
  for (int i = 0; i < 5000; ++i) {
    ASSERT_EQ(bench.rig.tick(0.001), LawResult::ok);
    EXPECT_LT((bench.rig.tau(0) - before).norm(), 0.05);
    before = bench.rig.tau(0);
  }
  // The posture has arrived: the torque is that of a posture at zero.
  const TaskSpace& task = bench.rig.terms(0).task();
  const JointVector expected = task.null_space_torque(bench.rig.terms(0).J_V_WE(), -10.0 * bent(7));
  EXPECT_NEAR((before - expected).norm(), 0, 1e-9);
}

// A hand whose rotations have no stiffness: a goal that turns it moves nothing, and what turns is braked.
TEST(CartesianImpedance, AxesWithoutStiffnessAreBrakedAndNotLed) {
  Draw draw(58);
  for (const bool given : {false, true}) {
    Bench bench(7, draw.pose(1));
    bench.stiffness(Vector3(300, 400, 500), Vector3::Zero());
    bench.rig.set("nullspace_stiffness_nm_per_rad", {0});
    bench.rig.set("damping_design", {given ? 1.0 : 0.0});
    bench.rig.set("rotational_damping_nm_s_per_rad", {0});
    ASSERT_EQ(bench.rig.start(), LawResult::ok);
    Reference& pose = bench.rig.input("pose");
    Pose goal = pose.pose();
    goal.rotation = exp_rotation({0.4, -0.3, 0.5}) * goal.rotation;
    pose.set(pose_target(goal, 1));
    for (int k = 0; k < 300; ++k) {
      ASSERT_EQ(bench.rig.tick(0.001), LawResult::ok);
      EXPECT_LT((bench.rig.tau(0) - bench.rig.terms(0).c()).norm(), 1e-9)
          << "an arm at rest where it shall be";
    }
    EXPECT_GT(pose.acceleration().angular().norm(), 0.1);
    // A motion that turns the hand about where it is: only the brake acts, -2 1/s J^T Lambda V.
    const JointVector q = bent(7);
    const MatrixXd J = bench.plain.jacobian(q), Lambda = task_inertia(J, bench.plain.mass(q));
    VectorXd V = VectorXd::Zero(6);
    V.tail<3>() = Vector3(0.5, 0.2, -0.4);
    const VectorXd dq = J.transpose() * inverse(MatrixXd(J * J.transpose())) * V;
    bench.rig.place(0, q, dq);
    ASSERT_EQ(bench.rig.update(), LawResult::ok);
    MatrixXd braked = MatrixXd::Zero(6, 6);
    braked.bottomRightCorner(3, 3) = 2 * Lambda.bottomRightCorner(3, 3);
    const double power = VectorXd(bench.rig.tau(0) - bench.rig.terms(0).c()).dot(dq);
    EXPECT_LT(power, -0.99 * V.dot(braked * V));
  }
}

}  // namespace
}  // namespace multipanda::cartesian_impedance_test
