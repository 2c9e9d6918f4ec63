// The arm's own controllers in closed loop, and the planner of asynchronous motion.
#include <deque>

#include <Eigen/Cholesky>
#include <gtest/gtest.h>

#include "backends/simulated_arm/async_planner.hpp"
#include "backends/simulated_arm/desired_motion.hpp"
#include "backends/simulated_arm/internal_controllers.hpp"
#include "core/testing/test_arm.hpp"
#include "models/arm_source.hpp"

namespace multipanda::motion_control_test {
namespace {

using test::Draw;
constexpr double dt = 0.001;

// Rigid bodies whose gravity is compensated, driven by motors that may be slow and late.
class Plant {
 public:
  Plant(const RobotDescription& robot, const Pose& X_WB, bool realistic)
      : model(std::make_shared<const ArmModel>(arm_model_source(robot, X_WB, true))),
        measured(model),
        q(model->q_home()),
        dq(JointVector::Zero(q.size())),
        friction(*robot.friction),
        body_(model),
        realistic_(realistic),
        tracked_(dq) {
    set_frames({});
    sense();
  }
  void set_frames(const ArmFrames& frames) {
    measured.set_config(frames, {}, {});
    body_.set_config(frames, {}, {});
    sense();
  }
  // A control period: 50 Hz of torque bandwidth, a period of delay, friction and noise, or none of them.
  void step(const JointVector& tau) {
    late_.push_back(tau);
    const JointVector requested = realistic_ && late_.size() > 1 ? late_[late_.size() - 2] : tau;
    if (late_.size() > 2) late_.pop_front();
    constexpr int kSubsteps = 4;
    const double h = dt / kSubsteps, share = realistic_ ? 1 - std::exp(-2 * M_PI * 50 * h) : 1;
    for (int k = 0; k < kSubsteps; ++k) {
      tracked_ += share * (requested - tracked_);
      body_.update(q, dq);
      JointVector load = tracked_ + push - body_.c();
      load += body_.J_V_WK().transpose() * F_K_W_on_arm;
      for (Eigen::Index i = 0; realistic_ && i < q.size(); ++i) {
        const double p1 = friction.p1[i], p2 = friction.p2[i], p3 = friction.p3[i];
        load[i] -= p1 / (1 + std::exp(-p2 * (dq[i] + p3))) - p1 / (1 + std::exp(-p2 * p3));
      }
      dq += h * JointVector(body_.M().llt().solve(load));
      q += h * dq;
    }
    sense();
  }

  std::shared_ptr<const ArmModel> model;
  ModelTerms measured;
  JointVector q, dq, push = JointVector::Zero(7);
  Vector6 F_K_W_on_arm = Vector6::Zero();
  JointFriction friction;

