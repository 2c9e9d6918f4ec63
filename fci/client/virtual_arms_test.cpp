// The backend for real arms on virtual ones in lock-step: the contract of core/cycle/backend.hpp, faults, and
// recovery from them.
#include "fci/server/virtual_arms.hpp"

#include <cmath>
#include <map>
#include <memory>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "backends/mujoco/mujoco_backend.hpp"
#include "core/cycle/control_cycle.hpp"
#include "core/rt/guard/loop_guard.hpp"
#include "fci/client/fci_backend.hpp"
#include "scene/build.hpp"

namespace multipanda::fci::virtual_arms_test {
namespace {

using testing::HasSubstr;

// Two different arms, bases off the origin and rotated, too far apart to touch.
Scene two_arms() {
  Scene scene;
  scene.name = "two virtual arms";
  scene.seed = 7;
  for (int i = 0; i < 2; ++i) {
    SceneArm arm;
    arm.name = i == 0 ? "left" : "right";
    arm.model = i == 0 ? "fer" : "fr3";
    arm.hand = i == 0;
    arm.X_WB = {rotation_from_rpy({0.1, -0.2, 0.7 * i}), Vector3(0.3, 1.0 - 2.0 * i, 0.4)};
    const auto model = build_arm_model(arm);
    arm.q_start = model->q_home();
    arm.safety = SafetyLimits::of(*model);
    scene.arms.push_back(arm);
  }
  scene.controllets = {{.name = "left_joints", .type = "joint_impedance", .arms = {0}},
                       {.name = "right_joints", .type = "joint_impedance", .arms = {1}}};
  return scene;
}
constexpr InstanceSet kLeftJoints = bit(2), kRightJoints = bit(3);  // after the two holds

// Virtual arms and a backend that is connected to them.
struct Rig {
  explicit Rig(int version = 0, WorldPace pace = WorldPace::lockstep)
      : world(std::make_unique<VirtualArms>(scene, options(pace))) {
    world->start();
    std::vector<FciArmConfig> configs;
    for (ArmIndex i = 0; i < 2; ++i) {
      configs.push_back(fci_arm_config(scene.arms[i], world->place(i).address));
      configs[i].port = world->place(i).port;
      configs[i].version = version;
      configs[i].end_effector = {};
    }
    FciOptions fci_options{
        .lockstep = pace == WorldPace::lockstep, .state_timeout_s = 20, .lockstep_wait_s = 20};
    fci_options.report = [this](const std::string& text) { said += text + "\n"; };
    backend = std::make_unique<FciBackend>(configs, fci_options);
  }
  static VirtualArmOptions options(WorldPace pace) {
    VirtualArmOptions result{.pace = pace, .strict = true, .grippers = false, .idle_stands_still = true};
    const ArmPlace any{.address = "127.0.0.1", .port = 0, .versions = VersionRange{}};
    result.places = {any, any};
    return result;
  }
  void start_cycle(InstanceSet active) {
    cycle = std::make_unique<ControlCycle>(build_cycle_config(scene), registry, *backend);
    cycle->modes().activate_at_start(active);
    backend->start();
  }
  ArmSet step() {
    const ArmSet due = backend->wait();
    cycle->step(due);
    return due;
  }
  RequestAnswer answer(std::future<RequestAnswer> future) {
    while (future.wait_for(std::chrono::seconds(0)) != std::future_status::ready) step();
    return future.get();
  }
  const ArmState& state(ArmIndex i) const { return cycle->data().state[i]; }
  bool is_held(ArmIndex i) const { return cycle->modes().owner(i) == i; }

