// A program's motion on the arm's clock, against the checks of the arm itself (backends/simulated_arm): a
// violation of any is a reflex. Two clocks in simulated time.
#include "runtime/embedded/command_follower.hpp"

#include <array>
#include <cmath>
#include <optional>
#include <sstream>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "backends/simulated_arm/desired_motion.hpp"
#include "core/rt/guard/loop_guard.hpp"
#include "core/testing/test_arm.hpp"
#include "models/arm_source.hpp"
#include "runtime/embedded/testing/two_clocks.hpp"

namespace multipanda::command_follower_test {
namespace {

using test::ClocksConfig;
using test::Draw;
using test::Quintics;
using test::TwoClocks;

MotionGenerator generator(FollowedMotion motion) {
  switch (motion) {
    case FollowedMotion::joint_position:
      return MotionGenerator::joint_position;
    case FollowedMotion::joint_velocity:
      return MotionGenerator::joint_velocity;
    case FollowedMotion::cartesian_pose:
      return MotionGenerator::cartesian_pose;
    case FollowedMotion::cartesian_velocity:
      return MotionGenerator::cartesian_velocity;
  }
  return MotionGenerator::none;
}

double single(double x) { return static_cast<double>(static_cast<float>(x)); }

// An arm in a motion: its checks, and what it publishes in single precision. Its commands come from the
// follower, or unfiltered.
struct FollowingArm {
  FollowingArm(const std::string& name, FollowedMotion kind, const JointVector* at = nullptr)
      : robot(load_robot(name)),
        model(std::make_shared<const ArmModel>(arm_model_source(robot, Draw(5).pose(1), false))),
        motion(model, MotionLimits::of(robot)),
        follower(FollowerLimits::of(robot), 7) {
    const JointVector q = at != nullptr ? *at : model->q_home();
    motion.hold(q, Draw(9).pose(0.1));
    EXPECT_EQ(motion.start({.controller = ArmController::joint_impedance, .generator = generator(kind)}),
              MotionStart::started);
    follower.begin(kind);
    command.q_c = command.dq_c = q;
    command.dq_c.setZero();
    begin_kind = kind;
    shown_ = published();
  }

  DesiredMotionState published() const {
    const DesiredState& s = motion.state();
    DesiredMotionState shown;
    for (std::size_t i = 0; i < 7; ++i) {
      const auto k = static_cast<Eigen::Index>(i);
      shown.q_d[i] = single(s.q[k]);
      shown.dq_d[i] = single(s.dq[k]);
      shown.ddq_d[i] = single(s.ddq[k]);
    }
    shown.O_T_EE_c = column_major(s.X_BE_c);
    for (double& x : shown.O_T_EE_c) x = single(x);
    for (std::size_t i = 0; i < 6; ++i) {
      shown.O_dP_EE_c[i] = single(s.V_BE_c.vector[static_cast<Eigen::Index>(i)]);
      shown.O_ddP_EE_c[i] = single(s.A_BE_c[static_cast<Eigen::Index>(i)]);
    }
    return shown;
  }

  // One period; false after a violation.
  bool answer(bool lost) {
    // Some arms' packets may show a command one packet later.
    const DesiredMotionState now = published();
    follower.step(late_by_one ? shown_ : now, command);
    shown_ = now;
    return take(lost ? nullptr : &command);
  }
  bool take(const InterfaceCommand* sent) {
    if (reflex) return false;
    const MotionStep step = motion.step(sent);
    ++periods;
    if (step == MotionStep::moving) return true;
    std::ostringstream text;
    text << "period " << periods << ", step " << static_cast<int>(step);
    for (const auto& v : motion.violations()) {
      text << "; error " << static_cast<int>(v.error) << " axis " << int{v.index} << ": " << v.value
           << ", limit " << v.limit;
    }
    reflex = text.str();
    return false;
  }

