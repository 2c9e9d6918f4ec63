// A cycle in somebody else's loop, on robots that offer position, velocity and effort and nothing else.
#include "runtime/hosted/hosted_cycle.hpp"

#include <algorithm>
#include <cmath>
#include <mutex>

#include <Eigen/Cholesky>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/rt/guard/loop_guard.hpp"
#include "runtime/hosted/hosted_rig.hpp"
#include "scene/build.hpp"
#include "scene/load.hpp"

namespace multipanda {
namespace {

using test::eventually;
using testing::HasSubstr;
using Gravity = HostedArm::Gravity;

const Registry& builtins() {
  static const Registry registry = Registry::with_builtins();
  return registry;
}

// Two arms on bases that are turned and tilted.
Scene scene_of(const std::string& more) {
  return parse_scene(
      "arms:\n"
      "  left: {model: fer, hand: false, base: {position_m: [0, 0.5, 0], rpy_rad: [0.3, 0, 0.4]}}\n"
      "  right: {model: fr3, hand: false, base: {position_m: [0, -0.5, 0], rpy_rad: [0, 0.5, -1]}}\n" +
          more,
      "test", builtins());
}

const char* const kJoints =
    "controllets:\n"
    "  left_joints: {type: joint_impedance, arms: left}\n"
    "  right_pose: {type: cartesian_impedance, arms: right}\n"
    "active: [left_joints, right_pose]\n";

// A third that may have the left arm.
const char* const kChoice =
    "controllets:\n"
    "  left_joints: {type: joint_impedance, arms: left}\n"
    "  left_pose: {type: cartesian_impedance, arms: left}\n"
    "  right_pose: {type: cartesian_impedance, arms: right}\n"
    "active: [left_joints, right_pose]\n";

// M ddq = tau - c - g (or without g, where the robot compensates it), a period of 1 ms by ten smaller steps.
struct Robot {
  Robot(std::shared_ptr<const ArmModel> model, bool heavy_, JointVector q_)
      : terms(model), heavy(heavy_), q(std::move(q_)), dq(joint_constant(model->joint_count(), 0)) {
    terms.set_config({}, {}, {});
  }
  void step(const JointVector& tau) {
    for (int k = 0; k < 10; ++k) {
      terms.update(q, dq);
      JointVector rest = tau - terms.c();
      if (heavy) rest -= terms.g();
      const JointVector ddq = terms.M().llt().solve(rest);
      dq += 1e-4 * ddq;
      q += 1e-4 * dq;
    }
    tau_J = tau;
    if (!heavy) tau_J += terms.g();
  }
  ModelTerms terms;
  bool heavy;
  JointVector q, dq, tau_J;
};

struct Counting : RunAdapter {
  void take(const CycleRecord& record) override {
    const std::lock_guard lock(mutex);
    cycles.push_back(record.cycle);
  }
  void take(const Event& event) override {
    const std::lock_guard lock(mutex);
    events.push_back(event);
  }
  std::mutex mutex;  // who holds it keeps the relay waiting
  std::vector<std::uint64_t> cycles;
  std::vector<Event> events;
};

// The step of a later activation in which its controllets start: one with the arms recovering, two in which
// they take commands, and then.
constexpr int kFirstStart = 2 + static_cast<int>(HostedCycle::kSettled);

struct Rig {
  explicit Rig(const std::string& yaml = kJoints, bool effort = true,
               std::vector<Gravity> gravity = {Gravity::cycle, Gravity::robot})
      : scene(scene_of(yaml)) {
    HostedOptions options;
    for (ArmIndex i = 0; i < 2; ++i) {
      options.arms.push_back({.name = scene.arms[i].name, .joints = {}, .gravity = gravity[i]});
    }
    options.make_adapter = [this](const RunWorld&) {
      auto adapter = std::make_unique<Counting>();
      counting = adapter.get();
      return adapter;
    };
    cycle = std::make_unique<HostedCycle>(scene, builtins(), options);
    for (ArmIndex i = 0; i < 2; ++i) {
      JointVector q = scene.arms[i].q_start;
      q[1] += 0.2;
      robots.emplace_back(cycle->models()[i], gravity[i] == Gravity::cycle, q);
      robots[i].step(joint_constant(7, 0));
      robots[i].q = q;
      robots[i].dq.setZero();
      cycle->signals(i).has_effort = effort;
    }
    take_in();
  }
  void take_in() {
    for (ArmIndex i = 0; i < 2; ++i) {
      ArmSignals& signals = cycle->signals(i);
      std::copy(robots[i].q.begin(), robots[i].q.end(), signals.position.begin());
      std::copy(robots[i].dq.begin(), robots[i].dq.end(), signals.velocity.begin());
      std::copy(robots[i].tau_J.begin(), robots[i].tau_J.end(), signals.effort.begin());
    }
  }
  JointVector command(ArmIndex i) const {
    return Eigen::Map<const Eigen::VectorXd>(cycle->signals(i).effort_command.data(), 7);
  }
  void move() {
    for (ArmIndex i = 0; i < 2; ++i) robots[i].step(command(i));
  }
  bool step() {
    take_in();
    const bool any = cycle->step(0.001);
    move();
    return any;
  }
  bool runs(const char* name) const {
    return (cycle->modes().active() & bit(cycle->modes().find(name))) != 0;
  }
  void steps(int n) {
    for (int i = 0; i < n; ++i) step();
  }
  // Steps until the scene's controllets run: at the latest when an activation is over.
  bool start() {
    steps(kFirstStart);
    return runs("left_joints") && runs("right_pose");
  }
  // What a user asks for while the loop runs: taken at the next boundary.
  Verdict post(const Request& request) {
    std::uint64_t ticket = 0;
    return cycle->modes().post(std::span(&request, 1), ticket);
  }
  Verdict activate(const char* name) { return post({.activate = bit(cycle->modes().find(name))}); }
  bool relayed() {  // the relay has seen all that happened
    return eventually([&] {
      const std::lock_guard lock(counting->mutex);
      return !counting->cycles.empty() && counting->cycles.back() == cycle->data().tick.cycle;
    });
  }
  // How often an instance was started, as far as the relay has told.
  int starts(const char* name) {
    const std::lock_guard lock(counting->mutex);
    const InstanceSet one = bit(cycle->modes().find(name));
    return static_cast<int>(std::count_if(counting->events.begin(), counting->events.end(), [&](auto& e) {
      return e.kind == EventKind::switched && (e.started & one) != 0;
    }));
  }
  JointVector gravity(ArmIndex i) {
    robots[i].terms.update(robots[i].q, robots[i].dq);
    return robots[i].terms.g();
  }

