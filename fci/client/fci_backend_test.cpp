// Several arms in one loop, against fake arms whose packets the test sends.
#include "fci/client/fci_backend.hpp"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <csignal>
#include <memory>
#include <thread>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "arm_interface/arm_settings.hpp"
#include "core/cycle/control_cycle.hpp"
#include "core/rt/guard/loop_guard.hpp"
#include "fci/client/model_check.hpp"
#include "fci/client/testing/fake_arm.hpp"
#include "fci/model/model_library.hpp"
#include "scene/build.hpp"

namespace multipanda::fci::fci_backend_test {
namespace {

using testing::HasSubstr;

Scene two_arms() {
  Scene scene;
  scene.name = "two fake arms";
  for (int i = 0; i < 2; ++i) {
    SceneArm arm;
    arm.name = i == 0 ? "left" : "right";
    arm.model = i == 0 ? "fr3" : "fer";
    arm.hand = i == 0;
    arm.X_WB = {rotation_from_rpy({0.1, -0.2, 0.7 * i}), Vector3(0.3, 1.0 - 2.0 * i, 0.4)};
    const auto model = build_arm_model(arm);
    arm.q_start = model->q_home();
    arm.safety = SafetyLimits::of(*model);
    arm.safety.max_state_age_s = 60;  // packets arrive when the test sends them, except in one test
    scene.arms.push_back(arm);
  }
  scene.arms[0].load_declared = {.mass = 0.4, .p_FC = {0, 0, 0.1}};
  scene.arms[1].X_EK.position = {0, 0, 0.05};
  scene.controllets = {{.name = "left_joints", .type = "joint_impedance", .arms = {0}},
                       {.name = "right_joints", .type = "joint_impedance", .arms = {1}},
                       {.name = "both", .type = "dual_cartesian_impedance", .arms = {0, 1}}};
  return scene;
}

void until(const auto& condition) {
  const HostTime since = host_now();
  while (!condition() && seconds(host_now() - since) < 20) std::this_thread::yield();
}

bool was_asked(const FakeArm& arm, Command command) {
  const auto all = arm.asked();
  return std::ranges::any_of(all, [=](const auto& a) { return a.command == command; });
}

class Backends : public testing::Test {
 protected:
  Backends() {
    for (std::size_t i = 0; i < 2; ++i) {
      const auto& q = scene_.arms[i].q_start;
      fakes_[i]->change([&](RobotState& s) { Eigen::Map<Eigen::Matrix<double, 7, 1>>(s.q.data()) = q; });
    }
    const Load hand = config(0).hand_declared.value();
    fakes_[0]->change([&](RobotState& s) {
      s.m_ee = hand.mass;
      Eigen::Map<Vector3>(s.F_x_Cee.data()) = hand.p_FC;
      Eigen::Map<Matrix3>(s.I_ee.data()) = hand.inertia_C;
    });
  }

  FciArmConfig config(std::size_t i) {
    FciArmConfig result = fci_arm_config(scene_.arms[i], fakes_[i]->address());
    result.port = fakes_[i]->port();
    result.end_effector = {};
    return result;
  }
  // Connected, in torque control; the test sends the packets from now on.
  void begin(FciOptions options = {}, std::vector<FciArmConfig> configs = {}) {
    options.model_check = ModelCheck::off;
    options.state_timeout_s = options.lost_after_s = 20;  // the whole machine may stand still for seconds
    options.report = [this](const std::string& text) {
      said_ += text + "\n";
      if (stands_still_ && text.find("requests of this run") != std::string::npos)
        std::this_thread::sleep_for(GapWatch::kLongest + std::chrono::milliseconds(200));
    };
    if (configs.empty()) configs = {config(0), config(1)};
    backend_ = std::make_unique<FciBackend>(std::move(configs), options);
    cycle_ = std::make_unique<ControlCycle>(build_cycle_config(scene_), registry_, *backend_);
    cycle_->modes().activate_at_start(active_);
    backend_->start();
    for (auto& fake : fakes_) fake->set_automatic(false);
    for (auto& fake : fakes_) fake->publish();
    cycle_->step(backend_->wait());
    for (auto& fake : fakes_) (void)fake->commands_waiting();
  }
  void activate(const char* name) {
    ControlCycle plan(build_cycle_config(scene_), registry_,
                      *std::make_unique<FciBackend>(std::vector{config(0), config(1)}));
    active_ = bit(plan.modes().find(name));
  }
  // Runs the backend with the packets that have arrived.
  ArmSet step() {
    const ArmSet due = backend_->wait();
    cycle_->step(due);
    return due;
  }
  // Steps until the answer arrives.
  RequestAnswer answer(std::future<RequestAnswer> future) {
    while (future.wait_for(std::chrono::seconds(0)) != std::future_status::ready) step();
    return future.get();
  }
  bool is_held(ArmIndex arm) const { return cycle_->modes().owner(arm) == arm; }

