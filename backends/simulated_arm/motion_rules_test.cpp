// Each rule for commanded motion at its own limit: found by trial, compared with the published figure.
#include <functional>

#include <Eigen/QR>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "backends/simulated_arm/testing/motion_rig.hpp"

namespace multipanda::motion_rules_test {
namespace {

using namespace test;
using testing::Contains;
using testing::ElementsAre;
constexpr double dt = 0.001;
constexpr double kJerkSlack = 0x1p-22 / 1e-9;  // of joints and elbow [rad/s^3]; half of it for poses

// The largest x in [low, high] whose command is not refused with `error`.
double largest(const DesiredMotion& motion, ArmError error, double low, double high,
               const std::function<InterfaceCommand(double)>& command) {
  EXPECT_THAT(errors_after(motion, command(high)), Contains(error));
  for (int k = 0; k < 60; ++k) {
    const double middle = 0.5 * (low + high);
    const auto errors = errors_after(motion, command(middle));
    (std::find(errors.begin(), errors.end(), error) == errors.end() ? low : high) = middle;
  }
  return low;
}

// Brings a scalar velocity from 0 to v with acceleration of share `a` of the limits, then holds it.
void ramp(double v, double acceleration, double jerk, const std::function<void(double)>& command) {
  double now = 0, rate = 0;
  while (now < v - 1e-12) {
    rate = std::min(
        {rate + 0.5 * jerk * dt, acceleration, std::sqrt(jerk * std::max(0.0, v - now)), (v - now) / dt});
    now += rate * dt;
    command(now);
  }
  for (int k = 0; k < 4; ++k) command(v);
}

TEST(MotionRules, JointVelocityAccelerationAndJerk) {
  for (const char* name : {"fr3", "fer"}) {
    for (const Eigen::Index i : {0, 3, 6}) {
      Arm arm(name, [](MotionLimits& l) { l.velocity_offset.resize(0), l.deceleration.resize(0); });
      const double v_max = arm.limits.dq_max[i], a_max = arm.limits.ddq_max[i],
                   j_max = arm.limits.dddq_max[i];
      const double sign = i == 3 ? -1 : 1;
      const auto along = [&](double v) {
        JointVector dq = JointVector::Zero(7);
        dq[i] = sign * v;
        return velocities(dq);
      };
      const auto expect_moving = [&](double v) {
        const InterfaceCommand c = along(v);
        EXPECT_EQ(arm.motion->step(&c), MotionStep::moving);
      };
      // From rest the jerk limits.
      DesiredMotion& motion = arm.begin(MotionGenerator::joint_velocity);
      EXPECT_NEAR(largest(motion, ArmError::joint_motion_generator_acceleration_discontinuity, 0, 1, along),
                  (j_max + kJerkSlack) * dt * dt, 1e-4 * j_max * dt * dt);
      // The acceleration, from nine tenths of it.
      double v = 0;
      for (int k = 1; k <= 30; ++k) expect_moving(v += 0.9 * a_max * std::min(1.0, k / 10.0) * dt);
      EXPECT_NEAR((largest(motion, ArmError::joint_motion_generator_velocity_discontinuity, v,
                           v + 1.1 * a_max * dt, along) -
                   v) /
                      dt,
                  a_max, 1e-3 * a_max);
      // The velocity, from just below it.
      arm.begin(MotionGenerator::joint_velocity);
      const double below = v_max - 0.1 * a_max * dt;
      ramp(below, 0.9 * a_max, 0.5 * j_max, expect_moving);
      EXPECT_NEAR(largest(motion, ArmError::joint_motion_generator_velocity_limits_violation, 0,
                          v_max + 0.2 * a_max * dt, along),
                  v_max, 2e-5 * v_max);
      // A step is named by the highest derivative alone.
      EXPECT_THAT(errors_after(motion, along(v_max + 1)),
                  ElementsAre(ArmError::joint_motion_generator_acceleration_discontinuity));
    }
  }
}

TEST(MotionRules, VelocityTiedToPosition) {
  const MotionLimits l = MotionLimits::of(load_robot("fr3"));
  // By hand from the published figures: sqrt(2 * 2.585 * (1.8361 - 1.5)) - 0.2517.
  EXPECT_NEAR(l.upper_velocity(1, 1.5), 1.06650, 1e-5);
  EXPECT_NEAR(l.lower_velocity(1, -1.5), -1.06650, 1e-5);
  EXPECT_EQ(l.upper_velocity(1, 1.83), 0);
  EXPECT_EQ(l.upper_velocity(1, 0), 2.62);
  EXPECT_NEAR(l.lower_velocity(3, -3.0), -(std::sqrt(8 * 0.077) - 0.3533), 1e-12);
  const MotionLimits panda = MotionLimits::of(load_robot("fer"));
  EXPECT_EQ(panda.upper_velocity(1, 1.76), 2.175);

  Arm arm("fr3");
  JointVector q = arm.model->q_home();
  q[1] = 1.5;
  DesiredMotion& motion = arm.begin(MotionGenerator::joint_velocity, q);
  const auto along = [&](double v) {
    JointVector dq = JointVector::Zero(7);
    dq[1] = v;
    return velocities(dq);
  };
  ramp(0.7, 9, 4000, [&](double v) {
    const InterfaceCommand c = along(v);
    EXPECT_EQ(motion.step(&c), MotionStep::moving);
  });
  // On at 1 rad/s^2, into the limit.
  double v = 0.7;
  std::vector<ArmError> errors;
  for (int k = 0; k < 1000 && errors.empty(); ++k) {
    const InterfaceCommand c = along(v += dt);
    errors = errors_after(motion, c);
    if (errors.empty()) motion.step(&c);
  }
  EXPECT_THAT(errors, ElementsAre(ArmError::joint_motion_generator_velocity_limits_violation));
  const double room = 1.8361 - motion.state().q[1];
  const double limit = std::sqrt(2 * 2.585 * room) - 0.2517 + 2 * dt * 2.585;
  EXPECT_GT(v, limit);
  EXPECT_LT(v, limit + 3e-3);  // in a period v grows by 1e-3, and the limit falls by 2e-3
}

TEST(MotionRules, JointRangeAndStart) {
  Arm arm("fr3");
  JointVector q = arm.model->q_home();
  q[1] = 1.8361 - 1e-5;
  DesiredMotion& motion = arm.begin(MotionGenerator::joint_position, q);
  q[1] = 1.8361 + 2e-6;
  EXPECT_THAT(errors_after(motion, positions(q)), Contains(ArmError::joint_position_limits_violation));

  q = arm.model->q_home();
  arm.begin(MotionGenerator::joint_position, q);
  JointVector off = q;
  off[4] -= 0.006;
  EXPECT_THAT(errors_after(motion, positions(off)),
              ElementsAre(ArmError::joint_position_motion_generator_start_pose_invalid));
  EXPECT_EQ(motion.state().q, q);
  off[4] = q[4] + 0.004;  // for example where the arm was measured
  InterfaceCommand command = positions(off);
  EXPECT_EQ(motion.step(&command), MotionStep::moving);
  EXPECT_EQ(motion.state().q, off);
  EXPECT_EQ(motion.state().dq.norm(), 0);
  EXPECT_LT(motion.state().V_BE_d.vector.norm(), 1e-12);
  // Only the first command may.
  EXPECT_THAT(errors_after(motion, positions(q)),
              Contains(ArmError::joint_motion_generator_velocity_discontinuity));
  // The first one may also continue from the start at once.
  arm.begin(MotionGenerator::joint_position, q);
  off[4] = q[4] + 4e-6;
  command = positions(off);
  EXPECT_EQ(motion.step(&command), MotionStep::moving);
  EXPECT_NEAR(motion.state().dq[4], 4e-3, 1e-9);
}

TEST(MotionRules, CartesianVelocityAccelerationAndJerk) {
  for (const char* name : {"fr3", "fer"}) {
    for (const bool turning : {false, true}) {
      Arm arm(name, [](MotionLimits& l) {
        any_joints(l);
        l.cartesian.velocity = l.cartesian.rotation_velocity = 0.5;  // reached within a few centimeters
      });
      const CartesianLimits& c = arm.limits.cartesian;
      const double v_max = turning ? c.rotation_velocity : c.velocity,
                   a_max = turning ? c.rotation_acceleration : c.acceleration,
                   j_max = turning ? c.rotation_jerk : c.jerk;
      Draw draw(15);
      const Vector3 direction = draw.vector3(1).normalized();
      const auto along = [&](double v) {
        Vector6 V = Vector6::Zero();
        (turning ? V.tail<3>() : V.head<3>()) = v * direction;
        return twist(V);
      };
      const auto expect_moving = [&](double v) {
        const InterfaceCommand command = along(v);
        EXPECT_EQ(arm.motion->step(&command), MotionStep::moving);
      };
      DesiredMotion& motion = arm.begin(MotionGenerator::cartesian_velocity);
      EXPECT_NEAR(
          largest(motion, ArmError::cartesian_motion_generator_acceleration_discontinuity, 0, 1, along),
          (j_max + kJerkSlack / 2) * dt * dt, 1e-4 * j_max * dt * dt);
      double v = 0;
      for (int k = 1; k <= 15; ++k) expect_moving(v += 0.9 * a_max * std::min(1.0, k / 10.0) * dt);
      EXPECT_NEAR((largest(motion, ArmError::cartesian_motion_generator_velocity_discontinuity, v,
                           v + 1.1 * a_max * dt, along) -
                   v) /
                      dt,
                  a_max, 1e-3 * a_max);
      arm.begin(MotionGenerator::cartesian_velocity);
      ramp(v_max - 0.1 * a_max * dt, 0.9 * a_max, 0.5 * j_max, expect_moving);
      EXPECT_NEAR(largest(motion, ArmError::cartesian_motion_generator_velocity_limits_violation, 0,
                          v_max + 0.2 * a_max * dt, along),
                  v_max, 2e-5 * v_max);
      const InterfaceCommand wild = along(5);
      EXPECT_THAT(errors_after(motion, wild),
                  ElementsAre(ArmError::cartesian_motion_generator_acceleration_discontinuity));
      EXPECT_EQ(motion.step(&wild), MotionStep::violation);
      EXPECT_EQ(motion.violations()[0].index, turning ? 3 : 0);
    }
  }
}

TEST(MotionRules, PosesAreFramesAndBeginWhereTheArmIs) {
  Arm arm("fr3");
  DesiredMotion& motion = arm.begin(MotionGenerator::cartesian_pose);
  const Pose X = motion.state().X_BE_c;
  EXPECT_TRUE(errors_after(motion, pose(X)).empty());
  const auto invalid = [&](const std::function<void(Eigen::Map<Eigen::Matrix4d>)>& spoil) {
    InterfaceCommand c = pose(X);
    spoil(Eigen::Map<Eigen::Matrix4d>(c.O_T_EE_c.data()));
    return errors_after(motion, c) ==
           std::vector{ArmError::cartesian_position_motion_generator_invalid_frame};
  };
  EXPECT_TRUE(invalid([](auto T) { T(3, 0) = 1e-3; }));
  EXPECT_TRUE(invalid([](auto T) { T(3, 3) = 0; }));
  EXPECT_TRUE(invalid([](auto T) { T.template topLeftCorner<3, 3>() *= 1 + 2e-5; }));
  EXPECT_TRUE(invalid([](auto T) { T.col(0) *= -1; }));
  EXPECT_TRUE(invalid([](auto T) { T.setZero(); }));
  EXPECT_FALSE(invalid([](auto T) { T.template topLeftCorner<3, 3>() *= 1 + 8e-6; }));
  InterfaceCommand nan = pose(X);
  nan.O_T_EE_c[13] = std::nan("");
  EXPECT_EQ(motion.step(&nan), MotionStep::input_error);

  const auto displaced = [&](double way, double angle) {
    return pose({exp_rotation({0, angle, 0}) * X.rotation, X.position + Vector3(0, 0, way)});
  };
  EXPECT_THAT(errors_after(motion, displaced(2.1e-3, 0)),
              ElementsAre(ArmError::cartesian_position_motion_generator_start_pose_invalid));
  EXPECT_THAT(errors_after(motion, displaced(0, 5.1e-3)),
              ElementsAre(ArmError::cartesian_position_motion_generator_start_pose_invalid));
  const InterfaceCommand near = displaced(1.9e-3, 4.9e-3);
  EXPECT_EQ(motion.step(&near), MotionStep::moving);
  EXPECT_EQ(motion.state().V_BE_c.vector.norm(), 0);
  EXPECT_EQ(motion.state().dq.norm(), 0);
  EXPECT_NEAR(motion.state().X_BE_d.position.z(), X.position.z() + 1.9e-3, 1e-9);
}

// The measured pose, from which the manufacturer's examples start, is micrometers from the commanded one; of
// holding Pandas, joints are up to 2 mrad from q_d.
TEST(MotionRules, AMotionStartsAtEveryPoseNearTheCommandedOne) {
  for (const char* robot : {"fer", "fr3", "fr3v2"}) {
    Arm arm(robot);
    for (double off = 1e-7; off < 4.9e-3; off *= 1.2) {
      DesiredMotion& motion = arm.begin(MotionGenerator::joint_position);
      const JointVector q = motion.state().q + JointVector::Constant(7, off);
      const InterfaceCommand there = positions(q);
      for (int k = 0; k < 20; ++k) EXPECT_EQ(motion.step(&there), MotionStep::moving) << robot << ": " << off;
      EXPECT_EQ(motion.state().q, q);
      EXPECT_EQ(motion.state().dq.norm(), 0);
    }
    for (double off = 1e-7; off < 1.9e-3; off *= 1.2) {
      DesiredMotion& motion = arm.begin(MotionGenerator::cartesian_pose);
      Pose X = motion.state().X_BE_c;
      X.position += off / std::sqrt(3) * Vector3(1, -1, 1);
      X.rotation = exp_rotation(Vector3(off, off, -off)) * X.rotation;
      const InterfaceCommand there = pose(X);
      for (int k = 0; k < 20; ++k) EXPECT_EQ(motion.step(&there), MotionStep::moving) << robot << ": " << off;
      EXPECT_LT((motion.state().X_BE_d.position - X.position).norm(), 1e-9);
    }
  }
}

TEST(MotionRules, Elbow) {
  Arm arm("fr3", any_joints);
  DesiredMotion& motion = arm.begin(MotionGenerator::cartesian_velocity);
  const Elbow start = motion.state().elbow_c;
  EXPECT_EQ(start, (Elbow{0, -1}));  // home: q3 = 0, q4 = -3/4 pi
  const auto with = [&](double elbow, double side = -1) {
    InterfaceCommand c = twist(Vector6::Zero());
    c.has_elbow = true;
    c.elbow_c = {elbow, side};
    return c;
  };
  EXPECT_THAT(errors_after(motion, with(0, 1)),
              ElementsAre(ArmError::cartesian_motion_generator_elbow_sign_inconsistent));
  EXPECT_THAT(errors_after(motion, with(0, 0)),
              ElementsAre(ArmError::cartesian_motion_generator_elbow_sign_inconsistent));
  EXPECT_THAT(errors_after(motion, with(0.006)),
              ElementsAre(ArmError::cartesian_motion_generator_start_elbow_invalid));
  EXPECT_TRUE(errors_after(motion, with(0.004)).empty());
  // In motion: jerk, acceleration, velocity.
  InterfaceCommand first = with(0);
  EXPECT_EQ(motion.step(&first), MotionStep::moving);
  const auto limit = ArmError::cartesian_motion_generator_elbow_limit_violation;
  const auto by = [&](double v) { return with(motion.state().elbow_c[0] + dt * v); };
  const CartesianLimits& c = arm.limits.cartesian;
  EXPECT_NEAR(largest(motion, limit, 0, 1, by), (c.elbow_jerk + kJerkSlack) * dt * dt, 1e-4 * 5e-3);
  double v = 0;
  for (int k = 1; k <= 15; ++k) {
    const InterfaceCommand command = by(v += 0.9 * c.elbow_acceleration * std::min(1.0, k / 10.0) * dt);
    ASSERT_EQ(motion.step(&command), MotionStep::moving);
  }
  EXPECT_NEAR((largest(motion, limit, v, v + 1, by) - v) / dt, c.elbow_acceleration,
              1e-3 * c.elbow_acceleration);
  EXPECT_NEAR(motion.state().delbow_c[0], v, 1e-9);
  EXPECT_NEAR(motion.state().ddelbow_c[0], 0.9 * c.elbow_acceleration, 1e-6);
  EXPECT_EQ(motion.state().delbow_c[1], 0);
  // The end effector is at rest meanwhile.
  EXPECT_LT(pose_error(motion.state().X_BE_c, motion.state().X_BE_d).norm(), 1e-9);
  EXPECT_NEAR(motion.state().q[2], motion.state().elbow_c[0], 1e-9);
}

TEST(MotionRules, JointsOfACartesianMotion) {
  const auto first_error = [](const std::function<void(MotionLimits&)>& change, double& value) {
    Arm arm("fr3", change);
    DesiredMotion& motion = arm.begin(MotionGenerator::cartesian_velocity);
    for (int k = 0; k < 1500; ++k) {
      Vector6 V = Vector6::Zero();
      V[2] = 0.1 * (1 - std::cos(2 * M_PI * k * dt));
      const InterfaceCommand command = twist(V);
      if (motion.step(&command) == MotionStep::violation) {
        value = motion.violations()[0].value;
        return motion.violations()[0].error;
      }
    }
    return ArmError::count_;
  };
  double value = 0;
  EXPECT_EQ(first_error({}, value), ArmError::count_);
  EXPECT_EQ(first_error([](MotionLimits& l) { l.ddq_max.setConstant(0.2); }, value),
            ArmError::cartesian_motion_generator_joint_velocity_discontinuity);
  EXPECT_NEAR(std::abs(value), 0.2, 0.01);
  EXPECT_EQ(first_error([](MotionLimits& l) { l.dq_max.setConstant(0.1); }, value),
            ArmError::cartesian_motion_generator_joint_velocity_limits_violation);
  EXPECT_NEAR(std::abs(value), 0.1, 0.005);
  EXPECT_EQ(first_error([](MotionLimits& l) { any_joints(l), l.q_max[3] = -2.3562 + 0.02; }, value),
            ArmError::joint_position_limits_violation);

  // The jerk of the first step, by the least joint motion for it.
  Arm arm("fr3");
  DesiredMotion& first = arm.begin(MotionGenerator::cartesian_velocity);
  Jacobian J;
  KinematicChain(arm.model).X_BE(first.state().q, J);
  const JointVector per_meter = J.completeOrthogonalDecomposition().solve(Vector6(Vector6::Unit(2)));
  Eigen::Index fastest = 0;
  const double most = per_meter.cwiseAbs().maxCoeff(&fastest);
  const auto upwards = [](double v) { return twist(v * Vector6::Unit(2)); };
  EXPECT_NEAR(
      largest(first, ArmError::cartesian_motion_generator_joint_acceleration_discontinuity, 0, 4e-3, upwards),
      (arm.limits.dddq_max[fastest] + kJerkSlack) * dt * dt / most, 1e-6);

  // To an unreachable pose: refused before it is reached.
  JointVector q = JointVector::Zero(7);
  q << 0, 0.5, 0, -1.2, 0, 1.8, 0;
  DesiredMotion& motion = arm.begin(MotionGenerator::cartesian_velocity, q);
  const Vector3 outwards = motion.state().X_BE_c.position - Vector3(0, 0, 0.333);
  std::vector<ArmError> errors;
  for (int k = 0; k < 8000 && errors.empty(); ++k) {
    Vector6 V = Vector6::Zero();
    V.head<3>() = 0.1 * std::min(1.0, k / 500.0) * outwards.normalized();
    errors = errors_after(motion, twist(V));
    const InterfaceCommand command = twist(V);
    motion.step(&command);
    EXPECT_TRUE(motion.state().q.allFinite());
  }
  EXPECT_FALSE(errors.empty());
  q[3] = kElbowFlip;
  JointVector stretched = q;
  stretched << 0, 1.28, 0, -0.5415, 0, 2.74, 0;  // users of real arms report it as singular
  for (const JointVector& start : {q, stretched}) {
    arm.motion->hold(start, {});
    EXPECT_EQ(arm.motion->start({.generator = MotionGenerator::cartesian_pose}), MotionStart::singular);
  }
  EXPECT_EQ(arm.motion->start({.generator = MotionGenerator::joint_position}), MotionStart::started);
}

// Which flags a translation along x raises near the ready pose, by acceleration and jerk.
std::vector<ArmError> flags_of(const char* name, double acceleration, double jerk) {
  Arm arm(name);
  JointVector ready(7);
  ready << 0, -M_PI / 4, 0, -3 * M_PI / 4, 0, M_PI / 2, M_PI / 4;
  DesiredMotion& motion = arm.begin(MotionGenerator::cartesian_pose, ready);
  Pose X = motion.state().X_BE_c;
  double v = 0, a = 0;
  for (int k = 0; k < 100; ++k) {
    a = std::min(acceleration, a + jerk * dt);
    v += a * dt;
    X.position.x() += v * dt;
    const InterfaceCommand command = pose(X);
    if (auto errors = errors_after(motion, command); !errors.empty()) return errors;
    motion.step(&command);
  }
  return {};
}

// What peers measured on a Panda.
TEST(MotionRules, JointFlagsOfACartesianMotionAsReported) {
  using enum ArmError;
  EXPECT_TRUE(flags_of("fer", 1.5, 200).empty());
  EXPECT_THAT(flags_of("fer", 13, 6500),
              Contains(cartesian_motion_generator_joint_acceleration_discontinuity));
  // Within the Cartesian limits, beyond the joints': by J dq = V, joint 4 takes about 2.3 rad per meter.
  EXPECT_THAT(flags_of("fr3", 2, 3000),
              ElementsAre(cartesian_motion_generator_joint_acceleration_discontinuity));
}

}  // namespace
}  // namespace multipanda::motion_rules_test
