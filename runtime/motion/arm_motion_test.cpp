#include "runtime/motion/arm_motion.hpp"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <functional>
#include <limits>
#include <unistd.h>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "backends/mujoco/mujoco_backend.hpp"
#include "core/cycle/control_cycle.hpp"
#include "core/model/model_terms.hpp"
#include "core/testing/wrong_goals.hpp"
#include "core/trajectory/quintic.hpp"
#include "runtime/motion/joint_move.hpp"
#include "scene/build.hpp"
#include "scene/load.hpp"

namespace multipanda::arm_motion_test {
namespace {

using ::testing::HasSubstr;

struct Listener : MotionListener {
  void progress(const MotionProgress& now) override {
    ++reports;
    EXPECT_GE(now.time_s, last.time_s);
    last = now;
  }
  void over(MotionResult end, const std::string& why) override {
    EXPECT_FALSE(ended) << "reported twice";
    ended = end;
    reason = why;
  }
  int reports = 0;
  MotionProgress last;
  std::optional<MotionResult> ended;
  std::string reason;
};

// Two simulated arms, the right one on a rotated base. The test steps them and passes on each record as the
// publisher's thread does: no middleware, no threads, deterministic.
class ArmMotionTest : public testing::Test {
 protected:
  static constexpr double kPeriod = 0.001;

  // `hand_speed`: these motions are faster than what is allowed beside people.
  static Scene make_scene(const Registry& registry, double hand_speed) {
    return parse_scene(
        "arms:\n"
        "  - {name: left, base: {position_m: [0, 0.4, 0]}}\n"
        "  - {name: right, base: {position_m: [0.1, -0.4, 0.05], rpy_rad: [0.1, -0.2, 0.7]}}\n"
        "contact_bounds: {hand_speed_m_per_s: " +
            std::to_string(hand_speed) +
            "}\n"
            "controllets:\n"
            "  - {name: left_joints, type: joint_impedance, arms: left}\n"
            "  - {name: left_pose, type: cartesian_impedance, arms: left}\n"
            "  - {name: right_pose, type: cartesian_impedance, arms: right}\n"
            "active: [left_joints, right_pose]\n",
        "test.yaml", registry);
  }

  explicit ArmMotionTest(double hand_speed = 3)
      : ArmMotionTest([hand_speed](const Registry& registry) { return make_scene(registry, hand_speed); }) {}
  explicit ArmMotionTest(const std::function<Scene(const Registry&)>& make) : scene_(make(registry_)) {
    run_.scene = &scene_;
    run_.modes = &cycle_.modes();
    run_.backend = &backend_;
    run_.layout = &cycle_.layout();
    for (const auto& arm : config_.arms) run_.models.push_back(arm.model);
    cycle_.modes().activate_at_start(start_set(scene_, cycle_.modes()));
    backend_.start();
    left_ = std::make_unique<ArmMotion>(run_, 0, false);
    right_ = std::make_unique<ArmMotion>(run_, 1, false);
  }

  void steps(int count) {
    for (int i = 0; i < count; ++i) {
      cycle_.step(backend_.wait());
      RecordRing& ring = *cycle_.record();
      for (; const Event* event = ring.events.front(); ring.events.pop()) {
        if (event->kind == EventKind::intervention) {
          interventions_ += std::string(to_string(event->intervention)) + "; ";
        }
        left_->take(*event);
        right_->take(*event);
      }
      for (; const CycleRecord* record = ring.ring.front(); ring.ring.pop()) {
        newest_ = *record;
        left_->take(*record);
        right_->take(*record);
        watch(*record);
      }
    }
  }
  // Steps until `listener` has received the end; returns false if that takes too long.
  bool run(const Listener& listener, double longest_s) {
    for (int i = 0; i < longest_s / kPeriod && !listener.ended; ++i) steps(1);
    return listener.ended.has_value();
  }
  // Set-points never jump: the speeds of successive records differ by less than an acceleration limit allows.
  void watch(const CycleRecord& record) {
    for (std::size_t i = 0; i < record.reference_count; ++i) {
      const ReferenceSample& now = record.references[i];
      EXPECT_FALSE(std::ranges::any_of(now.values, [](double v) { return std::isnan(v); }));
      const auto before = std::ranges::find_if(before_, [&](const ReferenceSample& each) {
        return each.instance == now.instance && each.input == now.input;
      });
      if (before != before_.end()) {
        for (std::size_t k = 0; k < 7; ++k)
          largest_step_ = std::max(largest_step_, std::abs(now.rates[k] - before->rates[k]));
      }
    }
    before_.assign(record.references.begin(),
                   record.references.begin() + static_cast<std::ptrdiff_t>(record.reference_count));
  }

