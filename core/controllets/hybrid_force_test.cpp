// Forces and moments along any subset of axes: the law against textbook algebra, and closed loops with the
// arm's own equations of motion against springs of closed form. Its bounds: hybrid_force_bounds_test.cpp.
#include <limits>
#include <string>

#include <gtest/gtest.h>

#include "core/controllets/builtins.hpp"
#include "core/controllets/damping_design.hpp"
#include "core/testing/dense_algebra.hpp"
#include "core/testing/hybrid_force_bench.hpp"

namespace multipanda::hybrid_force_test {
namespace {

TEST(HybridForce, WithoutAxesItIsTheCartesianImpedanceToTheBit) {
  Draw draw(201);
  for (const bool bounded : {false, true}) {
    for (int trial = 0; trial < 6; ++trial) {
      const Pose X_WB = draw.pose(1);
      Bench hybrid(X_WB), impedance(X_WB, cartesian_impedance_controllet());
      const Vector3 way = draw.vector3(0.3), turn = draw.vector3(0.4);
      const JointVector q = bent(7) + draw.joints(7, 0.1), dq = draw.joints(7, 0.3);
      for (Bench* bench : {&hybrid, &impedance}) {
        if (bounded) bench->rig.bound({});
        bench->rig.set("stiffness_axes", {trial % 2 == 0 ? 0.0 : 1.0});
        ASSERT_EQ(bench->rig.start(), LawResult::ok);
        const Pose start = bench->rig.input("pose").pose();
        bench->rig.input("pose").set(
            pose_target({exp_rotation(turn) * start.rotation, start.position + way}, 1));
        bench->feel(six({3, 5, -9}, {1, -2, 0.5}));
        bench->ticks(400);
        bench->rig.place(0, q, dq);
        bench->ticks(1);
      }
      hybrid.want(six({20, 0, -20}, {1, 1, 1}));
      EXPECT_GT(hybrid.rig.tau(0).norm(), 1);
      EXPECT_EQ(hybrid.rig.tau(0), impedance.rig.tau(0));
      hybrid.ticks(300);
      impedance.ticks(300);
      EXPECT_EQ(hybrid.rig.tau(0), impedance.rig.tau(0));
    }
  }
}

// At rest in contact, one axis gives the torque of `force`.
TEST(HybridForce, OneAxisAtRestAgreesWithForce) {
  Bench hybrid, force({}, force_controllet());
  hybrid.select(2);
  for (Bench* bench : {&hybrid, &force}) {
    bench->rig.set("force_integral_per_s", {2});
    ASSERT_EQ(bench->rig.start(), LawResult::ok);
    bench->feel(six({0, 0, -8}, Vector3::Zero()));
    bench->want(six({0, 0, -12}, Vector3::Zero()));
    bench->ticks(1500);
    bench->feel(six({0, 0, -12}, Vector3::Zero()));
    bench->ticks(3000);
  }
  EXPECT_GT(force.rig.tau(0).norm(), 1);
  // The integrals began some milliseconds apart.
  EXPECT_NEAR(-hybrid.command()[2], force.rig.output("force_command_n")[0], 1.0);
  EXPECT_NEAR(
      (hybrid.rig.tau(0) / -hybrid.command()[2] - force.rig.tau(0) / force.rig.output("force_command_n")[0])
          .norm(),
      0, 1e-6);
  Bench without, reference({}, force_controllet());
  without.select(2);
  for (Bench* bench : {&without, &reference}) {
    bench->rig.set("force_integral_per_s", {0});
    ASSERT_EQ(bench->rig.start(), LawResult::ok);
    bench->feel(six({0, 0, -8}, Vector3::Zero()));
    bench->want(six({0, 0, -12}, Vector3::Zero()));
    bench->ticks(3000);
  }
  EXPECT_NEAR((without.rig.tau(0) - reference.rig.tau(0)).norm(), 0, 1e-6);
}

// In contact, filters at rest: the stated sum with explicit inverses and projectors, for random sets of axes
// of both frames on tilted bases.
TEST(HybridForce, TorqueIsTheStatedLaw) {
  Draw draw(202);
  int checked = 0;
  for (int trial = 0; trial < 24; ++trial) {
    Bench bench(draw.pose(1));
    const bool of_hand = trial % 2 == 0;
    bool on[6];
    for (bool& axis : on) axis = draw.coin();
    for (int i = 0; i < 6; ++i) bench.select(i, on[i]);
    bench.rig.set("force_frame", {of_hand ? 1.0 : 0.0});
    bench.rig.set("force_integral_per_s", {0});
    bench.rig.set("moment_integral_per_s", {0});
    bench.rig.set("force_proportional", {0.15});
    bench.rig.set("translational_stiffness_n_per_m", {400, 300, 200});
    bench.rig.set("rotational_stiffness_nm_per_rad", {20});
    ASSERT_EQ(bench.rig.start(), LawResult::ok);
    const Pose start = bench.rig.input("pose").pose();
    Matrix3 R = of_hand ? start.rotation : Matrix3(Matrix3::Identity());
    // Above the thresholds along every axis.
    Vector6 felt_f, desired_f;
    for (int i = 0; i < 6; ++i) {
      const double size = i < 3 ? 1 : 0.2;
      const double sign = draw.coin() ? 1 : -1;
      felt_f[i] = sign * size * draw.uniform(6, 10);
      desired_f[i] = sign * size * draw.uniform(6, 10);
    }
    const auto world = [&](const Vector6& x) { return six(R * x.head<3>(), R * x.tail<3>()); };
    bench.feel(world(felt_f));
    bench.want(world(desired_f));
    bench.ticks(3000);
    bench.rig.input("pose").set(pose_target({start.rotation, start.position + draw.vector3(0.1)}, 1.0));
    bench.ticks(300);
    const JointVector q = bent(7) + draw.joints(7, 0.05), dq = draw.joints(7, 0.3);
    bench.rig.place(0, q, dq);
    ASSERT_EQ(bench.rig.update(), LawResult::ok);
    if (bench.rig.terms(0).task().floored) continue;
    ++checked;

    // The desired wrench counts along the axes as they are now; the low-passed error is that of before.
    const VectorXd error_f = desired_f - felt_f, desired = world(desired_f);
    const Matrix3 R_before = R;
    if (of_hand) R = bench.plain.end_effector(q).rotation;
    const Reference& pose = bench.rig.input("pose");
    const MatrixXd J = bench.plain.jacobian(q), M = bench.plain.mass(q);
    const MatrixXd Lambda = task_inertia(J, M), A = inverse(Lambda);
    MatrixXd S = MatrixXd::Zero(6, 6), D_f = MatrixXd::Zero(6, 6);  // projector and added damping
    VectorXd f = VectorXd::Zero(6);
    // What the axes do to one mode together: the largest eigenvalue of their mobility, each scaled to 1.
    MatrixXd scaled = MatrixXd::Zero(6, 6);
    for (int i = 0; i < 6; ++i) {
      if (!on[i]) continue;
      VectorXd a = VectorXd::Zero(6);
      a.segment(i < 3 ? 0 : 3, 3) = R.col(i % 3);
      scaled.col(i) = a / std::sqrt(a.dot(A * a));
    }
    const MatrixXd together = scaled.transpose() * A * scaled;
    const double shared = std::max(1.0, eigenvalues(together).real().maxCoeff());
    for (int i = 0; i < 6; ++i) {
      if (!on[i]) continue;
      VectorXd a = VectorXd::Zero(6);
      a.segment(i < 3 ? 0 : 3, 3) = R.col(i % 3);
      S += a * a.transpose();
      D_f += std::min(i < 3 ? 100.0 : 2.0, 60 / a.dot(A * a) / shared) * a * a.transpose();
      f += (a.dot(desired) + 0.15 * error_f[i]) * a;
    }
    const MatrixXd rest = MatrixXd::Identity(6, 6) - S;
    VectorXd K(6);
    K << 400, 300, 200, 20, 20, 20;
    const Matrix6 D = task_damping(Lambda, Matrix6(K.asDiagonal()), 1);
    const Pose X = bench.plain.end_effector(q);
    const Eigen::AngleAxisd turn(start.rotation * X.rotation.transpose());
    VectorXd error(6);
    // Along the axes as they were, the set-point had stayed where the arm was.
    const Vector3 way = pose.pose().position - start.position;
    Vector3 moved = Vector3::Zero();
    for (int i = 0; i < 3; ++i)
      if (!on[i]) moved += way.dot(R_before.col(i)) * R_before.col(i);
    error << start.position + moved - X.position, turn.angle() * turn.axis();
    const VectorXd V = J * dq;
    // For equal rotational stiffness the gradient of the spring is K r along any r.
    const VectorXd P = K.asDiagonal() * (rest * error) + D * (rest * pose.twist().vector) +
                       Lambda * (rest * pose.acceleration().vector);
    const VectorXd F = rest * P - VectorXd(D * V) + f - D_f * V;
    const MatrixXd N = null_space_projector(J, M);
    const VectorXd D_N = 2 * (10 * M.diagonal().array()).sqrt();
    const VectorXd null = N * (10 * (bent(7) - q) - D_N.asDiagonal() * N.transpose() * dq);
    const VectorXd expected = J.transpose() * F + null + bench.plain.coriolis(q, dq);
    EXPECT_NEAR((bench.rig.tau(0) - expected).norm(), 0, 2e-4 * (1 + expected.norm())) << "trial " << trial;
  }
  EXPECT_GE(checked, 12);
}

// A valve: a torsional spring about one axis of the world, on a tilted base. It settles at theta = M / k.
TEST(HybridForce, AMomentTurnsAValveUntilItsSpringBalancesIt) {
  Draw draw(203);
  for (const double sign : {1.0, -1.0}) {
    Bench bench(Pose{rotation_from_rpy({0.5, -0.3, 1.0}), Vector3(0.2, -0.1, 0.3)});
    bench.rig.bound({});
    bench.select(5);
    ASSERT_EQ(bench.rig.start(), LawResult::ok);
    const Pose start = bench.X();
    bench.want(six({9, 9, 9}, {4, 4, sign * 1.5}));  // what is not selected is ignored
    constexpr double kSpring = 15;                   // [N m/rad]
    Observer observer;
    double angle = 0;
    for (int t = 0; t < 20000; ++t) {
      bench.ticks(1);
      angle = log_rotation(bench.X().rotation * start.rotation.transpose()).z();
      const double moment = kSpring * angle + 0.3 * bench.V()[5];
      bench.feel(observer.update(six(Vector3::Zero(), {0, 0, moment})));
      bench.move(six(Vector3::Zero(), {0, 0, -moment}));
    }
    EXPECT_NEAR(angle, sign * 1.5 / kSpring, 1e-3);
    EXPECT_LT(bench.V().norm(), 1e-3);
    EXPECT_LT((bench.X().position - start.position).norm(), 1e-3);
    const Vector3 turned = log_rotation(bench.X().rotation * start.rotation.transpose());
    EXPECT_LT(std::hypot(turned.x(), turned.y()), 1e-3);
  }
}

// Two forces at once along axes of the hand, against two walls that meet in a corner, on a tilted base.
TEST(HybridForce, TwoForcesPressIntoACorner) {
  Bench bench(Pose{rotation_from_rpy({-0.4, 0.6, -0.8}), Vector3(-0.1, 0.3, 0.1)});
  bench.rig.bound({});
  bench.select(0);
  bench.select(2);
  bench.rig.set("force_frame", {1});
  ASSERT_EQ(bench.rig.start(), LawResult::ok);
  const Pose start = bench.X();
  const Matrix3 R = start.rotation;
  bench.want(six(R * Vector3(-8, 5, 12), Vector3::Zero()));
  constexpr double kWall = 5000, kGap = 0.01;
  Observer observer;
  Vector3 pressed;
  double fastest = 0;
  for (int t = 0; t < 6000; ++t) {
    bench.ticks(1);
    const Vector3 moved = R.transpose() * (bench.X().position - start.position);
    const Vector3 v = R.transpose() * bench.V().head<3>();
    pressed.setZero();
    if (moved.x() < -kGap) pressed.x() = std::min(0.0, kWall * (moved.x() + kGap) + 60 * v.x());
    if (moved.z() > kGap) pressed.z() = std::max(0.0, kWall * (moved.z() - kGap) + 60 * v.z());
    if (t < 400) fastest = std::max(fastest, v.norm());
    bench.feel(observer.update(six(R * pressed, Vector3::Zero())));
    bench.move(six(R * -pressed, Vector3::Zero()));
  }
  EXPECT_NEAR(pressed.x(), -8, 0.05);
  EXPECT_NEAR(pressed.z(), 12, 0.05);
  const Vector3 error = R.transpose() * (bench.X().position - start.position);
  EXPECT_NEAR(error.y(), 0, 5e-4);
  EXPECT_LT(log_rotation(bench.X().rotation * R.transpose()).norm(), 5e-3);
  EXPECT_LT(fastest, 0.04);  // two axes at the speed of approach
}

// A tilted plate under the tool: with no moment about x and y, the tool lies flat on it; the impedance alone
// stays tilted.
TEST(HybridForce, ZeroMomentsLayAToolFlat) {
  for (const bool aligns : {true, false}) {
    Bench bench;
    bench.rig.bound({});
    bench.select(2);
    if (aligns) {
      bench.select(3);
      bench.select(4);
    }
    bench.rig.set("moment_threshold_nm", {0.1});
    ASSERT_EQ(bench.rig.start(), LawResult::ok);
    const Pose start = bench.X();
    bench.want(six({0, 0, -15}, Vector3::Zero()));
    // Four springs at the corners of a square of 6 cm, fixed to the tool, against a plane of this slope.
    const Vector3 normal = Vector3(0.06, -0.04, 1).normalized();
    Observer observer;
    Vector3 up;
    for (int t = 0; t < 6000; ++t) {
      bench.ticks(1);
      const Matrix3 turned = bench.X().rotation * start.rotation.transpose();
      Vector6 on_arm = Vector6::Zero();
      for (const double x : {-0.03, 0.03}) {
        for (const double y : {-0.03, 0.03}) {
          const Vector3 lever = turned * Vector3(x, y, 0);
          const Vector3 p = bench.X().position + lever;
          const Vector3 v = bench.V().head<3>() + Vector3(bench.V().tail<3>()).cross(lever);
          const double depth = -normal.dot(p - start.position) - 0.005;
          const double push = depth > 0 ? std::max(0.0, 3000 * depth - 40 * normal.dot(v)) : 0;
          on_arm += six(push * normal, lever.cross(push * normal));
        }
      }
      bench.feel(observer.update(-on_arm));
      bench.move(on_arm);
      up = turned * Vector3::UnitZ();
    }
    const double tilt = std::acos(std::min(1.0, up.dot(normal)));
    if (aligns) {
      EXPECT_LT(tilt, 0.01);
    } else {
      EXPECT_GT(tilt, 0.02);
    }
    EXPECT_NEAR(bench.three("estimated_force_n").z(), -15, 0.3);
  }
}

// Selecting and releasing axes, another frame and other gains, while spring and forces are far from rest: no
// joint's torque changes by more than 1 N m per period (the limit of its rate); with a usual pull far less.
TEST(HybridForce, SelectingAndReleasingCausesNoStep) {
  Draw draw(207);
  for (int trial = 0; trial < 8; ++trial) {
    Bench bench(draw.pose(1));
    bench.rig.bound({});
    ASSERT_EQ(bench.rig.start(), LawResult::ok);
    const Pose start = bench.rig.input("pose").pose();
    // Pulled aside by 5 cm and 0.2 rad: 20 N, 4 N m.
    bench.rig.input("pose").set(
        pose_target({exp_rotation(0.2 * draw.vector3(1).normalized()) * start.rotation,
                     start.position + 0.05 * draw.vector3(1).normalized()}));
    Vector3 moment = draw.vector3(1);
    bench.want(six(draw.vector3(15), moment));
    moment = draw.vector3(1);
    bench.feel(six(draw.vector3(15), moment));
    bench.ticks(2500);
    JointVector before = bench.rig.tau(0);
    double step = 0, changed = 0;
    const JointVector at_first = before;
    for (int t = 0; t < 6000; ++t) {
      if (t % 150 == 0) {
        const int axis = static_cast<int>(draw.index(6));
        bench.select(axis, draw.coin());
      }
      if (t % 1000 == 500) bench.rig.approach("force_proportional", {draw.uniform(0, 0.3)});
      if (t % 2000 == 700) bench.rig.set("force_frame", {t % 4000 == 700 ? 1.0 : 0.0});
      if (t % 1500 == 900) {
        moment = draw.vector3(1);
        bench.feel(six(draw.vector3(15), moment));
      }
      bench.ticks(1);
      step = std::max(step, (bench.rig.tau(0) - before).cwiseAbs().maxCoeff());
      changed = std::max(changed, (bench.rig.tau(0) - at_first).cwiseAbs().maxCoeff());
      before = bench.rig.tau(0);
    }
    EXPECT_LT(step, 0.5) << trial;
    EXPECT_GT(changed, 3) << trial;
  }
}

// Along a selected axis the set-point follows the arm; released, the arm stays. The next goal is absolute.
TEST(HybridForce, AReleasedAxisStaysAndTheNextGoalIsAbsolute) {
  Bench bench;
  bench.rig.bound({});
  bench.select(0);
  bench.select(5);
  ASSERT_EQ(bench.rig.start(), LawResult::ok);
  const Pose start = bench.X();
  const auto led = [&](const Vector6& push, int ticks) {
    for (int t = 0; t < ticks; ++t) {
      bench.ticks(1);
      bench.move(push);
    }
  };
  led(six({8, 0, 0}, {0, 0, 0.8}), 2500);  // somebody leads it
  led(Vector6::Zero(), 500);
  const Pose there = bench.X();
  ASSERT_GT(there.position.x() - start.position.x(), 0.02);
  ASSERT_GT(log_rotation(there.rotation * start.rotation.transpose()).z(), 0.05);
  bench.select(0, false);
  bench.select(5, false);
  led(Vector6::Zero(), 1500);
  EXPECT_LT((bench.X().position - there.position).norm(), 2e-3);
  EXPECT_LT(log_rotation(bench.X().rotation * there.rotation.transpose()).norm(), 5e-3);
  const Pose goal{exp_rotation({0.05, 0.1, 0}) * start.rotation, start.position + Vector3(-0.02, 0.03, 0.04)};
  bench.rig.input("pose").set(pose_target(goal, 1));
  led(Vector6::Zero(), 7000);
  EXPECT_LT((bench.X().position - goal.position).norm(), 1e-3);
  EXPECT_LT(log_rotation(bench.X().rotation * goal.rotation.transpose()).norm(), 2e-3);
}

// Free axes without a desired force only take energy: what the arm and the springs of the other axes have
// never grows.
TEST(HybridForce, FreeAxesOnlyDissipate) {
  Draw draw(208);
  for (int trial = 0; trial < 6; ++trial) {
    Bench bench(draw.pose(1));
    bench.rig.set("nullspace_stiffness_nm_per_rad", {0});
    bench.rig.set("rotational_stiffness_nm_per_rad", {20});
    bool on[3];
    for (int i = 0; i < 3; ++i) bench.select(i, on[i] = draw.coin());
    ASSERT_EQ(bench.rig.start(), LawResult::ok);
    const Pose start = bench.X();
    bench.ticks(300);
    bench.rig.place(0, bent(7) + draw.joints(7, 0.05), draw.joints(7, 0.4));
    const auto energy = [&] {
      const Vector6 e = pose_error(start, bench.X());
      double sum = bench.rig.kinetic_energy(0) + 0.5 * 20 * e.tail<3>().squaredNorm();
      for (int i = 0; i < 3; ++i) sum += on[i] ? 0 : 0.5 * 400 * e[i] * e[i];
      return sum;
    };
    double before = energy();
    const double first = before;
    for (int t = 0; t < 1500; ++t) {
      bench.ticks(1);
      bench.rig.integrate(0.001, {joint_constant(7, 0)}, 4);
      const double now = energy();
      EXPECT_LT(now, before + 2e-4 * first) << trial << " " << t;  // the torque is held over a period
      before = now;
    }
    EXPECT_LT(before, 0.5 * first);  // nothing damps the null space without its spring
  }
}

TEST(HybridForce, IsInvariantToThePoseOfTheWorldInTheHandsFrame) {
  Draw draw(209);
  const Pose X = draw.pose(2), X_WB = draw.pose(1);
  Bench here(X_WB), there(X * X_WB);
  const Vector3 f = draw.vector3(10), m = draw.vector3(2), f_hat = draw.vector3(10), m_hat = draw.vector3(2);
  const JointVector q = bent(7) + draw.joints(7, 0.02), dq = draw.joints(7, 0.2);
  for (Bench* bench : {&here, &there}) {
    const Matrix3 R = bench == &here ? Matrix3(Matrix3::Identity()) : X.rotation;
    for (const int axis : {0, 2, 4}) bench->select(axis);
    bench->rig.set("force_frame", {1});
    bench->rig.set("translational_stiffness_n_per_m", {400});
    ASSERT_EQ(bench->rig.start(), LawResult::ok);
    bench->want(six(R * f, R * m));
    bench->feel(six(R * f_hat, R * m_hat));
    bench->ticks(500);
    bench->rig.place(0, q, dq);
    bench->ticks(20);
  }
  EXPECT_GT(here.rig.tau(0).norm(), 1);
  EXPECT_NEAR((here.rig.tau(0) - there.rig.tau(0)).norm(), 0, 1e-7);
}

// The estimate is about K; the law controls the wrench at E.
TEST(HybridForce, TheMomentIsThatAtTheEndEffector) {
  Bench bench;
  const Vector3 p_EK(0.1, 0.05, -0.2);
  bench.rig.frames(0, {kTool, {Matrix3::Identity(), p_EK}});
  bench.rig.place(0, bent(7), joint_constant(7, 0));
  ASSERT_EQ(bench.rig.start(), LawResult::ok);
  const Vector3 f(3, -4, 5), at_hand(0.2, 0.1, -0.3);
  const Vector3 lever = bench.X().rotation * p_EK;  // of K, from E
  bench.feel(six(f, at_hand - lever.cross(f)));
  bench.ticks(1);
  EXPECT_LT((bench.three("estimated_moment_nm") - at_hand).norm(), 1e-12);
}

TEST(HybridForce, RefusesWhatItCannotControl) {
  Bench bench;
  bench.rig.state(0).has_wrench_estimate = false;
  EXPECT_EQ(bench.rig.start(), LawResult::fault);
  for (int axis = 0; axis < 6; ++axis) {
    for (const double bad :
         {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity()}) {
      Bench felt, asked;
      for (Bench* each : {&felt, &asked}) {
        each->select(axis);
        ASSERT_EQ(each->rig.start(), LawResult::ok);
        each->ticks(50);
      }
      Vector6 F = Vector6::Zero();
      F[axis] = bad;
      felt.feel(F);
      EXPECT_EQ(felt.rig.tick(0.001), LawResult::fault);
      asked.want(F);
      EXPECT_EQ(asked.rig.tick(0.001), LawResult::fault);
    }
  }
}

}  // namespace
}  // namespace multipanda::hybrid_force_test
