#include <gtest/gtest.h>

#include "core/controllets/builtins.hpp"
#include "core/controllets/damping_design.hpp"
#include "core/controllets/task_spring.hpp"
#include "core/testing/controllet_rig.hpp"
#include "core/testing/dense_algebra.hpp"
#include "core/testing/plain_arm.hpp"

// Tested like the other laws; grasps in MuJoCo are in tests/interaction/.
namespace multipanda::coupled_ufic_test {
namespace {

using namespace test;
using Eigen::MatrixXd;
using Eigen::VectorXd;

// A seven-joint and a six-joint arm on turned bases.
struct Bench {
  explicit Bench(const Pose& X = {})
      : X_WB{X * Pose{rotation_from_rpy({0.1, 0, 0.4}), Vector3(0, 0.4, 0)},
             X * Pose{rotation_from_rpy({0, 0.2, -2.5}), Vector3(0.1, -0.4, 0)}},
        plain{PlainArm(TestArm::make(7), X_WB[0]), PlainArm(TestArm::make(6), X_WB[1])},
        rig(coupled_ufic_controllet(), {TestArm::make(7).model(X_WB[0]), TestArm::make(6).model(X_WB[1])}) {
    for (std::size_t i = 0; i < 2; ++i) {
      rig.state(i).has_wrench_estimate = true;
      rig.state(i).tau_J_d = joint_constant(i == 0 ? 7 : 6, 0);
    }
    rig.set("contact_threshold_n", {2});  // the estimate has no errors here
    rig.set("contact_motion_share", {0});
  }
  void place(const VectorXd& q_1, const VectorXd& q_2) {
    rig.place(0, q_1, joint_constant(7, 0));
    rig.place(1, q_2, joint_constant(6, 0));
  }
  void request(double squeeze) {
    Target target;
    target.size = 1;
    target.values[0] = squeeze;
    rig.input("squeeze").set(target);
  }
  // Both hands press with this force, along the line between them.
  void feel(double first, double second) {
    rig.state(0).F_K_W_est.force() = first * n();
    rig.state(1).F_K_W_est.force() = -second * n();
  }
  Vector3 n() const {  // at the start
    return (plain[1].end_effector(bent(6)).position - plain[0].end_effector(bent(7)).position).normalized();
  }
  void ticks(int count) {
    for (int i = 0; i < count; ++i) ASSERT_EQ(rig.tick(0.001), LawResult::ok);
  }
  // Runs until the squeeze is complete; each hand's estimate is `force`.
  void grasp(double requested, double force) {
    ASSERT_EQ(rig.start(), LawResult::ok);
    request(requested);
    feel(force, force);
    ticks(3000);
    ASSERT_EQ(number("phase"), 2);
  }
  double number(std::string_view output) { return rig.output(output)[0]; }
  // The wrench behind each torque, by least squares over the independent Jacobian.
  Vector6 wrench(std::size_t arm) {
    const MatrixXd J = plain[arm].jacobian(rig.state(arm).q);
    return least_squares(J.transpose(), rig.tau(arm));
  }
  Pose X_WB[2];
  PlainArm plain[2];
  ControlletRig rig;
};

// Grasped, filters at rest, tanks full: the torque is the stated sum, with explicit inverses and
// independently written coordinates.
TEST(CoupledUfic, TorqueIsTheStatedLaw) {
  Draw draw(91);
  for (int trial = 0; trial < 12; ++trial) {
    Bench bench(draw.pose(1));
    bench.rig.set("force_integral_per_s", {0});
    bench.rig.set("force_proportional", {0.15});
    bench.rig.set("squeeze_damping_n_s_per_m", {25});
    bench.rig.set("object_mass_kg", {1.5});
    bench.rig.set("translational_stiffness_n_per_m", {600, 600, 600});
    bench.rig.set("relative_translational_stiffness_n_per_m", {300, 300, 300});
    bench.rig.set("relative_rotational_stiffness_nm_per_rad", {15, 15, 15});
    bench.grasp(12, 8);
    EXPECT_NEAR(bench.number("gamma_f"), 1, 1e-9);
    const Matrix3 R_E[2] = {bench.plain[0].end_effector(bent(7)).rotation,
                            bench.plain[1].end_effector(bent(6)).rotation};
    const Vector3 line =
        bench.plain[1].end_effector(bent(6)).position - bench.plain[0].end_effector(bent(7)).position;

    const Pose start = bench.rig.input("pose").pose();
    bench.rig.input("pose").set(pose_target(
        {exp_rotation(draw.vector3(0.2)) * start.rotation, start.position + draw.vector3(0.1)}, 1.0));
    bench.ticks(300);
    const VectorXd q[2] = {bent(7) + draw.joints(7, 0.1), bent(6) + draw.joints(6, 0.1)};
    const VectorXd dq[2] = {draw.joints(7, 0.4), draw.joints(6, 0.4)};
    bench.rig.place(0, q[0], dq[0]);
    bench.rig.place(1, q[1], dq[1]);
    // The squeezing direction rotates with the set-point, and so do the estimates.
    const Reference& pose = bench.rig.input("pose");
    const Matrix3 R_d = pose.pose().rotation;
    const Vector3 n = R_d * line.normalized();
    bench.rig.state(0).F_K_W_est.force() = 8 * n;
    bench.rig.state(1).F_K_W_est.force() = -8 * n;
    ASSERT_EQ(bench.rig.update(), LawResult::ok);
    ASSERT_FALSE(bench.rig.terms(0).task().floored || bench.rig.terms(1).task().floored);

    Pose E[2];
    MatrixXd J[2], M[2], L(12, 12), Lambda = MatrixXd::Zero(12, 12);
    VectorXd V(12);
    for (std::size_t i = 0; i < 2; ++i) {
      E[i] = bench.plain[i].end_effector(q[i]);
      J[i] = bench.plain[i].jacobian(q[i]);
      M[i] = bench.plain[i].mass(q[i]);
      Lambda.block(6 * i, 6 * i, 6, 6) = task_inertia(J[i], M[i]);
      V.segment(6 * i, 6) = J[i] * dq[i];
    }
    // L by differences of the coordinates themselves.
    const auto absolute_rotation = [&](const Matrix3& R_1, const Matrix3& R_2) -> Matrix3 {
      const Eigen::AngleAxisd phi(R_2 * R_E[1].transpose() * (R_1 * R_E[0].transpose()).transpose());
      return Eigen::AngleAxisd(0.5 * phi.angle(), phi.axis()) * R_1 * R_E[0].transpose();
    };
    const auto relative_rotation = [&](const Matrix3& R_1, const Matrix3& R_2) -> Vector3 {
      const Eigen::AngleAxisd phi(R_2 * R_E[1].transpose() * (R_1 * R_E[0].transpose()).transpose());
      return phi.angle() * phi.axis();
    };
    constexpr double h = 1e-6;
    L.setZero();
    for (Eigen::Index k = 0; k < 12; ++k) {
      const Eigen::Index arm = k / 6, axis = k % 6;
      if (axis < 3) {
        L(axis, k) = 0.5;
        L(6 + axis, k) = arm == 0 ? -1 : 1;
        continue;
      }
      Matrix3 plus[2] = {E[0].rotation, E[1].rotation}, minus[2] = {E[0].rotation, E[1].rotation};
      plus[arm] = Eigen::AngleAxisd(h, Vector3::Unit(axis - 3)) * plus[arm];
      minus[arm] = Eigen::AngleAxisd(-h, Vector3::Unit(axis - 3)) * minus[arm];
      const Eigen::AngleAxisd turn(absolute_rotation(plus[0], plus[1]) *
                                   absolute_rotation(minus[0], minus[1]).transpose());
      L.block(3, k, 3, 1) = turn.angle() / (2 * h) * turn.axis();
      L.block(9, k, 3, 1) =
          (relative_rotation(plus[0], plus[1]) - relative_rotation(minus[0], minus[1])) / (2 * h);
    }
    const VectorXd V_ar = L * V;
    const MatrixXd L_inverse = inverse(L);
    const Eigen::Matrix<double, 12, 12> Lambda_ar = L_inverse.transpose() * Lambda * L_inverse;
    Eigen::Matrix<double, 12, 12> K = Eigen::Matrix<double, 12, 12>::Zero();
    K.diagonal() << 600, 600, 600, 20, 20, 20, 300, 300, 300, 15, 15, 15;
    const MatrixXd D = coupled_damping(Lambda_ar, K, 1.0);

    const Vector3 p_a = 0.5 * (E[0].position + E[1].position), p_r = E[1].position - E[0].position;
    const Eigen::AngleAxisd turn(R_d * absolute_rotation(E[0].rotation, E[1].rotation).transpose());
    const Vector3 e_r = R_d * line - p_r;
    VectorXd F(12), V_d = VectorXd::Zero(12), A_d = VectorXd::Zero(12);
    F << 600 * (pose.pose().position - p_a), 20 * turn.angle() * turn.axis(), 300 * (e_r - n.dot(e_r) * n),
        -15 * relative_rotation(E[0].rotation, E[1].rotation);
    V_d.head(6) = pose.twist().vector;
    const double d_d = bench.number("hand_distance_set_m");
    V_d.segment(6, 3) = pose.twist().angular().cross(Vector3(R_d * line + (d_d - line.norm()) * n));
    A_d.head(6) = pose.acceleration().vector;
    F += D * (V_d - V_ar) + Lambda_ar * A_d;
    F.head(3) += 1.5 * (Vector3(pose.acceleration().linear()) + Vector3(0, 0, 9.81));
    const double v_n = n.dot(Vector3(V_ar.segment(6, 3)));
    F.segment(6, 3) -= n * (12 + 0.15 * (12 - 8) + 25 * v_n);
    const VectorXd F_E = L.transpose() * F;
    for (std::size_t i = 0; i < 2; ++i) {
      const Eigen::Index joints = q[i].size();
      const MatrixXd N = null_space_projector(J[i], M[i]);
      const VectorXd D_N = 2 * (10 * M[i].diagonal().array()).sqrt();
      const VectorXd q_N = bent(static_cast<std::size_t>(joints));
      const VectorXd null = N * (10 * (q_N - q[i]) - D_N.asDiagonal() * N.transpose() * dq[i]);
      const VectorXd expected = J[i].transpose() * F_E.segment(6 * static_cast<Eigen::Index>(i), 6) + null +
                                bench.plain[i].coriolis(q[i], dq[i]);
      // gamma has left 1 where the hands were moved; the fraction of an incoming force is 1 all the same.
      if (v_n > 0.02) {
        EXPECT_NEAR((bench.rig.tau(i) - expected).norm(), 0, 2e-4 * (1 + expected.norm()))
            << "trial " << trial << " arm " << i;
      } else {
        const double share = bench.number("force_command_n") / 12.6;
        Vector6 F_f = Vector6::Zero();
        F_f.head<3>() = (i == 0 ? 1.0 : -1.0) * (share - 1) * 12.6 * n;
        const VectorXd with_share = expected + J[i].transpose() * F_f;
        EXPECT_NEAR((bench.rig.tau(i) - with_share).norm(), 0, 2e-4 * (1 + expected.norm()))
            << "trial " << trial << " arm " << i;
        EXPECT_GE(share, 0);
        EXPECT_LE(share, 1 + 1e-3);
      }
    }
  }
}

TEST(CoupledUfic, IsZeroAtRestWithoutRequestedForce) {
  Bench bench;
  ASSERT_EQ(bench.rig.start(), LawResult::ok);
  bench.ticks(500);
  EXPECT_NEAR(bench.rig.tau(0).norm() + bench.rig.tau(1).norm(), 0, 1e-9);
  const Vector3 midway =
      0.5 * (bench.plain[0].end_effector(bent(7)).position + bench.plain[1].end_effector(bent(6)).position);
  EXPECT_NEAR((bench.rig.input("pose").pose().position - midway).norm(), 0, 1e-12);
}

// The squeeze is a pair of opposite forces at the hands, without a moment; the weight is shared by halves,
// without a moment either.
TEST(CoupledUfic, SqueezeAndWeightAreForcesAtTheHands) {
  Bench bench;
  bench.rig.set("nullspace_stiffness_nm_per_rad", {0});
  bench.rig.set("object_mass_kg", {2});
  bench.rig.set("force_integral_per_s", {0});
  bench.grasp(20, 20);
  const Vector3 n = bench.n();
  const Vector3 half = 0.5 * 2 * 9.81 * Vector3::UnitZ();
  Vector6 expected[2];
  expected[0] << 20 * n + half, Vector3::Zero();
  expected[1] << -20 * n + half, Vector3::Zero();
  for (std::size_t i = 0; i < 2; ++i) EXPECT_NEAR((bench.wrench(i) - expected[i]).norm(), 0, 1e-6);
}

// Meaning of "coupled": a push of both hands in one direction acts on the absolute spring and does not change
// the squeeze; the squeeze does not depend on the hands' positions (no stiffness), only on their forces.
TEST(CoupledUfic, CommonMotionMeetsTheSpringAndLeavesTheSqueeze) {
  Draw draw(92);
  for (int trial = 0; trial < 10; ++trial) {
    Bench bench;
    bench.rig.set("nullspace_stiffness_nm_per_rad", {0});
    bench.rig.set("translational_stiffness_n_per_m", {700, 700, 700});
    bench.rig.set("force_integral_per_s", {0});
    bench.grasp(15, 15);
    const Vector3 n = bench.n();
    const VectorXd q_1 = bent(7) + draw.joints(7, 0.02), q_2 = bent(6) + draw.joints(6, 0.02);
    bench.place(q_1, q_2);
    ASSERT_EQ(bench.rig.update(), LawResult::ok);
    const Vector3 moved =
        0.5 * (bench.plain[0].end_effector(q_1).position + bench.plain[1].end_effector(q_2).position -
               bench.plain[0].end_effector(bent(7)).position - bench.plain[1].end_effector(bent(6)).position);
    const Vector3 f_1 = bench.wrench(0).head<3>(), f_2 = bench.wrench(1).head<3>();
    EXPECT_NEAR((f_1 + f_2 + 700 * moved).norm(), 0, 1e-6);
    const double share = bench.number("gamma_f") * bench.number("alpha_f");
    EXPECT_NEAR(0.5 * n.dot(f_1 - f_2), 15 * share, 1e-6);
    EXPECT_GT(share, 0.3);
  }
}

// Only the mean of both estimates drives the force law: one hand pressing more than the other is the
// object's motion, not the squeeze.
TEST(CoupledUfic, OneHandPressingMoreIsNotASqueeze) {
  Bench even, uneven;
  even.grasp(10, 9);
  uneven.grasp(10, 9);
  even.feel(9, 9);
  uneven.feel(13, 5);
  for (auto* bench : {&even, &uneven}) bench->ticks(500);
  EXPECT_NEAR(even.number("force_command_n"), uneven.number("force_command_n"), 1e-9);
  EXPECT_GT(even.number("force_command_n"), 10.1);
}

// Minus the gradient, over the joints of both arms, of the energy in all springs, before a grasp.
TEST(CoupledUfic, SpringsAreTheGradientOfTheirEnergy) {
  Draw draw(93);
  for (int trial = 0; trial < 10; ++trial) {
    Bench bench;
    bench.rig.set("nullspace_stiffness_nm_per_rad", {0});
    bench.rig.set("translational_stiffness_n_per_m", {300, 500, 200});
    bench.rig.set("rotational_stiffness_nm_per_rad", {30, 10, 20});
    bench.rig.set("relative_translational_stiffness_n_per_m", {700, 700, 700});
    bench.rig.set("relative_rotational_stiffness_nm_per_rad", {15, 25, 5});
    for (const char* name : {"tank_max_j", "tank_start_j"}) bench.rig.set(name, {1000});
    ASSERT_EQ(bench.rig.start(), LawResult::ok);
    const Matrix3 R_0[2] = {bench.plain[0].end_effector(bent(7)).rotation,
                            bench.plain[1].end_effector(bent(6)).rotation};
    const Vector3 line =
        bench.plain[1].end_effector(bent(6)).position - bench.plain[0].end_effector(bent(7)).position;
    const Pose X_d =
        bench.rig.input("pose").pose() * Pose{exp_rotation(draw.vector3(0.3)), draw.vector3(0.05)};
    const Vector3 p_r_d = X_d.rotation * line;
    bench.rig.input("pose").start(X_d);
    const VectorXd q_1 = bent(7) + draw.joints(7, 0.1), q_2 = bent(6) + draw.joints(6, 0.1);
    bench.place(q_1, q_2);
    ASSERT_EQ(bench.rig.update(), LawResult::ok);
    const auto energy = [&](const VectorXd& a, const VectorXd& b) {
      const Pose E1 = bench.plain[0].end_effector(a), E2 = bench.plain[1].end_effector(b);
      const Matrix3 R_1 = E1.rotation * R_0[0].transpose(), R_2 = E2.rotation * R_0[1].transpose();
      const Eigen::AngleAxisd phi(R_2 * R_1.transpose());
      const Matrix3 R_a = Eigen::AngleAxisd(0.5 * phi.angle(), phi.axis()) * R_1;
      const Eigen::AngleAxisd turn(X_d.rotation * R_a.transpose());
      const Vector3 p_a = X_d.position - 0.5 * (E1.position + E2.position);
      const Vector3 p_r = p_r_d - (E2.position - E1.position);
      const Vector3 r_a = FadedRotation(turn.angle() * turn.axis()).value, r_r = phi.angle() * phi.axis();
      return 0.5 * (Vector3(300, 500, 200).dot(p_a.cwiseAbs2()) + Vector3(30, 10, 20).dot(r_a.cwiseAbs2()) +
                    700 * p_r.squaredNorm() + Vector3(15, 25, 5).dot(r_r.cwiseAbs2()));
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

// Without weight and integral the law does not depend on the pose of the world.
TEST(CoupledUfic, IsInvariantToThePoseOfTheWorld) {
  const Pose X = Draw(94).pose(2);
  Bench here, there(X);
  for (auto* bench : {&here, &there}) {
    Draw draw(95);
    bench->grasp(12, 9);
    // Offsets X_EiA differ by the turn of A's axes; equal stiffness is not affected.
    const Pose A = bench->rig.input("pose").pose();
    const Matrix3 turn = bench == &here ? Matrix3(Matrix3::Identity()) : X.rotation;
    bench->rig.input("pose").start(
        Pose{turn * exp_rotation({0.1, -0.05, 0.1}) * turn.transpose() * A.rotation,
             A.position + turn * Vector3(0.1, 0.02, 0.05)});
    bench->rig.place(0, bent(7) + draw.joints(7, 0.05), draw.joints(7, 0.3));
    bench->rig.place(1, bent(6) + draw.joints(6, 0.05), draw.joints(6, 0.3));
    bench->ticks(50);
  }
  EXPECT_GT(here.rig.tau(0).norm(), 1);
  EXPECT_NEAR((here.rig.tau(0) - there.rig.tau(0)).norm(), 0, 1e-7);
  EXPECT_NEAR((here.rig.tau(1) - there.rig.tau(1)).norm(), 0, 1e-7);
}

// Empty tanks: no spring, no squeeze; only dampers.
TEST(CoupledUfic, EmptyTanksLeaveOnlyDamping) {
  Draw draw(96);
  Bench bench;
  bench.rig.set("tank_start_j", {0});
  bench.rig.set("object_mass_kg", {1});
  ASSERT_EQ(bench.rig.start(), LawResult::ok);
  bench.request(20);
  bench.feel(20, 20);
  const Pose start = bench.rig.input("pose").pose();
  bench.rig.input("pose").set(pose_target({start.rotation, start.position + Vector3(0.2, 0, 0)}, 1.0));
  bench.ticks(2000);
  EXPECT_EQ(bench.number("alpha_i"), -1);
  EXPECT_EQ(bench.number("alpha_f"), 0);
  EXPECT_NEAR(bench.rig.tau(0).norm() + bench.rig.tau(1).norm(), 0, 1e-9);
  for (int trial = 0; trial < 50; ++trial) {
    bench.rig.place(0, bent(7), draw.joints(7, 0.5));
    bench.rig.place(1, bent(6), draw.joints(6, 0.5));
    ASSERT_EQ(bench.rig.update(), LawResult::ok);
    double power = 0;
    for (std::size_t i = 0; i < 2; ++i) {
      power += bench.rig.state(i).dq.dot(bench.rig.tau(i) - bench.rig.terms(i).c());
    }
    EXPECT_LT(power, 0);
  }
}

// Somebody pushes both hands to their set-point, faster than a spring with bounds would: the damping takes
// more than the spring gives, so neither the spring nor an object's weight has to be let go of.
TEST(CoupledUfic, APushTowardsTheSetPointLetsGoOfNothing) {
  Draw draw(112);
  for (const ContactBounds& bounds : {ContactBounds{}, ContactBounds{0.1, 30, 10}}) {
    for (int trial = 0; trial < 5; ++trial) {
      Bench bench;
      bench.rig.bound(bounds);
      ASSERT_EQ(bench.rig.start(), LawResult::ok);
      const Vector3 way = draw.vector3(1).normalized();
      for (std::size_t i = 0; i < 2; ++i) {
        const JointVector q = bent(i == 0 ? 7 : 6);
        VectorXd twist = VectorXd::Zero(6);
        twist.head<3>() = way;
        const VectorXd along = least_squares(bench.plain[i].jacobian(q), twist);
        bench.rig.place(i, q - 0.002 * along, 1.6 * bounds.hand_speed * along);
      }
      ASSERT_EQ(bench.rig.tick(0.001), LawResult::ok);
      EXPECT_EQ(bench.number("alpha_i"), 0) << "trial " << trial;
    }
  }
}

// Held 0.1 m beside their set-points: the more loaded hand pulls with the bound at most.
TEST(CoupledUfic, SpringsPullWithNoMoreThanTheBoundsForContact) {
  Draw draw(113);
  double greatest = 0;
  for (int trial = 0; trial < 12; ++trial) {
    Bench bench;
    bench.rig.bound({.hand_speed = 0.25, .spring_force = 30, .spring_moment = 10});
    bench.place(bent(7), bent(6));
    ASSERT_EQ(bench.rig.start(), LawResult::ok);
    bench.ticks(10);
    VectorXd twist = VectorXd::Zero(6);
    twist.head<3>() = 0.1 * draw.vector3(1).normalized();
    const auto beside = [&](std::size_t i, const VectorXd& q) {
      return VectorXd(q + least_squares(bench.plain[i].jacobian(q), twist));
    };
    bench.place(beside(0, bent(7)), beside(1, bent(6)));
    bench.ticks(1);
    double most = 0;
    for (std::size_t i = 0; i < 2; ++i) {
      const Vector6 F = bench.rig.terms(i).task().J_bar.transpose() * bench.rig.tau(i);
      most = std::max({most, F.head<3>().norm() / 30, F.tail<3>().norm() / 10});
    }
    EXPECT_LT(most, 1 + 1e-6) << "trial " << trial;
    greatest = std::max(greatest, most);
  }
  EXPECT_NEAR(greatest, 1, 1e-6) << "where nothing softens the springs";
}

// A mass that is declared and not there lifts the hands: at most what both arms carry, and slowly.
TEST(CoupledUfic, TheObjectsMassIsBoundedAndComesInSlowly) {
  const auto model_of = [](std::size_t joints, const Pose& X_WB, double largest_load) {
    ArmModelSource source = TestArm::make(joints).source(X_WB);
    source.largest_load = largest_load;
    return std::make_shared<const ArmModel>(std::move(source));
  };
  const Bench poses;
  const ControlletRig carries(coupled_ufic_controllet(),
                              {model_of(7, poses.X_WB[0], 2), model_of(6, poses.X_WB[1], 1.5)});
  const ParameterSet& parameters = carries.parameters();
  const std::size_t mass = parameters.find("object_mass_kg");
  EXPECT_EQ(parameters.check(mass, std::array{3.5}), Verdict::accepted);
  EXPECT_EQ(parameters.check(mass, std::array{3.6}), Verdict::out_of_bounds);
  EXPECT_EQ(parameters.bound_reason(mass), "the arms can carry no more besides hands and tools");

  Bench bench;
  bench.rig.set("object_mass_kg", {1});
  bench.grasp(12, 8);
  EXPECT_NEAR(bench.number("vertical_force_n"), 9.81, 1e-6);
  bench.rig.set("object_mass_kg", {3.5});
  bench.ticks(1);
  EXPECT_LT(bench.number("vertical_force_n"), 1.02 * 9.81);
  bench.ticks(250);
  EXPECT_NEAR(bench.number("vertical_force_n"), 9.81 * (1 + 2 * 0.251), 1e-6);
  bench.ticks(1000);
  EXPECT_NEAR(bench.number("vertical_force_n"), 9.81 * 3.5, 1e-6);
}

// For any motion: the energy that arms and springs gain, the tanks lose. The test prescribes the motion of
// the arms, so the work of the torques follows from their paths alone.
TEST(CoupledUfic, TanksSupplyAllEnergyThatGoesIn) {
  Draw draw(97);
  for (int trial = 0; trial < 10; ++trial) {
    Bench bench;
    const bool full = trial % 2 == 0;
    bench.rig.set("tank_start_j", {full ? 50.0 : 0.2});
    bench.rig.set("object_mass_kg", {1});
    bench.rig.set("vertical_integral_n_per_m_s", {500});
    ASSERT_EQ(bench.rig.start(), LawResult::ok);
    bench.request(15);
    bench.ticks(1);
    const double initial = bench.number("force_tank_j") + bench.number("impedance_tank_j");
    EXPECT_NEAR(initial, full ? 100 : 0.4, 1e-9);
    const Pose start = bench.rig.input("pose").pose();
    bench.rig.input("pose").set(
        pose_target({exp_rotation(draw.vector3(0.2)) * start.rotation, start.position + draw.vector3(0.2)}));
    const JointVector way[2] = {draw.joints(7, 0.05), draw.joints(6, 0.05)};
    JointVector q[2] = {bent(7), bent(6)}, tau[2] = {bench.rig.tau(0), bench.rig.tau(1)};
    double into_arms = 0, traffic = 0, before = initial;
    for (int k = 1; k <= 3000; ++k) {
      const double t = 0.001 * k;
      for (std::size_t i = 0; i < 2; ++i) {
        const JointVector next = bent(i == 0 ? 7 : 6) + way[i] * std::sin(3 * t);
        into_arms += tau[i].dot(next - q[i]);
        q[i] = next;
        bench.rig.state(i).tau_J_d = tau[i];
        bench.rig.place(i, q[i], way[i] * 3 * std::cos(3 * t));
      }
      bench.feel(9 - 6 * std::cos(2 * t), 9 - 6 * std::cos(3 * t));
      ASSERT_EQ(bench.rig.tick(0.001), LawResult::ok);
      for (std::size_t i = 0; i < 2; ++i) tau[i] = bench.rig.tau(i);
      double kinetic = 0;
      for (std::size_t i = 0; i < 2; ++i) {
        kinetic += 0.5 * bench.rig.state(i).dq.dot(bench.rig.terms(i).M() * bench.rig.state(i).dq);
      }
      // stored_energy_j is kinetic + springs + tanks.
      const double stored = bench.number("stored_energy_j") - kinetic;
      ASSERT_LE(into_arms + stored, initial + 1e-9) << "trial " << trial << " tick " << k;
      if (full) {
        ASSERT_NEAR(into_arms + stored, initial, 1e-6) << "trial " << trial << " tick " << k;
      }
      const double tanks = bench.number("force_tank_j") + bench.number("impedance_tank_j");
      traffic += std::abs(tanks - before);
      before = tanks;
      ASSERT_GT(bench.number("force_tank_j"), -0.02);
      ASSERT_GT(bench.number("impedance_tank_j"), -0.02);
    }
    EXPECT_GT(traffic, 0.05) << "nothing was booked";
  }
}

// An object that hangs 2 cm too low: its force grows by gain times error, and vanishes within a few tenths of
// a second once it is let go.
TEST(CoupledUfic, TheVerticalForceIsTheIntegralOfTheErrorAndFadesAfterAGrasp) {
  Bench bench;
  bench.rig.set("vertical_integral_n_per_m_s", {100});
  bench.grasp(12, 12);
  const Pose start = bench.rig.input("pose").pose();
  bench.rig.input("pose").set(pose_target({start.rotation, start.position + Vector3(0, 0, 0.02)}));
  bench.ticks(500);
  const double before = bench.number("vertical_force_n");
  bench.ticks(500);
  EXPECT_NEAR(bench.number("vertical_force_n") - before, 100 * 0.02 * 0.5, 1e-3);
  bench.request(0);
  bench.ticks(1000);
  ASSERT_EQ(bench.number("phase"), 0);
  const double released = bench.number("vertical_force_n");
  bench.ticks(200);
  EXPECT_NEAR(bench.number("vertical_force_n") / released, std::exp(-1), 1e-3);
}

// Nothing would pay for it: it would act at once when energy returns.
TEST(CoupledUfic, TheVerticalForceDoesNotWindUpOnAnEmptyTank) {
  Bench bench;
  bench.rig.set("tank_start_j", {0});
  bench.rig.set("vertical_integral_n_per_m_s", {100});
  bench.grasp(12, 12);
  const Pose start = bench.rig.input("pose").pose();
  bench.rig.input("pose").set(pose_target({start.rotation, start.position + Vector3(0, 0, 0.02)}));
  bench.ticks(1000);
  EXPECT_EQ(bench.number("vertical_force_n"), 0);
}

TEST(CoupledUfic, ContactCausesNoStep) {
  Bench bench;
  ASSERT_EQ(bench.rig.start(), LawResult::ok);
  bench.request(20);
  bench.ticks(400);
  JointVector before[2] = {bench.rig.tau(0), bench.rig.tau(1)};
  bench.feel(4, 3);
  for (int i = 0; i < 2500; ++i) {
    ASSERT_EQ(bench.rig.tick(0.001), LawResult::ok);
    for (std::size_t arm = 0; arm < 2; ++arm) {
      EXPECT_LT((bench.rig.tau(arm) - before[arm]).cwiseAbs().maxCoeff(), 0.3) << i;
      before[arm] = bench.rig.tau(arm);
    }
  }
  EXPECT_EQ(bench.number("phase"), 2);
  bench.feel(0, 3);  // and so does the loss
  for (int i = 0; i < 1000; ++i) {
    ASSERT_EQ(bench.rig.tick(0.001), LawResult::ok);
    for (std::size_t arm = 0; arm < 2; ++arm) {
      EXPECT_LT((bench.rig.tau(arm) - before[arm]).cwiseAbs().maxCoeff(), 0.5) << i;
      before[arm] = bench.rig.tau(arm);
    }
  }
  EXPECT_EQ(bench.number("phase"), 3);
  EXPECT_EQ(bench.number("force_command_n"), 0);
}

TEST(CoupledUfic, FaultsOnNaNAndContradictingEstimates) {
  for (const double bad : {std::nan(""), std::numeric_limits<double>::infinity()}) {
    for (int where = 0; where < 5; ++where) {
      Bench bench;
      ASSERT_EQ(bench.rig.start(), LawResult::ok);
      JointVector q = bent(6), dq = joint_constant(6, 0);
      if (where == 0) q[2] = bad;
      if (where == 1) dq[2] = bad;
      if (where == 2) bench.rig.state(1).F_K_W_est.force()[1] = bad;
      if (where == 3) bench.rig.input("squeeze").start_constant(bad);
      if (where == 4) q[5] += 2.5;  // the second hand turned away
      bench.rig.place(1, q, dq);
      EXPECT_EQ(bench.rig.tick(0.001), LawResult::fault) << where;
      // A new start from valid numbers succeeds.
      bench.feel(0, 0);
      bench.place(bent(7), bent(6));
      ASSERT_EQ(bench.rig.start(), LawResult::ok);
      EXPECT_EQ(bench.rig.tick(0.001), LawResult::ok);
    }
  }
}

TEST(CoupledUfic, WithoutAnEstimateItDoesNotStart) {
  for (std::size_t i = 0; i < 2; ++i) {
    Bench bench;
    bench.rig.state(i).has_wrench_estimate = false;
    EXPECT_EQ(bench.rig.start(), LawResult::fault);
  }
}

}  // namespace
}  // namespace multipanda::coupled_ufic_test