  JointVector q_d() const { return from(newest_.references, cycle_.modes().find("left_joints")); }
  static JointVector from(const std::vector<ReferenceSample>& references, InstanceIndex instance) {
    for (const auto& each : references) {
      if (each.instance == instance) return Eigen::Map<const Eigen::VectorXd>(each.values.data(), 7);
    }
    return {};
  }
  JointVector q(std::size_t arm) const {
    return Eigen::Map<const Eigen::VectorXd>(newest_.arms[arm].q.data(), 7);
  }
  double speed(std::size_t arm) const {
    return Eigen::Map<const Eigen::VectorXd>(newest_.arms[arm].dq.data(), 7).lpNorm<Eigen::Infinity>();
  }
  void switch_to(const std::string& name) {
    const Request request{.activate = bit(cycle_.modes().find(name))};
    std::uint64_t ticket = 0;
    ASSERT_EQ(cycle_.modes().post(std::span(&request, 1), ticket), Verdict::accepted);
    steps(2);
  }
  static JointVector offset(const JointVector& q, Eigen::Index joint, double by) {
    JointVector out = q;
    out[joint] += by;
    return out;
  }
  // Points without velocities or accelerations if none are given.
  static TrajectoryPoint point(double time, const JointVector& q, std::optional<double> speed = {}) {
    TrajectoryPoint out{.time_s = time, .position = q};
    if (speed) out.velocity = JointVector::Constant(q.size(), *speed);
    return out;
  }
  std::string refusal(const std::function<void()>& begin) {
    try {
      begin();
    } catch (const MotionRefused& refused) {
      return refused.what();
    }
    return "it was accepted";
  }