  Scene scene;
  std::unique_ptr<HostedCycle> cycle;
  std::vector<Robot> robots;
  Counting* counting = nullptr;
};

TEST(HostedCycle, HoldsAndControlsRobotsWithAndWithoutTheirOwnGravityCompensation) {
  for (const bool effort : {true, false}) {
    Rig rig(kJoints, effort);
    const JointVector start[2] = {rig.robots[0].q, rig.robots[1].q};
    rig.cycle->activate();
    ASSERT_TRUE(rig.start());
    for (int i = 0; i < 500; ++i) ASSERT_TRUE(rig.step());
    for (ArmIndex i = 0; i < 2; ++i) {  // held where it was measured, whoever carries the weight
      EXPECT_LT((rig.robots[i].q - start[i]).lpNorm<Eigen::Infinity>(), 2e-4) << i << effort;
    }
    // A goal, reached: left by its joints.
    Instance& joints = rig.cycle->modes().instance(rig.cycle->modes().find("left_joints"));
    Target target;
    target.size = 7;
    const JointVector goal = start[0] + joint_constant(7, 0.1);
    std::copy(goal.begin(), goal.end(), target.values.begin());
    ASSERT_EQ(joints.inputs()[0].post(target), Verdict::accepted);
    for (int i = 0; i < 3000; ++i) rig.step();
    EXPECT_LT((rig.robots[0].q - goal).lpNorm<Eigen::Infinity>(), 1e-3) << effort;
    EXPECT_TRUE(rig.runs("right_pose"));
    // At rest the external torque is zero within what the integration leaves.
    const ArmState& state = rig.cycle->data().state[0];
    EXPECT_LT(state.tau_ext_hat.lpNorm<Eigen::Infinity>(), 0.05) << effort;
  }
}

TEST(HostedCycle, ControlletsStartInTheFirstStepOfAll) {
  Rig rig;
  rig.cycle->activate();
  rig.step();
  EXPECT_TRUE(rig.runs("left_joints") && rig.runs("right_pose"));
  EXPECT_EQ(rig.cycle->data().tick.cycle, 1u);
}

TEST(HostedCycle, LaterTheyStartWhenTheirArmsHaveSettledToTheStep) {
  Rig rig;
  for (int round = 0; round < 3; ++round) {
    const std::lock_guard busy(rig.counting->mutex);  // no other thread has a part in it
    rig.cycle->activate();
    for (int i = 1; i < 6; ++i) {
      rig.step();
      EXPECT_EQ(rig.runs("left_joints"), round == 0 || i >= kFirstStart) << round << " " << i;
      EXPECT_EQ(rig.runs("right_pose"), round == 0 || i >= kFirstStart) << round << " " << i;
    }
    rig.cycle->deactivate();
  }
}

// Where users and the scene differ, users win, however busy the computer is: the relay sees nothing before
// the user's switch was taken.
TEST(HostedCycle, AUsersSwitchInTheFirstStepsStands) {
  Rig rig(kChoice);
  {
    const std::lock_guard busy(rig.counting->mutex);
    rig.cycle->activate();
    rig.steps(10);
    ASSERT_EQ(rig.activate("left_pose"), Verdict::accepted);
    rig.step();
    ASSERT_TRUE(rig.runs("left_pose"));
  }
  ASSERT_TRUE(rig.relayed());
  std::this_thread::sleep_for(std::chrono::milliseconds(5));
  rig.steps(50);
  EXPECT_TRUE(rig.runs("left_pose") && rig.runs("right_pose"));
  EXPECT_EQ(rig.starts("left_joints"), 1);  // in the first step
}

// The same at a later activation, with the user's switch taken before, in and after the step in which the
// start is due. Before its arms take commands again a switch is refused, and the scene's start comes.
TEST(HostedCycle, AUsersSwitchStandsInWhicheverStepItComes) {
  for (int when = 1; when <= kFirstStart + 1; ++when) {
    Rig rig(kChoice);
    rig.cycle->activate();
    rig.step();
    rig.cycle->deactivate();
    ASSERT_TRUE(rig.relayed());
    const int before = rig.starts("left_joints");
    rig.cycle->activate();
    rig.steps(when - 1);
    ASSERT_EQ(rig.activate("left_pose"), Verdict::accepted);
    rig.steps(20);
    const bool too_soon = when == 1;
    EXPECT_EQ(rig.runs("left_pose"), !too_soon) << when;
    EXPECT_EQ(rig.runs("left_joints"), too_soon) << when;
    EXPECT_TRUE(rig.runs("right_pose")) << when;  // nobody spoke about this arm
    ASSERT_TRUE(rig.relayed());
    // Not even started to be stopped at once.
    EXPECT_EQ(rig.starts("left_joints") - before, when == 1 || when > kFirstStart ? 1 : 0) << when;
  }
}

TEST(HostedCycle, WhatAUserSwitchedOffOrStoppedStaysOff) {
  for (int when = 1; when <= kFirstStart; ++when) {
    for (const bool stop : {false, true}) {
      Rig rig;
      rig.cycle->activate();
      rig.step();
      rig.cycle->deactivate();
      ASSERT_TRUE(rig.relayed());
      const int before = rig.starts("left_joints");
      rig.cycle->activate();
      rig.steps(when - 1);
      MultimodeController& modes = rig.cycle->modes();
      if (stop) {
        modes.stop(ArmSet::of(0));
      } else {
        ASSERT_EQ(rig.post({.deactivate = bit(modes.find("left_joints"))}), Verdict::accepted);
      }
      rig.steps(20);
      EXPECT_EQ(modes.owner(0), modes.find("left_hold")) << when << stop;
      EXPECT_TRUE(rig.runs("right_pose"));
      ASSERT_TRUE(rig.relayed());
      EXPECT_EQ(rig.starts("left_joints"), before) << when << stop;
      if (!stop) continue;
      // Resuming starts nothing by itself. Neither does the next activation while the stop is in force, nor
      // after it was lifted.
      ASSERT_EQ(rig.post({.kind = Request::Kind::resume, .arms = ArmSet::of(0)}), Verdict::accepted);
      rig.steps(20);
      EXPECT_EQ(modes.owner(0), modes.find("left_hold"));
      modes.stop(ArmSet::of(0));
      rig.step();
      rig.cycle->deactivate();
      rig.cycle->activate();
      rig.steps(2);
      ASSERT_EQ(rig.post({.kind = Request::Kind::resume, .arms = ArmSet::of(0)}), Verdict::accepted);
      rig.steps(20);
      EXPECT_EQ(modes.owner(0), modes.find("left_hold"));
      EXPECT_TRUE(rig.runs("right_pose"));
      rig.cycle->deactivate();  // and the one after it is as any other
      rig.cycle->activate();
      EXPECT_TRUE(rig.start());
    }
  }
}

// An arm whose hardware says its mode: in the first step it does not take commands.
struct LateArm {
  explicit LateArm(Rig& rig) : rig_(rig) {
    window.model = &rig.robots[0].terms;
    window.state.mode = ArmMode::other;
    rig.cycle->signals(0).window = &window;
  }
  bool steps(int n, double period_s = 0.001) {
    bool any = false;
    for (int i = 0; i < n; ++i) {
      ++window.state.sequence;
      window.state.q = rig_.robots[0].q;
      window.state.dq = window.state.tau_J_d = joint_constant(7, 0);
      window.state.tau_J = rig_.robots[0].tau_J;
      rig_.take_in();
      any = rig_.cycle->step(period_s);
    }
    return any;
  }
  ArmWindow window;