  Scene scene = two_arms();
  Registry registry = Registry::with_builtins();
  std::string said;
  std::unique_ptr<VirtualArms> world;
  std::unique_ptr<FciBackend> backend;
  std::unique_ptr<ControlCycle> cycle;
};

// Smooth torques that accelerate each joint alone by about 1 rad/s^2, reached within the rate limit.
std::vector<ArmCommand> commands_at(const Scene& scene, int cycle) {
  static const std::vector<JointVector> amplitude = [&] {
    std::vector<JointVector> all;
    for (const auto& arm : scene.arms) {
      ModelTerms terms(build_arm_model(arm));
      all.push_back(1.0 * terms.M().diagonal());
    }
    return all;
  }();
  std::vector<ArmCommand> commands(scene.arms.size());
  for (std::size_t i = 0; i < commands.size(); ++i) {
    commands[i].tau_cmd = amplitude[i];
    for (Eigen::Index j = 0; j < amplitude[i].size(); ++j) {
      commands[i].tau_cmd[j] *=
          std::sin(0.02 * cycle + static_cast<double>(j) + 2.0 * static_cast<double>(i)) *
          std::min(1.0, 0.1 * cycle);
    }
  }
  return commands;
}

class Versions : public testing::TestWithParam<int> {};

TEST_P(Versions, KeepTheContractOfEveryBackend) {
  Rig rig(GetParam());
  rig.backend->start();
  std::vector<ArmState> states(2);
  JointVector q_0[2];
  LoopTime before{};
  std::uint64_t sequence = 0;
  for (int k = 0; k < 200; ++k) {
    ASSERT_EQ(rig.backend->wait(), ArmSet::all(2));
    rig.backend->read(ArmSet::all(2), states);
    if (k > 0) {
      ASSERT_EQ((rig.backend->now() - before).count(), 1'000'000);
      ASSERT_EQ(states[0].sequence, sequence + 1);
    } else {
      EXPECT_EQ(rig.backend->now(), LoopTime{});
      for (int i = 0; i < 2; ++i) q_0[i] = states[static_cast<std::size_t>(i)].q;
    }
    before = rig.backend->now();
    sequence = states[0].sequence;
    ASSERT_EQ(states[1].sequence, sequence) << "one world, one clock";
    for (const ArmState& s : states) {
      ASSERT_EQ(s.mode, ArmMode::move) << "period " << k << ", errors " << std::hex << s.errors;
      ASSERT_EQ(s.q.size(), 7);
      ASSERT_TRUE(s.q.allFinite() && s.dq.allFinite() && s.tau_J.allFinite());
      ASSERT_EQ(s.errors, 0u);
    }
    // Zero at first: the arm compensates gravity itself.
    const int since = k - 100;
    if (since == 0) {
      for (ArmIndex i = 0; i < 2; ++i) EXPECT_LT((states[i].q - q_0[i]).norm(), 1e-5);
    }
    if (since > 0) {
      for (ArmIndex i = 0; i < 2; ++i) {
        ASSERT_LT((states[i].tau_J_d - commands_at(rig.scene, since - 1)[i].tau_cmd).norm(), 1e-5);
      }
    }
    rig.backend->write(ArmSet::all(2),
                       since < 0 ? std::vector<ArmCommand>{{joint_constant(7, 0)}, {joint_constant(7, 0)}}
                                 : commands_at(rig.scene, since));
  }
  for (ArmIndex i = 0; i < 2; ++i) {
    EXPECT_GT((states[i].q - q_0[i]).norm(), 1e-3) << "it moved";
    EXPECT_EQ(rig.backend->connection(i)->lost, 0u);
    EXPECT_GT(states[i].command_success_rate, 0.99);
  }
  rig.backend->finish();
  EXPECT_TRUE(rig.backend->ended());
  EXPECT_EQ(rig.said, "");
}

INSTANTIATE_TEST_SUITE_P(Protocol, Versions, testing::Values(5, 7, 8, 10));

class EveryVersion : public testing::TestWithParam<int> {};
INSTANTIATE_TEST_SUITE_P(Protocol, EveryVersion, testing::Range<int>(kOldestVersion, kNewestVersion + 1));

// A force on the flange of each arm, so that the moment that the loop sees follows from where K is. (Frames
// that a program has moved: arm_packet_test.cpp, tests/fci/panda_test.py.)
TEST_P(EveryVersion, AForceOnTheFlangeHasItsMomentAboutK) {
  Rig rig(GetParam());
  rig.start_cycle(kLeftJoints | kRightJoints);
  rig.step();
  const std::array<Vector3, 2> push{Vector3(6, -9, 7), Vector3(-8, 5, -10)};
  for (ArmIndex i = 0; i < 2; ++i) rig.world->push(i, push[i], 1);
  for (int k = 0; k < 700; ++k) ASSERT_EQ(rig.step(), ArmSet::all(2)) << rig.said;
  for (ArmIndex i = 0; i < 2; ++i) {
    const ArmState& state = rig.state(i);
    ModelTerms terms(build_arm_model(rig.scene.arms[i]));
    terms.set_config(state.frames, state.tool, state.load);
    terms.update(state.q, state.dq);
    const Vector3 p_WF = terms.X_WE() * state.frames.X_FE.inverse().position;
    const Vector3 moment = (p_WF - terms.X_WK().position).cross(-push[i]);
    EXPECT_GT(moment.norm(), i == 0 ? 0.5 : -1);  // without hand, E and K are at the flange
    EXPECT_LT((state.F_K_W_est.force() + push[i]).norm(), 0.1) << "arm " << i;
    EXPECT_LT((state.F_K_W_est.torque() - moment).norm(), 0.02) << "arm " << i;
  }
  rig.backend->finish();
}

TEST(VirtualRig, TheSameCommandsGiveTheSameStates) {
  Rig rigs[2];
  std::vector<std::array<JointVector, 2>> seen;
  for (auto& rig : rigs) {
    rig.backend->start();
    std::vector<ArmState> states(2);
    std::size_t same = 0;
    for (int k = 0; k < 150; ++k) {
      ASSERT_EQ(rig.backend->wait(), ArmSet::all(2));
      rig.backend->read(ArmSet::all(2), states);
      if (&rig == &rigs[0]) {
        seen.push_back({states[0].q, states[1].q});
      } else {
        same += seen[static_cast<std::size_t>(k)][0] == states[0].q &&
                seen[static_cast<std::size_t>(k)][1] == states[1].q;
      }
      rig.backend->write(ArmSet::all(2), commands_at(rig.scene, k));
    }
    if (&rig != &rigs[0]) {
      EXPECT_EQ(same, 150u) << "to the bit";
    }
    rig.backend->finish();
  }
}

TEST(VirtualRig, ReadTouchesOnlyTheArmsDueAndTheLoopNeitherAllocatesNorLocks) {
  Rig rig;
  rig.start_cycle(kLeftJoints | kRightJoints);
  for (int k = 0; k < 5; ++k) rig.step();
  for (int k = 0; k < 200 && kLoopGuardWorks; ++k) {
    LoopGuard::arm();
    rig.step();
    const LoopGuardCounts counts = LoopGuard::disarm();
    ASSERT_EQ(counts.heap_calls, 0u);
    ASSERT_EQ(counts.lock_calls, 0u);
  }
  std::vector<ArmState> states(2);
  states[0].sequence = states[1].sequence = 12345678;
  ASSERT_EQ(rig.backend->wait(), ArmSet::all(2));
  rig.backend->read(ArmSet::of(1), states);
  EXPECT_EQ(states[0].sequence, 12345678u);
  EXPECT_NE(states[1].sequence, 12345678u);
  EXPECT_FALSE(rig.backend->request(7, StopMotion{}).get().success);
  EXPECT_FALSE(rig.backend->request(0, SetLoad{{.mass = -1}}).get().success);
  rig.backend->finish();
}

TEST(VirtualRig, TheArmsOwnModelIsChecked) {
  Rig rig;
  rig.backend->start();
  for (ArmIndex i = 0; i < 2; ++i) {
    EXPECT_TRUE(rig.backend->identity(i).model_checked);
    EXPECT_EQ(rig.backend->identity(i).version, 10);
    EXPECT_FALSE(rig.backend->capabilities(i).simulated);
    EXPECT_TRUE(rig.backend->capabilities(i).has_external_torque);
  }
  rig.backend->finish();
  // The scene names the other arm model: same lengths, different masses.
  auto wrong = fci_arm_config(rig.scene.arms[1], rig.world->place(0).address);
  wrong.port = rig.world->place(0).port;
  wrong.end_effector = {};
  FciBackend refusing({wrong}, {.lockstep = true, .model_check = ModelCheck::refuse});
  try {
    refusing.start();
    FAIL();
  } catch (const std::runtime_error& error) {
    EXPECT_THAT(error.what(), HasSubstr("masses"));
  }
}

TEST(VirtualRig, AReflexOfOneArmDoesNotAffectTheOtherAndEndsInHold) {
  Rig rig;
  rig.start_cycle(kLeftJoints | kRightJoints);
  for (int k = 0; k < 20; ++k) ASSERT_EQ(rig.step(), ArmSet::all(2));
  ASSERT_TRUE(rig.world->raise(0, ArmError::joint_reflex));
  std::uint64_t last = rig.state(1).sequence;
  for (int k = 0; rig.state(0).mode != ArmMode::reflex; ++k) {
    ASSERT_LT(k, 1000);
    rig.step();
    ASSERT_EQ(rig.state(1).sequence, ++last) << "not one period without the other arm";
    ASSERT_EQ(rig.state(1).mode, ArmMode::move);
  }
  EXPECT_NE(rig.state(0).errors & error_bit(ArmError::joint_reflex), 0u);
  EXPECT_TRUE(rig.is_held(0));
  EXPECT_FALSE(rig.is_held(1));
  const auto recovered = rig.answer(rig.backend->request(0, RecoverFromError{}));
  EXPECT_TRUE(recovered.success) << recovered.reason;
  for (int k = 0; k < 50; ++k) {
    rig.step();
    ASSERT_EQ(rig.state(1).mode, ArmMode::move);
  }
  EXPECT_EQ(rig.state(0).mode, ArmMode::move);
  EXPECT_EQ(rig.state(0).errors, 0u);
  EXPECT_TRUE(rig.is_held(0)) << "until somebody switches";
  EXPECT_FALSE(rig.is_held(1));
  const auto nothing = rig.answer(rig.backend->request(0, RecoverFromError{}));
  EXPECT_FALSE(nothing.success);
  EXPECT_THAT(rig.said, HasSubstr("joint_reflex"));
  rig.backend->finish();
}

TEST(VirtualRig, AnArmThatStillMovesIsRecoveredOnceItIsAtRest) {
  Rig rig;
  rig.start_cycle(kLeftJoints | kRightJoints);
  for (int k = 0; k < 20; ++k) rig.step();
  ASSERT_TRUE(rig.world->push(0, Vector3(0, 60, 0), 0.2));
  double speed = 0;
  for (int k = 0; k < 200 && speed < 0.4; ++k) {
    rig.step();
    speed = rig.state(0).dq.cwiseAbs().maxCoeff();
  }
  ASSERT_GE(speed, 0.4);
  ASSERT_TRUE(rig.world->raise(0, ArmError::joint_reflex));
  while (rig.state(0).mode != ArmMode::reflex) rig.step();
  auto recovered = rig.backend->request(0, RecoverFromError{});
  while (rig.state(0).mode == ArmMode::reflex) rig.step();
  ASSERT_EQ(rig.state(0).mode, ArmMode::recovering);
  EXPECT_GT(rig.state(0).dq.cwiseAbs().maxCoeff(), 0.05);
  const RequestAnswer answer = rig.answer(std::move(recovered));
  EXPECT_TRUE(answer.success) << answer.reason;
  EXPECT_LT(rig.state(0).dq.cwiseAbs().maxCoeff(), 0.03);
  for (int k = 0; k < 50; ++k) rig.step();
  EXPECT_EQ(rig.state(0).mode, ArmMode::move) << rig.said;
  EXPECT_TRUE(rig.is_held(0));
  rig.backend->finish();
}

TEST(VirtualRig, UserStopWaitsForItsRelease) {
  Rig rig;
  rig.start_cycle(kLeftJoints | kRightJoints);
  for (int k = 0; k < 5; ++k) rig.step();
  EXPECT_TRUE(rig.answer(rig.world->request(0, SetUserStop{true})).success);
  while (rig.state(0).mode != ArmMode::user_stopped) rig.step();
  const auto pressed = rig.answer(rig.backend->request(0, RecoverFromError{}));
  EXPECT_FALSE(pressed.success);
  EXPECT_THAT(pressed.reason, HasSubstr("release"));
  EXPECT_TRUE(rig.answer(rig.world->request(0, SetUserStop{false})).success);
  while (rig.state(0).mode == ArmMode::user_stopped) rig.step();
  const auto released = rig.answer(rig.backend->request(0, RecoverFromError{}));
  EXPECT_TRUE(released.success) << released.reason;
  while (rig.state(0).mode != ArmMode::move) rig.step();
  EXPECT_TRUE(rig.is_held(0));
  EXPECT_FALSE(rig.is_held(1));
  rig.backend->finish();
}

TEST(VirtualRig, AConnectionClosedByTheArmIsRestored) {
  Rig rig;
  rig.start_cycle(kLeftJoints | kRightJoints);
  for (int k = 0; k < 5; ++k) rig.step();
  ASSERT_TRUE(rig.world->close_connection(0));
  while (rig.state(0).mode != ArmMode::disconnected) {
    rig.step();
    ASSERT_EQ(rig.state(1).mode, ArmMode::move);
  }
  EXPECT_TRUE(rig.is_held(0));
  EXPECT_FALSE(rig.is_held(1));
  const auto back = rig.answer(rig.backend->request(0, Reconnect{}));
  EXPECT_TRUE(back.success) << back.reason;
  while (rig.state(0).mode != ArmMode::move) rig.step();
  EXPECT_TRUE(rig.is_held(0));
  for (int k = 0; k < 20; ++k) ASSERT_EQ(rig.step(), ArmSet::all(2));
  rig.backend->finish();
}

TEST(VirtualRig, AWorldThatEndsAndRestartsIsFoundAgain) {
  Rig rig;
  rig.start_cycle(kLeftJoints | kRightJoints);
  for (int k = 0; k < 5; ++k) rig.step();
  VirtualArmOptions again = Rig::options(WorldPace::lockstep);
  for (ArmIndex i = 0; i < 2; ++i) again.places[i] = rig.world->place(i);
  rig.world.reset();
  while (rig.state(0).mode != ArmMode::disconnected || rig.state(1).mode != ArmMode::disconnected) rig.step();
  EXPECT_FALSE(rig.backend->ended());
  const auto nobody = rig.answer(rig.backend->request(0, Reconnect{}));
  EXPECT_FALSE(nobody.success);
  EXPECT_THAT(nobody.reason, HasSubstr("refused"));
  rig.world = std::make_unique<VirtualArms>(rig.scene, again);
  rig.world->start();
  auto left = rig.backend->request(0, Reconnect{}), right = rig.backend->request(1, Reconnect{});
  EXPECT_TRUE(rig.answer(std::move(left)).success);
  EXPECT_TRUE(rig.answer(std::move(right)).success);
  while (rig.state(0).mode != ArmMode::move || rig.state(1).mode != ArmMode::move) rig.step();
  for (int k = 0; k < 20; ++k) ASSERT_EQ(rig.step(), ArmSet::all(2));
  EXPECT_TRUE(rig.is_held(0) && rig.is_held(1));
  rig.backend->finish();
}

TEST(VirtualRig, SettingsWhileMovingAreAcceptedAndVisible) {
  Rig rig;
  rig.start_cycle(kRightJoints);
  for (int k = 0; k < 5; ++k) rig.step();
  const std::uint32_t before = rig.state(0).config_version;
  const Pose X_EK{rotation_from_rpy({0.1, 0.2, 0.3}), Vector3(0, 0, 0.05)};
  const auto frames = rig.answer(rig.backend->request(0, SetFrames{{}, X_EK}));
  EXPECT_TRUE(frames.success) << frames.reason;
  const auto load = rig.answer(rig.backend->request(0, SetLoad{{.mass = 0.5, .p_FC = {0, 0, 0.1}}}));
  EXPECT_TRUE(load.success) << load.reason;
  for (int k = 0; k < 10; ++k) rig.step();
  EXPECT_NEAR(rig.state(0).load.mass, 0.5, 1e-6);
  EXPECT_LT(pose_error(rig.state(0).frames.X_EK, X_EK).norm(), 1e-6);
  EXPECT_GT(rig.state(0).config_version, before);
  EXPECT_EQ(rig.state(0).mode, ArmMode::move);
  EXPECT_FALSE(rig.is_held(1));
  rig.backend->finish();
}

TEST(VirtualRig, InRealTimeLostPacketsAreCountedAndTheDelayIsTheComputingTime) {
  Rig rig(0, WorldPace::realtime);
  ASSERT_TRUE(rig.world->set_faults(0, {.loss = 0.1}));
  rig.start_cycle(0);
  for (int k = 0; k < 1000; ++k) rig.step();
  const ConnectionStatistics left = *rig.backend->connection(0), right = *rig.backend->connection(1);
  EXPECT_GT(left.lost, left.received / 50);
  EXPECT_GE(left.lost_in_a_row_max, 1u);
  EXPECT_LT(left.lost, left.received / 3);
  EXPECT_GT(right.sent, 0u);
  std::printf("answer to a packet: mean %.1f us, longest %.1f us; lost %llu of %llu\n",
              1e6 * right.answer_delay_mean_s, 1e6 * right.answer_delay_max_s,
              static_cast<unsigned long long>(left.lost), static_cast<unsigned long long>(left.received));
  rig.backend->finish();
}

}  // namespace
}  // namespace multipanda::fci::virtual_arms_test
