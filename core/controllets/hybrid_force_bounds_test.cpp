// What `hybrid_force` keeps to: speeds of the hand, of light axes and of set-points, forces and moments,
// and no step.
#include <string>

#include "core/controllets/damping_design.hpp"
#include "core/testing/hybrid_force_bench.hpp"

namespace multipanda::hybrid_force_test {
namespace {

// Nothing to press on, everything selected, far more desired than is allowed: it moves at the speeds of
// approach, never pushes harder than desired, and the integrals stay empty.
TEST(HybridForceBounds, InFreeSpaceSelectedAxesDoNotRunAway) {
  Draw draw(204);
  for (int trial = 0; trial < 6; ++trial) {
    Bench bench(draw.pose(1));
    bench.rig.bound({});
    for (int i = 0; i < 6; ++i) bench.select(i, trial == 0 || i % 6 == trial - 1 || draw.coin());
    bench.rig.set("force_frame", {trial % 2 == 0 ? 1.0 : 0.0});
    ASSERT_EQ(bench.rig.start(), LawResult::ok);
    const Vector3 force = 100 * draw.vector3(1).normalized(), moment = 20 * draw.vector3(1).normalized();
    bench.want(six(force, moment));
    double fast = 0, turning = 0;
    for (int t = 0; t < 2500; ++t) {
      bench.ticks(1);
      bench.move(Vector6::Zero());
      if (bench.rig.terms(0).task().floored) break;
      fast = std::max(fast, bench.V().head<3>().norm());
      turning = std::max(turning, bench.V().tail<3>().norm());
    }
    EXPECT_LT(fast, 1.5 * 0.02 * std::sqrt(3.0)) << trial;
    EXPECT_LT(turning, 1.5 * 0.1 * std::sqrt(3.0)) << trial;
    EXPECT_GT(fast + turning, 0.01) << trial;
  }
}

// A contact that disappears at full force and moment.
TEST(HybridForceBounds, LosingContactTheHandStaysSlow) {
  Draw draw(205);
  double fast = 0, turning = 0;
  for (int trial = 0; trial < 8; ++trial) {
    Bench bench(draw.pose(1));
    bench.rig.bound({});
    for (int i = 0; i < 6; ++i) bench.select(i, draw.coin() || i == trial % 6);
    ASSERT_EQ(bench.rig.start(), LawResult::ok);
    const Vector6 F = six(40 * draw.vector3(1).normalized(), 3 * draw.vector3(1).normalized());
    bench.want(F);
    bench.feel(F);
    bench.ticks(2000);
    bench.feel(Vector6::Zero());
    const Pose start = bench.X();
    for (int t = 0; t < 1000; ++t) {
      bench.ticks(1);
      bench.move(Vector6::Zero());
      if (bench.rig.terms(0).task().floored) break;
      fast = std::max(fast, bench.V().head<3>().norm());
      turning = std::max(turning, bench.V().tail<3>().norm());
    }
    EXPECT_LT((bench.X().position - start.position).norm(), 0.15) << trial;
  }
  RecordProperty("fast_m_per_s", std::to_string(fast));
  RecordProperty("turning_rad_per_s", std::to_string(turning));
  EXPECT_GT(fast, 0.05);
  EXPECT_LT(fast, 1.5 * 0.25);
  EXPECT_LT(turning, 2);
}

// An estimate that is wrong by much in free air draws the hand; no faster than allowed.
TEST(HybridForceBounds, AWrongEstimateDoesNotThrowTheHand) {
  double fast = 0, turning = 0;
  for (const double sign : {1.0, -1.0}) {
    for (int axis = 0; axis < 6; ++axis) {
      Bench bench;
      bench.rig.bound({});
      if (axis < 3) {
        bench.rig.set("force_proportional", {5});
        bench.rig.set("force_integral_per_s", {20});
        bench.rig.set("force_integral_limit_n", {100});
      }
      bench.select(axis);
      ASSERT_EQ(bench.rig.start(), LawResult::ok);
      Vector6 felt = Vector6::Zero();
      felt[axis] = sign * (axis < 3 ? 30 : 4);
      bench.feel(felt);
      for (int t = 0; t < 1000; ++t) {
        bench.ticks(1);
        bench.move(Vector6::Zero());
        fast = std::max(fast, bench.V().head<3>().norm());
        turning = std::max(turning, std::abs(bench.V()[axis < 3 ? 3 : axis]));
      }
    }
  }
  RecordProperty("fast_m_per_s", std::to_string(fast));
  RecordProperty("turning_rad_per_s", std::to_string(turning));
  EXPECT_GT(fast, 0.05);
  EXPECT_LT(fast, 1.5 * 0.25);
  EXPECT_LT(turning, 2);
}

// Whatever is felt and asked, at rest the hand presses with the bounds at most.
TEST(HybridForceBounds, ForcesAndSpringTogetherKeepToTheBounds) {
  Draw draw(206);
  double hardest = 0, strongest = 0;
  for (int trial = 0; trial < 16; ++trial) {
    Bench bench(draw.pose(1));
    bench.rig.bound({});
    bench.rig.set("nullspace_stiffness_nm_per_rad", {0});
    bench.rig.set("force_frame", {trial % 2 == 0 ? 1.0 : 0.0});
    bench.rig.set("force_proportional", {draw.uniform(0, 5)});
    bench.rig.set("force_integral_limit_n", {100});
    bench.rig.set("moment_integral_limit_nm", {20});
    for (int i = 0; i < 6; ++i) bench.select(i, draw.coin());
    ASSERT_EQ(bench.rig.start(), LawResult::ok);
    const Pose start = bench.rig.input("pose").pose();
    bench.rig.input("pose").set(
        pose_target({exp_rotation(draw.vector3(1)) * start.rotation, start.position + draw.vector3(0.4)}));
    const Vector3 moment = draw.vector3(20);
    bench.want(six(draw.vector3(90), moment));
    const Vector3 felt = draw.vector3(3);
    bench.feel(six(draw.vector3(20), felt));
    for (int t = 0; t < 3000; ++t) {
      if (t % 500 == 250) bench.select(static_cast<int>(draw.index(6)), draw.coin());
      bench.ticks(1);
      if (t % 10 != 0) continue;
      const Vector6 F = (bench.rig.terms(0).task().J_bar.transpose() * bench.rig.tau(0));
      hardest = std::max(hardest, F.head<3>().norm());
      strongest = std::max(strongest, F.tail<3>().norm());
    }
  }
  EXPECT_LE(hardest, 60.01);
  EXPECT_LE(strongest, 15.01);
  EXPECT_GT(hardest, 50);
  EXPECT_GT(strongest, 12);
}

// Three axes together keep to the bounds of one, also where nothing but the law damps them: in free space
// at the greatest speeds of approach, and drawn by an estimate that is wrong.
TEST(HybridForceBounds, AxesTogetherKeepToTheBoundsOfOne) {
  constexpr double kHand = 0.1, kTurning = 0.5;  // [m/s, rad/s]
  Draw draw(211);
  for (const bool moments : {false, true}) {
    double approach = 0, drawn = 0;
    for (int trial = 0; trial < 8; ++trial) {
      Bench bench(draw.pose(1));
      bench.rig.bound({.hand_speed = kHand});
      for (int i = 0; i < 3; ++i) bench.select(moments ? 3 + i : i);
      bench.rig.set("force_damping_n_s_per_m", {0});
      bench.rig.set("moment_damping_nm_s_per_rad", {0});
      bench.rig.set("approach_speed_m_per_s", {0.2});
      bench.rig.set("turning_speed_rad_per_s", {0.5});
      ASSERT_EQ(bench.rig.start(), LawResult::ok);
      // All three axes are as fast as one may be.
      Vector3 along;
      for (int i = 0; i < 3; ++i) along[i] = draw.coin() ? 1 : -1;
      const bool wrong = trial % 2 == 1;
      const Vector3 size = (moments ? 6.0 : 30.0) * along;
      const Vector6 F = moments ? six(Vector3::Zero(), size) : six(size, Vector3::Zero());
      if (wrong) {
        bench.feel(F);
      } else {
        bench.want(F);
      }
      double& fastest = wrong ? drawn : approach;
      for (int t = 0; t < 1500; ++t) {
        bench.ticks(1);
        bench.move(Vector6::Zero());
        if (bench.rig.terms(0).task().floored) break;
        fastest = std::max(fastest, (moments ? bench.V().tail<3>() : bench.V().head<3>()).norm());
      }
    }
    RecordProperty(moments ? "approach_rad_per_s" : "approach_m_per_s", std::to_string(approach));
    RecordProperty(moments ? "drawn_rad_per_s" : "drawn_m_per_s", std::to_string(drawn));
    const double limit = moments ? kTurning : kHand;
    EXPECT_LT(approach, 1.05 * limit);  // 5 %: axes that the inertia couples
    EXPECT_GT(approach, 0.8 * limit);
    EXPECT_LT(drawn, 1.05 * (moments ? 3 : 1.5) * limit);  // where the reduction ends
    EXPECT_GT(drawn, 0.5 * limit);
  }
}

// A wrist that its links alone give 0.001 kg m^2 about the tool's axis, all gains at their maxima, and an
// estimate in free air that is missing, of the wrong sign, or as if the goal were reached.
TEST(HybridForceBounds, AWrongMomentDoesNotSpinALightAxis) {
  double fastest = 0, least = 1;
  for (const int axis : {3, 4, 5}) {
    for (const double goal : {0.0, 3.0, 20.0, -20.0}) {
      for (const double felt : {0.0, 4.0, -4.0, 15.0, -15.0}) {
        Bench bench({}, hybrid_force_controllet(), light_wrist());
        bench.rig.bound({});
        bench.rig.set("force_frame", {1});
        bench.rig.set("moment_integral_per_s", {50});
        bench.rig.set("moment_integral_limit_nm", {20});
        bench.rig.set("force_proportional", {5});
        bench.rig.set("moment_damping_nm_s_per_rad", {0});
        bench.select(axis);
        ASSERT_EQ(bench.rig.start(), LawResult::ok);
        double turning = 0;
        for (int t = 0; t < 700; ++t) {
          const Vector3 a = bench.X().rotation.col(axis - 3);
          if (t == 0) bench.want(six(Vector3::Zero(), goal * a), 0.1);
          bench.feel(six(Vector3::Zero(), felt * a));
          bench.ticks(1);
          bench.move(Vector6::Zero());
          if (bench.rig.terms(0).task().floored) break;
          turning = std::max(turning, bench.V().tail<3>().norm());
          if (axis == 5) {
            const Matrix6& A = bench.rig.terms(0).task().mobility;
            least = std::min(least, 1 / a.dot(A.bottomRightCorner<3, 3>() * a));
          }
        }
        EXPECT_LT(turning, 1.1 * 1.5) << "axis " << axis << ", goal " << goal << ", felt " << felt;
        fastest = std::max(fastest, turning);
      }
    }
  }
  RecordProperty("turning_rad_per_s", std::to_string(fastest));
  EXPECT_GT(fastest, 0.3);
  EXPECT_LT(least, 0.002);  // a light axis, indeed
}

// A wrist of 0.002 kg m^2 that lies diagonally in the force frame, all three moments, torques that act 3 ms
// late: axes that share a joint share what it bears.
TEST(HybridForceBounds, MomentsThatShareALightJointBearADelay) {
  TestArm arm = light_wrist();
  arm.links[6].inertia_C = 2e-3 * Matrix3::Identity();
  arm.X_JF.rotation =
      Eigen::Quaterniond::FromTwoVectors(Vector3(1, 1, 1), Vector3::UnitZ()).toRotationMatrix() *
      kTool.rotation.transpose();
  constexpr int kLate = 3;
  double fastest = 0;
  for (const double goal : {0.0, 3.0, -15.0}) {
    for (const double felt : {0.0, 4.0, -15.0}) {
      Bench bench({}, hybrid_force_controllet(), arm);
      bench.rig.bound({});
      bench.rig.set("force_frame", {1});
      bench.rig.set("moment_integral_per_s", {50});
      bench.rig.set("moment_integral_limit_nm", {20});
      bench.rig.set("force_proportional", {5});
      for (const int axis : {3, 4, 5}) bench.select(axis);
      ASSERT_EQ(bench.rig.start(), LawResult::ok);
      std::vector<JointVector> sent(kLate, bench.rig.tau(0));
      double turning = 0;
      for (int t = 0; t < 700; ++t) {
        const Vector3 a = bench.X().rotation * Vector3(1, 1, 1).normalized();
        if (t == 0) bench.want(six(Vector3::Zero(), goal * a), 0.1);
        bench.feel(six(Vector3::Zero(), felt * a));
        bench.ticks(1);
        sent.push_back(bench.rig.tau(0));
        const JointVector acts = sent[static_cast<std::size_t>(t)];
        bench.rig.integrate(0.001, {acts - bench.rig.tau(0)}, 2);
        if (bench.rig.terms(0).task().floored) break;
        turning = std::max(turning, bench.V().tail<3>().norm());
      }
      EXPECT_LT(turning, 2) << "goal " << goal << ", felt " << felt;
      fastest = std::max(fastest, turning);
    }
  }
  RecordProperty("turning_rad_per_s", std::to_string(fastest));
  EXPECT_GT(fastest, 0.3);
}

// An approach and a goal across it share the hand's speed.
TEST(HybridForceBounds, ApproachAndGoalShareTheHandsSpeed) {
  Bench bench(Pose{rotation_from_rpy({0.2, -0.1, 1}), Vector3(0.3, -0.2, 0.1)});
  bench.rig.bound({.hand_speed = 0.1});
  bench.rig.set("approach_speed_m_per_s", {0.2});
  bench.select(2);
  ASSERT_EQ(bench.rig.start(), LawResult::ok);
  bench.want(six({0, 0, -40}, Vector3::Zero()));
  Pose goal = bench.X();
  goal.position += Vector3(0.1, 0.05, 0);
  bench.rig.input("pose").set(pose_target(goal));
  double fastest = 0, down = 0;
  for (int t = 0; t < 2500; ++t) {
    bench.ticks(1);
    bench.move(Vector6::Zero());
    fastest = std::max(fastest, bench.V().head<3>().norm());
    down = std::max(down, -bench.V()[2]);
  }
  EXPECT_LT(fastest, 1.1 * 0.1);  // while the goal gains speed, the axis loses it a little later
  EXPECT_GT(fastest, 0.09);
  EXPECT_GT(down, 0.06);  // and it does approach when the goal leaves it the speed
}

// The same wrist against a spring: where a reaction holds the axis, the whole moment is reached.
TEST(HybridForceBounds, ALightAxisThatIsHeldReachesItsMoment) {
  Bench bench({}, hybrid_force_controllet(), light_wrist());
  bench.rig.bound({});
  bench.rig.set("force_frame", {1});
  bench.select(5);
  ASSERT_EQ(bench.rig.start(), LawResult::ok);
  const Pose start = bench.X();
  const Vector3 a = start.rotation.col(2);
  bench.want(six(Vector3::Zero(), 3 * a));
  constexpr double kSpring = 15;  // [N m/rad]
  Observer observer;
  double moment = 0;
  for (int t = 0; t < 12000; ++t) {
    bench.ticks(1);
    const double angle = log_rotation(bench.X().rotation * start.rotation.transpose()).dot(a);
    moment = kSpring * angle + 0.05 * a.dot(Vector3(bench.V().tail<3>()));
    bench.feel(observer.update(six(Vector3::Zero(), moment * a)));
    bench.move(six(Vector3::Zero(), -moment * a));
  }
  EXPECT_NEAR(moment, 3, 0.02);
  EXPECT_LT(bench.V().norm(), 1e-3);
}

// Published contact over touch and release, for axes that are selected and others.
TEST(HybridForceBounds, ContactIsShownWhileThereIsOne) {
  Bench bench;
  bench.rig.bound({});
  ASSERT_EQ(bench.rig.start(), LawResult::ok);
  const auto touching = [&](double force, double moment) {
    bench.feel(six({0, 0, force}, {0, moment, 0}));
    bench.ticks(150);
    std::string shown;
    for (const double one : bench.rig.output("in_contact")) shown += one != 0 ? '1' : '0';
    return shown;
  };
  for (const bool selected : {false, true, false}) {
    bench.select(2, selected);
    EXPECT_EQ(touching(0, 0), "000000");
    EXPECT_EQ(touching(-1.5, 0.4), "000000");  // below the thresholds
    EXPECT_EQ(touching(-3, 0), "001000");
    EXPECT_EQ(touching(-1.5, 0.6), "001010");  // lost below half a threshold only
    EXPECT_EQ(touching(-0.5, 0.1), "000000");
    EXPECT_EQ(touching(4, -0.7), "001010");
    bench.select(2, !selected);  // in contact
    EXPECT_EQ(touching(4, -0.7), "001010");
    EXPECT_EQ(touching(0, 0), "000000");
  }
}

// Three released axes come back while the input's own motion goes the same way.
TEST(HybridForceBounds, ComingBackAndTheGoalShareTheHandsSpeed) {
  for (const double most : {0.25, 0.1}) {
    for (const bool far : {false, true}) {
      Bench bench;
      bench.rig.bound({.hand_speed = most});
      for (int i = 0; i < 3; ++i) bench.select(i);
      ASSERT_EQ(bench.rig.start(), LawResult::ok);
      const Pose start = bench.X();
      const Vector3 way = Vector3(1, -1, 1).normalized();
      for (int t = 0; t < 2500; ++t) {  // somebody leads it
        bench.ticks(1);
        bench.move(six(12 * way, Vector3::Zero()));
      }
      for (int i = 0; i < 3; ++i) bench.select(i, false);
      for (int t = 0; t < 1000; ++t) {
        bench.ticks(1);
        bench.move(Vector6::Zero());
      }
      ASSERT_GT((bench.X().position - start.position).dot(way), 0.05);
      bench.rig.input("pose").set(
          pose_target({start.rotation, start.position - (far ? 0.2 : 0.0) * way}, 0.1));
      Vector3 before = Vector3::Zero();
      double fastest = 0;
      for (int t = 0; t < 3000; ++t) {
        bench.ticks(1);
        const Vector3 set_point = bench.X().position + bench.three("position_error_m");
        if (t > 0) fastest = std::max(fastest, (set_point - before).norm() / 0.001);
        before = set_point;
        bench.move(Vector6::Zero());
      }
      EXPECT_LT(fastest, 1.02 * (far ? most : std::min(0.05, 0.2 * most))) << most;
      EXPECT_GT(fastest, (far ? 0.8 : 0.9 * 0.2) * most) << most;
    }
  }
}

// While axes fade, the pull that the projection leaves points elsewhere than the one before it, along a
// faster motion: it keeps to what is allowed there.
TEST(HybridForceBounds, ThePullThatIsLeftIsBoundedAgain) {
  Draw draw(212);
  double most = 0;
  for (int trial = 0; trial < 30; ++trial) {
    Bench bench(draw.pose(1));
    bench.rig.bound({});
    bench.rig.set("force_damping_n_s_per_m", {0});
    bench.rig.set("moment_damping_nm_s_per_rad", {0});
    bench.rig.set("nullspace_stiffness_nm_per_rad", {0});
    ASSERT_EQ(bench.rig.start(), LawResult::ok);
    bench.rig.input("pose").start(
        Pose{bench.X().rotation, bench.X().position + 0.4 * draw.vector3(1).normalized()});
    bench.select(static_cast<int>(draw.index(3)));
    bench.ticks(40 + static_cast<int>(draw.index(120)));
    bench.rig.place(0, bent(7), draw.joints(7, 0.4));
    ASSERT_EQ(bench.rig.update(), LawResult::ok);
    if (bench.rig.terms(0).task().floored) continue;
    const JointVector q = bench.rig.state(0).q, dq = bench.rig.state(0).dq;
    const MatrixXd J = bench.plain.jacobian(q), M = bench.plain.mass(q);
    VectorXd K(6);
    K << 400, 400, 400, 20, 20, 20;
    const Vector6 V = J * dq, damping = task_damping(task_inertia(J, M), Matrix6(K.asDiagonal()), 1) * V;
    const BoundedPull left = bound_pull({}, bench.wrench() + damping, damping, V.head<3>());
    EXPECT_LT(left.force_share, 1 + 1e-4) << trial;
    EXPECT_LT(left.moment_share, 1 + 1e-4) << trial;
    most = std::max(most, left.force_share);
  }
  EXPECT_GT(most, 0.99);
}

// Another end effector while a force and moments act, about 15 cm away: from the wrench before to the one
// about the new point it takes a fade, also where the axes are released meanwhile.
TEST(HybridForceBounds, ARedefinedEndEffectorCausesNoStep) {
  for (const int released : {-1, 0, 50, 120}) {
    for (const bool of_hand : {false, true}) {
      Bench bench(Pose{rotation_from_rpy({0.3, -0.2, 0.7}), Vector3(0.1, 0.2, -0.1)});
      bench.rig.bound({});
      bench.rig.set("force_frame", {of_hand ? 1.0 : 0.0});
      for (const int axis : {2, 3, 4}) bench.select(axis);
      ASSERT_EQ(bench.rig.start(), LawResult::ok);
      const Matrix3 R = of_hand ? bench.X().rotation : Matrix3(Matrix3::Identity());
      const Vector3 f = R * Vector3(0, 0, -10), m = R * Vector3(0.6, -0.8, 0);
      bench.want(six(f, 1.5 * m));
      bench.feel(six(f, m));
      bench.ticks(3000);
      const Vector3 at = bench.X().position;
      JointVector before = bench.rig.tau(0);
      const JointVector first = before;
      EXPECT_GT(bench.command().norm(), 7);
      double step = 0;
      for (int t = 0; t < 600; ++t) {
        if (t == released)
          for (const int axis : {2, 3, 4}) bench.select(axis, false);
        if (t == 100) {
          bench.rig.redefine(0, {rotation_from_rpy({0.3, -0.2, 0.5}), Vector3(0.1, -0.08, 0.08)});
          ASSERT_GT((bench.X().position - at).norm(), 0.14);
          bench.feel(six(f, m + (at - bench.X().position).cross(f)));  // the same, about the new point
        }
        bench.ticks(1);
        step = std::max(step, (bench.rig.tau(0) - before).lpNorm<Eigen::Infinity>());
        before = bench.rig.tau(0);
      }
      EXPECT_LT(step, 0.1) << released << " " << of_hand;
      EXPECT_GT((before - first).lpNorm<Eigen::Infinity>(), 0.5) << released << " " << of_hand;
      if (released >= 0) {
        EXPECT_LT(before.norm(), 1e-6);  // nothing stays
      }
    }
  }
}

}  // namespace
}  // namespace multipanda::hybrid_force_test