  Scene scene_ = two_arms();
  Registry registry_ = Registry::with_builtins();
  std::array<std::unique_ptr<FakeArm>, 2> fakes_{std::make_unique<FakeArm>(10, "127.0.0.1"),
                                                 std::make_unique<FakeArm>(5, "127.0.0.2")};
  std::string said_;
  std::atomic<bool> stands_still_ = false;
  InstanceSet active_ = 0;
  std::unique_ptr<FciBackend> backend_;
  std::unique_ptr<ControlCycle> cycle_;
};

TEST_F(Backends, StartConfiguresEachArmFromTheSceneAndBeginsTorqueControl) {
  FciArmConfig left = config(0), right = config(1);
  right.joint_stiffness = JointVector::Constant(7, 1234);
  right.thresholds =
      SetCollisionThresholds{.nominal = {JointVector::Constant(7, 10), JointVector::Constant(7, 20),
                                         Vector6::Constant(30), Vector6::Constant(40)},
                             .acceleration = {}};
  begin({}, {left, right});
  EXPECT_EQ(backend_->identity(0).version, 10);
  EXPECT_EQ(backend_->identity(1).version, 5);
  EXPECT_EQ(fakes_[0]->last<SetLoadRequest>().m_load, 0.4);
  EXPECT_EQ(fakes_[1]->last<SetEEToKRequest>().EE_T_K[14], 0.05);
  EXPECT_EQ(fakes_[1]->last<SetJointImpedanceRequest>().K_theta[3], 1234);
  EXPECT_EQ(fakes_[1]->last<SetCollisionBehaviorRequest>().upper_force_thresholds_acceleration[5], 40);
  EXPECT_EQ(fakes_[0]->last<MoveRequest>().generator, MoveGenerator::none);
  EXPECT_EQ(fakes_[1]->last<MoveRequest>().generator, MoveGenerator::joint_velocity);
  EXPECT_EQ(said_, "") << "nothing to complain about";

  const auto& states = cycle_->data().state;
  for (ArmIndex i = 0; i < 2; ++i) {
    EXPECT_EQ(states[i].mode, ArmMode::move);
    EXPECT_LT((states[i].q - scene_.arms[i].q_start).norm(), 1e-6);
    EXPECT_TRUE(states[i].has_wrench_estimate);
    EXPECT_EQ(states[i].tool.mass, 0) << "the hand is in the model already";
  }
  EXPECT_NEAR(states[0].load.mass, 0.4, 1e-6);
  const Pose X_FE = arm_config(scene_.arms[0]).frames.X_FE;
  EXPECT_LT(pose_error(states[0].frames.X_FE, X_FE).norm(), 1e-6);
  EXPECT_FALSE(backend_->ended());
  backend_->finish();
  EXPECT_TRUE(backend_->ended());
}

// What came while the program was set up, or stood still, is not acted on: a full socket buffer keeps the
// oldest states. The first cycle begins at a state of now, answers that one, and no arm counts as one that
// was silent.
TEST_F(Backends, TheFirstCycleBeginsAtTheNewestStates) {
  activate("both");
  FciOptions options;
  options.model_check = ModelCheck::off;
  options.first_states_s = options.state_timeout_s = options.lost_after_s = 20;
  backend_ = std::make_unique<FciBackend>(std::vector{config(0), config(1)}, options);
  cycle_ = std::make_unique<ControlCycle>(build_cycle_config(scene_), registry_, *backend_);
  cycle_->modes().activate_at_start(active_);
  backend_->start();
  constexpr int kQueued = 400;  // more than the buffer holds
  std::array<std::uint64_t, 2> newest{};
  for (std::size_t i = 0; i < 2; ++i) {
    fakes_[i]->set_automatic(false);
    for (int k = 0; k < kQueued; ++k) {
      fakes_[i]->change([](RobotState& s) { s.q[2] += 1e-5; });
      newest[i] = fakes_[i]->publish();
    }
    (void)fakes_[i]->commands_waiting();
  }
  for (auto& fake : fakes_) fake->set_automatic(true);
  ArmSet seen;
  for (int k = 0; k < 20 && seen != ArmSet::all(2); ++k) {
    const ArmSet due = step();
    for (std::size_t i = 0; i < 2; ++i) {
      if (!due.contains(i) || seen.contains(i)) continue;
      EXPECT_NEAR(cycle_->data().state[i].q[2], scene_.arms[i].q_start[2] + 1e-5 * kQueued, 1e-9);
      const auto command = fakes_[i]->command();
      ASSERT_TRUE(command);
      EXPECT_GE(command->message_id, newest[i]);
    }
    seen |= due;
  }
  EXPECT_EQ(seen, ArmSet::all(2));
  for (std::size_t i = 0; i < 2; ++i) EXPECT_EQ(cycle_->safety().counted(i, Intervention::state_old), 0u);
}

TEST_F(Backends, AnArmIsDueWithItsPacketAndAnsweredInThatStep) {
  begin();
  for (int k = 0; k < 20; ++k) {
    const ArmIndex arm = static_cast<ArmIndex>(k % 3 == 0 ? 1 : 0);
    const std::uint64_t id = fakes_[arm]->publish();
    EXPECT_EQ(step(), ArmSet::of(arm));
    const auto command = fakes_[arm]->command();
    ASSERT_TRUE(command);
    EXPECT_EQ(command->message_id, id);
    EXPECT_EQ(fakes_[1 - arm]->commands_waiting(), 0u);
  }
  EXPECT_GT(backend_->connection(0)->answer_delay_mean_s, 0);
  RecordProperty("answer_delay_mean_us",
                 static_cast<int>(1e6 * backend_->connection(0)->answer_delay_mean_s));
}

// Packets less than half a period apart: the group computes with its first arm's packet, the other gets that
// tick's torque with its own packet. If the machine took longer, it ticks again.
TEST_F(Backends, AGroupTicksOncePerPeriodAndServesEachArmWithItsOwnPacket) {
  activate("both");
  begin();
  ASSERT_FALSE(is_held(0));
  for (int k = 0; k < 10; ++k) {
    // A wide swing of the second arm's q would change a torque that is computed again.
    fakes_[1]->change([k](RobotState& s) { s.q[1] += 1e-4 * (k % 2 == 0 ? 1 : -1); });
    fakes_[0]->publish();
    ASSERT_EQ(step(), ArmSet::of(0));
    const JointVector of_tick = cycle_->data().tau_controllet[1];
    const LoopTime ticked = cycle_->data().tick.t;
    fakes_[1]->publish();
    ASSERT_EQ(step(), ArmSet::of(1));
    if (seconds(cycle_->data().tick.t - ticked) > 0.0005) continue;
    ASSERT_EQ(cycle_->data().tau_controllet[1], of_tick) << "no second tick in this period";
    const auto command = fakes_[1]->command();
    ASSERT_TRUE(command);
    if (k > 5) {  // the rate limit of the start no longer acts
      for (std::size_t j = 0; j < 7; ++j) {
        EXPECT_NEAR(command->tau_J_d[j], of_tick[static_cast<Eigen::Index>(j)], 1e-9);
      }
    }
  }
}

TEST_F(Backends, AMemberThatFallsSilentSendsItsGroupToHold) {
  for (auto& arm : scene_.arms) arm.safety.max_state_age_s = 0.002;
  activate("both");
  begin();
  int steps = 0;
  while (!is_held(0)) {
    fakes_[0]->publish();
    step();
    ASSERT_LT(++steps, 100000);
  }
  EXPECT_TRUE(is_held(1));
  EXPECT_GT(cycle_->data().state[1].age_s, 0.002);
  fakes_[0]->publish();
  (void)fakes_[0]->commands_waiting();
  step();
  EXPECT_TRUE(fakes_[0]->command()) << "the arm that is there is held by torques";
}

TEST_F(Backends, SilentArmsGiveAnEmptyStepAndNotTheEnd) {
  begin();
  EXPECT_TRUE(step().empty());
  EXPECT_FALSE(backend_->ended());
  const HostTime deadline = host_now() + std::chrono::milliseconds(3);
  EXPECT_TRUE(backend_->wait_until(deadline).empty());
  EXPECT_GE(host_now(), deadline);
  EXPECT_GE(cycle_->data().state[0].age_s, 0.02);
}

TEST_F(Backends, AReflexStopsItsArmOnlyAndRecoveryLeadsToHoldAtTheCurrentPosition) {
  activate("left_joints");
  active_ |= bit(3);  // right_joints: after two holds and left_joints
  begin();
  ASSERT_FALSE(is_held(0) || is_held(1));
  fakes_[0]->end_motion(Status::reflex_aborted, RobotMode::reflex, 6);
  fakes_[1]->publish();
  while (cycle_->data().state[0].mode != ArmMode::reflex) step();
  EXPECT_EQ(cycle_->data().state[0].errors, std::uint64_t{1} << 6);
  EXPECT_TRUE(is_held(0));
  EXPECT_FALSE(is_held(1));
  (void)fakes_[0]->commands_waiting();
  fakes_[0]->publish();
  step();
  EXPECT_EQ(fakes_[0]->commands_waiting(), 0u) << "nothing is sent to an arm in reflex";

  // Meanwhile a person moves it by hand.
  fakes_[0]->change([](RobotState& s) { s.q[0] += 0.5; });
  for (auto& fake : fakes_) fake->set_automatic(true);
  const RequestAnswer recovered = answer(backend_->request(0, RecoverFromError{}));
  EXPECT_TRUE(recovered.success) << recovered.reason;
  while (cycle_->data().state[0].mode != ArmMode::move) step();
  EXPECT_TRUE(is_held(0)) << "not back into what ran before";
  for (int k = 0; k < 20; ++k) step();
  EXPECT_LT(cycle_->data().tau_controllet[0].norm(), 0.1) << "held where it was moved to";
  EXPECT_THAT(said_, HasSubstr("joint_reflex"));
  EXPECT_THAT(said_, HasSubstr("ctl recover left"));

  const RequestAnswer again = answer(backend_->request(0, RecoverFromError{}));
  EXPECT_FALSE(again.success);
  EXPECT_THAT(again.reason, HasSubstr("nothing to recover"));
}

TEST_F(Backends, ALostConnectionIsReportedAndRestoredOnRequest) {
  active_ = bit(2) | bit(3);
  begin();
  fakes_[0]->hang_up();
  while (cycle_->data().state[0].mode != ArmMode::disconnected) {
    fakes_[1]->publish();
    step();
  }
  fakes_[1]->publish();
  EXPECT_EQ(step(), ArmSet::of(1));
  EXPECT_TRUE(is_held(0));
  const RequestAnswer recover = answer(backend_->request(0, RecoverFromError{}));
  EXPECT_FALSE(recover.success);
  EXPECT_THAT(recover.reason, HasSubstr("ctl reconnect left"));
  EXPECT_FALSE(backend_->ended());

  for (auto& fake : fakes_) fake->set_automatic(true);
  const RequestAnswer back = answer(backend_->request(0, Reconnect{}));
  EXPECT_TRUE(back.success) << back.reason;
  while (cycle_->data().state[0].mode != ArmMode::move) step();
  EXPECT_TRUE(is_held(0));
  EXPECT_EQ(fakes_[0]->last<SetLoadRequest>().m_load, 0.4) << "told again";
  EXPECT_FALSE(answer(backend_->request(0, Reconnect{})).success);
}

// An arm that was switched off has forgotten what the run has set: it would stop later than its user has
// asked for. What it carries now, only a person knows.
TEST_F(Backends, AReconnectedArmGetsWhatTheRunHasChanged) {
  FciArmConfig left = config(0);
  left.thresholds =
      SetCollisionThresholds{.nominal = {JointVector::Constant(7, 10), JointVector::Constant(7, 40),
                                         Vector6::Constant(10), Vector6::Constant(80)},
                             .acceleration = {}};
  begin({}, {left, config(1)});
  for (auto& fake : fakes_) fake->set_automatic(true);
  SetLoad load{.load = config(0).load};
  load.load.mass = 1.2;
  SetCollisionThresholds lower = *left.thresholds;
  lower.nominal.wrench_upper.setConstant(25);
  for (const ArmRequest& request : {ArmRequest(load), ArmRequest(lower)}) {
    const RequestAnswer set = answer(backend_->request(0, request));
    ASSERT_TRUE(set.success) << set.reason;
  }
  const auto begins = [&] {
    while (cycle_->data().state[0].mode != ArmMode::move) step();
  };
  const auto reconnect = [&](double m_load) {
    fakes_[0]->hang_up();
    while (cycle_->data().state[0].mode != ArmMode::disconnected) step();
    fakes_[0]->change([=](RobotState& s) { s.m_load = m_load; });
    return answer(backend_->request(0, Reconnect{}));
  };
  const RequestAnswer back = reconnect(1.2);  // the cable was loose
  ASSERT_TRUE(back.success) << back.reason;
  begins();
  EXPECT_EQ(fakes_[0]->last<SetLoadRequest>().m_load, 1.2);
  EXPECT_EQ(fakes_[0]->last<SetCollisionBehaviorRequest>().upper_force_thresholds_nominal[2], 25);
  EXPECT_NEAR(cycle_->data().state[0].load.mass, 1.2, 1e-6) << "the controllers' model has it, too";
  EXPECT_THAT(said_, HasSubstr("load, collision thresholds"));
  EXPECT_THAT(said_, HasSubstr("1200 g"));

  const RequestAnswer switched_off = reconnect(0);
  EXPECT_FALSE(switched_off.success);
  EXPECT_THAT(switched_off.reason, HasSubstr("1200 g, and the arm has one of 0 g now"));
  for (int k = 0; k < 20; ++k) step();
  EXPECT_NE(cycle_->data().state[0].mode, ArmMode::move) << "nothing starts with an unknown load";
  EXPECT_NEAR(cycle_->data().state[0].load.mass, 0, 1e-6);
  EXPECT_EQ(fakes_[0]->last<SetCollisionBehaviorRequest>().upper_force_thresholds_nominal[2], 25);
  for (int k = 0; k < 2; ++k) {
    const RequestAnswer too_early = answer(backend_->request(0, RecoverFromError{}));
    EXPECT_FALSE(too_early.success);
    EXPECT_THAT(too_early.reason, HasSubstr("set the load that it carries"));
  }
  load.load.mass = 0.3;
  ASSERT_TRUE(answer(backend_->request(0, load)).success);
  ASSERT_TRUE(answer(backend_->request(0, RecoverFromError{})).success);
  begins();
  EXPECT_NEAR(cycle_->data().state[0].load.mass, 0.3, 1e-6);
}

// Also where the arms hold themselves until somebody drives them, as in ros2_control.
TEST_F(Backends, AnArmWithAnUnknownLoadIsNotDriven) {
  FciOptions options;
  options.begin_torque = false;
  begin(options);
  for (auto& fake : fakes_) fake->set_automatic(true);
  SetLoad load{.load = config(0).load};
  load.load.mass = 1.2;
  ASSERT_TRUE(answer(backend_->request(0, load)).success);
  fakes_[0]->hang_up();
  while (cycle_->data().state[0].mode != ArmMode::disconnected) step();
  fakes_[0]->change([](RobotState& s) { s.m_load = 0; });
  const RequestAnswer back = answer(backend_->request(0, Reconnect{}));
  EXPECT_TRUE(back.success) << back.reason;
  EXPECT_THAT(said_, HasSubstr("set the load that it carries"));
  const auto moves_asked = [&] {
    const auto asked = fakes_[0]->asked();
    return std::count_if(asked.begin(), asked.end(),
                         [](const auto& a) { return a.command == Command::move; });
  };
  const auto before = moves_asked();
  said_.clear();
  backend_->request_motion(0, ArmMotion::torque);
  while (said_.find("set the load") == std::string::npos) step();
  EXPECT_EQ(moves_asked(), before);
  load.load.mass = 0.3;
  ASSERT_TRUE(answer(backend_->request(0, load)).success);
  ASSERT_TRUE(answer(backend_->request(0, RecoverFromError{})).success);
  while (cycle_->data().state[0].mode != ArmMode::move) step();
  EXPECT_EQ(moves_asked(), before + 1);
}

// A connection without a loop would start a motion that nobody answers.
TEST_F(Backends, AnArmThatTheRunHasLeftIsNotReconnected) {
  begin();
  for (auto& fake : fakes_) fake->set_automatic(true);
  backend_->finish();
  const std::size_t asked = fakes_[0]->asked().size();
  const RequestAnswer back = backend_->request(0, Reconnect{}).get();
  EXPECT_FALSE(back.success);
  EXPECT_THAT(back.reason, HasSubstr("its run has ended"));
  EXPECT_EQ(fakes_[0]->asked().size(), asked);
  backend_->start();  // another run
  EXPECT_EQ(fakes_[0]->last<MoveRequest>().generator, MoveGenerator::none);
  EXPECT_GT(fakes_[0]->asked().size(), asked);
  backend_->finish();
}

// With a patience of 0 s every request waited for too long; the start itself has no patience.
TEST_F(Backends, ARequestThatWaitedForTooLongIsNotExecuted) {
  begin({.request_patience_s = 0});
  const std::size_t asked = fakes_[0]->asked().size();
  for (const ArmRequest& request :
       {ArmRequest(SetLoad{}), ArmRequest(RecoverFromError{}), ArmRequest(Reconnect{})}) {
    const RequestAnswer late = answer(backend_->request(0, request));
    EXPECT_FALSE(late.success);
    EXPECT_THAT(late.reason, HasSubstr("was not executed"));
  }
  EXPECT_EQ(fakes_[0]->asked().size(), asked);
  for (auto& fake : fakes_) fake->set_automatic(true);
  EXPECT_TRUE(answer(backend_->request(0, StopMotion{})).success);  // a stop is never too late
}

// A stop of the motion that comes while the arm recovers, and what was asked before it.
TEST_F(Backends, AStopOvertakesTheRecoveryThatIsOnItsWay) {
  begin();
  fakes_[0]->end_motion(Status::reflex_aborted, RobotMode::reflex, 6);
  while (cycle_->data().state[0].mode != ArmMode::reflex) {
    fakes_[1]->publish();
    step();
  }
  const auto count = [this](Command command) {
    return std::ranges::count(fakes_[0]->asked(), command, &FakeArm::Asked::command);
  };
  const auto motions = count(Command::move);
  auto first = backend_->request(0, RecoverFromError{});  // waits for a state, of which none comes
  while (count(Command::automatic_error_recovery) == 0) std::this_thread::yield();
  auto second = backend_->request(0, RecoverFromError{});
  auto stopped = backend_->request(0, StopMotion{});
  for (auto& fake : fakes_) fake->set_automatic(true);
  for (auto* recovery : {&first, &second}) {
    const RequestAnswer refused = answer(std::move(*recovery));
    EXPECT_FALSE(refused.success);
    EXPECT_THAT(refused.reason, HasSubstr("motion has been stopped since"));
  }
  EXPECT_TRUE(answer(std::move(stopped)).success);
  EXPECT_EQ(count(Command::move), motions) << "no motion began";
  EXPECT_TRUE(answer(backend_->request(0, RecoverFromError{})).success) << "asked after the stop";
}

// The thread of the requests stands still between two of its waits, here where it reports.
TEST_F(Backends, AReconnectionThatStoodStillBeginsNoMotion) {
  begin();
  for (auto& fake : fakes_) fake->set_automatic(true);
  SetLoad load{.load = config(0).load};
  load.load.mass = 1.2;
  ASSERT_TRUE(answer(backend_->request(0, load)).success);
  fakes_[0]->hang_up();
  while (cycle_->data().state[0].mode != ArmMode::disconnected) step();
  fakes_[0]->change([](RobotState& s) { s.m_load = 1.2; });
  std::size_t motions = fakes_[0]->asked().size();
  stands_still_ = true;
  const RequestAnswer refused = answer(backend_->request(0, Reconnect{}));
  EXPECT_FALSE(refused.success);
  EXPECT_THAT(refused.reason, HasSubstr("stalled"));
  const auto asked = fakes_[0]->asked();
  for (; motions < asked.size(); ++motions) EXPECT_NE(asked[motions].command, Command::move);
}

// The program stalls when the motion of a recovery has begun and the arm waits for its first torque: before,
// it got one, by whatever held it afterwards.
TEST_F(Backends, AMotionThatWaitedForItsFirstTorqueDuringAStallIsStopped) {
  begin();
  fakes_[0]->end_motion(Status::reflex_aborted, RobotMode::reflex, 6);
  while (cycle_->data().state[0].mode != ArmMode::reflex) {
    fakes_[1]->publish();
    step();
  }
  for (auto& fake : fakes_) fake->set_automatic(true);
  auto recovered = backend_->request(0, RecoverFromError{});
  while (recovered.wait_for(std::chrono::seconds(0)) != std::future_status::ready) (void)backend_->wait();
  ASSERT_TRUE(recovered.get().success);
  (void)fakes_[0]->commands_waiting();
  std::this_thread::sleep_for(GapWatch::kLongest + std::chrono::milliseconds(200));
  for (int k = 0; k < 5000; ++k) {
    if (step().contains(0) && k > 100 && cycle_->data().state[0].mode != ArmMode::move) break;
  }
  EXPECT_NE(cycle_->data().state[0].mode, ArmMode::move);
  EXPECT_EQ(fakes_[0]->commands_waiting(), 0u);
  const RequestAnswer again = answer(backend_->request(0, RecoverFromError{}));
  EXPECT_TRUE(again.success) << again.reason;
  while (cycle_->data().state[0].mode != ArmMode::move) step();
  EXPECT_THAT(said_, HasSubstr("stalled before the motion's first torque, and the motion was stopped"));

  // A motion that has had its first torque goes on after any time, also if the arm left it shortly.
  std::this_thread::sleep_for(GapWatch::kLongest + std::chrono::milliseconds(200));
  const auto show = [&](RobotMode mode) {
    fakes_[0]->change([&](RobotState& s) { s.robot_mode = static_cast<std::uint8_t>(mode); });
  };
  show(RobotMode::other);
  while (cycle_->data().state[0].mode == ArmMode::move) step();
  show(RobotMode::move);
  for (int k = 0; k < 100; ++k) step();
  (void)answer(backend_->request(0, StopMotion{}));  // after what its thread had to say before
  EXPECT_EQ(said_.find("stalled"), said_.rfind("stalled"));
}

TEST_F(Backends, ALowShareOfReceivedCommandsIsReportedOnce) {
  begin();
  const auto reports = [&] {
    (void)answer(backend_->request(0, StopMotion{}));  // after what its thread had to say before
    const std::string words = "received only 85 % of the last 100 commands";
    int count = 0;
    for (std::size_t at = said_.find(words); at != std::string::npos; at = said_.find(words, at + 1)) ++count;
    return count;
  };
  const auto run = [&](int packets, double share) {
    fakes_[0]->change([share](RobotState& s) { s.control_command_success_rate = share; });
    for (int k = 0; k < packets; ++k) {
      fakes_[0]->publish();
      while (!step().contains(0)) {
      }
    }
  };
  run(100,
      0.5);  // of a motion that has only begun: of two commands, the one before the first cycle is missing
  run(300, 0.85);
  for (auto& fake : fakes_) fake->set_automatic(true);
  EXPECT_EQ(reports(), 1) << said_;
  EXPECT_THAT(said_, Not(HasSubstr("50 %")));
}

TEST_F(Backends, InvalidTorquesAreNotSentAndStopTheMotion) {
  begin();
  const std::uint64_t id = fakes_[0]->publish();
  while (backend_->wait() != ArmSet::of(0)) {
  }
  std::vector<ArmState> states(2);
  backend_->read(ArmSet::of(0), states);
  EXPECT_EQ(states[0].sequence, id);
  std::vector<ArmCommand> commands(2, ArmCommand{joint_constant(7, 0)});
  commands[0].tau_cmd[3] = std::nan("");
  backend_->write(ArmSet::of(0), commands);
  while (states[0].mode == ArmMode::move) {
    (void)backend_->wait();
    fakes_[0]->publish();
    backend_->read(ArmSet::of(0), states);
    commands[0].tau_cmd[3] = 0;
    backend_->write(ArmSet::of(0), commands);
  }
  EXPECT_EQ(states[0].mode, ArmMode::other);
  EXPECT_NO_THROW((void)fakes_[0]->last<StopMoveRequest>());
  EXPECT_EQ(fakes_[0]->commands_waiting(), 0u) << "nor anything after it";
}

// An arm that keeps its own torque: 1 to 19 answers are lost in a row, at full slew. The answers are those
// that the log holds, and none is more than a step of 1 ms from the torque in use.
TEST_F(Backends, LostAnswersAreNoDiscontinuityAndTheLogHoldsWhatWasSent) {
  activate("left_joints");
  begin();
  std::array<double, 7> in_use{};
  const auto period = [&](bool arrives) {
    fakes_[0]->change([&](RobotState& s) { s.tau_J_d = in_use; });
    fakes_[0]->publish();
    ASSERT_EQ(step(), ArmSet::of(0));
    const auto command = fakes_[0]->command();
    ASSERT_TRUE(command);
    for (std::size_t j = 0; j < 7; ++j) {
      EXPECT_EQ(command->tau_J_d[j], cycle_->data().tau_cmd[0][static_cast<Eigen::Index>(j)]);
      if (arrives) {
        ASSERT_LE(std::abs(command->tau_J_d[j] - in_use[j]), 1.0 + 1e-5);
      }
    }
    if (arrives) in_use = command->tau_J_d;
  };
  for (int k = 0; k < 5; ++k) period(true);
  double sign = 1;
  for (int lost = 1; lost <= 19; ++lost) {
    sign = -sign;
    fakes_[0]->change([&](RobotState& s) { s.q[1] += sign * 0.1; });  // pushed: the spring pulls by 60 N m
    for (int k = 0; k < 8; ++k) period(true);
    for (int k = 0; k < lost; ++k) period(false);
    for (int k = 0; k < 8; ++k) period(true);
  }
  EXPECT_FALSE(is_held(0));
  EXPECT_GT(cycle_->safety().counted(0, Intervention::torque_rate_clamped), 100u) << "it was at full slew";
}

// What an arm shows before the first command of a motion is not known: its zero, or the torque of its own
// hold. The first command is a step from what it shows, and from zero, too, if that is possible.
class FirstTorques : public Backends, public testing::WithParamInterface<double> {};
INSTANTIATE_TEST_SUITE_P(Shown, FirstTorques, testing::Values(0.0, 1.5, 12.0));

TEST_P(FirstTorques, CountFromWhatTheArmShows) {
  const double shown = GetParam();
  fakes_[0]->change([&](RobotState& s) { s.tau_J_d.fill(shown); });
  backend_ = std::make_unique<FciBackend>(std::vector{config(0), config(1)},
                                          FciOptions{.model_check = ModelCheck::off});
  backend_->start();
  const auto first = fakes_[0]->command();
  ASSERT_TRUE(first);
  for (const double tau : first->tau_J_d) {
    EXPECT_LE(std::abs(tau - shown), 1 + 1e-5);
    if (shown < 2) {
      EXPECT_LE(std::abs(tau), 1 + 1e-5);
    }
  }
}

// Torques that come from no control cycle are limited here.
TEST_F(Backends, RateLimitAndLowPassCountFromTheTorqueInUse) {
  FciArmConfig limited = config(0), smooth = config(1);
  limited.limit_rate = smooth.limit_rate = true;
  smooth.low_pass_hz = 100;
  begin({}, {limited, smooth});
  std::vector<ArmState> states(2);
  std::vector<ArmCommand> commands(2, ArmCommand{JointVector::Constant(7, 2.0)});
  const double gain = 1e-3 / (1e-3 + 1 / (2 * M_PI * 100));
  double expected = 0;
  for (int k = 1; k <= 3; ++k) {
    for (ArmIndex i = 0; i < 2; ++i) {
      fakes_[i]->publish();
      ASSERT_EQ(backend_->wait(), ArmSet::of(i));
      backend_->read(ArmSet::of(i), states);
      backend_->write(ArmSet::of(i), commands);
      const auto sent = fakes_[i]->command();
      ASSERT_TRUE(sent);
      // begin() has sent one command already; these are counted from its torque.
      if (k == 1) {
        if (i == 1) expected = sent->tau_J_d[0];
      } else if (i == 1) {
        expected += gain * (2.0 - expected);
        EXPECT_NEAR(sent->tau_J_d[0], expected, 1e-12);
      } else if (k == 2) {
        EXPECT_NEAR(sent->tau_J_d[0] - states[0].tau_J_d[0], 0.999999, 1e-6);
      }
      fakes_[i]->change([&](RobotState& s) { s.tau_J_d = sent->tau_J_d; });
    }
  }
}

TEST_F(Backends, SettingsInMotionInterruptTheMotion) {
  active_ = bit(2) | bit(3);
  begin();
  for (auto& fake : fakes_) fake->set_automatic(true);
  const RequestAnswer load = answer(backend_->request(0, SetLoad{{.mass = 0.9}}));
  EXPECT_TRUE(load.success) << load.reason;
  EXPECT_EQ(fakes_[0]->last<SetLoadRequest>().m_load, 0.9);
  EXPECT_FALSE(is_held(1));
  const RequestAnswer nonsense = answer(backend_->request(0, SetLoad{{.mass = -1}}));
  EXPECT_FALSE(nonsense.success);
  EXPECT_FALSE(answer(backend_->request(PlaceObject{})).success);
  EXPECT_FALSE(answer(backend_->request(0, GripperHoming{})).success);
  EXPECT_FALSE(answer(backend_->request(7, StopMotion{})).success);
  EXPECT_TRUE(answer(backend_->request(0, StopMotion{})).success);
  while (cycle_->data().state[0].mode != ArmMode::other) step();
  EXPECT_TRUE(is_held(0));
  EXPECT_TRUE(answer(backend_->request(0, RecoverFromError{})).success) << "a stopped arm is brought back";
}

TEST_F(Backends, AnUnavailableArmIsNamedAndTheOthersAreReleased) {
  FciArmConfig left = config(0), right = config(1);
  fakes_[1]->answer(Command::set_ee_to_k, Status::invalid_argument);
  FciBackend backend({left, right}, {.model_check = ModelCheck::off});
  try {
    backend.start();
    FAIL();
  } catch (const std::runtime_error& error) {
    EXPECT_THAT(error.what(), HasSubstr("arm right"));
    EXPECT_THAT(error.what(), testing::Not(HasSubstr("arm left")));
  }
  EXPECT_TRUE(backend.wait().empty());
  EXPECT_TRUE(backend.ended());
  for (const auto& asked : fakes_[0]->asked()) EXPECT_NE(asked.command, Command::move);
  EXPECT_THROW(FciBackend({}), std::invalid_argument);
  left.model = nullptr;
  EXPECT_THROW(FciBackend({left}), std::invalid_argument);
}

void put_in_reflex(FakeArm& fake) {
  fake.change([](RobotState& s) {
    s.robot_mode = static_cast<std::uint8_t>(RobotMode::reflex);
    s.errors[7] = 1;
  });
}

// It may have stopped on a person.
TEST_F(Backends, AnArmFoundInAReflexStaysSoUntilItIsRecoveredOnRequest) {
  put_in_reflex(*fakes_[0]);
  begin();
  EXPECT_EQ(cycle_->data().state[0].mode, ArmMode::reflex);
  EXPECT_EQ(cycle_->data().state[1].mode, ArmMode::move) << "the other arm runs";
  EXPECT_THAT(said_, HasSubstr("cartesian_reflex"));
  EXPECT_THAT(said_, HasSubstr("ctl recover left"));
  for (const auto& asked : fakes_[0]->asked()) {
    EXPECT_NE(asked.command, Command::automatic_error_recovery);
    EXPECT_NE(asked.command, Command::move);
    EXPECT_NE(asked.command, Command::set_load);
  }
  for (auto& fake : fakes_) fake->set_automatic(true);
  const RequestAnswer recovered = answer(backend_->request(0, RecoverFromError{}));
  EXPECT_TRUE(recovered.success) << recovered.reason;
  while (cycle_->data().state[0].mode != ArmMode::move) step();
  EXPECT_EQ(fakes_[0]->last<SetLoadRequest>().m_load, 0.4) << "set up now";
  EXPECT_NO_THROW((void)fakes_[0]->last<SetCollisionBehaviorRequest>());

  // The same after a lost connection.
  fakes_[0]->hang_up();
  while (cycle_->data().state[0].mode != ArmMode::disconnected) step();
  put_in_reflex(*fakes_[0]);
  const RequestAnswer back = answer(backend_->request(0, Reconnect{}));
  EXPECT_FALSE(back.success);
  EXPECT_THAT(back.reason, HasSubstr("ctl recover left"));
  while (cycle_->data().state[0].mode != ArmMode::reflex) step();
  const RequestAnswer again = answer(backend_->request(0, RecoverFromError{}));
  EXPECT_TRUE(again.success) << again.reason;
  while (cycle_->data().state[0].mode != ArmMode::move) step();
}

// A request for one frame leaves the other as this run has set it, whatever an earlier program left.
TEST_F(Backends, AFrameSetInAReflexDoesNotAdoptAnotherProgramsOther) {
  put_in_reflex(*fakes_[0]);
  fakes_[0]->change([](RobotState& s) { s.F_T_EE[14] = s.NE_T_EE[14] = 0.9; });
  begin();
  for (auto& fake : fakes_) fake->set_automatic(true);
  (void)answer(
      backend_->request(0, SetFrames{.X_FE = {}, .X_EK = Pose{Matrix3::Identity(), Vector3(0, 0, 0.02)}}));
  const RequestAnswer recovered = answer(backend_->request(0, RecoverFromError{}));
  ASSERT_TRUE(recovered.success) << recovered.reason;
  while (cycle_->data().state[0].mode != ArmMode::move) step();
  EXPECT_NEAR(cycle_->data().state[0].frames.X_FE.position.z(), config(0).frames.X_FE.position.z(), 1e-6);
}

TEST_F(Backends, AnEarlierErrorIsRecoveredAtTheStartIfTheSceneAsksAndAUserStopIsNot) {
  put_in_reflex(*fakes_[0]);
  FciArmConfig left = config(0);
  left.recover_at_start = true;
  begin({}, {left, config(1)});
  EXPECT_EQ(cycle_->data().state[0].mode, ArmMode::move);
  EXPECT_THAT(said_, HasSubstr("cartesian_reflex"));
  backend_->finish();
  for (auto& fake : fakes_) fake->set_automatic(true);
  for (const auto& [mode, cure] :
       {std::pair{RobotMode::user_stopped, "release the stop button"},
        std::pair{RobotMode::guiding, "guiding buttons"}, std::pair{RobotMode::other, "unlocked"}}) {
    fakes_[1]->change([m = mode](RobotState& s) { s.robot_mode = static_cast<std::uint8_t>(m); });
    try {
      backend_->start();
      FAIL();
    } catch (const std::runtime_error& error) {
      EXPECT_THAT(error.what(), HasSubstr(cure));
      EXPECT_THAT(error.what(), HasSubstr("arm right"));
    }
  }
}

TEST_F(Backends, AnUndeclaredEndEffectorIsReported) {
  fakes_[0]->change([](RobotState& s) { s.m_ee = 0; });
  begin();
  EXPECT_THAT(said_, HasSubstr("end effector of 0 g"));
  // The controllers' model matches what the arm compensates: the model's hand is subtracted.
  EXPECT_NEAR(cycle_->data().state[0].tool.mass, -config(0).hand_declared->mass, 1e-6);
}

// 0.73 kg at [-0.01, 0, 0.03] m are the manufacturer's figures for its hand, whose parts weigh 0.7126 kg.
TEST_F(Backends, TheHandByEitherFiguresIsNothingToReport) {
  for (const Load& hand : {config(0).hand, Load{.mass = 0.73, .p_FC = {-0.01, 0, 0.03}}}) {
    said_.clear();
    fakes_[0]->change([&](RobotState& s) {
      s.m_ee = hand.mass;
      Eigen::Map<Vector3>(s.F_x_Cee.data()) = hand.p_FC;
    });
    begin();
    EXPECT_EQ(said_, "");
    EXPECT_LT(std::abs(cycle_->data().state[0].tool.mass), 0.02);
    backend_->finish();
    for (auto& fake : fakes_) fake->set_automatic(true);
  }
  // 100 g more weigh 0.84 N m on the shoulder of an outstretched arm.
  fakes_[0]->change([&](RobotState& s) { s.m_ee = 0.83; });
  begin();
  EXPECT_THAT(said_, HasSubstr("end effector of 830 g"));
  EXPECT_THAT(said_, HasSubstr(" N m at a joint"));
}

TEST_F(Backends, ArmsGetCarefulThresholdsUnlessTheSceneNamesOthersOrKeepsThem) {
  scene_.arms[1].fci = FciConnection{};
  scene_.arms[1].fci->keep_collision_thresholds = true;
  begin();
  const auto set = fakes_[0]->last<SetCollisionBehaviorRequest>();
  const std::array<double, 6> stops{80, 80, 80, 25, 25, 25}, reports{20, 20, 20, 10, 10, 10};
  const std::array<double, 7> joint_stops{40, 40, 40, 40, 12, 12, 12},
      joint_reports{20, 20, 20, 20, 12, 12, 12};
  EXPECT_EQ(set.upper_force_thresholds_nominal, stops);
  EXPECT_EQ(set.upper_force_thresholds_acceleration, stops);
  EXPECT_EQ(set.lower_force_thresholds_nominal, reports);
  EXPECT_EQ(set.lower_force_thresholds_acceleration, reports);
  EXPECT_EQ(set.upper_torque_thresholds_nominal, joint_stops);
  EXPECT_EQ(set.upper_torque_thresholds_acceleration, joint_stops);
  EXPECT_EQ(set.lower_torque_thresholds_nominal, joint_reports);
  EXPECT_EQ(set.lower_torque_thresholds_acceleration, joint_reports);
  EXPECT_THROW((void)fakes_[1]->last<SetCollisionBehaviorRequest>(), std::runtime_error);
  // Named ones.
  scene_.arms[1].collision = default_settings(*build_arm_model(scene_.arms[1])).thresholds;
  EXPECT_EQ(config(1).thresholds->nominal.wrench_upper, Vector6::Constant(100));
}

// Arms round the entries of rotations: their 45 degrees are 0.7071, not 0.70710678.
TEST_F(Backends, FramesThatTheArmRoundsAreTheOnesThatWereSent) {
  const auto rounded = [](const Pose& X) {
    std::array<double, 16> T{};
    for (Eigen::Index k = 0; k < 9; ++k) {
      T[static_cast<std::size_t>(4 * (k / 3) + k % 3)] = std::round(1e4 * X.rotation(k % 3, k / 3)) * 1e-4;
    }
    for (Eigen::Index k = 0; k < 3; ++k) T[static_cast<std::size_t>(12 + k)] = X.position[k];
    T[15] = 1;
    return T;
  };
  const Pose X_FE = arm_config(scene_.arms[0]).frames.X_FE;
  fakes_[0]->change([&](RobotState& s) { s.F_T_NE = rounded(X_FE); });
  begin();
  EXPECT_EQ(cycle_->data().state[0].mode, ArmMode::move) << said_;
  const auto sent = fakes_[0]->last<SetNEToEERequest>().NE_T_EE;
  const std::array<double, 16> identity{1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1};
  for (std::size_t k = 0; k < 16; ++k) EXPECT_NEAR(sent[k], identity[k], 1e-8) << "of single precision only";
  EXPECT_LT(pose_error(cycle_->data().state[0].frames.X_FE, X_FE).norm(), 1e-6);
}

TEST_F(Backends, ARefusedSettingLeavesTheArmInTorqueControl) {
  begin();
  for (auto& fake : fakes_) fake->set_automatic(true);
  // Refused in motion, and refused again at rest.
  fakes_[0]->answer(Command::set_joint_impedance, Status::not_possible);
  const RequestAnswer refused =
      answer(backend_->request(0, SetJointStiffness{JointVector::Constant(7, 1000)}));
  EXPECT_FALSE(refused.success);
  EXPECT_NO_THROW((void)fakes_[0]->last<StopMoveRequest>());
  for (int k = 0; k < 1000 && cycle_->data().state[0].mode != ArmMode::move; ++k) step();
  EXPECT_EQ(cycle_->data().state[0].mode, ArmMode::move);
}

// While one arm takes too long to begin, the one that has begun is held, not left to float; then the start is
// given up.
TEST_F(Backends, AnArmThatHasBegunIsHeldUntilTheOthersBeginOrTheStartIsGivenUp) {
  fakes_[0]->change([](RobotState& s) { s.dq.fill(0.2); });
  fakes_[1]->withhold(Command::move);
  std::thread right([&] {  // released when the left arm is stopped, so that the test need not wait for it
    until([&] { return was_asked(*fakes_[0], Command::stop_move); });
    fakes_[1]->hang_up();
  });
  FciBackend backend({config(0), config(1)}, {.longest_wait_packets = 30, .model_check = ModelCheck::off});
  try {
    backend.start();
    ADD_FAILURE() << "it began without the right arm";
  } catch (const std::runtime_error& error) {
    EXPECT_THAT(error.what(), HasSubstr("arm right did not begin"));
    EXPECT_THAT(error.what(), testing::Not(HasSubstr("arm left")));
  }
  right.join();
  // The arm reports no torque in use, so each answer is at most one step from zero, against the motion.
  const auto answer = fakes_[0]->command();
  ASSERT_TRUE(answer);
  for (std::size_t j = 0; j < 7; ++j) {
    EXPECT_LT(answer->tau_J_d[j], -0.01) << j;
    EXPECT_GE(answer->tau_J_d[j], -1.0) << j;
  }
  EXPECT_GE(fakes_[0]->commands_waiting(), 29u);
}

// An arm that moves is not late, however late the answer to its request: no other arm waits for it.
TEST_F(Backends, AnArmThatMovesIsNotGivenUpWhenItsAnswerComesLate) {
  fakes_[0]->withhold(Command::move);
  std::thread arm([&] {
    until([&] { return was_asked(*fakes_[0], Command::move); });
    fakes_[0]->change([](RobotState& s) {
      s.robot_mode = static_cast<std::uint8_t>(RobotMode::move);
      s.controller_mode = static_cast<std::uint8_t>(ControllerMode::external);
      s.motion_generator_mode = static_cast<std::uint8_t>(MotionGeneratorMode::joint_velocity);
    });
    std::size_t commands = 0;
    until([&] { return (commands += fakes_[0]->commands_waiting()) > 60; });
    fakes_[0]->release(Command::move);
  });
  FciBackend backend({config(0)}, {.longest_wait_packets = 30, .model_check = ModelCheck::off});
  EXPECT_NO_THROW(backend.start());
  arm.join();
}

// One that left its motion before its answer is late like one that never moved: the other is not held for the
// seconds after which the answer is given up.
TEST_F(Backends, AnArmThatStopsBeforeItsAnswerIsGivenUp) {
  fakes_[0]->withhold(Command::move);
  const auto show = [&](RobotMode mode, ControllerMode controller) {
    fakes_[0]->change([=](RobotState& s) {
      s.robot_mode = static_cast<std::uint8_t>(mode);
      s.controller_mode = static_cast<std::uint8_t>(controller);
      s.motion_generator_mode = static_cast<std::uint8_t>(MotionGeneratorMode::joint_velocity);
    });
  };
  std::size_t held = 0;
  std::thread arms([&] {
    until([&] { return was_asked(*fakes_[0], Command::move); });
    show(RobotMode::move, ControllerMode::external);
    until([&] { return fakes_[0]->command(0).has_value(); });
    show(RobotMode::reflex, ControllerMode::other);
    until([&] {
      held += fakes_[1]->commands_waiting();
      return was_asked(*fakes_[1], Command::stop_move);
    });
    fakes_[0]->hang_up();
  });
  FciBackend backend({config(0), config(1)}, {.longest_wait_packets = 30, .model_check = ModelCheck::off});
  try {
    backend.start();
    ADD_FAILURE() << "it began without the left arm";
  } catch (const std::runtime_error& error) {
    EXPECT_THAT(error.what(), HasSubstr("arm left did not begin"));
  }
  arms.join();
  EXPECT_LT(held, 500u);
}

// The program stalls while it starts, as in a suspended computer: a person may have come to it.
TEST_F(Backends, AStartThatStoodStillBeginsNothing) {
  for (const Command stalls_at : {Command::set_load, Command::move}) {
    fakes_[0]->withhold(stalls_at);
    FciBackend backend({config(0)}, {.model_check = ModelCheck::off});
    std::string said;
    std::thread loop([&] {
      try {
        backend.start();
      } catch (const std::runtime_error& error) {
        said = error.what();
      }
    });
    until([&] { return was_asked(*fakes_[0], stalls_at); });
    static std::atomic<bool> stalled;
    stalled = false;
    const auto before = std::signal(SIGUSR1, [](int) {
      const timespec time{.tv_sec = 0, .tv_nsec = 700'000'000};
      (void)::nanosleep(&time, nullptr);
      stalled = true;
    });
    ASSERT_EQ(::pthread_kill(loop.native_handle(), SIGUSR1), 0);
    until([] { return stalled.load(); });
    (void)std::signal(SIGUSR1, before);
    fakes_[0]->release(stalls_at);
    loop.join();
    EXPECT_THAT(said, HasSubstr("stalled"));
    EXPECT_TRUE(backend.ended());
    EXPECT_EQ(was_asked(*fakes_[0], Command::move), stalls_at == Command::move);
    EXPECT_EQ(was_asked(*fakes_[0], Command::stop_move), stalls_at == Command::move);
  }
}

// At the end the arm is held until it has left its motion: the last torque alone would keep pushing it.
TEST_F(Backends, FinishHoldsTheArmUntilItHasLeftItsMotion) {
  begin();
  std::vector<RobotCommand> answers;
  std::thread arms([&] {
    fakes_[1]->end_motion(Status::success, RobotMode::idle);
    fakes_[0]->change([](RobotState& s) { s.dq.fill(0.3); });
    for (int k = 0; k < 16; ++k) {
      fakes_[0]->publish();
      const auto answer = fakes_[0]->command();
      ASSERT_TRUE(answer);
      answers.push_back(*answer);
      fakes_[0]->change([&](RobotState& s) { s.tau_J_d = answer->tau_J_d; });
      if (k == 8) {  // it was stopped, but is away from where it was
        fakes_[0]->change([](RobotState& s) {
          s.dq.fill(0);
          s.q[3] -= 0.2;
        });
      }
    }
    fakes_[0]->end_motion(Status::success, RobotMode::idle);
  });
  backend_->finish();
  arms.join();
  ASSERT_EQ(answers.size(), 16u);
  for (std::size_t k = 1; k < answers.size(); ++k) {
    EXPECT_TRUE(answers[k].torque_command_finished);
    for (std::size_t j = 0; j < 7; ++j) {
      EXPECT_LE(std::abs(answers[k].tau_J_d[j] - answers[k - 1].tau_J_d[j]), 1 + 1e-5);
    }
  }
  for (std::size_t j = 0; j < 7; ++j) EXPECT_LT(answers[8].tau_J_d[j], -0.02) << "damped";
  EXPECT_LT(answers[8].tau_J_d[0], answers[0].tau_J_d[0] - 5);
  EXPECT_GT(answers[15].tau_J_d[3], answers[8].tau_J_d[3] + 5) << "pulled back";
}

TEST_F(Backends, FinishEndsTheMotionsByTheirLastTorque) {
  begin();
  std::thread arms([this] {
    for (auto& fake : fakes_) {
      fake->publish();
      const auto last = fake->command();
      ASSERT_TRUE(last);
      EXPECT_TRUE(last->torque_command_finished || last->motion_generation_finished);
      fake->end_motion(Status::success, RobotMode::idle);
    }
  });
  backend_->finish();
  arms.join();
  for (auto& fake : fakes_) {
    for (const auto& asked : fake->asked()) EXPECT_NE(asked.command, Command::stop_move);
  }
  EXPECT_FALSE(backend_->request(0, RecoverFromError{}).get().success);
}

TEST_F(Backends, TheLoopSideNeitherAllocatesNorLocks) {
  if (!kLoopGuardWorks) GTEST_SKIP() << "sanitizers replace malloc themselves";
  active_ = bit(2) | bit(3);
  begin();
  for (int k = 0; k < 300; ++k) {
    for (auto& fake : fakes_) fake->publish(k % 7 == 0 ? 2 : 0);
    for (int i = 0; i < 2; ++i) {
      LoopGuard::arm();
      const ArmSet due = backend_->wait();
      cycle_->step(due);
      const LoopGuardCounts counts = LoopGuard::disarm();
      ASSERT_EQ(counts.heap_calls, 0u);
      ASSERT_EQ(counts.lock_calls, 0u);
      if (due == ArmSet::all(2)) break;
    }
  }
  EXPECT_GT(backend_->overruns(), 50u) << "what was left out is counted";
}

TEST(ModelCheck, DistinguishesADifferentArmFromTheSameOne) {
  const Scene scene = two_arms();
  const FciArmConfig fr3 = fci_arm_config(scene.arms[0], "127.0.0.1"),
                     fer = fci_arm_config(scene.arms[1], "127.0.0.1");
  const ModelComparison same = compare_models(model_urdf(robot_of(scene.arms[0])), fr3.hand, *fr3.model);
  EXPECT_TRUE(same.same_kinematics() && same.same_dynamics()) << same.text();
  EXPECT_LT(same.position_m, 1e-9);
  EXPECT_LT(same.gravity_nm, 1e-6);
  EXPECT_TRUE(same.limits.empty()) << same.limits;
  // Both arms have the same lengths and different masses.
  const ModelComparison other = compare_models(model_urdf(robot_of(scene.arms[0])), {}, *fer.model);
  EXPECT_TRUE(other.same_kinematics());
  EXPECT_FALSE(other.same_dynamics());
  EXPECT_FALSE(other.limits.empty());
  // Without its hand.
  const ModelComparison bare = compare_models(model_urdf(robot_of(scene.arms[0])), {}, *fr3.model);
  EXPECT_GT(bare.gravity_nm, 1.0);
  // A longer forearm.
  std::string longer = model_urdf(robot_of(scene.arms[1]));
  const auto at = longer.find("0.384");
  ASSERT_NE(at, std::string::npos);
  longer.replace(at, 5, "0.386");
  EXPECT_FALSE(compare_models(longer, {}, *fer.model).same_kinematics());
  EXPECT_THROW((void)compare_models("<robot name='x'/>", {}, *fer.model), std::invalid_argument);
}

// Up to version 7 an arm's model is a library, which a Panda computes with numbers of its own.
TEST(ModelCheck, ComparesWithAnArmsLibrary) {
  const Scene scene = two_arms();
  const FciArmConfig fr3 = fci_arm_config(scene.arms[0], "127.0.0.1"),
                     fer = fci_arm_config(scene.arms[1], "127.0.0.1");
  const auto library = [&](std::size_t arm, LibraryModel model) {
    return model_library(robot_of(scene.arms[arm]), model);
  };
  const std::vector<std::byte> pandas = library(1, LibraryModel::own);
  if (pandas.empty()) GTEST_SKIP() << "the model library is made for x86-64 only";
  const ModelComparison exact = compare_models(library(0, LibraryModel::own), fr3.hand, *fr3.model);
  EXPECT_TRUE(exact.same_kinematics()) << exact.text();
  EXPECT_LT(exact.gravity_nm, 1e-6);
  EXPECT_LT(exact.mass_matrix, 1e-9);
  const ModelComparison panda = compare_models(pandas, fer.hand, *fer.model);
  EXPECT_TRUE(panda.same_kinematics() && panda.same_dynamics()) << panda.text();
  EXPECT_GT(panda.gravity_nm, 0.1);
  EXPECT_LT(panda.gravity_nm, 0.25);
  EXPECT_FALSE(compare_models(pandas, {0.73, {-0.01, 0, 0.03}, Matrix3::Zero()}, *fer.model).same_dynamics())
      << "a hand";
  EXPECT_FALSE(compare_models(pandas, fr3.hand, *fr3.model).same_dynamics()) << "another arm";
  EXPECT_THROW((void)compare_models(std::vector<std::byte>(4096), {}, *fer.model), std::invalid_argument);
}

}  // namespace
}  // namespace multipanda::fci::fci_backend_test
