// Teleoperation on arms that the test places: where the follower is led to, and what the leader feels, from
// the kinematics and dynamics of both arms written independently. Its energy: tests/teleoperation.
#include <cmath>

#include <Eigen/Eigenvalues>
#include <gtest/gtest.h>

#include "core/controllets/builtins.hpp"
#include "core/testing/moving_law.hpp"

namespace multipanda::teleoperation_test {
namespace {

using namespace test;

// Arm 0 leads, arm 1 follows and stays where it is. Both bases are rotated and off the origin.
struct Held : LedLaw {
  explicit Held(std::uint32_t seed = 21) : LedLaw(teleoperation_controllet(), 0, seed) {
    for (std::size_t i = 0; i < 2; ++i) rig.state(i).has_wrench_estimate = true;
    rig.set("nullspace_stiffness_nm_per_rad", {0});
  }
  Matrix3 R_map() {
    return rig.terms(1).model().X_WB().rotation * rig.terms(0).model().X_WB().rotation.transpose();
  }
};

TEST(Teleoperation, BeginsWithoutAJump) {
  for (const double architecture : {0.0, 1.0}) {
    Held arms;
    arms.rig.set("architecture", {architecture});
    arms.rig.state(1).F_K_W_est.vector << 3, -4, -20, 0.1, 0.2, 0.3;  // already in contact
    ASSERT_EQ(arms.rig.start(), LawResult::ok);
    JointVector before[2] = {JointVector::Zero(7), JointVector::Zero(7)};
    for (int k = 0; k < 1000; ++k) {
      ASSERT_EQ(arms.tick(JointVector::Zero(7)), LawResult::ok);
      for (std::size_t i = 0; i < 2; ++i) {
        ASSERT_LT((arms.rig.tau(i) - before[i]).lpNorm<Eigen::Infinity>() / 0.001, 1000) << k;
        before[i] = arms.rig.tau(i);
      }
    }
    EXPECT_LT(before[1].norm(), 1e-9);
    EXPECT_EQ(before[0].norm() > 1, architecture == 1);  // what the follower presses with
  }
}

// At rest both hands feel the same force, in their own axes: F_f = K s R d, F_l = -force_scale R^T F_f.
TEST(Teleoperation, PositionPositionIsASpringBetweenBothHands) {
  for (const double scale : {1.0, 0.5, 2.0}) {
    for (const double force_scale : {1.0, 0.5}) {
      Held arms;
      arms.rig.set("scale", {scale});
      arms.rig.set("force_scale", {force_scale});
      ASSERT_EQ(arms.rig.start(), LawResult::ok);
      arms.wait(0.3);
      const Pose X_l = arms.X_WE(0), X_f = arms.X_WE(1);
      arms.lead(arms.draw.joints(7, 0.02), 1);
      arms.wait(1);
      const Pose X_l2 = arms.X_WE(0);
      const Matrix3 R = arms.R_map();
      const Vector3 d = scale * R * (X_l2.position - X_l.position);
      const Vector3 r = R * log_rotation(X_l2.rotation * X_l.rotation.transpose());
      EXPECT_GT(d.norm(), 0.002);
      const Vector6 F_f = arms.wrench(1), F_l = arms.wrench(0);
      EXPECT_LT((F_f.head<3>() - 1500 * d).norm(), 1e-4 * F_f.head<3>().norm()) << scale;
      EXPECT_LT((F_f.tail<3>() - 40 * r).norm(), 1e-4 * F_f.tail<3>().norm()) << scale;
      Vector6 reflected;
      reflected << R.transpose() * F_f.head<3>(), R.transpose() * F_f.tail<3>();
      EXPECT_LT((F_l + force_scale * reflected).norm(), 1e-4 * F_f.norm()) << scale << force_scale;
      EXPECT_LT((arms.shown("position_error_m") - d).norm(), 1e-9);
      EXPECT_LT((arms.X_WE(1).position - X_f.position).norm(), 1e-12);
    }
  }
}

// At rest the leader feels what the follower's estimate shows, at its hand, whatever the springs are.
TEST(Teleoperation, PositionForceReflectsTheEstimate) {
  Held arms(22);
  arms.rig.set("architecture", {1});
  arms.rig.set("force_scale", {0.7});
  ArmFrames frames = arms.rig.state(1).frames;
  frames.X_EK.position = Vector3(0.01, 0.02, -0.03);
  arms.rig.frames(1, frames);
  arms.rig.place(1, arms.q[1], arms.dq[1]);
  ASSERT_EQ(arms.rig.start(), LawResult::ok);
  Vector6 F;
  F << 5, -7, -15, 0.3, -0.2, 0.4;  // about K
  arms.rig.state(1).F_K_W_est.vector = F;
  arms.lead(arms.draw.joints(7, 0.02), 1);
  arms.wait(3);
  const Vector3 p_EK = arms.X_WE(1).rotation * frames.X_EK.position;
  Vector6 at_hand = F;
  at_hand.tail<3>() += p_EK.cross(Vector3(F.head<3>()));
  const Matrix3 R = arms.R_map();
  Vector6 expected;
  expected << -0.7 * R.transpose() * at_hand.head<3>(), -0.7 * R.transpose() * at_hand.tail<3>();
  EXPECT_LT((arms.wrench(0) - expected).norm(), 1e-3 * F.norm());
}

TEST(Teleoperation, NeedsAnEstimateForPositionForce) {
  Held arms;
  arms.rig.state(1).has_wrench_estimate = false;
  EXPECT_EQ(arms.rig.start(), LawResult::ok);
  arms.rig.set("architecture", {1});
  EXPECT_EQ(arms.tick(JointVector::Zero(7)), LawResult::fault);
  EXPECT_EQ(arms.rig.start(), LawResult::fault);
}

// Open, neither arm moves the other; closed again, both begin where they are.
TEST(Teleoperation, ClutchLetsBothArmsGo) {
  Held arms(23);
  ASSERT_EQ(arms.rig.start(), LawResult::ok);
  arms.lead(arms.draw.joints(7, 0.02), 1);
  arms.wait(0.3);
  const JointVector pulled = arms.rig.tau(1);
  EXPECT_GT(pulled.norm(), 1);
  arms.rig.set("clutch", {0});
  JointVector before = arms.rig.tau(0);
  for (int k = 0; k < 500; ++k) {
    ASSERT_EQ(arms.tick(JointVector::Zero(7)), LawResult::ok);
    ASSERT_LT((arms.rig.tau(0) - before).lpNorm<Eigen::Infinity>() / 0.001, 1000);
    before = arms.rig.tau(0);
  }
  EXPECT_LT(before.norm(), 1e-9);
  EXPECT_LT((arms.rig.tau(1) - pulled).norm(), 1e-6);  // it stays, and keeps pressing
  arms.lead(arms.draw.joints(7, 0.2), 1);
  arms.wait(0.1);
  EXPECT_LT((arms.rig.tau(1) - pulled).norm(), 1e-6);
  EXPECT_LT(arms.rig.tau(0).norm(), 1e-9);
  arms.rig.set("clutch", {1});
  for (int k = 0; k < 500; ++k) {
    ASSERT_EQ(arms.tick(JointVector::Zero(7)), LawResult::ok);
    ASSERT_LT((arms.rig.tau(0) - before).lpNorm<Eigen::Infinity>() / 0.001, 1000);
    before = arms.rig.tau(0);
  }
  EXPECT_LT((arms.rig.tau(1) - pulled).norm(), 1e-6);
  const Matrix3 R = arms.R_map();  // the leader feels what the follower presses with
  EXPECT_LT((arms.wrench(0).head<3>() + R.transpose() * arms.wrench(1).head<3>()).norm(),
            1e-3 * pulled.norm());
}

// Each side learns of the other after the delay, neither before nor much later.
TEST(Teleoperation, SimulatesADelayInEachDirection) {
  Held arms(24);
  arms.rig.set("channel_delay_s", {0.1});
  ASSERT_EQ(arms.rig.start(), LawResult::ok);
  arms.wait(0.5);
  int followed = 0, felt = 0;
  const JointVector way = arms.draw.joints(7, 0.05);
  for (int k = 1; k <= 300; ++k) {
    ASSERT_EQ(arms.tick(k <= 20 ? JointVector(way) : JointVector(JointVector::Zero(7))), LawResult::ok);
    if (followed == 0 && arms.rig.tau(1).norm() > 1e-6) followed = k;
  }
  EXPECT_EQ(followed, 101);
  // The follower moves: the leader feels it as late.
  const JointVector at_rest = arms.rig.tau(0);
  arms.q[1] += joint_constant(7, 0.002);
  arms.rig.place(1, arms.q[1], arms.dq[1]);
  for (int k = 1; k <= 150; ++k) {
    ASSERT_EQ(arms.tick(JointVector::Zero(7)), LawResult::ok);
    if (felt == 0 && (arms.rig.tau(0) - at_rest).norm() > 0.1) felt = k;
  }
  EXPECT_EQ(felt, 101);
}

// With empty tanks neither hand is driven. Leading against the spring fills them.
TEST(Teleoperation, AnEmptyTankDrivesNothing) {
  Held arms(25);
  arms.rig.set("tank_start_j", {0});
  ASSERT_EQ(arms.rig.start(), LawResult::ok);
  arms.wait(0.3);
  const JointVector elsewhere = arms.draw.joints(7, 0.02);
  for (int k = 0; k < 20; ++k) {  // there without work, since no velocity is damped
    arms.q[0] += 0.05 * elsewhere;
    ASSERT_EQ(arms.tick(JointVector::Zero(7)), LawResult::ok);
  }
  arms.wait(0.3);
  EXPECT_LT(arms.rig.output("follower_valve")[0], 1e-12);
  EXPECT_LT(arms.wrench(1).norm(), 1e-9);
  EXPECT_LT(arms.wrench(0).norm(), 1e-9);
  arms.lead(arms.draw.joints(7, 0.03), 1);
  arms.wait(0.5);
  EXPECT_GT(arms.rig.output("leader_tank_j")[0], 0);
  EXPECT_GT(arms.wrench(1).norm(), 0.01);
}

// Pulls on both hands keep to the bounds for contact, however far the leader goes.
TEST(Teleoperation, KeepsToTheBoundsForContact) {
  for (const double architecture : {0.0, 1.0}) {
    Held arms(26);
    arms.rig.bound({});
    arms.rig.set("architecture", {architecture});
    ASSERT_EQ(arms.rig.start(), LawResult::ok);
    const JointVector way = arms.draw.joints(7, 0.3);
    double force = 0, moment = 0;
    for (int k = 0; k < 4000; ++k) {
      arms.rig.state(1).F_K_W_est.vector.head<3>() = Vector3(0, 0, -100);  // an estimate far above
      ASSERT_EQ(arms.tick(k < 1000 ? way : JointVector(JointVector::Zero(7))), LawResult::ok);
      for (std::size_t i = 0; i < 2; ++i) {
        if (i == 0 && k < 1000) continue;  // the damping of a moving hand is not bounded
        const Vector6 F = arms.wrench(i);
        force = std::max(force, F.head<3>().norm());
        moment = std::max(moment, F.tail<3>().norm());
      }
    }
    EXPECT_LT(force, 60.001);
    EXPECT_LT(moment, 15.001);
    EXPECT_GT(force, 50);
  }
}

// The pulls leave the joints room, with gravity and without: beyond its limit, a joint stops its arm, and the
// command is clamped.
TEST(Teleoperation, PullsNoJointBeyondItsLimit) {
  for (const std::uint32_t seed : {28u, 29u, 30u}) {
    Held arms(seed);
    arms.rig.set("tank_start_j", {50});
    ASSERT_EQ(arms.rig.start(), LawResult::ok);  // without bounds for contact
    const JointVector way = arms.draw.joints(7, 1);
    double closest = 0;
    for (int k = 0; k < 1500; ++k) {
      ASSERT_EQ(arms.tick(k < 500 ? way : JointVector(JointVector::Zero(7))), LawResult::ok);
      if (k < 500) continue;  // damping of a moving hand is not bounded
      for (std::size_t i = 0; i < 2; ++i) {
        const JointVector measured = arms.rig.tau(i) + arms.rig.terms(i).g();
        const JointVector largest = measured.cwiseAbs().cwiseMax(arms.rig.tau(i).cwiseAbs());
        const JointVector& most = arms.rig.terms(i).model().limits().tau_max;
        closest = std::max(closest, largest.cwiseQuotient(most).maxCoeff());
      }
    }
    EXPECT_LE(closest, 0.9 + 1e-9) << seed;
    EXPECT_GT(closest, 0.85) << seed;  // without the limit it would be more
  }
}

// However the scales multiply, the leader's spring is no stiffer than a hand's may be.
TEST(Teleoperation, TheLeadersSpringIsNoStiffer) {
  Held arms(31);
  arms.rig.set("scale", {3});
  arms.rig.set("force_scale", {3});
  ASSERT_EQ(arms.rig.start(), LawResult::ok);
  arms.wait(0.3);
  const Pose X = arms.X_WE(0);
  arms.lead(arms.draw.joints(7, 0.003), 1);
  arms.wait(1);
  const double d = (arms.X_WE(0).position - X.position).norm();
  EXPECT_NEAR(arms.wrench(0).head<3>().norm(), 5000 * d, 5 * d);
}

// Nor faster than what a leader bears: by its own kinematics and dynamics, and how the force at its hand
// answers to small turns of its joints.
TEST(Teleoperation, TheLeadersSpringIsNoFasterThanItBears) {
  for (const double force_scale : {1.0, 3.0}) {
    for (const double scale : {1.0, 2.0}) {
      Held arms(32);
      arms.rig.set("rotational_stiffness_nm_per_rad", {300});
      arms.rig.set("translational_stiffness_n_per_m", {4000});
      arms.rig.set("force_scale", {force_scale});
      arms.rig.set("scale", {scale});
      ASSERT_EQ(arms.rig.start(), LawResult::ok);
      arms.wait(0.3);
      Eigen::MatrixXd K(6, 6), X(6, 6);
      for (int k = 0; k < 6; ++k) {
        const JointVector way = arms.draw.joints(7, 2e-4);
        const Vector6 before = arms.wrench(0);
        X.col(k) = arms.plain[0].jacobian(arms.q[0]) * way;
        arms.lead(way, 0.5);
        arms.wait(0.5);
        K.col(k) = before - arms.wrench(0);
      }
      K = K * inverse(X);
      const Eigen::MatrixXd J = arms.plain[0].jacobian(arms.q[0]), M = arms.plain[0].mass(arms.q[0]);
      const Eigen::VectorXcd squared = Eigen::MatrixXd(J * inverse(M) * J.transpose() * K).eigenvalues();
      const double fastest = std::sqrt(squared.real().maxCoeff());
      EXPECT_LT(fastest, 1.01 * 150) << force_scale << " " << scale;
      EXPECT_GT(fastest, 0.5 * 150) << "it is softened no more than it must be";
    }
  }
}

// A jump of either is force on a hand, and energy that nobody supplied.
TEST(Teleoperation, FaultsOnAnArmThatJumps) {
  for (const std::size_t arm : {0u, 1u}) {
    Held arms(32);
    ASSERT_EQ(arms.rig.start(), LawResult::ok);
    ASSERT_EQ(arms.tick(joint_constant(7, 0.3)), LawResult::ok);
    arms.q[arm][5] -= 0.02;
    arms.rig.place(arm, arms.q[arm], arms.dq[arm]);
    EXPECT_EQ(arms.tick(JointVector::Zero(7)), LawResult::fault) << arm;
  }
}

// Held, the follower is left behind, and the clutch opens: neither hand is pulled any more.
TEST(Teleoperation, SlipsWhenTheFollowerIsLeftBehind) {
  for (const double architecture : {0.0, 1.0}) {
    Held arms(34);
    arms.rig.bound({});
    arms.rig.set("architecture", {architecture});
    arms.rig.set("channel_delay_s", {0.05});
    ASSERT_EQ(arms.rig.start(), LawResult::ok);
    arms.wait(0.3);
    JointVector way = arms.draw.joints(7, 1);
    way *= 0.3 / (arms.plain[0].jacobian(arms.q[0]) * way).head<3>().norm();  // of the hand [m]
    arms.lead(way, 3);
    EXPECT_EQ(arms.rig.output("slipped")[0], 1);
    arms.wait(1);
    for (const std::size_t i : {0u, 1u}) EXPECT_LT(arms.wrench(i).norm(), 0.1) << architecture << i;
    arms.lead(-way, 3);
    EXPECT_LT(arms.wrench(0).norm(), 5) << architecture;  // its own damping
    for (int k = 0; k < 100; ++k) ASSERT_EQ(arms.tick(0.3 * way), LawResult::ok);
    // Perhaps nobody holds it: 5 N s/m of its own and 30 N s/m more; and 0.1 N m s/rad of the joints.
    const Vector3 v = arms.V_WE(0).head<3>(), F = arms.wrench(0).head<3>();
    EXPECT_NEAR(-F.dot(v) / v.squaredNorm(), 35, 5) << architecture;
    arms.wait(0.01);
    EXPECT_LT(arms.wrench(1).norm(), 0.1) << architecture;
    arms.rig.set("clutch", {0});
    arms.wait(0.1);
    EXPECT_EQ(arms.rig.output("slipped")[0], 0);
    arms.rig.set("clutch", {1});
    arms.wait(0.3);
    arms.lead(0.1 * way, 1);
    EXPECT_GT(arms.wrench(1).norm(), 1) << architecture;
  }
}

// The person who opened the clutch before the follower slipped has not seen it slip, so it stays open.
TEST(Teleoperation, AnOldOpeningDoesNotEndANewSlip) {
  Held arms(38);
  arms.rig.bound({});
  arms.rig.set("channel_delay_s", {0.2});
  ASSERT_EQ(arms.rig.start(), LawResult::ok);
  arms.wait(0.5);
  JointVector way = arms.draw.joints(7, 1);
  way *= 0.6 / (arms.plain[0].jacobian(arms.q[0]) * way).head<3>().norm();  // 0.6 m/s of the hand
  int ticks = 0;
  for (; ticks < 1000 && arms.rig.output("slipped")[0] == 0; ++ticks) {
    ASSERT_EQ(arms.tick(way), LawResult::ok);
  }
  // The same again, with an opening of 10 ms that begins 0.1 s before it slips.
  Held again(38);
  again.rig.bound({});
  again.rig.set("channel_delay_s", {0.2});
  ASSERT_EQ(again.rig.start(), LawResult::ok);
  again.wait(0.5);
  for (int k = 0; k < ticks + 400; ++k) {
    if (k == ticks - 100) again.rig.set("clutch", {0});
    if (k == ticks - 90) again.rig.set("clutch", {1});
    ASSERT_EQ(again.tick(k < ticks ? way : JointVector(JointVector::Zero(7))), LawResult::ok);
    ASSERT_EQ(again.rig.output("slipped")[0], k >= ticks - 1 ? 1 : 0) << k;
  }
}

// The clutch opened, and the axes changed, in the middle of a motion: what the leader feels fades.
TEST(Teleoperation, LetsALeaderGoWithoutAKickInMotion) {
  for (const double architecture : {0.0, 1.0}) {
    for (const double delay : {0.0, 0.1}) {
      for (const char* what : {"clutch", "axes", "architecture", "clutch and stiffness"}) {
        Held arms(35);
        arms.rig.bound({});
        arms.rig.set("architecture", {architecture});
        arms.rig.set("channel_delay_s", {delay});
        ASSERT_EQ(arms.rig.start(), LawResult::ok);
        arms.wait(0.5);
        const JointVector way = arms.draw.joints(7, 0.5), begin = arms.q[1];
        std::vector<JointVector> led;
        Vector6 before = Vector6::Zero();
        double step = 0;
        for (int k = 0; k < 900; ++k) {
          // The follower's hand is 20 ms and the delay behind its leader's.
          led.push_back(arms.q[0]);
          const std::size_t late = std::size_t(20 + 1000 * delay);
          const std::size_t at = led.size() > late ? led.size() - 1 - late : 0;
          arms.dq[1] = (led.size() > late ? std::min(1.0, 0.005 * double(at)) : 0.0) * way;
          arms.q[1] = begin + led[at] - led[0];
          arms.rig.place(1, arms.q[1], arms.dq[1]);
          if (k == 500) {
            const std::string_view name = what;
            if (name.starts_with("clutch")) {
              arms.rig.set("clutch", {0});
            } else {
              arms.rig.set(what, {name == "axes" ? 1.0 : 1.0 - architecture});
            }
            if (name.ends_with("stiffness"))
              arms.rig.set("translational_stiffness_n_per_m", {5000, 5000, 5000});
          }
          ASSERT_EQ(arms.tick(way * std::min(1.0, 0.005 * k)), LawResult::ok);
          const Vector6 F = arms.wrench(0);
          if (k >= 495) step = std::max(step, (F - before).head<3>().norm());
          before = F;
        }
        EXPECT_LT(step, 5) << architecture << delay << what;  // [N] within one tick
      }
    }
  }
}

// Opened and closed at once, the lag is dropped: the leader feels it fade out, then the new one fade in.
TEST(Teleoperation, ClosesWithoutAJumpHoweverSoon) {
  Held arms(36);
  ASSERT_EQ(arms.rig.start(), LawResult::ok);
  arms.lead(arms.draw.joints(7, 0.03), 1);
  arms.wait(0.3);
  EXPECT_GT(arms.wrench(0).head<3>().norm(), 10);
  arms.rig.set("clutch", {0});
  arms.wait(0.002);
  arms.rig.set("clutch", {1});
  Vector6 before = arms.wrench(0);
  for (int k = 0; k < 600; ++k) {
    ASSERT_EQ(arms.tick(JointVector::Zero(7)), LawResult::ok);
    const Vector6 F = arms.wrench(0);
    ASSERT_LT((F - before).head<3>().norm(), 0.5) << k;
    before = F;
  }
}

// Nobody resists a leader that the follower drives: after half a second it is let go. With an estimate of a
// hand that resists, it is not; without an estimate, it is.
TEST(Teleoperation, LetsGoOfALeaderThatNobodyHolds) {
  for (const bool held : {false, true})
    for (const bool unknown : {false, true}) {
      Held arms(37);
      arms.rig.bound({});
      ASSERT_EQ(arms.rig.start(), LawResult::ok);
      arms.wait(0.3);
      if (held) arms.rig.state(0).F_K_W_est.vector[2] = 12;
      if (unknown) arms.rig.state(0).F_K_W_est.vector *= std::nan("");
      arms.rig.state(0).has_wrench_estimate = !unknown;
      const JointVector way = arms.draw.joints(7, 0.3);
      ASSERT_GT((arms.plain[0].jacobian(arms.q[0]) * way).head<3>().norm(), 0.06);
      for (int k = 0; k < 800; ++k) {  // the follower first, by 0.1 s; then the leader comes after it
        arms.q[1] += 0.001 * way;
        arms.dq[1] = way;
        arms.rig.place(1, arms.q[1], arms.dq[1]);
        ASSERT_EQ(arms.tick((k < 100 ? 0.0 : 1.0) * way), LawResult::ok);
      }
      EXPECT_EQ(arms.rig.output("slipped")[0], held && !unknown ? 0 : 1);
    }
}

// Also where a scene lifts the bounds, a follower that is pushed ahead drives its leader with 60 N at most.
TEST(Teleoperation, DrivesTheLeaderNoHarderWithLiftedBounds) {
  Held arms(39);
  ASSERT_EQ(arms.rig.start(), LawResult::ok);
  arms.wait(0.5);
  const Eigen::MatrixXd J = arms.plain[1].jacobian(arms.q[1]);
  Vector6 along = Vector6::Zero();
  along.head<3>() = 0.08 * arms.draw.vector3(1).normalized();  // 120 N with 1500 N/m
  const JointVector way = J.transpose() * (J * J.transpose()).ldlt().solve(along);
  for (int k = 0; k < 1000; ++k) {
    arms.q[1] += 0.001 * way;
    arms.dq[1] = way;
    arms.rig.place(1, arms.q[1], arms.dq[1]);
    ASSERT_EQ(arms.tick(JointVector::Zero(7)), LawResult::ok);
  }
  arms.dq[1].setZero();
  arms.rig.place(1, arms.q[1], arms.dq[1]);
  arms.wait(0.3);
  EXPECT_EQ(arms.rig.output("slipped")[0], 0);
  EXPECT_GT(arms.wrench(1).head<3>().norm(), 100);
  EXPECT_NEAR(arms.wrench(0).head<3>().norm(), 60, 0.1);
}

// Of 20 packets of the follower one arrives. Its velocity then drives the leader little, and never in steps.
TEST(Teleoperation, AFollowerThatFaltersDoesNotShakeTheLeader) {
  Held arms(33);
  ASSERT_EQ(arms.rig.start(), LawResult::ok);
  arms.wait(0.5);
  arms.dq[1] = joint_constant(7, 0.1);
  arms.rig.place(1, arms.q[1], arms.dq[1]);
  arms.wait(0.3);
  const double driven = arms.rig.tau(0).norm();
  EXPECT_GT(driven, 0.5);
  arms.rig.set("channel_loss", {0.95});
  double mean = 0;
  JointVector before = arms.rig.tau(0);
  for (int k = 0; k < 2000; ++k) {
    ASSERT_EQ(arms.tick(JointVector::Zero(7)), LawResult::ok);
    ASSERT_LT((arms.rig.tau(0) - before).norm(), 0.06 * driven) << k;
    before = arms.rig.tau(0);
    if (k >= 100) mean += before.norm() / driven / 1900;
  }
  EXPECT_LT(mean, 0.3);
}

TEST(Teleoperation, FaultsOnAStateThatIsNotANumber) {
  for (const std::size_t arm : {0u, 1u}) {
    Held arms(27);
    ASSERT_EQ(arms.rig.start(), LawResult::ok);
    arms.q[arm][2] = std::nan("");
    arms.rig.place(arm, arms.q[arm], arms.dq[arm]);
    EXPECT_EQ(arms.rig.tick(0.001), LawResult::fault) << arm;
  }
}

}  // namespace
}  // namespace multipanda::teleoperation_test
