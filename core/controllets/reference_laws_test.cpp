// The laws of the reference code and of the paper: damping of the velocity alone, given damping, C_c V_d, the
// damped pseudo-inverse and null-space damping as printed. Against closed forms and dense algebra.
#include <gtest/gtest.h>

#include "core/controllets/builtins.hpp"
#include "core/controllets/cartesian_law.hpp"
#include "core/testing/controllet_rig.hpp"
#include "core/testing/dense_algebra.hpp"
#include "core/testing/plain_arm.hpp"

namespace multipanda::reference_laws_test {
namespace {

using namespace test;
using Eigen::MatrixXd;
using Eigen::VectorXd;

struct Bench {
  Bench(const ControlletType& type, const Pose& X_WB, std::size_t joints = 7)
      : arm(TestArm::make(joints)), plain(arm, X_WB), rig(type, {arm.model(X_WB)}) {
    rig.place(0, bent(joints), joint_constant(joints, 0));
  }
  TestArm arm;
  PlainArm plain;
  ControlletRig rig;
};

// On a plant that follows exactly (q = what the law asks for at constant speed) the torque of joint i
// vanishes, apart from C dq, at the error e = D dq_d / K: the closed form of the lag.
TEST(ReferenceJointLaw, LagsByDampingTimesVelocityOverStiffness) {
  Draw draw(61);
  for (int trial = 0; trial < 20; ++trial) {
    Bench bench(joint_impedance_controllet(), draw.pose(1));
    const std::vector<double> K{24, 24, 24, 24, 10, 6, 2}, D{2, 1, 2, 0.5, 1, 0.2, 0.1};
    bench.rig.set("stiffness_nm_per_rad", K);
    bench.rig.set("damping_design", {2});
    bench.rig.set("damping_nms_per_rad", D);
    bench.rig.set("damping_of", {1});
    bench.rig.set("acceleration_feedforward", {0});
    ASSERT_EQ(bench.rig.start(), LawResult::ok);
    const JointVector dq = draw.joints(7, 0.5);
    JointVector q = bent(7);
    for (Eigen::Index i = 0; i < 7; ++i) {
      const auto k = static_cast<std::size_t>(i);
      q[i] -= D[k] * dq[i] / K[k];
    }
    bench.rig.place(0, q, dq);
    ASSERT_EQ(bench.rig.update(), LawResult::ok);
    EXPECT_NEAR((bench.rig.tau(0) - bench.plain.coriolis(q, dq)).norm(), 0, 1e-5);
    // On the error, the same arm under the same set-point at rest is damped alike.
    const JointVector tau = bench.rig.tau(0);
    bench.rig.set("damping_of", {0});
    ASSERT_EQ(bench.rig.update(), LawResult::ok);
    EXPECT_NEAR((bench.rig.tau(0) - tau).norm(), 0, 1e-9);
  }
}

TEST(ReferenceJointLaw, DampsTheLowPassedVelocity) {
  Draw draw(62);
  Bench bench(joint_impedance_controllet(), draw.pose(1));
  bench.rig.set("damping_design", {2});
  bench.rig.set("damping_of", {1});
  bench.rig.set("velocity_weight", {0.75});
  bench.rig.set("stiffness_nm_per_rad", {50, 50, 50, 20, 20, 10, 5});  // that these dampings bear
  const std::vector<double> D{2, 1, 2, 0.5, 1, 0.2, 0.1};
  bench.rig.set("damping_nms_per_rad", D);
  ASSERT_EQ(bench.rig.start(), LawResult::ok);
  VectorXd seen = VectorXd::Zero(7);
  for (int tick = 0; tick < 6; ++tick) {
    const JointVector q = bent(7), dq = draw.joints(7, 0.5);
    bench.rig.place(0, q, dq);
    ASSERT_EQ(bench.rig.tick(0.001), LawResult::ok);
    seen = 0.75 * VectorXd(dq) + 0.25 * seen;
    const VectorXd damping = Eigen::Map<const VectorXd>(D.data(), 7).cwiseProduct(seen);
    EXPECT_NEAR((VectorXd(bench.rig.tau(0)) - VectorXd(bench.plain.coriolis(q, dq)) + damping).norm(), 0,
                1e-5);
  }
}

// Every value of the new choices against a second calculation, in motion.
TEST(ReferenceCartesianLaw, TorqueIsTheStatedLaw) {
  Draw draw(63);
  int checked = 0;
  for (int trial = 0; trial < 48; ++trial) {
    const bool of_velocity = trial % 2 != 0, given = trial % 4 >= 2, of_joints = trial % 8 >= 4;
    const int projector = trial % 3;
    Bench bench(cartesian_impedance_controllet(), draw.pose(1));
    const Vector3 K_t(300, 500, 200), K_r(30, 12, 20);
    Vector6 D_given;
    D_given << 30, 50, 20, 0.4, 0.3, 0.2;
    bench.rig.set("translational_stiffness_n_per_m", {K_t.x(), K_t.y(), K_t.z()});
    bench.rig.set("rotational_stiffness_nm_per_rad", {K_r.x(), K_r.y(), K_r.z()});
    bench.rig.set("damping_of", {of_velocity ? 1.0 : 0.0});
    bench.rig.set("damping_design", {given ? 1.0 : 0.0});
    bench.rig.set("translational_damping_n_s_per_m", {D_given[0], D_given[1], D_given[2]});
    bench.rig.set("rotational_damping_nm_s_per_rad", {D_given[3], D_given[4], D_given[5]});
    bench.rig.set("nullspace_damping_nm_s_per_rad", {0.2});
    bench.rig.set("nullspace_damping_of", {of_joints ? 1.0 : 0.0});
    bench.rig.set("projector", {static_cast<double>(projector)});
    ASSERT_EQ(bench.rig.start(), LawResult::ok);
    Reference& pose = bench.rig.input("pose");
    const Pose start = pose.pose();
    pose.set(pose_target(
        {exp_rotation(draw.vector3(0.3)) * start.rotation, start.position + draw.vector3(0.2)}, 1));
    for (int i = 0; i < 300; ++i) ASSERT_EQ(bench.rig.tick(0.001), LawResult::ok);
    const JointVector q = bent(7) + draw.joints(7, 0.2), dq = draw.joints(7, 0.5);
    bench.rig.place(0, q, dq);
    ASSERT_EQ(bench.rig.update(), LawResult::ok);
    if (bench.rig.terms(0).task().floored) continue;

    const MatrixXd J = bench.plain.jacobian(q), M = bench.plain.mass(q), Lambda = task_inertia(J, M);
    VectorXd K(6);
    K << K_t, K_r;
    MatrixXd D = given ? MatrixXd(D_given.asDiagonal()) : modal_damping(Lambda, K.asDiagonal(), 1);
    MatrixXd D_N = given ? MatrixXd(0.2 * MatrixXd::Identity(7, 7))
                         : MatrixXd((2 * (10 * M.diagonal().array()).sqrt()).matrix().asDiagonal());
    if (given &&
        (symmetric_eigenvalues(symmetric_square_root(inverse(Lambda)) * D *
                               symmetric_square_root(inverse(Lambda)))
                 .maxCoeff() > 300 ||
         symmetric_eigenvalues(symmetric_square_root(inverse(M)) * D_N * symmetric_square_root(inverse(M)))
                 .maxCoeff() > 300))
      continue;  // limited, see LimitedDamping
    ++checked;
    const Vector6 V = J * VectorXd(dq);
    const TaskStiffness stiffness{K_t.asDiagonal(), K_r.asDiagonal()};
    VectorXd F = spring_wrench(stiffness, pose_error(pose.pose(), bench.plain.end_effector(q)));
    F += D * ((of_velocity ? Vector6(Vector6::Zero()) : pose.twist().vector) - V) +
         Lambda * pose.acceleration().vector;
    const MatrixXd I = MatrixXd::Identity(7, 7);
    MatrixXd N = null_space_projector(J, projector == 0 ? M : I);
    if (projector == 2)
      N = I - J.transpose() * inverse(J * J.transpose() + 0.04 * MatrixXd::Identity(6, 6)) * J;
    const VectorXd seen = of_joints ? VectorXd(dq) : VectorXd(N.transpose() * VectorXd(dq));
    const VectorXd expected = J.transpose() * F + N * (10 * VectorXd(bent(7) - q) - D_N * seen) +
                              VectorXd(bench.plain.coriolis(q, dq));
    EXPECT_NEAR((VectorXd(bench.rig.tau(0)) - expected).norm(), 0, 1e-5 * (1 + expected.norm())) << trial;
  }
  EXPECT_GE(checked, 24);
}

// At the error E = K^-1 D V the hand feels nothing: the lag of an undisturbed hand behind a steady set-point.
TEST(ReferenceCartesianLaw, LagsByDampingTimesVelocityOverStiffness) {
  Draw draw(64);
  Bench bench(cartesian_impedance_controllet(), draw.pose(1));
  for (const auto& value : reference_preset().values) {
    if (value.parameter.find("rotational_damping") != std::string::npos)
      continue;  // limited on so light a wrist
    const std::size_t size = bench.rig.parameters().value_size(bench.rig.parameters().find(value.parameter));
    bench.rig.set(value.parameter, std::vector<double>(size, value.values[0]));
  }
  bench.rig.set("rotational_damping_nm_s_per_rad", {0, 0, 0});
  bench.rig.set("nullspace_stiffness_nm_per_rad", {0});
  bench.rig.set("nullspace_damping_nm_s_per_rad", {0});
  ASSERT_EQ(bench.rig.start(), LawResult::ok);
  const JointVector q = bent(7);
  const MatrixXd J = bench.plain.jacobian(q);
  Vector6 V = Vector6::Zero();
  V.head<3>() << 0.1, 0.1, 0;  // the peak of 0.1 m sin t along x and y
  const JointVector dq = VectorXd(J.transpose() * inverse(J * J.transpose()) * V);
  bench.rig.place(0, q, dq);
  Pose ahead = bench.plain.end_effector(q);
  ahead.position += Vector3(0.01, 0.01, 0);  // 40 N s/m * 0.1 m/s / (400 N/m)
  bench.rig.input("pose").start(ahead);
  ASSERT_EQ(bench.rig.update(), LawResult::ok);
  EXPECT_NEAR((bench.rig.tau(0) - bench.plain.coriolis(q, dq)).norm(), 0, 1e-5);
}

// Damping of the velocity only takes energy, whatever is given, with every projector; as printed it does with
// the symmetric projectors and one D_N for all joints.
TEST(ReferenceCartesianLaw, DampingNeverSuppliesEnergy) {
  Draw draw(65);
  for (int trial = 0; trial < 150; ++trial) {
    Bench bench(cartesian_impedance_controllet(), {});
    const int projector = trial % 3;
    bench.rig.set("projector", {static_cast<double>(projector)});
    bench.rig.set("damping_of", {static_cast<double>(trial % 2)});
    bench.rig.set("damping_design", {1});
    bench.rig.set("translational_damping_n_s_per_m", {draw.uniform(0, 1000), draw.uniform(0, 1000), 0});
    bench.rig.set("rotational_damping_nm_s_per_rad", {draw.uniform(0, 100), 0, draw.uniform(0, 100)});
    bench.rig.set("nullspace_damping_nm_s_per_rad", {0.02});  // within what every joint bears
    bench.rig.set("nullspace_damping_of", {projector == 0 ? 0.0 : 1.0});
    const JointVector q = draw.joints(7, 2), dq = draw.joints(7, 2);
    bench.rig.place(0, q, joint_constant(7, 0));
    ASSERT_EQ(bench.rig.start(), LawResult::ok);
    bench.rig.place(0, q, dq);
    ASSERT_EQ(bench.rig.update(), LawResult::ok);
    EXPECT_LE(dq.dot(bench.rig.tau(0) - bench.rig.terms(0).c()), 1e-9) << trial;
  }
}

// No mode of a given damping gets more than 300 1/s, and none that had less gets another one.
TEST(LimitedDamping, LimitsEveryModeAndNoOther) {
  Draw draw(66);
  for (int trial = 0; trial < 50; ++trial) {
    const auto spd = [&](double scale) {
      Matrix6 A;
      for (double& a : A.reshaped()) a = draw.uniform(-1, 1);
      return Matrix6(scale * (A * A.transpose() + 0.1 * Matrix6::Identity()));
    };
    const Matrix6 inertia = spd(1), D = spd(trial % 2 == 0 ? 500 : 3);
    const MatrixXd half = symmetric_square_root(inverse(inertia));
    const VectorXd before = symmetric_eigenvalues(half * D * half);
    Matrix6 limited = D;
    const double share = limit_modes(inertia, 300, limited);
    EXPECT_NEAR(share, std::min(1.0, 300 / before.maxCoeff()), 1e-9);
    EXPECT_NEAR((limited - limited.transpose()).norm(), 0, 1e-9 * limited.norm());
    const VectorXd after = symmetric_eigenvalues(half * limited * half);
    EXPECT_NEAR((after - before.cwiseMin(300)).norm(), 0, 1e-6 * 300);
    if (before.maxCoeff() < 300) {
      EXPECT_EQ((limited - D).norm(), 0);
    }
  }
}

// A model with motors bears more: the same given damping is limited less.
TEST(LimitedDamping, CountsTheMotorsOfTheModel) {
  const TestArm arm = TestArm::make(7);
  ArmModelSource geared = arm.source();
  geared.motor_inertia = joint_constant(7, 0.1);
  ModelTerms light(arm.model()), heavy(std::make_shared<const ArmModel>(geared));
  for (ModelTerms* terms : {&light, &heavy}) terms->update(bent(7), joint_constant(7, 0));
  const MatrixXd J = light.J_V_WE(), M = light.M();
  EXPECT_NEAR((MatrixXd(damped_inertia(light)) - task_inertia(J, M)).norm(), 0, 1e-6);
  EXPECT_NEAR((MatrixXd(damped_inertia(heavy)) - task_inertia(J, M + 0.1 * MatrixXd::Identity(7, 7))).norm(),
              0, 1e-6);
  // Motors that M contains already count once.
  geared.known_motor_inertia = joint_constant(7, 0.06);
  ModelTerms known(std::make_shared<const ArmModel>(geared));
  known.update(bent(7), joint_constant(7, 0));
  EXPECT_NEAR((MatrixXd(damped_inertia(known)) - MatrixXd(damped_inertia(heavy))).norm(), 0, 1e-6);
}

// C_c by its definition: V^T (dLambda/dt - 2 C_c) V = 0 with Lambda by differences along the motion, for any
// V in world axes; and for V = J dq without self-motion, J_bar^T c - Lambda dJ dq is the whole of C_c V.
TEST(TaskCoriolis, KeepsTheSkewSymmetryAndTheAccelerationOfTheHand) {
  Draw draw(67);
  int checked = 0;
  for (int trial = 0; trial < 40; ++trial) {
    const std::size_t n = trial % 2 == 0 ? 7 : 6;
    const TestArm arm = TestArm::make(n);
    const Pose X_WB = draw.pose(1);
    const PlainArm plain(arm, X_WB);
    ModelTerms terms(arm.model(X_WB));
    const JointVector q = bent(n) + draw.joints(n, 0.3), dq = draw.joints(n, 1);
    terms.update(q, dq);
    if (terms.task().floored) continue;
    ++checked;
    constexpr double h = 1e-5;
    const auto Lambda = [&](double t) {
      const VectorXd moved = q + t * dq;
      return task_inertia(plain.jacobian(moved), plain.mass(moved));
    };
    const MatrixXd rate = (Lambda(h) - Lambda(-h)) / (2 * h);
    Vector6 V;
    V << draw.vector3(1), draw.vector3(1);
    EXPECT_NEAR(V.dot(rate * V) - 2 * V.dot(terms.task_coriolis(V)), 0, 2e-4 * (1 + rate.norm()));

    const MatrixXd J_rate = (plain.jacobian(q + h * dq) - plain.jacobian(q - h * dq)) / (2 * h);
    const JointVector v = draw.joints(n, 1);
    EXPECT_NEAR((terms.jacobian_rate_times(v) - Vector6(J_rate * VectorXd(v))).norm(), 0, 1e-6);
    EXPECT_NEAR((terms.coriolis_times(dq) - terms.c()).norm(), 0, 1e-9);
    // C(dq) v is bilinear: c(dq + v) = c(dq) + 2 C(dq) v + c(v).
    const VectorXd both = plain.coriolis(q, dq + v), own = plain.coriolis(q, dq),
                   other = plain.coriolis(q, v);
    EXPECT_NEAR((2 * VectorXd(terms.coriolis_times(v)) - (both - own - other)).norm(), 0, 1e-4);
  }
  EXPECT_GE(checked, 20);
}

TEST(ReferenceCartesianLaw, CoriolisIsAddedOnRequest) {
  Draw draw(68);
  Bench bench(cartesian_impedance_controllet(), draw.pose(1));
  ASSERT_EQ(bench.rig.start(), LawResult::ok);
  Reference& pose = bench.rig.input("pose");
  const Pose start = pose.pose();
  pose.set(
      pose_target({exp_rotation(draw.vector3(0.3)) * start.rotation, start.position + draw.vector3(0.2)}, 1));
  for (int i = 0; i < 300; ++i) ASSERT_EQ(bench.rig.tick(0.001), LawResult::ok);
  bench.rig.place(0, bent(7), draw.joints(7, 1));
  ASSERT_EQ(bench.rig.update(), LawResult::ok);
  const JointVector without = bench.rig.tau(0);
  bench.rig.set("coriolis_feedforward", {1});
  ASSERT_EQ(bench.rig.update(), LawResult::ok);
  const MatrixXd J = bench.plain.jacobian(bent(7));
  const Vector6 F = bench.rig.terms(0).task_coriolis(pose.twist().vector);
  EXPECT_GT(F.norm(), 1e-3);
  EXPECT_NEAR((VectorXd(bench.rig.tau(0) - without) - J.transpose() * F).norm(), 0, 1e-6);
}

}  // namespace
}  // namespace multipanda::reference_laws_test