 private:
  void sense() {
    JointVector q_seen = q, dq_seen = dq;
    if (realistic_) {
      for (Eigen::Index i = 0; i < q.size(); ++i) {
        q_seen[i] += 1e-5 * normal_(random_);
        dq_seen[i] += 1e-3 * normal_(random_);
      }
    }
    measured.update(q_seen, dq_seen);
  }
  ModelTerms body_;
  bool realistic_;
  JointVector tracked_;
  std::deque<JointVector> late_;
  std::mt19937_64 random_{1};
  std::normal_distribution<double> normal_;
};

struct Setup {
  const char* robot;
  bool realistic;
};
class Controllers : public testing::TestWithParam<Setup> {
 protected:
  Plant plant(std::uint32_t seed) {
    return {load_robot(GetParam().robot), Draw(seed).pose(1), GetParam().realistic};
  }
};

JointVector maker_stiffness(double share) {
  JointVector K(7);
  K << 3000, 3000, 3000, 2500, 2500, 2000, 2000;
  return share * K;
}

TEST_P(Controllers, APushedJointDeflectsByTorqueOverStiffness) {
  Draw draw(2);
  for (const double share : {0.02, 0.3, 1.0, 4.75}) {
    Plant arm = plant(3);
    InternalControllers controllers(7);
    const JointVector q_d = arm.q, zero = JointVector::Zero(7), K = maker_stiffness(share);
    for (Eigen::Index i = 0; i < 7; ++i)
      arm.push[i] = draw.uniform(1, 4) * (draw.coin() ? 1 : -1) * std::min(1.0, 3 * share);
    for (int k = 0; k < (GetParam().realistic ? 6000 : 3000); ++k) {
      arm.step(controllers.joint_impedance(arm.measured, q_d, zero, zero, K));
      ASSERT_LT(arm.dq.norm(), 20) << "unstable at " << k;
    }
    for (Eigen::Index i = 0; i < 7; ++i) {
      const double expected = arm.push[i] / K[i];
      EXPECT_NEAR(arm.q[i] - q_d[i], expected, 0.02 * std::abs(expected) + 1e-5)  // noise
          << share << " joint " << i;
    }
  }
}

Pose pose_of(Draw& draw) { return {draw.rotation(), draw.vector3(0.08)}; }

TEST_P(Controllers, APushedEndEffectorDeflectsByForceOverStiffness) {
  Draw draw(4);
  for (const double share : {0.1, 1.0}) {
    Plant arm = plant(5);
    const ArmFrames frames{.X_FE = pose_of(draw), .X_EK = pose_of(draw)};
    arm.set_frames(frames);
    InternalControllers controllers(7);
    KinematicChain chain(arm.model);
    chain.set_end_effector(frames.X_FE);
    const JointVector q_d = arm.q, zero = JointVector::Zero(7);
    const Pose X_BE_d = chain.X_BE(q_d), X_WK_d = arm.measured.X_WK();
    Vector6 K;
    K << 3000, 2000, 1500, 300, 200, 150;
    K *= share;
    Vector6 F_K;  // in K's axes
    F_K << draw.vector3(10), draw.vector3(0.5);
    F_K *= std::sqrt(share);
    arm.F_K_W_on_arm << X_WK_d.rotation * F_K.head<3>(), X_WK_d.rotation * F_K.tail<3>();
    for (int k = 0; k < (GetParam().realistic ? 6000 : 3000); ++k) {
      arm.step(controllers.cartesian_impedance(arm.measured, frames.X_EK, X_BE_d, {}, Vector6::Zero(), q_d,
                                               zero, K));
      ASSERT_LT(arm.dq.norm(), 20) << "unstable at " << k;
    }
    Vector6 moved = -pose_error(X_WK_d, arm.measured.X_WK());
    moved << X_WK_d.rotation.transpose() * moved.head<3>(), X_WK_d.rotation.transpose() * moved.tail<3>();
    const Vector6 expected = F_K.cwiseQuotient(K);
    for (int i = 0; i < 6; ++i) {
      const double size = i < 3 ? expected.head<3>().norm() : expected.tail<3>().norm();
      EXPECT_NEAR(moved[i], expected[i], 0.02 * size + 2e-5) << share << " axis " << i;
    }
  }
}

// Anywhere, with any stiffness that the interface allows, from a step of the set-point: it settles.
TEST_P(Controllers, SettleFromAnywhere) {
  Draw draw(6);
  for (int trial = 0; trial < 8; ++trial) {
    Plant arm = plant(7);
    const JointVector low = arm.model->limits().q_min, high = arm.model->limits().q_max;
    for (Eigen::Index i = 0; i < 7; ++i)
      arm.q[i] = draw.uniform(0.8 * low[i] + 0.2 * high[i], 0.2 * low[i] + 0.8 * high[i]);
    InverseKinematics inverse(arm.model);
    if (inverse.singular(arm.q)) continue;
    arm.set_frames({});
    const JointVector q_d = arm.q + draw.joints(7, 0.01), zero = JointVector::Zero(7);
    const bool joint = trial % 2 == 0;
    JointVector K(7);
    for (Eigen::Index i = 0; i < 7; ++i) K[i] = std::exp(draw.uniform(std::log(30.0), std::log(14250.0)));
    Vector6 K_x;
    for (int i = 0; i < 6; ++i) {
      K_x[i] = i < 3 ? std::exp(draw.uniform(std::log(100.0), std::log(3000.0)))
                     : std::exp(draw.uniform(std::log(10.0), std::log(300.0)));
    }
    InternalControllers controllers(7);
    const Pose X_BE_d = inverse.chain().X_BE(q_d);
    double fastest = 0, late = 0;
    for (int k = 0; k < 2500; ++k) {
      arm.step(joint ? controllers.joint_impedance(arm.measured, q_d, zero, zero, K)
                     : controllers.cartesian_impedance(arm.measured, {}, X_BE_d, {}, Vector6::Zero(), q_d,
                                                       zero, K_x));
      fastest = std::max(fastest, arm.dq.lpNorm<Eigen::Infinity>());
      if (k > 2200) late = std::max(late, arm.dq.lpNorm<Eigen::Infinity>());
    }
    EXPECT_LT(fastest, 3);
    EXPECT_LT(late, GetParam().realistic ? 5e-3 : 1e-3) << trial;
    const double left = joint ? (arm.q - q_d).lpNorm<Eigen::Infinity>()
                              : pose_error(X_BE_d, inverse.chain().X_BE(arm.q)).lpNorm<Eigen::Infinity>();
    EXPECT_LT(left, 2e-3) << trial;
  }
}

TEST_P(Controllers, FollowSlowMotion) {
  for (const bool joint : {true, false}) {
    Plant arm = plant(8);
    InternalControllers controllers(7, GetParam().realistic ? std::optional(arm.friction) : std::nullopt);
    DesiredMotion motion(arm.model, MotionLimits::of(load_robot(GetParam().robot)));
    motion.hold(arm.q, {});
    ASSERT_EQ(motion.start({.controller = ArmController::joint_impedance,
                            .generator = joint ? MotionGenerator::joint_velocity
                                               : MotionGenerator::cartesian_velocity}),
              MotionStart::started);
    double worst_joint = 0, worst_position = 0, worst_rotation = 0;
    for (int k = 0; k < 5000; ++k) {
      const double wave = 1 - std::cos(2 * M_PI * k / 5000.0);
      InterfaceCommand command;
      command.dq_c = JointVector::Constant(7, k < 2500 ? 0.15 : -0.15) *
                     std::abs(std::sin(2 * M_PI * k / 5000.0)) * (1 - std::cos(2 * M_PI * k / 2500.0));
      command.O_dP_EE_c << 0.05 * std::sin(2 * M_PI * k / 5000.0) * wave,
          0.03 * wave * std::cos(2 * M_PI * k / 5000.0), 0.05 * std::sin(4 * M_PI * k / 5000.0), 0,
          0.1 * std::sin(2 * M_PI * k / 5000.0), 0;
      // Gently into the motion and out of it.
      const double ramp = std::min({1.0, k / 500.0, (5000 - k) / 500.0});
      command.O_dP_EE_c *= ramp * ramp * (3 - 2 * ramp);
      ASSERT_EQ(motion.step(&command), MotionStep::moving) << describe(motion.violations()[0]);
      const DesiredState& d = motion.state();
      Vector6 K_x;
      K_x << 3000, 3000, 3000, 300, 300, 300;
      arm.step(joint ? controllers.joint_impedance(arm.measured, d.q, d.dq, d.ddq, maker_stiffness(1))
                     : controllers.cartesian_impedance(arm.measured, {}, d.X_BE_d, d.V_BE_d, d.A_BE_d, d.q,
                                                       d.dq, K_x));
      worst_joint = std::max(worst_joint, (d.q - arm.q).lpNorm<Eigen::Infinity>());
      KinematicChain chain(arm.model);
      const Vector6 e = pose_error(d.X_BE_d, chain.X_BE(arm.q));
      worst_position = std::max(worst_position, e.head<3>().norm());
      worst_rotation = std::max(worst_rotation, e.tail<3>().norm());
    }
    EXPECT_LT(worst_joint, 6e-4);
    EXPECT_LT(worst_position, 5e-4);
    EXPECT_LT(worst_rotation, 6e-4);
  }
}

INSTANTIATE_TEST_SUITE_P(Arms, Controllers,
                         testing::Values(Setup{"fr3", false}, Setup{"fr3", true}, Setup{"fer", false},
                                         Setup{"fer", true}),
                         [](const auto& p) {
                           return std::string(p.param.robot) + (p.param.realistic ? "_realistic" : "_ideal");
                         });

// --- asynchronous motion ---

// Steps and checks what every motion keeps: its limits, by differences of positions.
struct PlannerRig {
  explicit PlannerRig(const char* robot) : limits(MotionLimits::of(load_robot(robot))), planner(limits) {}
  void start(const JointVector& q, const JointVector& fastest) {
    planner.start(q, fastest);
    dq_max = fastest;
    history.assign(4, q);
  }
  void step() {
    planner.step();
    history.pop_front();
    history.push_back(planner.q());
    const JointVector v = (history[3] - history[2]) / dt, before = (history[2] - history[1]) / dt,
                      earlier = (history[1] - history[0]) / dt;
    const JointVector a = (v - before) / dt, j = (a - (before - earlier) / dt) / dt;
    EXPECT_LT((planner.dq() - v).norm(), 1e-12);
    EXPECT_LT((planner.ddq() - a).norm(), 1e-9);
    for (Eigen::Index i = 0; i < 7; ++i) {
      EXPECT_LE(std::abs(v[i]), dq_max[i] * (1 + 1e-9));
      EXPECT_LE(std::abs(a[i]), limits.ddq_max[i] * (1 + 1e-6));
      EXPECT_LE(std::abs(j[i]), limits.dddq_max[i] * (1 + 1e-3));
    }
  }
  bool reached(const JointVector& target) const {
    return (planner.q() - target).norm() < 1e-3 && planner.dq().norm() < 0.01;
  }
  MotionLimits limits;
  AsyncPlanner planner;
  JointVector dq_max;
  std::deque<JointVector> history;
};

TEST(AsyncPlanner, FromRestTakesTheTimeOfTheSlowestJointAlone) {
  PlannerRig rig("fr3");
  Draw draw(9);
  const JointVector q0 = draw.joints(7, 1), dq_max = JointVector::Constant(7, 0.5);
  JointVector way(7);
  way << 0.1, -1.0, 0.02, 0.5, -0.3, 0.001, 0;
  rig.start(q0, dq_max);
  rig.planner.set_target(q0 + way);
  // Joint 2: velocity v, acceleration a, jerk j all reached: T = d/v + v/a + a/j.
  const double expected = 1.0 / 0.5 + 0.5 / 10 + 10.0 / 5000;
  int steps = 0;
  JointVector half;
  for (; !rig.planner.at_rest(); ++steps) {
    rig.step();
    if (steps == static_cast<int>(expected / dt / 2) - 1) half = rig.planner.q() - q0;
  }
  EXPECT_NEAR(steps * dt, expected, 0.005);
  EXPECT_EQ(rig.planner.q(), q0 + way);
  for (Eigen::Index i = 0; i < 6; ++i) EXPECT_NEAR(half[i] / way[i], 0.5, 0.01);  // all arrive together
}

TEST(AsyncPlanner, TakesNewTargetsInMotionAndArrives) {
  for (const char* robot : {"fr3", "fer"}) {
    PlannerRig rig(robot);
    Draw draw(10);
    JointVector target = JointVector::Zero(7), dq_max(7);
    for (Eigen::Index i = 0; i < 7; ++i) dq_max[i] = draw.uniform(0.1, 2.5);
    dq_max = dq_max.cwiseMin(rig.limits.dq_max);
    rig.start(target, dq_max);
    int arrived = 0, turned_in_motion = 0;
    for (int k = 0; k < 40; ++k) {
      const JointVector aim = k % 5 == 4 ? JointVector(target + draw.joints(7, 0.02)) : draw.joints(7, 1.2);
      turned_in_motion += !rig.planner.at_rest();
      target = aim;
      rig.planner.set_target(target);
      const int patience = k % 2 == 0 ? static_cast<int>(draw.index(900)) : 60000;
      for (int step = 0; step < patience && !rig.planner.at_rest(); ++step) {
        rig.step();
        if (step % 10 == 0) rig.planner.set_target(target);  // said again: nothing new
      }
      if (rig.planner.at_rest()) {
        ++arrived;
        EXPECT_TRUE(rig.reached(target));
        EXPECT_LT((rig.planner.q() - target).norm(), 1e-12);
        EXPECT_EQ(rig.planner.dq().norm(), 0);
      }
      ASSERT_FALSE(testing::Test::HasFailure()) << k;
    }
    EXPECT_GE(arrived, 20);
    EXPECT_GE(turned_in_motion, 10);
  }
}

TEST(AsyncPlanner, StopsAsSoonAsTheLimitsAllow) {
  PlannerRig rig("fr3");
  Draw draw(12);
  rig.start(JointVector::Zero(7), JointVector::Constant(7, 1));
  rig.planner.set_target(draw.joints(7, 2));
  for (int k = 0; k < 500; ++k) rig.step();
  const JointVector dq = rig.planner.dq();
  rig.planner.stop();
  int steps = 0;
  for (; !rig.planner.at_rest(); ++steps) rig.step();
  EXPECT_NEAR(steps * dt, dq.lpNorm<Eigen::Infinity>() / 10 + 10.0 / 5000, 0.005);
  EXPECT_EQ(rig.planner.dq().norm(), 0);
}

}  // namespace
}  // namespace multipanda::motion_control_test