 private:
  Rig& rig_;
};

TEST(HostedCycle, AnArmThatIsLateIsWaitedForInTheLoopsTime) {
  const double period = 0.01;
  const int patience = static_cast<int>(std::lround(HostedCycle::kPatience / period));
  for (const int waits : {1, 5, patience - 5, patience + 5}) {
    Rig rig;
    LateArm left(rig);
    rig.cycle->activate();
    left.steps(waits, period);
    EXPECT_FALSE(rig.runs("left_joints"));
    EXPECT_EQ(rig.runs("right_pose"), waits > static_cast<int>(HostedCycle::kSettled));
    left.window.state.mode = ArmMode::move;
    left.steps(20, period);
    EXPECT_EQ(rig.runs("left_joints"), waits < patience) << waits;
    EXPECT_TRUE(rig.runs("right_pose"));
  }
}

TEST(HostedCycle, AnArmThatIsLostBeforeItSettledIsNotStartedByItself) {
  Rig rig;
  LateArm left(rig);
  rig.cycle->activate();
  left.steps(2);
  left.window.state.mode = ArmMode::move;
  left.steps(1);
  left.window.state.mode = ArmMode::reflex;
  left.steps(1);
  left.window.state.mode = ArmMode::move;
  left.steps(50);
  EXPECT_FALSE(rig.runs("left_joints"));
  ASSERT_EQ(rig.activate("left_joints"), Verdict::accepted);  // who asks gets it
  left.steps(1);
  EXPECT_TRUE(rig.runs("left_joints"));
}

// Activated again, an arm that says nothing yet: what ran before does not go on with what it knew.
TEST(HostedCycle, AnArmWithoutAStateOfThisActivationIsNotControlled) {
  Rig rig;
  rig.cycle->activate();
  rig.steps(5);
  rig.cycle->deactivate();
  rig.cycle->activate();
  rig.take_in();
  rig.cycle->signals(0).position[3] = NAN;
  rig.cycle->step(0.001);
  EXPECT_FALSE(rig.runs("left_joints"));
  for (int i = 0; i < 5; ++i) rig.cycle->step(0.001);
  EXPECT_FALSE(rig.runs("left_joints"));
  EXPECT_TRUE(rig.runs("right_pose"));
  rig.robots[0].q += joint_constant(7, 0.1);  // moved by somebody meanwhile
  rig.robots[0].dq.setZero();
  rig.take_in();
  rig.cycle->step(0.001);
  EXPECT_LT((rig.command(0) - rig.gravity(0)).lpNorm<Eigen::Infinity>(), 1e-9);
  rig.steps(kFirstStart);
  EXPECT_TRUE(rig.runs("left_joints"));
}

TEST(HostedCycle, RefusesWhatIsUnclear) {
  Rig rig(kJoints, true, {Gravity::unsaid, Gravity::robot});
  EXPECT_THAT(rig.cycle->check(), HasSubstr("arms.left.gravity_compensation"));
  Rig silent;
  EXPECT_EQ(silent.cycle->check(), "");
  silent.cycle->signals(1).velocity[3] = NAN;
  EXPECT_THAT(silent.cycle->check(), HasSubstr("right_joint4"));
  HostedOptions options;
  options.arms = {{.name = "left", .joints = {"a", "b"}}, {.name = "right"}};
  EXPECT_THROW(HostedCycle(scene_of(kJoints), builtins(), options), std::invalid_argument);
  options.arms = {{.name = "left"}};
  EXPECT_THROW(HostedCycle(scene_of(kJoints), builtins(), options), std::invalid_argument);
}

TEST(HostedCycle, LeavesGravityAloneAndComesBackFromTheMeasuredState) {
  Rig rig;
  rig.cycle->activate();
  ASSERT_TRUE(rig.start());
  for (int i = 0; i < 20; ++i) rig.step();
  for (int round = 0; round < 3; ++round) {
    rig.take_in();
    rig.cycle->deactivate();
    EXPECT_LT((rig.command(0) - rig.gravity(0)).norm(), 1e-9);
    EXPECT_EQ(rig.command(1).norm(), 0.0);
    // Somebody else moves the arms; the cycle sees nothing of it.
    for (ArmIndex i = 0; i < 2; ++i) {
      rig.robots[i].q += joint_constant(7, round == 1 ? -0.15 : 0.15);
      rig.robots[i].dq.setZero();
    }
    const JointVector there[2] = {rig.robots[0].q, rig.robots[1].q};
    rig.take_in();
    rig.cycle->activate();
    rig.cycle->step(0.001);
    // The first torque: no controllet, nothing of the torque of before.
    EXPECT_FALSE(rig.runs("left_joints"));
    EXPECT_LT((rig.command(0) - rig.gravity(0)).lpNorm<Eigen::Infinity>(), 1e-9);
    EXPECT_EQ(rig.command(1).norm(), 0.0);
    rig.move();
    ASSERT_TRUE(rig.start()) << round;
    for (int i = 0; i < 300; ++i) rig.step();
    for (ArmIndex i = 0; i < 2; ++i) {
      EXPECT_LT((rig.robots[i].q - there[i]).lpNorm<Eigen::Infinity>(), 1e-3) << round << i;
    }
  }
}

TEST(HostedCycle, SilentJointsGoToHoldThenToNoTorque) {
  Rig rig;
  rig.cycle->activate();
  ASSERT_TRUE(rig.start());
  rig.take_in();
  rig.cycle->signals(0).position[2] = NAN;
  const JointVector before = rig.command(0);
  for (int i = 0; i < 15; ++i) rig.cycle->step(0.001);
  EXPECT_EQ(rig.command(0), before);  // a packet lost is no reason to let go
  for (int i = 0; i < 10; ++i) rig.cycle->step(0.001);
  EXPECT_FALSE(rig.runs("left_joints"));
  EXPECT_TRUE(rig.runs("right_pose"));
  rig.robots[0].terms.update(rig.robots[0].q, rig.robots[0].dq);
  EXPECT_LT((rig.command(0) - rig.gravity(0)).lpNorm<Eigen::Infinity>(), 1e-2);
}

TEST(HostedCycle, LoadsAndFramesAreKeptHereOtherRequestsAreRefused) {
  Rig rig;
  rig.cycle->activate();
  ASSERT_TRUE(rig.start());
  const JointVector before = rig.command(0);
  Load load;
  load.mass = 2;
  load.p_FC = {0.1, 0, 0.1};
  ASSERT_TRUE(rig.cycle->backend().request(0, SetLoad{load}).get().success);
  rig.step();
  EXPECT_GT((rig.command(0) - before).norm(), 1.0);  // its weight is carried from the next step on
  EXPECT_EQ(rig.cycle->data().state[0].load.mass, 2);
  EXPECT_FALSE(rig.cycle->backend().request(0, RecoverFromError{}).get().success);
  EXPECT_FALSE(rig.cycle->backend().request(9, SetLoad{load}).get().success);
  load.mass = -1;
  EXPECT_FALSE(rig.cycle->backend().request(0, SetLoad{load}).get().success);
}

TEST(HostedCycle, TheAdapterGetsEveryRecordInOrder) {
  Rig rig;
  rig.cycle->activate();
  ASSERT_TRUE(rig.start());
  const std::uint64_t cycles = rig.cycle->data().tick.cycle;
  ASSERT_TRUE(eventually([&] {
    const std::lock_guard lock(rig.counting->mutex);
    return rig.counting->cycles.size() == cycles;
  }));
  for (std::size_t i = 0; i < cycles; ++i) ASSERT_EQ(rig.counting->cycles[i], i + 1);
  EXPECT_THAT(rig.counting->events, testing::Contains(testing::Field(&Event::kind, EventKind::arm_mode)));
}

TEST(HostedCycle, OddPeriodsAreTakenAsTheyAre) {
  Rig rig;
  rig.cycle->activate();
  for (const double period : {0.0, -1.0, static_cast<double>(NAN)}) rig.cycle->step(period);
  EXPECT_NEAR(rig.cycle->data().tick.t.seconds(), 0.003, 1e-9);
  rig.cycle->step(0.004);
  EXPECT_NEAR(rig.cycle->data().tick.dt, 0.004, 1e-9);
  EXPECT_EQ(rig.cycle->backend().overruns(), 3u);
}

TEST(HostedCycle, NeitherAllocatesNorLocks) {
  if (!kLoopGuardWorks) GTEST_SKIP() << "sanitizers replace malloc themselves";
  Rig rig;
  rig.cycle->activate();
  ASSERT_TRUE(rig.start());
  LoopGuard::arm();
  for (int round = 0; round < 3; ++round) {
    for (int i = 0; i < 50; ++i) rig.cycle->step(0.001);
    rig.cycle->deactivate();
    rig.cycle->activate();
  }
  const LoopGuardCounts counts = LoopGuard::disarm();
  EXPECT_EQ(counts.heap_calls, 0u);
  EXPECT_EQ(counts.lock_calls, 0u);
}

TEST(ArmWindow, OnlyAWindowOfThisBuildIsLookedThrough) {
  ArmWindow window;
  EXPECT_EQ(window_behind(to_interface(&window)), &window);
  for (const double value :
       {0.0, 1.0, -1.0, static_cast<double>(NAN), static_cast<double>(INFINITY), 1e-300}) {
    EXPECT_EQ(window_behind(value), nullptr) << value;
  }
  window.version = 2;
  EXPECT_EQ(window_behind(to_interface(&window)), nullptr);
  window = ArmWindow{};
  window.size += 8;
  EXPECT_EQ(window_behind(to_interface(&window)), nullptr);
  window = ArmWindow{};
  window.build[0] = 'x';
  EXPECT_EQ(window_behind(to_interface(&window)), nullptr);
  alignas(8) std::array<char, sizeof(ArmWindow)> other{};  // somebody else's struct
  EXPECT_EQ(window_behind(to_interface(reinterpret_cast<const ArmWindow*>(other.data()))), nullptr);
}

}  // namespace
}  // namespace multipanda
