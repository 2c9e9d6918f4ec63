// What `ufic` keeps to along axes: speeds, bounds, places of contact, and the books of its tanks, while
// contact, selection, goals or the end effector change.
#include <string>

#include "core/controllets/task_spring.hpp"
#include "core/testing/ufic_axes_bench.hpp"

namespace multipanda::ufic_axes_test {
namespace {

// Contact is lost, and the hand is elsewhere: forces fade with the way, moments with the way and the angle
// since the last contact, exp(-(d / d_max)^2) exp(-(phi / phi_max)^2). A moment that was felt 0.1 m away is
// none here, although the hand has not turned.
TEST(UficAxesBounds, AwayFromTheLastContactForcesAndMomentsFade) {
  for (const bool of_hand : {false, true}) {
    const Pose X_WB{rotation_from_rpy({0.3, -0.2, 0.7}), Vector3(0.1, 0.2, -0.1)};
    Bench bench(X_WB);
    bench.rig.set("force_frame", {of_hand ? 1.0 : 0.0});
    bench.rig.set("force_integral_per_s", {0});
    bench.rig.set("moment_integral_per_s", {0});
    bench.select_all({2, 4});
    ASSERT_EQ(bench.rig.start(), LawResult::ok);
    const Pose X0 = bench.X();
    const Vector3 inward = (X_WB.position - X0.position).normalized();
    const Matrix3 R0 = of_hand ? X0.rotation : Matrix3(Matrix3::Identity());
    const Vector6 desired = both(R0) * six({0, 0, -10}, {0, 1, 0});
    bench.want(desired);
    bench.feel(desired);
    bench.ticks(3000);
    EXPECT_LT((bench.of_axes() - six({0, 0, -10}, {0, 1, 0})).norm(), 1e-6);
    bench.feel(Vector6::Zero());
    bench.ticks(3000);  // the feedback has faded; where the hand was touched, F_d acts
    EXPECT_LT((bench.of_axes() - six({0, 0, -10}, {0, 1, 0})).norm(), 1e-6);
    for (const auto& [way, angle] :
         {std::pair{0.0, 0.0}, {0.01, 0.0}, {0.0, 0.1}, {0.025, 0.07}, {0.1, 0.0}, {0.1, 0.1}}) {
      const Pose goal{exp_rotation(angle * Vector3(0.6, 0, 0.8)) * X0.rotation, X0.position + way * inward};
      JointVector q = bent(7);
      for (int i = 1; i <= 300; ++i) {  // inverse kinematics
        const MatrixXd J = bench.plain.jacobian(q);
        const Vector6 left = pose_error(goal, bench.plain.end_effector(q));
        q += JointVector(J.transpose() * inverse(J * J.transpose()) * (std::min(1.0, 0.005 * i) * left));
      }
      bench.rig.place(0, q, joint_constant(7, 0));
      ASSERT_LT(pose_error(goal, bench.X()).norm(), 1e-6);
      bench.ticks(250);  // a fade: a place may be nearer than the one before
      const double of_way = std::exp(-std::pow(way / 0.02, 2)),
                   of_angle = std::exp(-std::pow(angle / 0.1, 2));
      const Matrix3 R = of_hand ? bench.X().rotation : Matrix3(Matrix3::Identity());
      const Vector6 d = both(R).transpose() * desired;
      EXPECT_NEAR(bench.of_axes()[2], d[2] * of_way, 1e-3) << way << " m, " << angle << " rad";
      EXPECT_NEAR(bench.of_axes()[4], d[4] * of_way * of_angle, 1e-4) << way << " m, " << angle << " rad";
    }
  }
}

// The estimate is about K; the law controls the wrench at E: f = d + P (d - F_hat), in contact. One moment at
// a time, since those that move one joint share what it bears.
TEST(UficAxesBounds, TheMomentIsThatAtTheEndEffector) {
  const Vector3 p_EK(0.1, 0.05, -0.2);
  const Vector6 at_hand = six({3, -4, 5}, {0.7, 0.9, -0.8}), desired = six({4, -6, 8}, {1, 1.2, -1.4});
  for (const int moment : {3, 4, 5}) {
    Bench bench;
    bench.rig.frames(0, {kTool, {Matrix3::Identity(), p_EK}});
    bench.rig.place(0, bent(7), joint_constant(7, 0));
    bench.rig.set("force_proportional", {0.2});
    bench.rig.set("force_integral_per_s", {0});
    bench.rig.set("moment_integral_per_s", {0});
    bench.select_all({0, 1, 2, moment});
    ASSERT_EQ(bench.rig.start(), LawResult::ok);
    const Vector3 lever = bench.X().rotation * p_EK;  // of K, from E
    bench.want(desired);
    bench.feel(six(at_hand.head<3>(), at_hand.tail<3>() - lever.cross(Vector3(at_hand.head<3>()))));
    bench.ticks(3000);
    Vector6 expected = desired + 0.2 * (desired - at_hand);
    for (int i = 3; i < 6; ++i) expected[i] *= i == moment;
    EXPECT_LT((bench.of_axes() - expected).norm(), 1e-6) << moment;
  }
}

// Another end effector while a force and moments act, about 15 cm away: from the wrench before to the one
// about the new point it takes a while, also where the axes are released meanwhile or the valve of the tank
// is half closed (0.05 J of 0.1). Moments about the new point start again: no contact was felt there. Axes of
// the end effector do not turn with its definition.
TEST(UficAxesBounds, ARedefinedEndEffectorCausesNoStep) {
  for (const auto& [released, tank] :
       {std::pair{-1, 100.0}, {0, 100.0}, {50, 100.0}, {120, 100.0}, {-1, 0.05}}) {
    for (const bool of_hand : {false, true}) {
      Bench bench(Pose{rotation_from_rpy({0.3, -0.2, 0.7}), Vector3(0.1, 0.2, -0.1)});
      bench.rig.bound({});
      bench.rig.set("force_frame", {of_hand ? 1.0 : 0.0});
      bench.rig.set("force_integral_per_s", {0});
      bench.rig.set("tank_start_j", {tank});
      bench.select_all({2, 3, 4});
      ASSERT_EQ(bench.rig.start(), LawResult::ok);
      const double valve = tank < 1 ? 0.5 : 1;
      const Matrix3 R = of_hand ? bench.X().rotation : Matrix3(Matrix3::Identity());
      const Vector3 f = R * Vector3(0, 0, -10), m = R * Vector3(0.6, -0.8, 0);
      bench.want(six(f, 1.5 * m));
      bench.feel(six(f, m));
      bench.ticks(3000);
      EXPECT_EQ(bench.number("alpha_f"), valve);
      EXPECT_NEAR(bench.of_axes()[2], -10 * valve, 1e-3);
      EXPECT_GT(bench.of_axes().tail<3>().norm(), 1.4 * valve);
      const Vector3 at = bench.X().position;
      JointVector before = bench.rig.tau(0);
      const JointVector first = before;
      double step = 0;
      for (int t = 0; t < 600; ++t) {
        if (t == released) bench.select_all({2, 3, 4}, false);
        if (t == 100) {
          bench.rig.redefine(0, {rotation_from_rpy({0.3, -0.2, 0.5}), Vector3(0.1, -0.08, 0.08)});
          ASSERT_GT((bench.X().position - at).norm(), 0.14);
          bench.feel(six(f, m + (at - bench.X().position).cross(f)));  // the same, about the new point
        }
        bench.ticks(1);
        step = std::max(step, (bench.rig.tau(0) - before).lpNorm<Eigen::Infinity>());
        before = bench.rig.tau(0);
        if (t == 100 && released < 0) {
          EXPECT_EQ(bench.of_axes().tail<3>().norm(), 0) << of_hand;
        }
      }
      EXPECT_LT(step, 0.1) << released << ' ' << tank << ' ' << of_hand;
      EXPECT_GT((before - first).lpNorm<Eigen::Infinity>(), 0.5 * valve) << released << ' ' << of_hand;
      if (released < 0) {
        EXPECT_NEAR(bench.of_axes()[2], -10 * valve, 1e-3) << of_hand;
      }
    }
  }
}

// End effectors that are redefined in a stream, 1 mm per tick: what the wrench before had beyond the new one
// leaves as after a single one, also when F_d and the contact end meanwhile.
TEST(UficAxesBounds, AStreamOfEndEffectorsHoldsNoForce) {
  Bench bench;
  bench.rig.bound({});
  bench.select_all({2, 4});
  ASSERT_EQ(bench.rig.start(), LawResult::ok);
  bench.want(six({0, 0, -10}, {0, 1, 0}));
  bench.feel(six({0, 0, -10}, {0, 1, 0}));
  bench.ticks(2000);
  const auto push = [&]() -> Vector6 {
    return bench.rig.terms(0).task().J_bar.transpose() * bench.rig.tau(0);
  };
  EXPECT_GT(push().norm(), 9);
  bench.want(Vector6::Zero(), 0.01);
  bench.feel(Vector6::Zero());
  for (int t = 0; t < 700; ++t) {
    bench.rig.redefine(0, {Matrix3::Identity(), Vector3(t % 2 == 0 ? 0.001 : -0.001, 0, 0)});
    bench.ticks(1);
  }
  EXPECT_LT(push().norm(), 0.5);
}

// The reaction goes in the same tick as the end effector is redefined: what bridges the two leaves with the
// motion, so letting go then makes the hand no faster than letting go alone.
TEST(UficAxesBounds, ABridgeDoesNotDriveAHandThatIsLetGo) {
  TestArm arm = light_wrist();
  for (const double inertia : {5e-3, 2e-2, 7e-2}) {
    arm.links[6].inertia_C = inertia * Matrix3::Identity();
    double turning[2] = {0, 0};
    for (const bool redefined : {false, true}) {
      Bench bench({}, arm);
      bench.rig.bound({});
      bench.rig.set("force_frame", {1});
      bench.select_all({0, 5});
      ASSERT_EQ(bench.rig.start(), LawResult::ok);
      const Vector6 F = both(bench.X().rotation) * six({30, 0, 0}, {0, 0, 2});
      bench.want(F);
      bench.feel(F);
      bench.ticks(3000);
      if (redefined) bench.rig.redefine(0, {Matrix3::Identity(), Vector3(0, 0.15, 0)});
      Observer observer;
      observer.shown = F;
      Late late(bench);
      for (int t = 0; t < 1000; ++t) {
        bench.feel(observer.update(Vector6::Zero()));
        bench.ticks(1);
        late.move(Vector6::Zero());
        turning[redefined] = std::max(turning[redefined], bench.V().tail<3>().norm());
      }
    }
    EXPECT_LT(turning[1], 1.05 * turning[0]) << inertia;
  }
}

// The tanks' book over everything that changes live: axes, their frame, the sides they press, contact, the
// end effector. What goes into the arm (by its torque and path alone), the spring and the tanks is constant
// while nothing overflows; with nearly empty tanks it never grows.
TEST(UficAxesBounds, LiveChangesKeepTheTanksBook) {
  Draw draw(2104);
  double pushed = 0, by_force = 0;
  int turned = 0;
  for (int trial = 0; trial < 12; ++trial) {
    Bench bench(draw.pose(1));
    const bool full = trial % 2 == 0;
    bench.rig.set("tank_start_j", {full ? 50.0 : 0.15});
    bench.rig.set("translational_stiffness_n_per_m", {400});
    bench.rig.set("force_frame", {draw.coin() ? 1.0 : 0.0});
    ASSERT_EQ(bench.rig.start(), LawResult::ok);
    bench.ticks(1);
    const double initial = bench.number("force_tank_j") + bench.number("impedance_tank_j");
    const TaskStiffness K{400 * Matrix3::Identity(), 20 * Matrix3::Identity()};
    const JointVector direction = draw.joints(7, 0.1);
    JointVector q = bent(7), tau = bench.rig.tau(0);
    double into_arm = 0;
    Vector6 desired = Vector6::Zero();
    double side = 0;
    for (int k = 1; k <= 3000; ++k) {
      if (k % 100 == 1) {
        const Vector3 moment = draw.vector3(2);
        desired = six(draw.vector3(20), moment);
        bench.want(desired, 0.08);
      }
      if (k % 60 == 5) bench.select(static_cast<int>(draw.index(6)), draw.index(3) > 0);
      if (k % 900 == 450) bench.rig.set("force_frame", {draw.coin() ? 1.0 : 0.0});
      if (k == 1200 || k == 2300)
        bench.rig.redefine(0, {exp_rotation(draw.vector3(0.3)), draw.vector3(0.05)});
      const double t = 0.001 * k;
      const JointVector next = bent(7) + direction * std::sin(3 * t);
      const double work = tau.dot(next - q);
      into_arm += work;
      q = next;
      bench.rig.state(0).tau_J_d = tau;
      bench.feel(k % 700 < 100 ? Vector6(Vector6::Zero()) : Vector6((0.8 + 0.4 * std::sin(5 * t)) * desired));
      bench.rig.place(0, q, direction * 3 * std::cos(3 * t));
      ASSERT_EQ(bench.rig.tick(0.001), LawResult::ok);
      tau = bench.rig.tau(0);
      const Vector6 F = bench.of_axes();
      pushed = std::max(pushed, F.norm());
      by_force += std::abs(bench.number("power_force_w")) * 0.001;
      if (F[2] * side < 0) ++turned;  // presses the other side
      if (F[2] != 0) side = F[2];
      if (k % 10 != 0) continue;
      const double s = 1 + bench.number("alpha_i");
      const double spring = s * spring_energy(K, pose_error(bench.rig.input("pose").pose(), bench.X()));
      const double tanks = bench.number("force_tank_j") + bench.number("impedance_tank_j");
      EXPECT_LE(into_arm + spring + tanks, initial + 1e-9) << trial << ' ' << k;
      if (full) {
        EXPECT_NEAR(into_arm + spring + tanks, initial, 1e-6) << trial << ' ' << k;
      }
      EXPECT_GT(bench.number("force_tank_j"), -0.02);
    }
  }
  EXPECT_GT(pushed, 20);
  EXPECT_GT(by_force, 5);
  EXPECT_GT(turned, 5);
}

// Somebody holds the hand while it presses with all that it may, and lets go: the estimate falls as a 30 Hz
// observer shows it, torques act 0 or 3 ms late. docs/controllets/ufic.md has the figures.
TEST(UficAxesBounds, AHeldHandThatIsLetGoDoesNotShootOff) {
  enum Arm { usual, light };  // light: a wrist of 0.001 kg m^2
  const double fast_limit[2][2] = {{0.375, 0.65}, {0.45, 1.6}}, turning_limit[2][2] = {{3, 5.5}, {8, 26}};
  double fastest[2][2] = {}, most_turning[2][2] = {};  // by arm, and whether torques are late
  for (const bool is_late : {false, true}) {
    for (const auto& axes : {std::vector<int>{2}, {0, 1, 2}, {5}, {3, 4, 5}, {0, 1, 2, 3, 4, 5}}) {
      for (const int which : {0, 1, 2}) {  // axes of the world; of the hand; the same of a light wrist
        const Arm kind = which == 2 ? light : usual;
        Bench bench({}, kind == light ? light_wrist() : TestArm::make(7));
        bench.rig.bound({});
        bench.rig.set("force_frame", {which > 0 ? 1.0 : 0.0});
        bench.rig.set("force_integral_limit_n", {100});
        bench.rig.set("moment_integral_limit_nm", {5});
        bench.select_all(axes);
        Vector6 desired = Vector6::Zero();
        for (const int axis : axes) desired[axis] = axis < 3 ? 40 : 3;
        const Pose start = bench.X();
        const Matrix6 R = both(which > 0 ? start.rotation : Matrix3(Matrix3::Identity()));
        ASSERT_EQ(bench.rig.start(), LawResult::ok);
        bench.want(R * desired);
        Vector6 ahead = R * desired;  // the set-point leads into the contact: 0.1 m, 0.1 rad
        for (const int at : {0, 3}) ahead.segment<3>(at) = 0.1 * ahead.segment<3>(at).normalized();
        bench.rig.input("pose").set(pose_target(
            {exp_rotation(ahead.tail<3>()) * start.rotation, start.position + ahead.head<3>()}, 1));
        Observer observer;
        const auto push = [&]() -> Vector6 {
          return bench.rig.terms(0).task().J_bar.transpose() * bench.rig.tau(0);
        };
        for (int t = 0; t < 4000; ++t) {
          bench.ticks(1);
          bench.feel(observer.update(push()));
        }
        const std::string of = std::to_string(axes.size()) + " axes from " + std::to_string(axes[0]) + ", " +
                               std::to_string(which) + (is_late ? ", late" : "");
        if (desired.head<3>().norm() > 0) {
          EXPECT_GT(push().head<3>().norm(), 39) << of;
          EXPECT_LT(push().head<3>().norm(), 60.1) << of;
        } else {
          EXPECT_GT(push().tail<3>().norm(), 2.9) << of;
        }
        double fast = 0, turning = 0;
        Late late(bench, is_late ? 3 : 0);
        for (int t = 0; t < 1500; ++t) {
          bench.feel(observer.update(Vector6::Zero()));
          bench.ticks(1);
          late.move(Vector6::Zero());
          if (bench.rig.terms(0).task().floored) break;
          fast = std::max(fast, bench.V().head<3>().norm());
          turning = std::max(turning, bench.V().tail<3>().norm());
        }
        EXPECT_LT(fast, fast_limit[kind][is_late]) << of;
        EXPECT_LT(turning, turning_limit[kind][is_late]) << of;
        fastest[kind][is_late] = std::max(fastest[kind][is_late], fast);
        most_turning[kind][is_late] = std::max(most_turning[kind][is_late], turning);
      }
    }
  }
  for (const Arm kind : {usual, light}) {
    for (const bool is_late : {false, true}) {
      const std::string of = std::string(kind == light ? "light" : "usual") + (is_late ? "_late" : "");
      RecordProperty(of + "_m_per_s", std::to_string(fastest[kind][is_late]));
      RecordProperty(of + "_rad_per_s", std::to_string(most_turning[kind][is_late]));
    }
  }
  EXPECT_GT(fastest[usual][0], 0.2);
}

}  // namespace
}  // namespace multipanda::ufic_axes_test