  const Registry registry_ = Registry::with_builtins();
  const Scene scene_;
  MujocoBackend backend_{scene_, {.pace = Pace::unpaced}};
  const CycleConfig config_ = build_cycle_config(scene_, 1000);
  ControlCycle cycle_{config_, registry_, backend_};
  RunContext run_;
  CycleRecord newest_;
  std::vector<ReferenceSample> before_;
  std::string interventions_;
  double largest_step_ = 0;  // of any set-point's rate between two records
  std::unique_ptr<ArmMotion> left_, right_;
  std::shared_ptr<Listener> listener_ = std::make_shared<Listener>();
};

TEST_F(ArmMotionTest, MovesThroughJointsToRestAtTheLastOneAndLeavesAGoal) {
  EXPECT_FALSE(left_->ready(Quantity::joints, {}));
  steps(10);
  EXPECT_TRUE(left_->ready(Quantity::joints, {}));
  EXPECT_THAT(
      refusal([&] { left_->through_joints(std::vector<JointVector>{JointVector::Zero(7)}, 1, listener_); }),
      HasSubstr("'left': joint4: 0 rad is outside of "));
  const HostTime now = host_now();
  EXPECT_FALSE(left_->ready(Quantity::joints, now)) << "the records are older";
  steps(1);
  EXPECT_TRUE(left_->ready(Quantity::joints, now));
  const JointVector start = q_d();
  const std::vector<JointVector> via{offset(start, 0, 0.2), offset(offset(start, 0, 0.4), 3, -0.2)};
  left_->through_joints(via, 1.0, listener_);
  double nearest = 1;
  for (int i = 0; i < 8000 && !listener_->ended; ++i) {
    steps(1);
    nearest = std::min(nearest, (q_d() - via[0]).lpNorm<Eigen::Infinity>());
  }
  ASSERT_TRUE(listener_->ended);
  EXPECT_EQ(*listener_->ended, MotionResult::reached) << listener_->reason;
  EXPECT_LT((q_d() - via[1]).lpNorm<Eigen::Infinity>(), 1e-3);
  EXPECT_LT((q(0) - via[1]).lpNorm<Eigen::Infinity>(), 0.02);
  EXPECT_LT(nearest, 0.005) << "it passes the first one";
  EXPECT_GT(listener_->reports, 10);
  EXPECT_EQ(listener_->last.point, 1U);
  EXPECT_GT(listener_->last.duration_s, 0.8) << "0.4 rad at 0.5 rad/s";
  // 7 rad/s^2 at most, and a third more while a starting stream is caught up with
  EXPECT_LT(largest_step_, 0.01);
  // No stream is left that could fall silent.
  steps(500);
  EXPECT_EQ(newest_.arms[0].owner, cycle_.modes().find("left_joints"));
  EXPECT_EQ(interventions_, "");
}

TEST_F(ArmMotionTest, HalfTheVelocityTakesAboutTwiceTheTime) {
  steps(10);
  const std::vector<JointVector> there{offset(q_d(), 0, 0.5)}, back{q_d()};
  left_->through_joints(there, 1.0, listener_);
  ASSERT_TRUE(run(*listener_, 10));
  const auto second = std::make_shared<Listener>();
  left_->through_joints(back, 0.5, second);
  ASSERT_TRUE(run(*second, 20));
  EXPECT_EQ(*second->ended, MotionResult::reached);
  EXPECT_GT(second->last.duration_s, 1.4 * listener_->last.duration_s);
}

TEST_F(ArmMotionTest, MovesThroughPosesOfAnArmOnARotatedBase) {
  steps(10);
  const auto input = cycle_.modes().find("right_pose");
  const auto pose_now = [&] { return Pose::from(from(newest_.references, input).data()); };
  const Pose start = pose_now();
  const Matrix3 turned = exp_rotation({0, 0.2, 0.3}) * start.rotation;
  right_->through_poses(std::vector<ViaPose>{{start.position + Vector3(0.05, 0, 0.05), {}},
                                             {start.position + Vector3(0.1, 0.05, 0), turned}},
                        1.0, listener_);
  ASSERT_TRUE(run(*listener_, 10));
  EXPECT_EQ(*listener_->ended, MotionResult::reached) << listener_->reason;
  EXPECT_LT((pose_now().position - start.position - Vector3(0.1, 0.05, 0)).norm(), 1e-3);
  EXPECT_LT(log_rotation(pose_now().rotation * turned.transpose()).norm(), 2e-3);
  EXPECT_EQ(interventions_, "");
  EXPECT_LT(largest_step_, 0.015);
}

TEST_F(ArmMotionTest, CancelBrakesToRestWithinTheLimitsAndHoldsThere) {
  steps(10);
  const JointVector start = q_d();
  left_->through_joints(std::vector{offset(start, 0, 0.8)}, 1.0, listener_);
  steps(800);
  ASSERT_FALSE(listener_->ended);
  const double moving = q_d()[0];
  EXPECT_GT(moving - start[0], 0.05);
  EXPECT_FALSE(left_->cancel(Listener())) << "another motion's";
  EXPECT_TRUE(left_->cancel(*listener_));
  EXPECT_FALSE(listener_->ended) << "not at rest yet";
  ASSERT_TRUE(run(*listener_, 2));
  EXPECT_EQ(*listener_->ended, MotionResult::canceled);
  EXPECT_GT(q_d()[0], moving) << "a smooth stop takes a moment";
  EXPECT_LT(q_d()[0], moving + 0.2);
  steps(500);
  EXPECT_LT(speed(0), 0.01);
  EXPECT_LT(largest_step_, 0.01);
  EXPECT_EQ(interventions_, "");
  EXPECT_FALSE(left_->cancel(*listener_)) << "it has ended";
}

TEST_F(ArmMotionTest, ANewerMotionTakesOverWithoutAJump) {
  steps(10);
  const JointVector start = q_d();
  left_->through_joints(std::vector{offset(start, 0, 0.8)}, 1.0, listener_);
  steps(700);
  const auto second = std::make_shared<Listener>(), third = std::make_shared<Listener>();
  left_->through_joints(std::vector{offset(start, 0, -0.1)}, 1.0, second);
  EXPECT_EQ(listener_->ended, MotionResult::preempted);
  steps(5);
  left_->through_joints(std::vector{offset(start, 1, 0.1)}, 1.0, third);  // before the second one started
  EXPECT_EQ(second->ended, MotionResult::preempted);
  ASSERT_TRUE(run(*third, 10));
  EXPECT_EQ(*third->ended, MotionResult::reached) << third->reason;
  EXPECT_LT((q_d() - offset(start, 1, 0.1)).lpNorm<Eigen::Infinity>(), 1e-3);
  EXPECT_LT(largest_step_, 0.01);
}

TEST_F(ArmMotionTest, EndsWhenTheArmLeavesItsControllet) {
  steps(10);
  left_->through_joints(std::vector{offset(q_d(), 0, 0.8)}, 1.0, listener_);
  steps(300);
  switch_to("left_pose");
  ASSERT_TRUE(run(*listener_, 0.1));
  EXPECT_EQ(*listener_->ended, MotionResult::lost);
  EXPECT_THAT(listener_->reason, HasSubstr("'left_joints' no longer drives 'left'"));

  // Joint motions are refused now, with the controllet to switch to
  const auto next = std::make_shared<Listener>();
  EXPECT_THAT(refusal([&] { left_->through_joints(std::vector{q(0)}, 1, next); }),
              HasSubstr("no active controllet takes joint positions of 'left'; switch to left_joints"));
  EXPECT_THAT(refusal([&] { right_->through_joints(std::vector{q(1)}, 1, next); }),
              HasSubstr("add one of the type joint_impedance"));
  EXPECT_FALSE(next->ended);
}

// A controllet that is started again, within one cycle, stands still where the arm is.
TEST_F(ArmMotionTest, EndsWhenItsControlletStartsAgain) {
  steps(10);
  const auto other = std::make_shared<Listener>();
  left_->through_joints(std::vector{offset(q_d(), 0, 0.8)}, 1.0, listener_);
  right_->through_poses(std::vector{ViaPose{Vector3(0.5, -0.3, 0.5), {}}}, 0.5, other);
  steps(300);
  ASSERT_GT(speed(0), 0.05);
  const JointVector there = q(0);
  const InstanceSet law = bit(cycle_.modes().find("left_joints"));
  const std::array again{Request{.deactivate = law}, Request{.activate = law}};
  std::uint64_t ticket = 0;
  ASSERT_EQ(cycle_.modes().post(again, ticket), Verdict::accepted);
  ASSERT_TRUE(run(*listener_, 0.01));
  EXPECT_EQ(*listener_->ended, MotionResult::lost);
  EXPECT_THAT(listener_->reason, HasSubstr("started again"));
  EXPECT_FALSE(other->ended) << "the other arm's controllet has not started again";
  for (int k = 0; k < 1000; ++k) {
    steps(1);
    ASSERT_LT((q(0) - there).lpNorm<Eigen::Infinity>(), 0.02);
  }
}

TEST_F(ArmMotionTest, DetectsAnotherClientOnTheSameInput) {
  steps(10);
  const JointVector goal = offset(q_d(), 0, 0.2), elsewhere = offset(q_d(), 1, 0.2);
  left_->through_joints(std::vector{goal}, 1.0, listener_);
  Target target;
  target.size = 7;
  std::copy_n(elsewhere.data(), 7, target.values.begin());
  for (int i = 0; i < 5000 && !listener_->ended; ++i) {
    steps(1);
    cycle_.modes().instance(cycle_.modes().find("left_joints")).inputs()[0].post(target);
  }
  ASSERT_TRUE(listener_->ended);
  EXPECT_EQ(*listener_->ended, MotionResult::lost);
  EXPECT_THAT(listener_->reason, HasSubstr("no other client"));
}

TEST_F(ArmMotionTest, ARunningMotionComesToRestWhenTheInterfaceCloses) {
  steps(10);
  left_->through_joints(std::vector{offset(q_d(), 0, 0.8)}, 1.0, listener_);
  steps(600);
  left_ = std::make_unique<ArmMotion>(run_, 0, false);  // destroys the other one
  EXPECT_EQ(listener_->ended, MotionResult::lost);
  steps(1000);
  EXPECT_LT(speed(0), 0.01);
  EXPECT_EQ(interventions_, "") << "no stream fell silent";
}

TEST_F(ArmMotionTest, InvalidGoalsAreRefusedWithWhatWasExpected) {
  steps(10);
  const JointVector here = q_d();
  const auto joints = [&](std::vector<JointVector> via, double scale) {
    return refusal([&] { left_->through_joints(via, scale, listener_); });
  };
  EXPECT_THAT(joints({}, 1), HasSubstr("at least one joint position"));
  EXPECT_THAT(joints({here}, 0), HasSubstr("above 0 and at most 1"));
  EXPECT_THAT(joints({here}, 1.5), HasSubstr("above 0 and at most 1"));
  EXPECT_THAT(joints({here}, std::nan("")), HasSubstr("above 0 and at most 1"));
  EXPECT_THAT(joints({here.head(6)}, 1), HasSubstr("'left': expected 7 numbers, found 6"));
  EXPECT_THAT(joints({offset(here, 3, 5)}, 1), HasSubstr("joint4: "));
  EXPECT_THAT(joints({offset(here, 2, std::nan(""))}, 1), HasSubstr("number 3 of 7 is not finite"));
  for (const auto& goal : test::wrong_goals(*run_.models[0])) {
    if (goal.quantity != Quantity::joints) continue;
    const Eigen::Map<const Eigen::VectorXd> q(goal.values.data(),
                                              static_cast<Eigen::Index>(goal.values.size()));
    EXPECT_THAT(joints({q}, 1), HasSubstr(goal.sentence));
  }
  switch_to("left_pose");
  const auto pose = [&](ViaPose via) {
    return refusal([&] { left_->through_poses(std::vector{via}, 1, listener_); });
  };
  EXPECT_THAT(pose({{std::nan(""), 0, 0}, {}}), HasSubstr("not finite"));
  EXPECT_THAT(pose({{50, 0, 0}, {}}), HasSubstr("out of reach"));
  EXPECT_FALSE(listener_->ended);
  steps(200);
  EXPECT_LT(speed(0), 0.01) << "nothing has moved";
}

TEST_F(ArmMotionTest, FollowsATrajectoryOfSomeJointsFromWhereTheArmIs) {
  steps(10);
  const JointVector start = q_d();
  const double nan = std::numeric_limits<double>::quiet_NaN();
  TrajectoryGoal goal;
  const auto only = [&](double q4, double q6) {
    JointVector q = JointVector::Constant(7, nan);
    q[3] = q4, q[5] = q6;
    return q;
  };
  // MoveIt sends the measured start as its first point, which may differ slightly from the set-point.
  goal.points = {point(0, only(start[3] + 0.01, start[5] - 0.01), 0.0),
                 point(1, only(start[3] - 0.2, start[5] + 0.1), -0.1),
                 point(2, only(start[3] - 0.3, start[5]), 0.0)};
  for (auto& each : goal.points) each.velocity[0] = each.velocity[5] = 0;
  goal.path_position = JointVector::Constant(7, 0.1);
  goal.goal_position = JointVector::Constant(7, 0.03);
  left_->follow(goal, listener_);
  const double start_s = newest_.t.seconds();
  double at_one = 1;
  for (int i = 0; i < 5000 && !listener_->ended; ++i) {
    steps(1);
    // One cycle until it starts, and a stream is followed a few cycles late
    if (std::abs(newest_.t.seconds() - start_s - 1.003) < 0.0006) at_one = q_d()[3] - (start[3] - 0.2);
  }
  ASSERT_TRUE(listener_->ended);
  EXPECT_EQ(*listener_->ended, MotionResult::reached) << listener_->reason;
  EXPECT_LT(std::abs(at_one), 0.002);
  EXPECT_NEAR(q_d()[3], start[3] - 0.3, 1e-3);
  EXPECT_NEAR(q_d()[5], start[5], 1e-3);
  for (const int j : {0, 1, 2, 4, 6}) EXPECT_NEAR(q_d()[j], start[j], 1e-6) << j;
  EXPECT_EQ(listener_->last.desired.position.size(), 7);
  EXPECT_LT((listener_->last.desired.position - listener_->last.q).lpNorm<Eigen::Infinity>(), 0.05);
  EXPECT_NEAR(newest_.t.seconds() - start_s, 2.1, 0.2);
}

TEST_F(ArmMotionTest, ALaterTrajectoryWaitsForItsTime) {
  steps(10);
  TrajectoryGoal goal;
  goal.points = {point(1, offset(q_d(), 0, 0.1))};
  goal.delay_s = 0.5;
  const JointVector start = q_d();
  left_->follow(goal, listener_);
  steps(490);
  EXPECT_NEAR(q_d()[0], start[0], 1e-9);
  ASSERT_TRUE(run(*listener_, 3));
  EXPECT_EQ(*listener_->ended, MotionResult::reached);
}

TEST_F(ArmMotionTest, LeavingThePathBrakesAndNamesTheJoint) {
  steps(10);
  const JointVector start = q_d();
  TrajectoryGoal goal;
  goal.points = {point(3, offset(start, 0, 0.8), 0.0)};
  goal.path_position = JointVector::Constant(7, 0);
  goal.path_position[0] = 1e-5;  // less than the lag of the spring
  left_->follow(goal, listener_);
  ASSERT_TRUE(run(*listener_, 5));
  EXPECT_EQ(*listener_->ended, MotionResult::path_tolerance);
  EXPECT_THAT(listener_->reason, HasSubstr("left_joint1 is"));
  EXPECT_LT(q_d()[0], start[0] + 0.4);
  EXPECT_LT(largest_step_, 0.01);
}

TEST_F(ArmMotionTest, AMissedGoalIsReported) {
  steps(10);
  TrajectoryGoal goal;
  goal.points = {point(1, offset(q_d(), 1, 0.1), 0.0)};
  goal.goal_position = JointVector::Constant(7, 1e-15);
  goal.goal_time_s = 1.5;
  left_->follow(goal, listener_);
  ASSERT_TRUE(run(*listener_, 5));
  EXPECT_EQ(*listener_->ended, MotionResult::goal_tolerance);
  EXPECT_THAT(listener_->reason, HasSubstr("off its goal"));
  EXPECT_GT(newest_.t.seconds(), 2.4) << "it had its time";
}

TEST_F(ArmMotionTest, TrajectoriesBeyondTheLimitsAreRefused) {
  steps(10);
  const JointVector start = q_d();
  const auto refused = [&](std::vector<TrajectoryPoint> points) {
    TrajectoryGoal goal;
    goal.points = std::move(points);
    return refusal([&] { left_->follow(goal, listener_); });
  };
  EXPECT_THAT(refused({}), HasSubstr("no point"));
  EXPECT_THAT(refused({point(0, start)}), HasSubstr("single point"));
  EXPECT_THAT(refused({point(0, offset(start, 1, 0.3)), point(1, start)}),
              ::testing::AllOf(HasSubstr("starts at"), HasSubstr("left_joint2")));
  EXPECT_THAT(refused({point(1, offset(start, 0, 9))}), HasSubstr("joint1: "));
  EXPECT_THAT(refused({point(0.1, offset(start, 0, 0.9))}), HasSubstr("rad/s; the arm's limit is"));
  EXPECT_THAT(refused({point(1, offset(start, 0, 0.8))}), HasSubstr("left_joints/joints is 0.5"));
  // Within the limits at its points, but not between them
  auto wild = point(1, start);
  wild.velocity = JointVector::Zero(7);
  wild.velocity[3] = -6;
  EXPECT_THAT(refused({point(0.5, start, 0.0), wild, point(1.5, start, 0.0)}), HasSubstr("left_joint4"));
  EXPECT_FALSE(listener_->ended);
}

// With the usual bounds for contact.
struct BesidePeopleTest : ArmMotionTest {
  BesidePeopleTest() : ArmMotionTest(0.25) {}
  Vector3 hand(const JointVector& at) {
    terms.update(at, joint_constant(7, 0));
    return terms.X_WE().position;
  }
  ModelTerms terms = [&] {
    ModelTerms own(run_.models[0]);
    const ArmConfig config = arm_config(scene_.arms[0]);
    own.set_config(config.frames, config.tool, config.load);
    return own;
  }();
};

// 0.5 rad/s of the first joint alone are 0.28 m/s at the hand. The plan itself is slow enough: the set-point
// keeps to it, and arrives when it says.
TEST_F(BesidePeopleTest, JointMotionsArePlannedWithinTheSpeedOfTheHand) {
  steps(10);
  const std::vector<JointVector> via{offset(offset(q_d(), 0, 0.4), 3, 0.5),
                                     offset(offset(q_d(), 0, 0.9), 1, 0.3)};
  left_->through_joints(via, 1.0, listener_);
  double fastest = 0;
  int count = 0;
  for (Vector3 before = hand(q_d()); count < 20000 && !listener_->ended; ++count) {
    steps(1);
    const Vector3 now = hand(q_d());
    fastest = std::max(fastest, (now - before).norm() / kPeriod);
    before = now;
  }
  ASSERT_TRUE(listener_->ended);
  EXPECT_EQ(*listener_->ended, MotionResult::reached) << listener_->reason;
  EXPECT_LT(fastest, 1.01 * 0.25);
  EXPECT_GT(fastest, 0.8 * 0.25);
  EXPECT_NEAR(count * kPeriod, listener_->last.duration_s, 0.06);
  EXPECT_LT((q_d() - via[1]).lpNorm<Eigen::Infinity>(), 1e-3);
}

TEST_F(BesidePeopleTest, TrajectoriesThatMoveTheHandTooFastAreRefusedWithTheKeyThatLiftsIt) {
  steps(10);
  const auto refused = [&](double time) {
    const JointVector there = offset(offset(q_d(), 0, 0.39), 3, 0.39);
    return refusal([&] { left_->follow({.points = {point(time, there)}}, listener_); });
  };
  EXPECT_THAT(refused(0.8), testing::AllOf(HasSubstr("moves the hand of 'left' at 0."),
                                           HasSubstr("contact_bounds"), HasSubstr("times the duration")));
  EXPECT_EQ(refused(3), "it was accepted");
}

// Two slides on each other that point in opposite directions: the hand rests while both move alike.
const char* const kSlides = R"(name: slides
title: Slides
joints:
  joint1: {position_m: [0, 0, 0.3], type: prismatic}
  joint2: {position_m: [0.2, 0, 0], rpy_rad: [pi, 0, 0], type: prismatic}
flange: {position_m: [0.1, 0, 0]}
inertials:
  link0: {mass_kg: 9, com_m: [0, 0, 0], inertia_kg_m2: {xx: 0.1, yy: 0.1, zz: 0.1, xy: 0, xz: 0, yz: 0}}
  link1: {mass_kg: 10, com_m: [0, 0, 0], inertia_kg_m2: {xx: 0.1, yy: 0.1, zz: 0.1, xy: 0, xz: 0, yz: 0}}
  link2: {mass_kg: 2, com_m: [0, 0, 0], inertia_kg_m2: {xx: 0.1, yy: 0.1, zz: 0.1, xy: 0, xz: 0, yz: 0}}
limits:
  joint1: {lower_m: -1, upper_m: 1, velocity_m_per_s: 5, effort_n: 500}
  joint2: {lower_m: -1, upper_m: 1, velocity_m_per_s: 5, effort_n: 500}
interface_limits:
  acceleration_rad_per_s2: [10, 10]
  jerk_rad_per_s3: [1000, 1000]
  torque_rate_nm_per_s: [9000, 9000]
home_rad: [0, 0]
self_collision: {capsules: {}, ignored_pairs: []}
)";

class CarriageTest : public ArmMotionTest {
 protected:
  static Scene make(const Registry& registry) {
    const auto file =
        std::filesystem::path(testing::TempDir()) / ("slides_" + std::to_string(::getpid()) + ".yaml");
    std::ofstream(file) << kSlides;
    const std::string model = ", hand: false, model: " + file.string();
    return parse_scene("arms:\n  - {name: left" + model +
                           ", base: {position_m: [0.1, 0.4, 2], rpy_rad: [pi/2, 0.3, 0]}}\n  - {name: right" +
                           model + ", base: {position_m: [0, -3, 1], rpy_rad: [-pi/2, 0, 0]}}\n" +
                           "controllets:\n  - {name: left_joints, type: joint_impedance, arms: left, inputs: "
                           "{joints: {max_speed_rad_per_s: 2}}}\nactive: [left_joints]\n",
                       "slides.yaml", registry);
  }
  CarriageTest() : ArmMotionTest(make) {}
};

TEST_F(CarriageTest, IsNoFasterThanAHandMayBe) {
  constexpr double kAllowed = 0.25;
  steps(10);
  const JointVector far = JointVector::Constant(2, 0.4);
  EXPECT_THAT(refusal([&] {
                left_->follow({.points = {point(0.8, far)},
                               .path_position = {},
                               .path_velocity = {},
                               .goal_position = {},
                               .goal_velocity = {}},
                              listener_);
              }),
              HasSubstr("a carriage of 'left'"));
  EXPECT_THAT(refusal([&] { left_->through_joints(std::vector<JointVector>{3 * far}, 1, listener_); }),
              HasSubstr("joint1: 1.2 m is outside of -1 to 1 m"));
  left_->through_joints(std::vector<JointVector>{far}, 1, listener_);
  double fastest = 0;
  for (int k = 0; k < 6000 && !listener_->ended; ++k) {
    steps(1);
    fastest = std::max(fastest, std::abs(newest_.arms[0].dq[0]));
  }
  ASSERT_TRUE(listener_->ended);
  EXPECT_EQ(*listener_->ended, MotionResult::reached) << listener_->reason;
  EXPECT_LT(fastest, 1.02 * kAllowed);
  EXPECT_GT(fastest, 0.8 * kAllowed);
  EXPECT_EQ(interventions_, "");

  // A move of `multipanda move`: minimum jerk, its peak is 1.875 times the mean.
  JointMove move{.arm = 0, .from = {}, .goal = far, .slowest_joint = 5};
  move.plan(-far, 0.2, scene_.arms[0], kAllowed);
  EXPECT_NEAR(move.duration_s, 1.875 * 0.8 / kAllowed, 1e-6);
  EXPECT_NEAR(move.hand_speed(), kAllowed, 1e-9);
}

}  // namespace
}  // namespace multipanda::arm_motion_test