  RobotDescription robot;
  std::shared_ptr<const ArmModel> model;
  DesiredMotion motion;
  CommandFollower follower;
  InterfaceCommand command;
  FollowedMotion begin_kind{};
  bool late_by_one = false;
  DesiredMotionState shown_;
  int periods = 0;
  std::optional<std::string> reflex;
};

// What the program commands at its time t [s]. Rotations about an axis that is askew to all frames.
class Program {
 public:
  Program(const FollowingArm& arm, double speed, std::uint32_t seed) : kind_(arm.begin_kind) {
    const MotionLimits& limits = arm.motion.limits();
    const bool joints = kind_ == FollowedMotion::joint_position || kind_ == FollowedMotion::joint_velocity;
    X_ = arm.motion.state().X_BE_d;
    for (Eigen::Index i = 0; i < (joints ? 7 : 2); ++i) {
      Quintics::Limits of{.range = joints   ? 0.4
                                   : i == 0 ? 0.12
                                            : 0.35,
                          .velocity = speed,
                          .acceleration = 1,
                          .jerk = 100};
      if (joints) {
        of.velocity = speed * limits.dq_max[i];
        of.acceleration = 0.6 * limits.ddq_max[i];
        of.jerk = 0.5 * limits.dddq_max[i];
      }
      axes_.emplace_back(joints ? arm.motion.state().q[i] : 0, of, seed + static_cast<std::uint32_t>(i));
    }
  }
  std::array<double, 16> at(double t) {
    std::array<double, 16> values{};
    if (kind_ == FollowedMotion::joint_position || kind_ == FollowedMotion::joint_velocity) {
      for (std::size_t i = 0; i < 7; ++i) {
        double v = 0;
        const double x = axes_[i].at(t, v);
        values[i] = kind_ == FollowedMotion::joint_position ? x : v;
      }
      return values;
    }
    double v = 0, w = 0;
    const double way = axes_[0].at(t, v), turn = axes_[1].at(t, w);
    if (kind_ == FollowedMotion::cartesian_pose) {
      values = column_major({exp_rotation(turn * axis_) * X_.rotation, X_.position + way * direction_});
    } else {
      for (Eigen::Index i = 0; i < 3; ++i) {
        values[static_cast<std::size_t>(i)] = v * direction_[i];
        values[static_cast<std::size_t>(3 + i)] = w * axis_[i];
      }
    }
    return values;
  }

