// `ufic` along axes where torques act 3 ms late: what opposes speed must not shake an axis of little inertia,
// and a wrong estimate must not spin it.
#include <string>

#include "core/testing/ufic_axes_bench.hpp"

namespace multipanda::ufic_axes_test {
namespace {

// A wrist of 0.002 kg m^2 that lies diagonally in the force frame, all three moments, torques that act 3 ms
// late: axes that share a joint share what it bears.
TEST(UficAxesDelay, MomentsThatShareALightJointBearADelay) {
  TestArm arm = light_wrist();
  arm.links[6].inertia_C = 2e-3 * Matrix3::Identity();
  const Vector3 diagonal = Vector3(1, 1, 1).normalized();
  double fastest = 0;
  int finished = 0;
  for (const bool of_hand : {false, true}) {
    TestArm turned = arm;
    Pose X_WB;
    if (of_hand) {
      turned.X_JF.rotation =
          Eigen::Quaterniond::FromTwoVectors(diagonal, Vector3::UnitZ()).toRotationMatrix() *
          kTool.rotation.transpose();
    } else {  // the base is turned: the joint's axis, z of the tool, is the diagonal of the world
      const Vector3 axis = Bench({}, arm).X().rotation.col(2);
      X_WB.rotation = Eigen::Quaterniond::FromTwoVectors(axis, diagonal).toRotationMatrix();
    }
    for (const double goal : {0.0, 3.0, -15.0}) {
      for (const double felt : {0.0, 4.0, -15.0}) {
        Bench bench(X_WB, turned);
        bench.rig.bound({});
        bench.rig.set("force_frame", {of_hand ? 1.0 : 0.0});
        bench.rig.set("moment_integral_per_s", {50});
        bench.rig.set("moment_integral_limit_nm", {5});
        bench.rig.set("force_proportional", {5});
        bench.select_all({3, 4, 5});
        ASSERT_EQ(bench.rig.start(), LawResult::ok);
        const Matrix3 R = of_hand ? bench.X().rotation : Matrix3(Matrix3::Identity());
        const Matrix6& mobility = bench.rig.terms(0).task().mobility;
        ASSERT_GT((R * diagonal).dot(mobility.bottomRightCorner<3, 3>() * R * diagonal), 1 / 0.004);
        bench.want(six(Vector3::Zero(), goal * R * diagonal), 0.1);
        Late late(bench);
        double turning = 0;
        int t = 0;
        for (; t < 1500; ++t) {
          bench.feel(six(Vector3::Zero(), felt * R * diagonal));
          bench.ticks(1);
          late.move(Vector6::Zero());
          if (bench.rig.terms(0).task().floored) break;
          turning = std::max(turning, bench.V().tail<3>().norm());
        }
        EXPECT_LT(turning, 2) << of_hand << " goal " << goal << ", felt " << felt;
        fastest = std::max(fastest, turning);
        finished += t == 1500;
      }
    }
  }
  RecordProperty("turning_rad_per_s", std::to_string(fastest));
  EXPECT_GT(fastest, 0.3);
  EXPECT_EQ(finished, 18);  // none came near a singular pose
}

// A light wrist waits in free air for 2 s while a moment is desired; then the estimate is wrong. Nothing
// pushed meanwhile, so the axis has withstood nothing, and the estimate does not count.
TEST(UficAxesDelay, AWrongEstimateAfterAWaitDoesNotSpinALightWrist) {
  double fastest = 0;
  for (const double stiffness : {0.0, 20.0}) {
    for (const double felt : {1.0, 10.0, 30.0}) {
      Bench bench({}, light_wrist());
      bench.rig.bound({});
      bench.rig.set("force_frame", {1});
      bench.rig.set("moment_integral_per_s", {50});
      bench.rig.set("moment_integral_limit_nm", {5});
      bench.rig.set("force_proportional", {5});
      bench.rig.set("rotational_stiffness_nm_per_rad", {stiffness});
      bench.select(5);
      ASSERT_EQ(bench.rig.start(), LawResult::ok);
      bench.want(six(Vector3::Zero(), 10 * bench.X().rotation.col(2)));
      Late late(bench);
      double turning = 0;
      for (int t = 0; t < 3500; ++t) {
        if (t >= 2000) bench.feel(six(Vector3::Zero(), felt * bench.X().rotation.col(2)));
        bench.ticks(1);
        late.move(Vector6::Zero());
        if (bench.rig.terms(0).task().floored) break;
        turning = std::max(turning, bench.V().tail<3>().norm());
      }
      // Undamped it ends at 1.5 rad/s, and 250 rad/s^2 act for 3 ms more.
      EXPECT_LT(turning, stiffness > 0 ? 1 : 1.5 + 250 * 0.003 + 0.1) << "felt " << felt << ", " << stiffness;
      fastest = std::max(fastest, turning);
    }
  }
  RecordProperty("turning_rad_per_s", std::to_string(fastest));
  EXPECT_GT(fastest, 0.2);
}

// The same after a contact that was felt where nothing is, or with the paper's valve, which needs none: then
// F_d acts in free air, and the impedance alone holds the hand. The environment bears nothing then.
TEST(UficAxesDelay, AnAxisThatItsImpedanceHoldsWithstandsNothing) {
  double fastest = 0, held = 1;
  for (int trial = 0; trial < 16; ++trial) {
    const bool paper = trial % 2 == 1;
    const double felt = trial % 4 < 2 ? 10 : 30;
    TestArm arm = light_wrist();
    if (trial % 8 >= 4) arm.links[6].inertia_C = 0.01 * Matrix3::Identity();
    Bench bench({}, arm);
    bench.rig.bound({});
    bench.rig.set("force_frame", {1});
    bench.rig.set("valve_law", {paper ? 1.0 : 0.0});
    bench.rig.set("rotational_stiffness_nm_per_rad", {trial < 8 ? 20.0 : 2.0});
    bench.select(5);
    ASSERT_EQ(bench.rig.start(), LawResult::ok);
    const auto a = [&]() -> Vector3 { return bench.X().rotation.col(2); };
    bench.want(six(Vector3::Zero(), 10 * a()));
    Late late(bench);
    double turning = 0, f = 0;
    for (int t = 0; t < 4000; ++t) {
      const double shown = t >= 2500 ? felt : !paper && t >= 200 && t < 700 ? 1 : 0;
      bench.feel(six(Vector3::Zero(), shown * a()));
      bench.ticks(1);
      late.move(Vector6::Zero());
      if (t < 2500) f = bench.of_axes()[5];
      if (t >= 2500) turning = std::max(turning, bench.V().tail<3>().norm());
    }
    EXPECT_LT(turning, 1) << trial;
    fastest = std::max(fastest, turning);
    held = std::min(held, f);
  }
  RecordProperty("turning_rad_per_s", std::to_string(fastest));
  EXPECT_GT(held, 0.05);  // it did push before
}

// A force and a moment wait in free air while somebody pushes the hand back against them: the valve lets them
// oppose that motion, as a damper no stronger than a late torque bears. With the damping of the impedance,
// which is that of an axis whose neighbors are held, the hand would shake and fill the tank by shaking.
TEST(UficAxesDelay, AForceThatWaitsDoesNotShakeAHandThatIsPushedBack) {
  double largest = 0;
  for (const double inertia : {2e-3, 5e-3}) {
    TestArm arm = light_wrist();
    arm.links[6].inertia_C = inertia * Matrix3::Identity();
    for (int trial = 0; trial < 18; ++trial) {
      const bool of_hand = trial % 2 == 1;
      const int force = trial / 2 % 3, moment = 3 + trial / 6;
      Bench bench({}, arm);
      bench.rig.bound({});
      bench.rig.set("force_frame", {of_hand ? 1.0 : 0.0});
      bench.rig.set("translational_stiffness_n_per_m", {2000});
      bench.rig.set("tank_start_j", {0.3});
      bench.select_all({force, moment});
      ASSERT_EQ(bench.rig.start(), LawResult::ok);
      const Matrix6 R = both(of_hand ? bench.X().rotation : Matrix3(Matrix3::Identity()));
      bench.want(R * (30 * Vector6::Unit(force) + 10 * Vector6::Unit(moment)));
      bench.ticks(1000);
      const double tank = bench.number("force_tank_j");
      const Vector6 push = R * (-20 * Vector6::Unit(force) - 6 * Vector6::Unit(moment));
      Late late(bench);
      JointVector before = bench.rig.tau(0);
      double step = 0, work = 0;
      for (int t = 0; t < 1000; ++t) {
        bench.ticks(1);
        if (t > 100) step = std::max(step, (bench.rig.tau(0) - before).lpNorm<Eigen::Infinity>());
        before = bench.rig.tau(0);
        const Pose X = bench.X();
        late.move(push);
        work += push.dot(pose_error(bench.X(), X));
      }
      EXPECT_LT(step, 0.2) << inertia << ", trial " << trial;
      EXPECT_LT(bench.number("force_tank_j") - tank, work) << inertia << ", trial " << trial;
      EXPECT_GT(work, 0.1) << inertia << ", trial " << trial;
      largest = std::max(largest, step);
    }
  }
  RecordProperty("step_nm_per_ms", std::to_string(largest));
}

}  // namespace
}  // namespace multipanda::ufic_axes_test
