#include <gtest/gtest.h>

#include "core/controllets/damping_design.hpp"
#include "core/controllets/task_spring.hpp"
#include "core/testing/ufic_axes_bench.hpp"

// `ufic` with forces and moments along a subset of six axes.
namespace multipanda::ufic_axes_test {
namespace {

// In contact along every selected axis, filters at rest, tanks full: the torque is the stated sum, computed
// with explicit inverses. In the frame of the end effector the feedback is left out, since the estimate
// turns against it in the last tick.
TEST(UficAxes, TorqueIsTheStatedLaw) {
  Draw draw(2101);
  int checked = 0;
  for (int trial = 0; trial < 16; ++trial) {
    Bench bench(draw.pose(1));
    const bool of_effector = trial % 2 == 1;
    const double P = of_effector ? 0 : 0.15;
    bench.rig.set("force_frame", {of_effector ? 1.0 : 0.0});
    bench.rig.set("translational_stiffness_n_per_m", {400});
    bench.rig.set("force_integral_per_s", {0});
    bench.rig.set("moment_integral_per_s", {0});
    bench.rig.set("force_proportional", {P});
    bench.rig.set("force_damping_n_s_per_m", {70});
    Vector6 selected = Vector6::Zero(), desired = Vector6::Zero(), felt = Vector6::Zero();
    for (const int axis : {trial % 3, (trial + 1) % 3, 3 + trial / 3 % 3}) {
      bench.select(axis);
      const double side = draw.uniform(-1, 1) < 0 ? -1 : 1;
      selected[axis] = 1;
      desired[axis] = side * (axis < 3 ? 12 : 1.0);
      felt[axis] = side * (axis < 3 ? 8 : 0.8);
    }
    ASSERT_EQ(bench.rig.start(), LawResult::ok);
    const Matrix3 R = of_effector ? bench.X().rotation : Matrix3(Matrix3::Identity());
    const Vector6 F_d = both(R) * desired, F_hat = both(R) * felt;
    bench.want(F_d);
    bench.feel(F_hat);
    bench.ticks(3000);
    for (int i = 0; i < 6; ++i) {
      EXPECT_EQ(bench.rig.output("axes_in_contact")[static_cast<std::size_t>(i)], selected[i]) << i;
    }
    const Pose start = bench.rig.input("pose").pose();
    bench.rig.input("pose").set(pose_target(
        {exp_rotation(draw.vector3(0.2)) * start.rotation, start.position + draw.vector3(0.1)}, 1.0));
    bench.ticks(300);
    const JointVector q = bent(7) + draw.joints(7, 0.1), dq = draw.joints(7, 0.05);
    bench.rig.place(0, q, dq);
    ASSERT_EQ(bench.rig.update(), LawResult::ok);
    if (bench.rig.terms(0).task().floored) continue;
    ++checked;

    const Reference& pose = bench.rig.input("pose");
    const MatrixXd J = bench.plain.jacobian(q), M = bench.plain.mass(q);
    const MatrixXd Lambda = task_inertia(J, M);
    VectorXd K(6);
    K << 400, 400, 400, 20, 20, 20;
    const Matrix6 D = task_damping(Lambda, Matrix6(K.asDiagonal()), 1);
    const Pose X = bench.plain.end_effector(q);
    const Eigen::AngleAxisd turn(pose.pose().rotation * X.rotation.transpose());
    VectorXd F(6);
    F << 400 * (pose.pose().position - X.position), 20 * turn.angle() * turn.axis();
    const VectorXd V = J * dq;
    F += D * (pose.twist().vector - V) + Lambda * pose.acceleration().vector;
    const Matrix6 frame = both(of_effector ? X.rotation : Matrix3(Matrix3::Identity()));
    const Vector6 d = frame.transpose() * F_d, e = d - Vector6(frame.transpose() * F_hat);
    Vector6 along = frame.transpose() * (pose.twist().vector - Vector6(V));
    along.tail<3>().setZero();
    // D_z is at most 60 1/s times the inertia, which axes that move one joint share.
    const MatrixXd A = frame.transpose() * inverse(Lambda) * frame;
    MatrixXd scaled = MatrixXd::Zero(6, 6);
    for (int i = 0; i < 6; ++i)
      for (int j = 0; j < 6; ++j)
        scaled(i, j) = selected[i] * selected[j] * A(i, j) / std::sqrt(A(i, i) * A(j, j));
    const double shared = std::max(1.0, eigenvalues(scaled).real().maxCoeff());
    Vector6 D_z;
    for (int i = 0; i < 6; ++i) D_z[i] = std::min(70.0, 60 / A(i, i) / shared);
    F += frame * selected.cwiseProduct(Vector6(d + P * e + D_z.cwiseProduct(along)));
    const MatrixXd N = null_space_projector(J, M);
    const VectorXd D_N = 2 * (10 * M.diagonal().array()).sqrt();
    const VectorXd null = N * (10 * (bent(7) - q) - D_N.asDiagonal() * N.transpose() * dq);
    const VectorXd expected = J.transpose() * F + null + bench.plain.coriolis(q, dq);
    EXPECT_NEAR((bench.rig.tau(0) - expected).norm(), 0, 1e-4 * (1 + expected.norm())) << "trial " << trial;
  }
  EXPECT_GE(checked, 8);
}

// Springs along x, z and about y of the tool: each axis comes to its own force, which a single direction
// cannot. The observer of the estimate is a low-pass.
TEST(UficAxes, EachAxisReachesItsForce) {
  for (const double stiffness : {1e3, 1e4}) {
    Bench bench(Pose{rotation_from_rpy({0.2, -0.1, 1}), Vector3(0.3, -0.2, 0.1)});
    bench.rig.bound({});
    bench.rig.set("force_frame", {1});
    for (const int axis : {0, 2, 4}) bench.select(axis);
    ASSERT_EQ(bench.rig.start(), LawResult::ok);
    const Pose X0 = bench.X();
    const Vector6 desired = six({6, 0, -10}, {0, 1, 0});
    Observer observer;
    bench.want(both(X0.rotation) * desired);
    // The set-point leads the tool into the surfaces.
    bench.rig.input("pose").start(X0 * Pose{rotation_from_rpy({0, 0.035, 0}), Vector3(0.005, 0, -0.01)});
    Vector6 felt = Vector6::Zero();
    for (int k = 0; k < 8000; ++k) {
      const Vector6 way = both(X0.rotation).transpose() * pose_error(bench.X(), X0);
      felt.setZero();
      felt[0] = std::max(0.0, stiffness * way[0]);
      felt[2] = std::min(0.0, stiffness * way[2]);
      felt[4] = std::max(0.0, 0.05 * stiffness * way[4]);
      const Vector6 exerted = both(X0.rotation) * felt;
      bench.feel(observer.update(exerted));
      bench.ticks(1);
      bench.move(-exerted);
    }
    EXPECT_NEAR(felt[0], desired[0], 0.1) << stiffness;
    EXPECT_NEAR(felt[2], desired[2], 0.1) << stiffness;
    EXPECT_NEAR(felt[4], desired[4], 0.02) << stiffness;
  }
}

// The tanks' book is complete along axes, too: on a path that is prescribed, what goes into the arm, the
// spring and the tanks together never grows.
TEST(UficAxes, TanksSupplyAllEnergyThatGoesIn) {
  Draw draw(2102);
  for (int trial = 0; trial < 8; ++trial) {
    Bench bench;
    bench.rig.set("tank_start_j", {trial % 2 == 0 ? 50.0 : 0.15});
    bench.rig.set("translational_stiffness_n_per_m", {400});
    bench.rig.set("force_frame", {trial % 4 < 2 ? 0.0 : 1.0});
    for (const int axis : {0, 2, 3}) bench.select(axis);
    ASSERT_EQ(bench.rig.start(), LawResult::ok);
    bench.want(six({9, 0, -15}, {1.5, 0, 0}));
    bench.ticks(1);
    const double initial = bench.number("force_tank_j") + bench.number("impedance_tank_j");
    const Pose start = bench.rig.input("pose").pose();
    bench.rig.input("pose").set(
        pose_target({exp_rotation(draw.vector3(0.3)) * start.rotation, start.position + draw.vector3(0.2)}));
    const TaskStiffness K{400 * Matrix3::Identity(), 20 * Matrix3::Identity()};
    const JointVector direction = draw.joints(7, 0.1);
    JointVector q = bent(7), tau = bench.rig.tau(0);
    double into_arm = 0, pushed = 0;
    for (int k = 1; k <= 1500; ++k) {
      const double t = 0.001 * k;
      const JointVector next = bent(7) + direction * std::sin(3 * t);
      into_arm += tau.dot(next - q);
      q = next;
      bench.rig.state(0).tau_J_d = tau;
      bench.feel(six({6 + 5 * std::sin(5 * t), 0, -12 - 8 * std::sin(2 * t)}, {1 + std::cos(3 * t), 0, 0}));
      bench.rig.place(0, q, direction * 3 * std::cos(3 * t));
      ASSERT_EQ(bench.rig.tick(0.001), LawResult::ok);
      tau = bench.rig.tau(0);
      pushed = std::max(pushed, bench.of_axes().norm());
    }
    const double s = 1 + bench.number("alpha_i");
    const double spring =
        s * spring_energy(K, pose_error(bench.rig.input("pose").pose(), bench.plain.end_effector(q)));
    const double tank = bench.number("force_tank_j") + bench.number("impedance_tank_j");
    EXPECT_LE(into_arm + spring + tank, initial + 1e-9) << trial;  // less the overflow, which is zero here
    if (trial % 2 == 0) {
      EXPECT_NEAR(into_arm + spring + tank, initial, 1e-6) << trial;
      EXPECT_GT(pushed, 10);
    }
    EXPECT_GT(bench.number("force_tank_j"), -0.02);
  }
}

// An estimate that shows contact where nothing is: neither one axis nor three throw or spin the hand, with
// the law that is passive and with the paper's.
TEST(UficAxes, AWrongEstimateDoesNotThrowOrSpinTheHand) {
  for (const double valve : {0.0, 1.0}) {
    for (const auto& axes : {std::vector<int>{5}, {3, 4, 5}, {2}, {0, 1, 2}, {0, 1, 2, 3, 4, 5}}) {
      for (const double felt : {-1.0, 0.0, 0.1, 1.0}) {
        Bench bench;
        bench.rig.bound({});
        bench.rig.set("valve_law", {valve});
        bench.rig.set("force_frame", {1});
        bench.rig.set("force_damping_n_s_per_m", {0});
        bench.rig.set("moment_integral_per_s", {50});
        bench.rig.set("moment_integral_limit_nm", {5});
        bench.rig.set("force_integral_limit_n", {100});
        for (const int axis : axes) bench.select(axis);
        ASSERT_EQ(bench.rig.start(), LawResult::ok);
        Vector6 desired = Vector6::Zero();
        for (const int axis : axes) desired[axis] = axis < 3 ? 30 : 10;
        bench.want(both(bench.X().rotation) * desired);
        double fastest = 0, spin = 0;
        for (int k = 0; k < 2000; ++k) {
          bench.feel(felt * (both(bench.X().rotation) * desired));
          bench.ticks(1);
          bench.move(Vector6::Zero());
          fastest = std::max(fastest, bench.V().head<3>().norm());
          spin = std::max(spin, bench.V().tail<3>().norm());
        }
        EXPECT_LT(fastest, 1.5 * 0.25) << valve << ' ' << axes.size() << " axes, felt " << felt;
        EXPECT_LT(spin, 2.0) << valve << ' ' << axes.size() << " axes, felt " << felt;
      }
    }
  }
}

// Forces, moments and the impedance together keep to their bounds for an arm that stands still and feels all
// of its push, and a change of the selection has no step.
TEST(UficAxes, KeepsToTheBoundsWithoutSteps) {
  Draw draw(2103);
  Bench bench;
  bench.rig.bound({});
  ASSERT_EQ(bench.rig.start(), LawResult::ok);
  Pose goal = bench.X();
  goal.position += Vector3(0.02, 0, -0.02);
  goal.rotation = exp_rotation({0.05, 0, 0.05}) * goal.rotation;
  bench.rig.input("pose").set(pose_target(goal, 1.5));
  bench.want(six({30, 0, -40}, {8, 0, 5}));
  Vector6 before = Vector6::Zero();
  double force = 0, moment = 0, step = 0, step_m = 0, of_axes = 0, largest = 0;
  for (int k = 0; k < 12000; ++k) {
    if (k == 2000) bench.select(2);
    if (k == 3000) bench.select(0);
    if (k == 4000) bench.select(3);
    if (k == 5000) bench.select(5);
    if (k == 6000) bench.select(2, false);
    if (k == 8000) bench.want(six({-30, 0, -40}, {-8, 0, 5}));
    if (k == 10000) {
      for (int axis = 0; axis < 6; ++axis) bench.select(axis, false);
    }
    bench.ticks(1);
    const Vector6 push = bench.rig.terms(0).task().J_bar.transpose() * bench.rig.tau(0);
    if (k > 1800 && k < 10000) {  // after the motion, and before the law along one direction comes back
      step = std::max(step, (push - before).head<3>().norm());
      step_m = std::max(step_m, (push - before).tail<3>().norm());
    }
    before = push;
    force = std::max(force, push.head<3>().norm());
    moment = std::max(moment, push.tail<3>().norm());
    of_axes = std::max(of_axes, bench.of_axes().norm());
    largest = std::max(largest, bench.of_axes().tail<3>().norm());
    bench.feel(push);
  }
  EXPECT_LE(force, 60.5);
  EXPECT_LE(moment, 15.2);
  EXPECT_LE(step, 0.8);
  EXPECT_LE(step_m, 0.2);
  EXPECT_GT(of_axes, 20);
  EXPECT_GT(largest, 2);
}

// None selected, the moment of the input has no effect: to the bit.
TEST(UficAxes, WithoutAxesTheMomentIsIgnored) {
  Bench with, without;
  for (Bench* bench : {&with, &without}) {
    ASSERT_EQ(bench->rig.start(), LawResult::ok);
    bench->want(six({0, 0, -10}, bench == &with ? Vector3(1, 2, 3) : Vector3(0, 0, 0)), 2);
    bench->feel(six({1, 0, -9}, {0.1, 0.2, 0.3}));
  }
  for (int k = 0; k < 3000; ++k) {
    with.ticks(1);
    without.ticks(1);
    if (k > 2500) {
      EXPECT_EQ((with.rig.tau(0) - without.rig.tau(0)).norm(), 0) << k;
    }
  }
}

// The estimate is about K; the law controls the wrench at E.
TEST(UficAxes, TheMomentIsThatAtTheEndEffector) {
  const Vector3 f(3, -4, -9), at_hand(0.8, 1, -0.6), p_EK(0.1, 0.05, -0.2);
  std::vector<JointVector> tau;
  for (const Vector3& p : {Vector3(Vector3::Zero()), p_EK}) {
    for (const Vector3& moment : {at_hand, Vector3(-at_hand)}) {
      Bench bench;
      bench.rig.frames(0, {kTool, {Matrix3::Identity(), p}});
      bench.rig.place(0, bent(7), joint_constant(7, 0));
      bench.select_all({2, 3, 4, 5});
      ASSERT_EQ(bench.rig.start(), LawResult::ok);
      bench.want(six({0, 0, -12}, at_hand));
      bench.feel(six(f, moment - (bench.X().rotation * p).cross(f)));
      bench.ticks(600);
      tau.push_back(bench.rig.tau(0));
    }
  }
  EXPECT_LT((tau[2] - tau[0]).norm(), 1e-9) << "wherever K is";
  EXPECT_LT((tau[3] - tau[1]).norm(), 1e-9);
  EXPECT_GT((tau[1] - tau[0]).norm(), 0.1) << "the moment counts";
}

// The other side is pressed only after contact is lost, and softly.
TEST(UficAxes, TheOtherSideWaitsForTheLossOfContact) {
  Bench bench;
  bench.select(2);
  bench.rig.set("force_integral_per_s", {0});
  ASSERT_EQ(bench.rig.start(), LawResult::ok);
  bench.want(six({0, 0, -10}, Vector3::Zero()));
  bench.feel(six({0, 0, -10}, Vector3::Zero()));
  bench.ticks(1000);
  EXPECT_NEAR(bench.of_axes()[2], -10, 0.1);
  bench.want(six({0, 0, 10}, Vector3::Zero()));
  bench.ticks(1000);
  EXPECT_EQ(bench.of_axes()[2], 0);
  bench.feel(six({0, 0, 10}, Vector3::Zero()));
  double before = 0, step = 0;
  for (int k = 0; k < 1500; ++k) {
    bench.ticks(1);
    step = std::max(step, std::abs(bench.of_axes()[2] - before));
    before = bench.of_axes()[2];
  }
  EXPECT_NEAR(before, 10, 0.1);
  EXPECT_LE(step, 0.3);
}

}  // namespace
}  // namespace multipanda::ufic_axes_test