 private:
  FollowedMotion kind_;
  Pose X_;
  std::vector<Quintics> axes_;
  Vector3 direction_ = Vector3(0.5, -0.6, 0.62).normalized(), axis_ = Vector3(0.3, 0.8, -0.5).normalized();
};

std::size_t size_of(FollowedMotion kind) {
  return kind == FollowedMotion::cartesian_pose ? 16 : kind == FollowedMotion::cartesian_velocity ? 6 : 7;
}

struct Trial {
  FollowedMotion kind = FollowedMotion::joint_position;
  std::string robot = "fer";
  double speed = 0.4;  // of the joints' limits; Cartesian [m/s, rad/s]
  ClocksConfig clocks;
  bool late_by_one = false;
};

// Runs a program's motion; returns the arm and how far it was from the program's motion, one delay ago.
struct Outcome {
  std::optional<std::string> reflex;
  double worst = 0;    // [rad] or [rad/s] of joint 1
  double fastest = 0;  // [rad/s] of any joint
};
Outcome follow(const Trial& trial, double seconds, bool unfiltered = false) {
  FollowingArm arm(trial.robot, trial.kind);
  arm.late_by_one = trial.late_by_one;
  Program program(arm, trial.speed, trial.clocks.seed), truth(arm, trial.speed, trial.clocks.seed);
  TwoClocks clocks(trial.clocks);
  std::array<double, 16> computed{}, written{};
  std::int64_t stamp = 0;
  bool any = false;
  Outcome outcome;
  clocks.cycle = [&](std::int64_t now, std::int64_t then) {
    stamp = then;
    computed = program.at(1e-9 * static_cast<double>(now));
  };
  clocks.publish = [&] {
    written = computed;
    any = true;
    arm.follower.push(stamp, std::span(written).first(size_of(trial.kind)));
  };
  clocks.packet = [&](bool lost) {
    if (arm.reflex) return;
    if (unfiltered) {
      for (Eigen::Index i = 0; i < 7; ++i) {
        arm.command.q_c[i] = any ? written[static_cast<std::size_t>(i)] : arm.motion.state().q[i];
      }
      (void)arm.take(lost ? nullptr : &arm.command);
      return;
    }
    (void)arm.answer(lost);
    outcome.fastest = std::max(outcome.fastest, arm.motion.state().dq.lpNorm<Eigen::Infinity>());
    // The delay, and half a period of the packets and commands each.
    const double then = clocks.now() - arm.follower.delay() - 0.6e-3;
    if (then < 0.3 || trial.kind >= FollowedMotion::cartesian_pose) return;
    const double d = truth.at(then)[0];
    const double is =
        trial.kind == FollowedMotion::joint_position ? arm.motion.state().q[0] : arm.motion.state().dq[0];
    outcome.worst = std::max(outcome.worst, std::abs(is - d));
  };
  clocks.run(static_cast<int>(1000 * seconds));
  outcome.reflex = arm.reflex;
  return outcome;
}

std::vector<Trial> trials(FollowedMotion kind) {
  std::vector<Trial> all;
  std::uint32_t seed = 100 * static_cast<std::uint32_t>(kind) + 1;
  const bool joints = kind == FollowedMotion::joint_position || kind == FollowedMotion::joint_velocity;
  for (const char* robot : {"fer", "fr3"}) {
    for (const std::int64_t jitter : {20'000, 200'000, 1'000'000}) {
      for (const double ppm : {-50.0, 50.0}) {
        ClocksConfig clocks;
        clocks.drift_ppm = ppm;
        clocks.jitter_ns = jitter;
        clocks.phase_ns = static_cast<std::int64_t>(seed * 137'000 % 1'000'000);
        clocks.stalls_per_s = 0.5;
        clocks.loss = ppm > 0 ? 0.01 : 0;
        clocks.seed = seed++;
        // With late stamps a faster hand has more joint jerk than FR3's 5000 rad/s^3 (flag 30).
        all.push_back({kind, robot, joints ? 0.5 : 0.2, clocks});
      }
    }
  }
  return all;
}

class FollowedMotions : public testing::TestWithParam<FollowedMotion> {};

TEST_P(FollowedMotions, NoReflexOverPhasesDriftsJitterStallsAndLosses) {
  test::Series series;
  for (const Trial& trial : trials(GetParam())) {
    if (!series.takes(true)) continue;
    const Outcome outcome = follow(trial, test::trial_seconds(series, 4));
    series.record("fastest_rad_per_s", outcome.fastest);
    EXPECT_FALSE(outcome.reflex) << trial.robot << ", jitter " << trial.clocks.jitter_ns << " ns, "
                                 << trial.clocks.drift_ppm << " ppm: " << *outcome.reflex;
    EXPECT_GT(outcome.fastest, 0.05);  // it moved
  }
}
// Nobody publishes whether a packet shows the answer to the one before, or that to the one before that.
TEST_P(FollowedMotions, NoReflexOnAnArmThatShowsCommandsOnePacketLater) {
  for (Trial trial : trials(GetParam())) {
    trial.late_by_one = true;
    trial.clocks.loss /= 10;
    const Outcome outcome = follow(trial, 4);
    EXPECT_FALSE(outcome.reflex) << trial.robot << ", jitter " << trial.clocks.jitter_ns << " ns, "
                                 << trial.clocks.drift_ppm << " ppm: " << *outcome.reflex;
  }
}
// ros2_control's node takes the time that it gives to write() after the controllers ran. What they computed
// is for an earlier instant, by a time that changes from cycle to cycle.
TEST_P(FollowedMotions, NoReflexWithCommandsThatAreStampedAfterTheControllersRan) {
  test::Series series;
  for (const std::int64_t update : {60'000, 400'000}) {
    for (Trial trial : trials(GetParam())) {
      if (!series.takes(true)) continue;
      trial.clocks.update_ns = update;
      const Outcome outcome = follow(trial, test::trial_seconds(series, 2));
      EXPECT_FALSE(outcome.reflex) << trial.robot << ", jitter " << trial.clocks.jitter_ns << " ns, update "
                                   << update << " ns, " << trial.clocks.drift_ppm
                                   << " ppm: " << *outcome.reflex;
    }
  }
}

std::string name_of_motion(const testing::TestParamInfo<FollowedMotion>& info) {
  const char* const names[] = {"JointPosition", "JointVelocity", "Pose", "Twist"};
  return names[static_cast<std::size_t>(info.param)];
}
INSTANTIATE_TEST_SUITE_P(All, FollowedMotions,
                         testing::Values(FollowedMotion::joint_position, FollowedMotion::joint_velocity,
                                         FollowedMotion::cartesian_pose, FollowedMotion::cartesian_velocity),
                         name_of_motion);

// The same trials are no easy ones: sent as they are, the positions stop the arm within a second.
TEST(CommandFollower, UnfilteredCommandsStopTheArm) {
  for (Trial trial : trials(FollowedMotion::joint_position)) {
    trial.clocks.stalls_per_s = trial.clocks.loss = 0;
    EXPECT_TRUE(follow(trial, 2, true).reflex) << trial.robot << ", jitter " << trial.clocks.jitter_ns;
  }
}

TEST(CommandFollower, FollowsAsTheProgramMovedOneDelayAgo) {
  for (const std::int64_t jitter : {0, 20'000, 200'000, 800'000}) {
    Trial trial;
    trial.clocks = {.drift_ppm = 30, .phase_ns = 400'000, .jitter_ns = jitter, .seed = 3};
    const Outcome outcome = follow(trial, 8);
    EXPECT_FALSE(outcome.reflex) << *outcome.reflex;
    // 1 rad/s and 9 rad/s^2: 3 a / w^2 = 1.2 mrad, and 0.7 ms by which the delay depends on phase and jitter.
    EXPECT_LT(outcome.worst, 2e-3) << jitter;
    trial.kind = FollowedMotion::joint_velocity;
    EXPECT_LT(follow(trial, 8).worst, 0.16) << jitter;  // [rad/s], 2 a / w and the delay
  }
}

TEST(CommandFollower, JumpsAreFollowedSlowlyAndNeverViolate) {
  for (const char* robot : {"fer", "fr3"}) {
    FollowingArm arm(robot, FollowedMotion::joint_position);
    Draw draw(17);
    std::array<double, 7> target{};
    double fastest = 0;
    for (int k = 0; k < 60'000 && !arm.reflex; ++k) {
      if (k % 400 == 0 && k < 50'000) {
        for (std::size_t i = 0; i < 7; ++i) {
          target[i] = arm.model->q_home()[static_cast<Eigen::Index>(i)] + draw.uniform(-0.8, 0.8);
        }
      }
      arm.follower.push(std::int64_t{1'000'000} * k, target);
      (void)arm.answer(draw.uniform(0, 1) < 0.02);
      fastest = std::max(fastest, arm.motion.state().dq.lpNorm<Eigen::Infinity>());
    }
    EXPECT_FALSE(arm.reflex) << robot << ": " << *arm.reflex;
    EXPECT_LT(fastest, 1.1 * FollowerLimits::kCatchUp);
    for (std::size_t i = 0; i < 7; ++i) {
      EXPECT_NEAR(arm.motion.state().q[static_cast<Eigen::Index>(i)], target[i], 1e-6);
    }
  }
}

class Robots : public testing::TestWithParam<const char*> {};
INSTANTIATE_TEST_SUITE_P(CommandFollower, Robots, testing::Values("fer", "fr3"));

TEST_P(Robots, PosesThatJumpAreFollowedSlowlyAndNeverViolate) {
  FollowingArm arm(GetParam(), FollowedMotion::cartesian_pose);
  Draw draw(23);
  const Pose X = arm.motion.state().X_BE_d;
  Pose goal = X;
  std::array<double, 16> target{};
  double fastest = 0, turning = 0;
  for (int k = 0; k < 40'000 && !arm.reflex; ++k) {
    if (k % 500 == 0 && k < 32'000) {
      goal = {exp_rotation(draw.vector3(0.25)) * X.rotation, X.position + draw.vector3(0.08)};
    }
    target = column_major(goal);
    arm.follower.push(std::int64_t{1'000'000} * k, target);
    (void)arm.answer(draw.uniform(0, 1) < 0.02);
    fastest = std::max(fastest, arm.motion.state().V_BE_c.linear().norm());
    turning = std::max(turning, arm.motion.state().V_BE_c.angular().norm());
  }
  EXPECT_FALSE(arm.reflex) << *arm.reflex;
  EXPECT_LT(fastest, 1.1 * FollowerLimits::kCatchUpLinear);
  EXPECT_LT(turning, 1.1 * FollowerLimits::kCatchUpAngular);
  EXPECT_LT(pose_difference(goal, arm.motion.state().X_BE_d).norm(), 1e-5);
}

TEST(CommandFollower, VelocitiesThatJumpNeverViolateAndEndBeforeTheJointsEnds) {
  for (const char* robot : {"fer", "fr3"}) {
    FollowingArm arm(robot, FollowedMotion::joint_velocity);
    Draw draw(29);
    std::array<double, 7> target{};
    for (int k = 0; k < 120'000 && !arm.reflex; ++k) {
      if (k % 900 == 0) {
        for (double& v : target) v = draw.uniform(-3, 3);
      }
      arm.follower.push(std::int64_t{1'000'000} * k, target);
      (void)arm.answer(draw.uniform(0, 1) < 0.02);
    }
    EXPECT_FALSE(arm.reflex) << robot << ": " << *arm.reflex;
  }
}

// Positions beyond the ends, approached at speed.
TEST(CommandFollower, PositionsBeyondTheEndsAreNotFollowed) {
  for (const char* robot : {"fer", "fr3"}) {
    FollowingArm arm(robot, FollowedMotion::joint_position);
    const MotionLimits& limits = arm.motion.limits();
    std::array<double, 7> target{};
    std::copy_n(arm.model->q_home().begin(), 7, target.begin());
    for (int k = 0; k < 12'000 && !arm.reflex; ++k) {
      for (std::size_t i = 0; i < 7; ++i) {
        const double up = k % 6000 < 3000 ? 1 : -1;
        target[i] += up * 0.9e-3 * limits.dq_max[static_cast<Eigen::Index>(i)];
      }
      arm.follower.push(std::int64_t{1'000'000} * k, target);
      (void)arm.answer(false);
    }
    EXPECT_FALSE(arm.reflex) << robot << ": " << *arm.reflex;
  }
}

// The tighter of the robot's limits and the scene's, joint by joint.
TEST(CommandFollower, LimitsThatASceneTightensAreKept) {
  for (const FollowedMotion kind : {FollowedMotion::joint_position, FollowedMotion::joint_velocity}) {
    FollowingArm arm("fr3", kind);
    const JointVector q_0 = arm.model->q_home();
    ArmLimits scene = arm.model->limits();
    scene.q_min[0] = q_0[0] - 0.2;
    scene.q_max[0] = q_0[0] + 0.3;
    scene.dq_max[0] = 0.4;
    scene.ddq_max[0] = 2;
    scene.dq_max[1] *= 3;  // looser: does not count
    scene.q_max[1] += 3;
    arm.follower = CommandFollower(FollowerLimits::of(arm.robot, &scene), 7);
    arm.follower.begin(kind);
    const bool positions = kind == FollowedMotion::joint_position;
    std::array<double, 7> target{};
    if (positions) std::copy_n(q_0.begin(), 7, target.begin());
    double fastest = 0, sharpest = 0, low = q_0[0], high = q_0[0];
    for (int k = 0; k < 20'000 && !arm.reflex; ++k) {
      const double phase = 1e-3 * k;
      for (std::size_t i = 0; i < 2; ++i) {
        target[i] =
            positions ? q_0[static_cast<Eigen::Index>(i)] + 0.4 * std::sin(phase) : 2 * std::cos(phase);
      }
      arm.follower.push(std::int64_t{1'000'000} * k, target);
      (void)arm.answer(false);
      const DesiredState& d = arm.motion.state();
      fastest = std::max(fastest, std::abs(d.dq[0]));
      sharpest = std::max(sharpest, std::abs(d.ddq[0]));
      low = std::min(low, d.q[0]);
      high = std::max(high, d.q[0]);
    }
    EXPECT_FALSE(arm.reflex) << *arm.reflex;
    EXPECT_LT(fastest, 0.4);
    EXPECT_GT(fastest, 0.3);
    EXPECT_LT(sharpest, 2);
    EXPECT_LT(high, q_0[0] + 0.3);
    EXPECT_GT(low, q_0[0] - 0.2);
    EXPECT_GT(high, q_0[0] + 0.25);
    EXPECT_LT(low, q_0[0] - 0.15);
  }
}

// An arm that stands beyond an end, of a scene that tightens the range: it stays there until its program
// moves it back, and does not go out again.
TEST(CommandFollower, AnEndAloneMovesNoArm) {
  FollowingArm arm("fer", FollowedMotion::joint_position);
  const JointVector q_0 = arm.model->q_home();
  ArmLimits scene = arm.model->limits();
  scene.q_max[0] = q_0[0] - 0.5;
  arm.follower = CommandFollower(FollowerLimits::of(arm.robot, &scene), 7);
  arm.follower.begin(FollowedMotion::joint_position);
  std::array<double, 7> target{};
  std::copy_n(q_0.begin(), 7, target.begin());
  int k = 0;
  const auto go = [&](double from, double to, int periods) {
    for (int i = 0; i < periods; ++i, ++k) {
      const double s = (i + 1.0) / periods;
      target[0] = q_0[0] + from + (to - from) * s;
      arm.follower.push(std::int64_t{1'000'000} * k, target);
      (void)arm.answer(false);
    }
    return arm.motion.state().q[0] - q_0[0];
  };
  EXPECT_NEAR(go(0, 0, 500), 0, 1e-6);
  EXPECT_NEAR(go(0, 0.2, 1000), 0, 1e-6);
  EXPECT_NEAR(go(0.2, -0.2, 4000), -0.2, 5e-3);
  EXPECT_NEAR(go(-0.2, 0, 4000), -0.2, 5e-3);
  EXPECT_NEAR(go(0, -0.8, 8000), -0.8, 5e-3);
  EXPECT_NEAR(go(-0.8, 0, 8000), -0.5, 5e-3);
  EXPECT_FALSE(arm.reflex) << *arm.reflex;
}

TEST(CommandFollower, ASilentProgramsMotionIsStoppedAndLaterCommandsDoNotCountUntilItBeginsAgain) {
  for (const FollowedMotion kind : {FollowedMotion::joint_position, FollowedMotion::joint_velocity}) {
    FollowingArm arm("fer", kind);
    std::array<double, 7> target{};
    const bool positions = kind == FollowedMotion::joint_position;
    if (positions) std::copy_n(arm.model->q_home().begin(), 7, target.begin());
    double v = 0;
    std::int64_t stamp = 0;
    const auto write = [&] {
      v = std::min(1.0, v + 2e-3);
      if (positions)
        target[0] += 1e-3 * v;
      else
        target[0] = v;
      arm.follower.push(stamp += 1'000'000, target);
    };
    for (int k = 0; k < 1000; ++k) {
      write();
      ASSERT_TRUE(arm.answer(false)) << *arm.reflex;
    }
    EXPECT_NEAR(arm.motion.state().dq[0], 1, 0.01);
    EXPECT_TRUE(arm.follower.follows());
    const double q = arm.motion.state().q[0];
    int moving_for = 0;
    for (int k = 0; k < 600; ++k) {
      ASSERT_TRUE(arm.answer(false)) << *arm.reflex;
      if (std::abs(arm.motion.state().dq[0]) > 1e-3) moving_for = k + 1;
      if (k == 15) {
        EXPECT_NEAR(arm.motion.state().dq[0], 1, 0.03);  // kept
      }
      if (k < 149) {
        EXPECT_TRUE(arm.follower.follows());
      }
    }
    EXPECT_FALSE(arm.follower.follows());
    EXPECT_TRUE(arm.follower.is_at_rest());
    EXPECT_LT(moving_for, 260);
    // The delay, 0.02 s, half of 0.1 s, and the follower's own stop at 1 rad/s.
    EXPECT_LT(arm.motion.state().q[0] - q, 0.13);
    const double rest = arm.motion.state().q[0];
    stamp += 600'000'000;
    for (int k = 0; k < 300; ++k) {
      write();
      ASSERT_TRUE(arm.answer(false)) << *arm.reflex;
    }
    EXPECT_NEAR(arm.motion.state().q[0], rest, 1e-4);
    arm.follower.resume();
    for (int k = 0; k < 300; ++k) {
      write();
      ASSERT_TRUE(arm.answer(false)) << *arm.reflex;
    }
    EXPECT_TRUE(arm.follower.follows());
    EXPECT_GT(arm.motion.state().q[0], rest + 0.05);
  }
}

TEST(CommandFollower, NeverAllocatesOrLocks) {
  if (!kLoopGuardWorks) GTEST_SKIP() << "sanitizers replace malloc themselves";
  for (const FollowedMotion kind : {FollowedMotion::joint_position, FollowedMotion::cartesian_pose}) {
    FollowingArm arm("fer", kind);
    Program program(arm, 0.2, 1);
    LoopGuard::arm();
    for (int k = 0; k < 300; ++k) {
      const std::array<double, 16> values = program.at(1e-3 * k);
      arm.follower.push(std::int64_t{1'000'000} * k, std::span(values).first(size_of(kind)));
      arm.follower.step(arm.published(), arm.command);
    }
    const LoopGuardCounts counts = LoopGuard::disarm();
    EXPECT_EQ(counts.heap_calls, 0u);
    EXPECT_EQ(counts.lock_calls, 0u);
  }
}

}  // namespace
}  // namespace multipanda::command_follower_test
