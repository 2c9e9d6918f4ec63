// Followers: where the set-point goes for a motion of the leader, from the kinematics of both arms written
// independently; and what happens at the start, at the clutch, and when the leader falters.
#include <cmath>

#include <gtest/gtest.h>

#include "core/controllets/builtins.hpp"
#include "core/testing/moving_law.hpp"

namespace multipanda::follower_test {
namespace {

using namespace test;

// Arm 0 follows, arm 1 leads; both bases are rotated and off the origin. The follower is held where it is, so
// that its error shows its set-point.
struct Pair : LedLaw {
  explicit Pair(const ControlletType& type, std::uint32_t seed = 5) : LedLaw(type, 1, seed) {}
  Pose set_point() {
    const Pose X = X_WE(0);
    return {exp_rotation(shown("orientation_error_rad")) * X.rotation,
            X.position + shown("position_error_m")};
  }
};

double distance(const Pose& a, const Pose& b) { return pose_error(a, b).norm(); }

TEST(Followers, BeginWithoutAPullWhereverTheLeaderIs) {
  for (const ControlletType& type : {joint_follower_controllet(), pose_follower_controllet()}) {
    for (const double alignment : {0.0, 1.0}) {
      Pair pair(type);
      pair.rig.set("alignment", {alignment});
      ASSERT_EQ(pair.rig.start(), LawResult::ok);
      ASSERT_EQ(pair.tick(JointVector::Zero(7)), LawResult::ok);
      EXPECT_LT(pair.rig.tau(0).lpNorm<Eigen::Infinity>(), 1.0) << type.descriptor.type << alignment;
      JointVector before = pair.rig.tau(0);
      double rate = 0;
      for (int k = 0; k < 1000; ++k) {
        ASSERT_EQ(pair.tick(JointVector::Zero(7)), LawResult::ok);
        rate = std::max(rate, (pair.rig.tau(0) - before).lpNorm<Eigen::Infinity>() / 0.001);
        before = pair.rig.tau(0);
      }
      EXPECT_LT(rate, 1000) << type.descriptor.type << alignment;
      if (alignment == 0) {
        EXPECT_LT(before.norm(), 1e-6) << type.descriptor.type;
      }
    }
  }
}

// The hand's way in the axes of each base, or of the world, scaled.
TEST(PoseFollower, MovesAsTheLeaderInItsAxesAndScale) {
  for (const bool world : {false, true}) {
    for (const double scale : {1.0, 0.4, 2.0}) {
      Pair pair(pose_follower_controllet(), 7);
      pair.rig.set("axes", {world ? 1.0 : 0.0});
      pair.rig.set("scale", {scale});
      ASSERT_EQ(pair.rig.start(), LawResult::ok);
      const Pose X_l = pair.X_WE(1), X_f = pair.X_WE(0);
      pair.lead(pair.draw.joints(7, 0.15), 1.5);
      pair.wait(1);
      const Pose X_l2 = pair.X_WE(1);
      Matrix3 R = Matrix3::Identity();
      if (!world)
        R = pair.rig.terms(0).model().X_WB().rotation * pair.rig.terms(1).model().X_WB().rotation.transpose();
      const Pose expected{R * X_l2.rotation * X_l.rotation.transpose() * R.transpose() * X_f.rotation,
                          X_f.position + scale * R * (X_l2.position - X_l.position)};
      EXPECT_GT(distance(X_l, X_l2), 0.02);
      EXPECT_LT(distance(pair.set_point(), expected), 1e-6) << world << scale;
    }
  }
}

TEST(PoseFollower, FollowsAMovingLeaderClosely) {
  Pair pair(pose_follower_controllet(), 8);
  ASSERT_EQ(pair.rig.start(), LawResult::ok);
  const Pose X_l = pair.X_WE(1), X_f = pair.X_WE(0);
  const Matrix3 R =
      pair.rig.terms(0).model().X_WB().rotation * pair.rig.terms(1).model().X_WB().rotation.transpose();
  const JointVector way = pair.draw.joints(7, 0.2);
  double largest = 0, hardest = 0;
  Vector3 v_before = Vector3::Zero();
  for (int k = 0; k < 4000; ++k) {  // sin^2 over 4 s, twice
    const double w = M_PI / 2;
    ASSERT_EQ(pair.tick(way * w * std::sin(2 * w * 0.001 * (k + 0.5))), LawResult::ok);
    const Vector3 expected = X_f.position + R * (pair.X_WE(1).position - X_l.position);
    largest = std::max(largest, (pair.set_point().position - expected).norm());
    const Vector3 v = pair.V_WE(1).head<3>();
    if (k > 0) hardest = std::max(hardest, (v - v_before).norm() / 0.001);
    v_before = v;
  }
  EXPECT_GT(hardest, 0.1);  // [m/s^2]
  EXPECT_LT(largest, 1.2 * 3 * hardest / (80 * 80) + 2e-4);
}

TEST(PoseFollower, MatchesTheLeadersPoseInItsBaseAtTheSpeedOfAHand) {
  Pair pair(pose_follower_controllet(), 9);
  pair.rig.bound({});
  pair.rig.set("alignment", {1});
  ASSERT_EQ(pair.rig.start(), LawResult::ok);
  // So soft that the held hand does not block it.
  pair.rig.set("translational_stiffness_n_per_m", {20, 20, 20});
  pair.rig.set("rotational_stiffness_nm_per_rad", {2, 2, 2});
  Vector3 before = pair.X_WE(0).position;
  double fastest = 0;
  const Pose X_WBf = pair.rig.terms(0).model().X_WB(), X_WBl = pair.rig.terms(1).model().X_WB();
  const Pose goal = X_WBf * X_WBl.inverse() * pair.X_WE(1);
  for (int k = 0; k < 8000; ++k) {
    ASSERT_EQ(pair.tick(JointVector::Zero(7)), LawResult::ok);
    const Vector3 p = pair.set_point().position;
    fastest = std::max(fastest, (p - before).norm() / 0.001);
    before = p;
  }
  EXPECT_LT(fastest, 1.03 * 0.25);
  EXPECT_LT(distance(pair.set_point(), goal), 1e-6);
}

// Nobody leads the way of an alignment: where a hand blocks it, the follower gives it up and yields.
TEST(Followers, MatchNoFartherThanToAHandInTheWay) {
  for (const ControlletType& type : {joint_follower_controllet(), pose_follower_controllet()}) {
    Pair pair(type, 9);
    pair.rig.bound({});
    pair.rig.set("alignment", {1});
    pair.q[1] += joint_constant(7, 0.7);
    pair.rig.place(1, pair.q[1], pair.dq[1]);
    ASSERT_EQ(pair.rig.start(), LawResult::ok);
    double hardest = 0;
    for (int k = 0; k < 6000; ++k) {
      ASSERT_EQ(pair.tick(JointVector::Zero(7)), LawResult::ok);
      const Vector6 F = pair.wrench(0);
      hardest = std::max({hardest, F.head<3>().norm() / 60, F.tail<3>().norm() / 15});
    }
    EXPECT_GT(hardest, 0.8) << type.descriptor.type;
    EXPECT_EQ(pair.rig.output("slipped")[0], 1) << type.descriptor.type;
    EXPECT_LT(pair.rig.tau(0).norm(), 0.1) << type.descriptor.type;
  }
}

TEST(Followers, StayWhileTheClutchIsOpenAndGoOnFromThere) {
  for (const ControlletType& type : {joint_follower_controllet(), pose_follower_controllet()}) {
    Pair pair(type, 10);
    ASSERT_EQ(pair.rig.start(), LawResult::ok);
    pair.rig.set("clutch", {0});
    pair.lead(pair.draw.joints(7, 0.3), 1);
    EXPECT_LT(pair.rig.tau(0).norm(), 1e-6) << type.descriptor.type;
    pair.rig.set("clutch", {1});
    pair.wait(0.5);
    EXPECT_LT(pair.rig.tau(0).norm(), 1e-6) << type.descriptor.type;
    pair.lead(pair.draw.joints(7, 0.005), 1);  // a light pull: it does not yield to it
    EXPECT_GT(pair.rig.tau(0).norm(), 0.1) << type.descriptor.type;
    // Opened while both move: brakes, and stays.
    for (int k = 0; k < 100; ++k) ASSERT_EQ(pair.tick(joint_constant(7, 0.02)), LawResult::ok);
    pair.rig.set("clutch", {0});
    for (int k = 0; k < 300; ++k) ASSERT_EQ(pair.tick(joint_constant(7, 0.1)), LawResult::ok);
    const JointVector tau = pair.rig.tau(0);
    for (int k = 0; k < 300; ++k) ASSERT_EQ(pair.tick(joint_constant(7, 0.1)), LawResult::ok);
    EXPECT_LT((pair.rig.tau(0) - tau).norm(), 1e-3) << type.descriptor.type;
  }
}

// No faster than a hand may be, however fast the leader is.
TEST(PoseFollower, KeepsToTheSpeedOfAHand) {
  Pair pair(pose_follower_controllet(), 11);
  pair.rig.bound({.hand_speed = 0.25, .spring_force = 1e6, .spring_moment = 1e6});
  ASSERT_EQ(pair.rig.start(), LawResult::ok);
  Vector3 before = pair.X_WE(0).position;
  const Vector3 begin = pair.X_WE(1).position;
  double fastest = 0;
  const JointVector way = pair.draw.joints(7, 1.5);
  for (int k = 0; k < 6000; ++k) {
    ASSERT_EQ(pair.tick(k < 500 ? JointVector(way) : JointVector(JointVector::Zero(7))), LawResult::ok);
    const Vector3 p = pair.set_point().position;
    fastest = std::max(fastest, (p - before).norm() / 0.001);
    before = p;
  }
  EXPECT_GT((pair.X_WE(1).position - begin).norm() / 0.5, 0.3);  // the leader's mean speed
  EXPECT_LT(fastest, 1.03 * 0.25);
  EXPECT_LT(pair.shown("lag_m").norm(), 1e-3);  // it arrived
}

TEST(JointFollower, KeepsToTheSpeedOfAHand) {
  Pair pair(joint_follower_controllet(), 12);
  pair.rig.bound({.hand_speed = 0.25, .spring_force = 1e6, .spring_moment = 1e6});
  pair.rig.set("stiffness_nm_per_rad", {200});
  ASSERT_EQ(pair.rig.start(), LawResult::ok);
  const JointVector way = pair.draw.joints(7, 1);
  double fastest = 0;
  for (int k = 0; k < 3000; ++k) {
    // The follower goes where its set-point is: a pull-free arm.
    ASSERT_EQ(pair.tick(k < 400 ? JointVector(way) : JointVector(JointVector::Zero(7))), LawResult::ok);
    pair.rig.integrate(0.001, {JointVector::Zero(7), JointVector::Zero(7)});
    pair.q[0] = pair.rig.state(0).q;
    pair.dq[0] = pair.rig.state(0).dq;
    pair.rig.place(1, pair.q[1], pair.dq[1]);  // integrate() moved it, too
    fastest = std::max(fastest, pair.V_WE(0).head<3>().norm());
  }
  EXPECT_LT(fastest, 1.1 * 0.25);
  EXPECT_GT(fastest, 0.2);
  EXPECT_LT(pair.rig.output("largest_lag_rad")[0], 1e-3);
}

// The velocity of a leader whose states fail to arrive no longer counts; the set-point comes to rest.
TEST(Followers, BrakeWhenTheLeaderFalters) {
  for (const ControlletType& type : {joint_follower_controllet(), pose_follower_controllet()}) {
    Pair pair(type, 13);
    ASSERT_EQ(pair.rig.start(), LawResult::ok);
    const JointVector way = pair.draw.joints(7, 0.03);
    for (int k = 0; k < 300; ++k) ASSERT_EQ(pair.tick(way), LawResult::ok);
    std::vector<double> taus;
    for (int k = 1; k <= 400; ++k) {
      pair.rig.state(1).age_s = 0.001 * k;
      ASSERT_EQ(pair.rig.tick(0.001), LawResult::ok);
      taus.push_back(pair.rig.tau(0).norm());
    }
    EXPECT_LT(std::abs(taus[399] - taus[299]), 1e-3 * taus[399]) << type.descriptor.type;
  }
}

// What presses on a held follower keeps to the bounds, however far the leader goes.
TEST(Followers, PullWithinTheBoundsForContact) {
  for (const ControlletType& type : {joint_follower_controllet(), pose_follower_controllet()}) {
    Pair pair(type, 14);
    pair.rig.bound({});
    ASSERT_EQ(pair.rig.start(), LawResult::ok);
    ASSERT_EQ(pair.tick(JointVector::Zero(7)), LawResult::ok);
    JointVector before = pair.rig.tau(0);
    double rate = 0, force = 0, moment = 0;
    for (int k = 0; k < 3000; ++k) {
      ASSERT_EQ(pair.tick(k < 1000 ? joint_constant(7, 0.4) : JointVector(JointVector::Zero(7))),
                LawResult::ok);
      rate = std::max(rate, (pair.rig.tau(0) - before).lpNorm<Eigen::Infinity>() / 0.001);
      before = pair.rig.tau(0);
      const Vector6 F = pair.wrench(0);
      force = std::max(force, F.head<3>().norm());
      moment = std::max(moment, F.tail<3>().norm());
    }
    EXPECT_LT(force, 60.001) << type.descriptor.type;
    EXPECT_LT(moment, 15.001) << type.descriptor.type;
    EXPECT_GT(std::max(force / 60, moment / 15), 0.7) << type.descriptor.type;
    EXPECT_LT(rate, 1000) << type.descriptor.type;
  }
}

// The pull at the hand says nothing of the joints across it. If those went on, the arm would fold around what
// holds its hand, until a wrist bears all it can.
TEST(JointFollower, WaitsAsAWholeForAHandThatIsHeld) {
  for (const std::uint32_t seed : {20u, 21u, 22u}) {
    Pair pair(joint_follower_controllet(), seed);
    pair.rig.bound({});
    ASSERT_EQ(pair.rig.start(), LawResult::ok);
    JointVector way = pair.draw.joints(7, 1);
    way *= 0.1 / (pair.plain[0].jacobian(pair.q[0]) * way).head<3>().norm();  // of the hand [m]
    pair.lead(way, 3);
    const double waits_at = pair.rig.output("largest_error_rad")[0];
    EXPECT_EQ(pair.rig.output("slipped")[0], 0) << seed;
    EXPECT_LT(waits_at, 0.7 * way.lpNorm<Eigen::Infinity>()) << seed;
    pair.wait(6);
    EXPECT_NEAR(pair.rig.output("largest_error_rad")[0], waits_at, 0.01) << seed;
    pair.lead(-way, 3);  // back: it is free again
    pair.wait(2);
    EXPECT_LT(pair.rig.output("largest_error_rad")[0], 1e-4) << seed;
  }
}

// The hand stays where it is while the elbow swings: nothing waits at the hand, and the elbow presses.
TEST(JointFollower, PressesNoHarderWithItsElbow) {
  Pair pair(joint_follower_controllet(), 23);
  pair.rig.bound({});
  ASSERT_EQ(pair.rig.start(), LawResult::ok);
  const Eigen::MatrixXd J = pair.plain[0].jacobian(pair.q[0]), M = pair.plain[0].mass(pair.q[0]);
  JointVector swing = Eigen::FullPivLU<Eigen::MatrixXd>(J).kernel().col(0);
  swing *= 0.5 / swing.lpNorm<Eigen::Infinity>();
  const Eigen::MatrixXd J_e = pair.plain[0].elbow_jacobian(pair.q[0]);
  const Eigen::MatrixXd A = J_e * inverse(M) * J_e.transpose() + 0.005 * Matrix3::Identity();
  const auto presses = [&](const Eigen::VectorXd& tau) {
    return (inverse(A) * J_e * inverse(M) * tau).norm();
  };
  double largest = 0;
  for (int k = 0; k < 2500; ++k) {
    const double s = (k + 0.5) / 1000;
    const double speed = s < 1 ? 30 * s * s * (1 - s) * (1 - s) : 0;
    ASSERT_EQ(pair.tick(speed * swing), LawResult::ok);
    largest = std::max(largest, presses(pair.rig.tau(0)));
    EXPECT_LT(pair.wrench(0).head<3>().norm(), 45);  // not what makes it wait
  }
  JointVector K(7);
  K << 600, 600, 600, 600, 250, 150, 50;
  EXPECT_LT(largest, 60.001);
  EXPECT_GT(largest, 48);
  EXPECT_GT(presses(K.cwiseProduct(swing)), 100);  // what it would come to
}

// A leader that goes back relieves the hand at once, though its follower is still behind.
TEST(Followers, RelieveAHandAsSoonAsTheirLeadersGoBack) {
  for (const ControlletType& type : {joint_follower_controllet(), pose_follower_controllet()}) {
    for (const std::uint32_t seed : {31u, 32u}) {
      Pair pair(type, seed);
      pair.rig.bound({});
      ASSERT_EQ(pair.rig.start(), LawResult::ok);
      const bool by_hand = type.descriptor.type == "pose_follower";
      const Eigen::MatrixXd J = pair.plain[by_hand ? 1 : 0].jacobian(pair.q[by_hand ? 1 : 0]);
      JointVector way = pair.draw.joints(7, 1);  // 1 m of the hand that is led
      if (by_hand) {
        const Vector6 along = (Vector6() << pair.draw.vector3(1), Vector3::Zero()).finished();
        way = J.transpose() * (J * J.transpose()).ldlt().solve(along);
      }
      way /= (J * way).head<3>().norm();
      pair.lead((by_hand ? 0.22 : 0.1) * way, 3);
      pair.wait(2);
      EXPECT_EQ(pair.rig.output("slipped")[0], 0) << type.descriptor.type << seed;
      const auto share = [&] {
        const Vector6 F = pair.wrench(0);
        return std::max(F.head<3>().norm() / 60, F.tail<3>().norm() / 15);
      };
      const double held = share();
      EXPECT_GT(held, 0.9) << type.descriptor.type << seed;
      for (int k = 0; k < 150; ++k) ASSERT_EQ(pair.tick(-0.1 * way), LawResult::ok);  // 15 mm in 0.15 s
      EXPECT_LT(share(), held - 0.06) << type.descriptor.type << seed;
    }
  }
}

// Where a scene lifts the bounds nothing waits: the clutch opens at three times the usual pull.
TEST(Followers, SlipWhereTheyPressHardWithLiftedBounds) {
  for (const ControlletType& type : {joint_follower_controllet(), pose_follower_controllet()}) {
    for (const double force : {1000.0, HUGE_VAL}) {
      Pair pair(type, 34);
      pair.rig.bound({.hand_speed = force, .spring_force = force, .spring_moment = force});
      if (type.descriptor.type == "pose_follower")
        pair.rig.set("translational_stiffness_n_per_m", {1500, 1500, 1500});
      ASSERT_EQ(pair.rig.start(), LawResult::ok);
      const std::size_t hand = type.descriptor.type == "pose_follower" ? 1 : 0;
      const Eigen::MatrixXd J = pair.plain[hand].jacobian(pair.q[hand]).topRows(3);
      const JointVector way =
          J.transpose() * (J * J.transpose()).ldlt().solve(pair.draw.vector3(0.25).normalized() * 0.25);
      double hardest = 0;
      for (int k = 0; k < 2000; ++k) {
        ASSERT_EQ(pair.tick(0.5 * way), LawResult::ok);
        hardest = std::max(hardest, pair.wrench(0).head<3>().norm());
      }
      EXPECT_EQ(pair.rig.output("slipped")[0], 1) << type.descriptor.type << force;
      EXPECT_GT(hardest, 100) << type.descriptor.type << force;
      EXPECT_LT(hardest, 1.6 * 180) << type.descriptor.type << force;  // damping and the way to rest
      pair.wait(2);
      EXPECT_LT(pair.rig.tau(0).norm(), 0.1) << type.descriptor.type << force;
    }
  }
}

// A held follower is left behind: its clutch opens, it yields, and goes on only after the clutch was opened.
TEST(Followers, SlipWhenTheyAreLeftBehind) {
  for (const ControlletType& type : {joint_follower_controllet(), pose_follower_controllet()}) {
    Pair pair(type, 24);
    pair.rig.bound({});
    ASSERT_EQ(pair.rig.start(), LawResult::ok);
    const JointVector way = pair.draw.joints(7, 0.9);
    double hardest = 0;
    for (int k = 0; k < 2000; ++k) {
      ASSERT_EQ(pair.tick(0.5 * way), LawResult::ok);
      hardest = std::max(hardest, pair.wrench(0).head<3>().norm());
    }
    EXPECT_GT(hardest, 40) << type.descriptor.type;
    EXPECT_EQ(pair.rig.output("slipped")[0], 1) << type.descriptor.type;
    pair.wait(1.5);
    EXPECT_LT(pair.rig.tau(0).norm(), 0.1) << type.descriptor.type;
    pair.lead(-way, 2);  // as far back, and more: it stays
    pair.lead(-way, 2);
    EXPECT_LT(pair.rig.tau(0).norm(), 0.1) << type.descriptor.type;
    pair.rig.set("clutch", {0});
    pair.wait(0.01);
    EXPECT_EQ(pair.rig.output("slipped")[0], 0) << type.descriptor.type;
    pair.rig.set("clutch", {1});
    pair.lead(0.05 * way, 1);
    EXPECT_GT(pair.rig.tau(0).norm(), 0.5) << type.descriptor.type;
  }
}

// An open clutch leaves a light pull as it is and yields to a hard one.
TEST(Followers, YieldToAHandThatIsPulledHard) {
  for (const ControlletType& type : {joint_follower_controllet(), pose_follower_controllet()}) {
    for (const bool hard : {false, true}) {
      Pair pair(type, 25);
      pair.rig.bound({});
      ASSERT_EQ(pair.rig.start(), LawResult::ok);
      const std::size_t hand = type.descriptor.type == "pose_follower" ? 1 : 0;  // whose way is led
      const Eigen::MatrixXd J = pair.plain[hand].jacobian(pair.q[hand]).topRows(3);
      const Vector3 shift = 0.12 * pair.draw.vector3(1).normalized();
      JointVector way = J.transpose() * (J * J.transpose()).ldlt().solve(shift);
      if (!hard) way *= 0.005 / way.lpNorm<Eigen::Infinity>();
      pair.lead(way, 2);
      pair.wait(1);
      const Vector6 F = pair.wrench(0);
      const double pulled = F.head<3>().norm(), share = std::max(pulled / 60, F.tail<3>().norm() / 15);
      EXPECT_GT(share, hard ? 0.6 : 0.01) << type.descriptor.type;
      EXPECT_LT(share, hard ? 1.0001 : 0.4) << type.descriptor.type;
      pair.rig.set("clutch", {0});
      JointVector before = pair.rig.tau(0);
      for (int k = 0; k < 1500; ++k) {
        ASSERT_EQ(pair.tick(way), LawResult::ok);  // whatever the leader does
        ASSERT_LT((pair.rig.tau(0) - before).lpNorm<Eigen::Infinity>() / 0.001, 1300);
        before = pair.rig.tau(0);
      }
      EXPECT_NEAR(pair.wrench(0).head<3>().norm(), hard ? 0 : pulled, 0.01) << type.descriptor.type << hard;
    }
  }
}

// The bystander on a half circle: the follower is slower than its leader and would cut across.
TEST(PoseFollower, StaysCloseToItsLeadersWay) {
  Pair pair(pose_follower_controllet(), 26);
  pair.rig.bound({.hand_speed = 0.25, .spring_force = 1e6, .spring_moment = 1e6});
  ASSERT_EQ(pair.rig.start(), LawResult::ok);
  const Matrix3 R =
      pair.rig.terms(0).model().X_WB().rotation * pair.rig.terms(1).model().X_WB().rotation.transpose();
  const Vector3 p_l = pair.X_WE(1).position, p_f = pair.X_WE(0).position;
  std::vector<Vector3> way;
  double farthest = 0;
  for (int k = 0; k < 4000; ++k) {
    // About 0.6 m/s along three quarters of a circle of 0.12 m.
    const double angle = std::min(1.5 * M_PI, 0.6 / 0.12 * 0.001 * k);
    Vector3 v = Vector3::Zero();
    if (angle < 1.5 * M_PI) v = 0.6 * Vector3(std::sin(angle), std::cos(angle), 0);
    const Eigen::MatrixXd J = pair.plain[1].jacobian(pair.q[1]).topRows(3);
    const JointVector dq = J.transpose() * (J * J.transpose() + 0.01 * Matrix3::Identity()).inverse() * v;
    ASSERT_EQ(pair.tick(dq), LawResult::ok) << k;
    if (k % 10 == 0) way.push_back(p_f + R * (pair.X_WE(1).position - p_l));
    double nearest = 1e9;
    for (const Vector3& p : way) nearest = std::min(nearest, (pair.set_point().position - p).norm());
    farthest = std::max(farthest, nearest);
  }
  EXPECT_GT((way.back() - p_f).norm(), 0.1);
  EXPECT_EQ(pair.rig.output("slipped")[0], 1);
  EXPECT_LT(farthest, 0.0625);  // half the way that it may be behind, so an end of that is nearer
}

// Alignment begins far away, and slips only once it has arrived.
TEST(PoseFollower, MatchesBeforeItMaySlip) {
  Pair pair(pose_follower_controllet(), 9);
  pair.rig.bound({.hand_speed = 0.25, .spring_force = 1e6, .spring_moment = 1e6});
  pair.rig.set("translational_stiffness_n_per_m", {20, 20, 20});  // the held hand does not block it
  pair.rig.set("rotational_stiffness_nm_per_rad", {2, 2, 2});
  pair.rig.set("alignment", {1});
  pair.q[1] += joint_constant(7, 0.3);
  pair.rig.place(1, pair.q[1], pair.dq[1]);
  ASSERT_EQ(pair.rig.start(), LawResult::ok);
  ASSERT_EQ(pair.tick(JointVector::Zero(7)), LawResult::ok);
  EXPECT_GT(pair.shown("lag_m").norm() + pair.shown("orientation_error_rad").norm(), 0.2);
  pair.wait(8);
  EXPECT_LT(pair.shown("lag_m").norm(), 1e-3);
  EXPECT_EQ(pair.rig.output("slipped")[0], 0);
  for (int k = 0; k < 1000; ++k) ASSERT_EQ(pair.tick(joint_constant(7, 1)), LawResult::ok);
  EXPECT_EQ(pair.rig.output("slipped")[0], 1);
}

// A velocity that does not belong to any way of the leader does not carry the set-point off.
TEST(PoseFollower, StaysWithALeaderWhoseVelocityIsWrong) {
  Pair pair(pose_follower_controllet(), 27);
  pair.rig.bound({.hand_speed = 0.25, .spring_force = 1e6, .spring_moment = 1e6});
  ASSERT_EQ(pair.rig.start(), LawResult::ok);
  pair.dq[1] = pair.draw.joints(7, 2);
  pair.rig.place(1, pair.q[1], pair.dq[1]);
  for (int k = 0; k < 3000; ++k) ASSERT_EQ(pair.rig.tick(0.001), LawResult::ok);
  EXPECT_GT(pair.V_WE(1).head<3>().norm(), 0.5);
  EXPECT_LT(pair.shown("lag_m").norm(), 0.02);
}

TEST(JointFollower, ScalesAndMirrorsJointsAndMatchesThem) {
  Pair pair(joint_follower_controllet(), 15);
  const std::vector<double> scale = {1, -1, 0.5, -0.5, 2, 0, 1};
  pair.rig.set("joint_scale", scale);
  pair.rig.set("stiffness_nm_per_rad", {10});  // the held arm does not strain it
  ASSERT_EQ(pair.rig.start(), LawResult::ok);
  const JointVector way = pair.draw.joints(7, 0.3);
  pair.lead(way, 2);
  pair.wait(1);
  const auto set_point = [&] {  // at rest: tau = K (q_d - q)
    return JointVector(pair.q[0] + pair.rig.tau(0) / 10);
  };
  for (int i = 0; i < 7; ++i)
    EXPECT_NEAR(set_point()[i] - pair.q[0][i], scale[static_cast<std::size_t>(i)] * way[i], 1e-6) << i;
  pair.rig.set("alignment", {1});
  pair.rig.set("joint_scale", {1});
  pair.wait(6);
  EXPECT_LT((set_point() - pair.q[1]).norm(), 1e-6);
}

TEST(JointFollower, StaysWithinItsOwnJointLimits) {
  Pair pair(joint_follower_controllet(), 16);
  pair.rig.set("stiffness_nm_per_rad", {1});  // the held arm does not strain it
  ASSERT_EQ(pair.rig.start(), LawResult::ok);
  JointVector way = JointVector::Zero(7);
  way[2] = 6;
  pair.lead(way, 8);
  pair.wait(6);
  const double limit = pair.rig.terms(0).model().limits().q_max[2] - 0.05;
  EXPECT_LT(limit, pair.q[0][2] + 6);
  EXPECT_NEAR(pair.q[0][2] + pair.rig.tau(0)[2], limit, 1e-6);
}

TEST(JointFollower, RefusesALeaderWithAnotherNumberOfJoints) {
  const Models models{TestArm::make(7).model(), TestArm::make(6).model()};
  EXPECT_THROW(ControlletRig(joint_follower_controllet(), models), std::invalid_argument);
}

// The hand that leads, or the one that follows, is redefined: nothing moves.
TEST(PoseFollower, IsNotMovedByAnotherEndEffectorOfEitherArm) {
  const Pose X{exp_rotation(Vector3(0.2, 0.1, 0.3)), Vector3(0.03, 0.05, -0.02)};
  for (const std::size_t arm : {0u, 1u}) {
    Pair pair(pose_follower_controllet(), 17);
    ASSERT_EQ(pair.rig.start(), LawResult::ok);
    pair.lead(pair.draw.joints(7, 0.05), 1);
    pair.wait(0.5);
    const Vector3 error = pair.shown("position_error_m"), lag = pair.shown("lag_m");
    EXPECT_LT(lag.norm(), 1e-6);
    const Vector3 turn = pair.shown("orientation_error_rad");
    pair.rig.redefine(arm, X);
    pair.wait(0.5);
    EXPECT_LT(pair.shown("lag_m").norm(), 1e-6) << arm;
    if (arm == 1) {
      EXPECT_LT((pair.shown("position_error_m") - error).norm(), 1e-6);
    }
    EXPECT_LT((pair.shown("orientation_error_rad") - turn).norm(), 1e-6) << arm;
  }
}

// Farther within one packet than the joints can turn, forwards or back; as far after a gap is possible.
TEST(Followers, FaultOnALeaderThatJumps) {
  for (const ControlletType& type : {joint_follower_controllet(), pose_follower_controllet()}) {
    for (const double jump : {0.02, -0.02}) {
      for (const double gap_s : {0.001, 0.015}) {
        Pair pair(type, 19);
        ASSERT_EQ(pair.rig.start(), LawResult::ok);
        ASSERT_EQ(pair.tick(joint_constant(7, 0.3)), LawResult::ok);
        pair.q[1][3] += jump;
        pair.rig.state(1).t_robot = pair.rig.state(1).t_robot + std::chrono::microseconds(int(1e6 * gap_s));
        EXPECT_EQ(pair.tick(JointVector::Zero(7)), gap_s < 0.01 ? LawResult::fault : LawResult::ok)
            << type.descriptor.type << jump << gap_s;
      }
    }
  }
}

TEST(Followers, FaultOnALeaderThatIsNotANumber) {
  for (const ControlletType& type : {joint_follower_controllet(), pose_follower_controllet()}) {
    Pair pair(type, 18);
    ASSERT_EQ(pair.rig.start(), LawResult::ok);
    EXPECT_EQ(pair.tick(joint_constant(7, std::nan(""))), LawResult::fault) << type.descriptor.type;
  }
}

}  // namespace
}  // namespace multipanda::follower_test
