// One virtual arm at its port: what a program sees, request by request and period by period. In lock-step, so
// that every state and every answer is known.
#include <random>
#include <thread>

#include "backends/mujoco/testing/test_scenes.hpp"
#include "fci/server/testing/test_program.hpp"
#include "fci/wire/error_flags.hpp"

namespace multipanda::fci::arm_port_test {
namespace {

using test::TestProgram;

bool is_idle(const RobotState& s) {
  return s.robot_mode == static_cast<std::uint8_t>(RobotMode::idle) && s.motion_generator_mode == 0 &&
         s.controller_mode == static_cast<std::uint8_t>(ControllerMode::other);
}
bool in_mode(const RobotState& s, RobotMode mode) { return s.robot_mode == static_cast<std::uint8_t>(mode); }

class OneArm : public testing::Test {
 protected:
  explicit OneArm(VirtualArmOptions options = {}) : arms_(scene(), with_place(std::move(options))) {
    arms_.start();
  }
  static Scene scene() { return multipanda::test::scene_of({multipanda::test::arm_named("left")}); }
  static VirtualArmOptions with_place(VirtualArmOptions options) {
    options.places = {{.address = test::own_address(0), .port = 0, .gripper_port = 0, .vacuum_port = 0}};
    options.pace = WorldPace::lockstep;
    return options;
  }
  const ArmPlace& place() const { return arms_.place(0); }
  PortStatistics counts() const { return arms_.statistics(0); }

  VirtualArms arms_;
};

TEST_F(OneArm, supportsVersions4To10AndOffersItsOwnToOthers) {
  const std::pair<std::uint16_t, std::size_t> sizes[] = {{4, 2341}, {5, 2373}, {6, 2373}, {7, 2373},
                                                         {8, 2373}, {9, 2373}, {10, 1377}};
  for (const auto& [version, size] : sizes) {
    TestProgram program(place(), version);
    ASSERT_TRUE(program.connected()) << version;
    EXPECT_EQ(program.server_version(), version);
    const RobotState state = program.read();
    EXPECT_EQ(program.size(), size) << version;
    EXPECT_TRUE(is_idle(state)) << version;
    EXPECT_NEAR(state.q[3], -3 * M_PI / 4, 1e-3);
  }
  for (const std::uint16_t version : std::to_array<std::uint16_t>({3, 11, 65535})) {
    TestProgram program(place(), version);
    EXPECT_EQ(program.answer(), Status::incompatible_version) << version;
    EXPECT_EQ(program.server_version(), kNewestVersion);
    EXPECT_TRUE(program.is_closed());
  }
}

TEST_F(OneArm, servesOneProgramAtATime) {
  auto first = std::make_unique<TestProgram>(place());
  ASSERT_TRUE(first->connected());
  EXPECT_FALSE(TestProgram(place()).connected());
  EXPECT_EQ(counts().refused, 1u);
  first->read();
  EXPECT_EQ(first->size(), 1377u);  // undisturbed
  first.reset();
  EXPECT_TRUE(TestProgram(place()).connected());  // at once, without a pause
}

class Versions : public OneArm, public testing::WithParamInterface<std::uint16_t> {};
INSTANTIATE_TEST_SUITE_P(All, Versions, testing::Values(4, 5, 6, 7, 8, 9, 10));

TEST_P(Versions, torqueMotionFromStartToFinish) {
  TestProgram program(place(), GetParam());
  RobotState state = program.begin_torques();
  // All modes change in the same state, and no torque was commanded yet.
  EXPECT_TRUE(in_mode(state, RobotMode::move));
  EXPECT_EQ(state.control_command_success_rate, 0);
  state = program.step_in(state);
  const auto used = counts().commands_used;
  for (int i = 0; i < 50; ++i) {
    const RobotState next = program.exchange(state);
    ASSERT_EQ(next.message_id, state.message_id + 1);  // the world moved by one period, for this answer
    ASSERT_TRUE(in_mode(next, RobotMode::move));
    state = next;
  }
  EXPECT_EQ(state.control_command_success_rate, 1);
  EXPECT_EQ(counts().commands_used, used + 50);
  // The finish is repeated until its effect is visible, as libfranka does.
  for (int i = 0; i < 100 && !is_idle(state); ++i) state = program.exchange(state, true);
  EXPECT_TRUE(is_idle(state));
  EXPECT_EQ(program.reply(program.move()), Status::success);
  // Late repetitions do not affect the next motion.
  program.command(program.torques(state, true));
  state = program.start_torques();
  for (int i = 0; i < 5; ++i) state = program.exchange(state);
  EXPECT_TRUE(in_mode(state, RobotMode::move));
}

// The world follows the wall clock until the first command: the first answer of a busy computer may be to a
// state that is not the last, and the next one follows at once. Its torque rises by 0.9 N m per answer, and
// the arm bears 1 N m.
TEST_P(Versions, anAnswerThatIsReplacedByTheNextOneCounts) {
  for (int repeat = 0; repeat < 3; ++repeat) {
    TestProgram program(place(), GetParam());
    const RobotState first = program.begin_torques();
    RobotState state = program.read();  // the world has gone on
    ASSERT_GT(state.message_id, first.message_id);
    double torque = 0;
    const auto answer = [&](const RobotState& to) {
      RobotCommand command = program.torques(to);
      torque += 0.9;
      command.tau_J_d[3] = torque;
      program.command(command);
    };
    answer(first);
    std::this_thread::sleep_for(std::chrono::milliseconds(3));  // the world stands still for 20 ms
    state = program.read_newest_or(state);
    for (int i = 0; i < 8; ++i) {
      answer(state);
      state = program.read_newest_or(program.read());
      ASSERT_TRUE(in_mode(state, RobotMode::move)) << "repeat " << repeat << ", period " << i;
    }
    EXPECT_NEAR(state.tau_J_d[3], torque, 1e-5);
    RobotCommand jump = program.torques(state);
    jump.tau_J_d[3] = torque + 1.8;
    program.command(jump);
    EXPECT_TRUE(in_mode(program.read(), RobotMode::reflex)) << "two steps in one answer";
    program.hang_up();
    if (repeat == 2) break;
    TestProgram recovers(place(), GetParam());
    EXPECT_EQ(recovers.ask(AutomaticErrorRecoveryRequest{}), Status::success);
    recovers.hang_up();
  }
}

TEST_P(Versions, stopEndsTheMotionAndIsNeverRefused) {
  TestProgram program(place(), GetParam());
  program.read();
  EXPECT_EQ(program.ask(StopMoveRequest{}), Status::success);  // nothing runs
  RobotState state = program.start_torques();
  for (int i = 0; i < 5; ++i) state = program.exchange(state);
  const auto stop = program.send(StopMoveRequest{});
  EXPECT_EQ(program.reply(program.move()), Status::preempted);  // first the motion's end
  EXPECT_EQ(program.reply(stop), Status::success);
  EXPECT_TRUE(is_idle(program.read_until(is_idle)));
}

TEST_F(OneArm, reflexIsShownByTheFirstStateAfterTheMotion) {
  TestProgram program(place());
  RobotState state = program.start_torques();
  for (int i = 0; i < 5; ++i) state = program.exchange(state);
  RobotCommand command = program.torques(state);
  command.tau_J_d[2] = 5;  // 5000 N m/s
  program.command(command);
  state = program.read();
  EXPECT_TRUE(in_mode(state, RobotMode::reflex));
  EXPECT_EQ(error_bits(state.errors), error_bit(ArmError::controller_torque_discontinuity));
  EXPECT_EQ(state.reflex_reason, state.errors);
  EXPECT_EQ(state.motion_generator_mode, 0);
  EXPECT_EQ(program.reply(program.move()), Status::reflex_aborted);

  EXPECT_EQ(program.ask(MoveRequest{}), Status::not_possible);
  EXPECT_EQ(program.ask(StopMoveRequest{}), Status::success);
  EXPECT_EQ(program.ask(AutomaticErrorRecoveryRequest{}), Status::success);
  // With the answer the arm is ready.
  state = program.start_torques();
  EXPECT_TRUE(in_mode(state, RobotMode::move));
  EXPECT_EQ(error_bits(state.errors), 0u);
}

// Both replies to a Move carry one id: the second must not reach the program together with the first.
TEST_F(OneArm, secondReplyToMoveComesLaterThanTheFirst) {
  TestProgram program(place());
  program.read();
  const auto move = program.send(MoveRequest{});
  EXPECT_EQ(program.reply(move), Status::motion_started);
  const HostTime started = host_now();
  ASSERT_TRUE(arms_.raise(0, ArmError::joint_reflex));  // before any command
  EXPECT_EQ(program.reply(move), Status::reflex_aborted);
  EXPECT_GT(seconds(host_now() - started), 0.04);
}

TEST_F(OneArm, userStopEndsTheMotionUntilItIsReleased) {
  TestProgram program(place());
  RobotState state = program.start_torques();
  for (int i = 0; i < 5; ++i) state = program.exchange(state);
  EXPECT_TRUE(arms_.request(0, SetUserStop{true}).get().success);
  state = program.read_until([](const auto& s) { return !in_mode(s, RobotMode::move); });
  EXPECT_TRUE(in_mode(state, RobotMode::user_stopped));
  EXPECT_EQ(program.reply(program.move()), Status::emergency_aborted);
  EXPECT_EQ(program.ask(MoveRequest{}), Status::not_possible);
  EXPECT_EQ(program.ask(AutomaticErrorRecoveryRequest{}), Status::not_possible);
  EXPECT_TRUE(arms_.request(0, SetUserStop{false}).get().success);
  program.read_until(is_idle);
  EXPECT_TRUE(in_mode(program.start_torques(), RobotMode::move));
}

TEST_F(OneArm, settersShowInTheStateAndAreRefusedInMotion) {
  TestProgram program(place());
  program.read();
  SetLoadRequest load{
      .m_load = 0.5, .F_x_Cload = {0.01, 0.02, 0.03}, .I_load = {2e-3, 0, 0, 0, 3e-3, 0, 0, 0, 4e-3}};
  EXPECT_EQ(program.ask(load), Status::success);
  SetEEToKRequest k;
  k.EE_T_K = to_wire(Pose{rotation_from_rpy({0.1, 0.2, 0.3}), {0.01, 0.02, 0.05}});
  EXPECT_EQ(program.ask(k), Status::success);
  SetNEToEERequest ne;
  ne.NE_T_EE = to_wire(Pose{rotation_from_rpy({0, 0, 0.5}), {0, 0, 0.1}});
  EXPECT_EQ(program.ask(ne), Status::success);
  const auto shown = program.read_until([](const auto& s) { return s.m_load > 0 && s.NE_T_EE[14] > 0.09; });
  EXPECT_FLOAT_EQ(static_cast<float>(shown.m_load), 0.5f);
  EXPECT_FLOAT_EQ(static_cast<float>(shown.I_load[8]), 4e-3f);
  for (std::size_t i = 0; i < 16; ++i) {
    EXPECT_NEAR(shown.EE_T_K[i], k.EE_T_K[i], 1e-6);
    EXPECT_NEAR(shown.NE_T_EE[i], ne.NE_T_EE[i], 1e-6);
  }
  // F_T_EE = F_T_NE * NE_T_EE: the hand's tool center point is 0.1034 m before the flange, E 0.1 m further.
  EXPECT_NEAR(shown.F_T_EE[14], 0.2034, 1e-6);
  EXPECT_NEAR(shown.m_ee, 0.73, 0.05);  // the hand

  load.m_load = -1;
  EXPECT_EQ(program.ask(load), Status::invalid_argument);
  k.EE_T_K[0] = std::nan("");
  EXPECT_EQ(program.ask(k), Status::invalid_argument);
  ne.NE_T_EE[3] = 0.5;  // the bottom row
  EXPECT_EQ(program.ask(ne), Status::invalid_argument);
  EXPECT_EQ(program.ask(SetJointImpedanceRequest{.K_theta = {3000, 3000, 3000, 2500, 2500, 2000, 14251}}),
            Status::invalid_argument);
  EXPECT_EQ(program.ask(SetCartesianImpedanceRequest{.K_x = {9, 2000, 2000, 100, 100, 100}}),
            Status::invalid_argument);
  EXPECT_EQ(program.ask(SetJointImpedanceRequest{.K_theta = {3000, 3000, 3000, 2500, 2500, 2000, 2000}}),
            Status::success);
  SetCollisionBehaviorRequest collision;
  for (auto* torque :
       {&collision.lower_torque_thresholds_acceleration, &collision.upper_torque_thresholds_acceleration,
        &collision.lower_torque_thresholds_nominal, &collision.upper_torque_thresholds_nominal}) {
    torque->fill(80);
  }
  for (auto* force :
       {&collision.lower_force_thresholds_acceleration, &collision.upper_force_thresholds_acceleration,
        &collision.lower_force_thresholds_nominal, &collision.upper_force_thresholds_nominal}) {
    force->fill(100);
  }
  EXPECT_EQ(program.ask(collision), Status::success);
  collision.lower_force_thresholds_nominal[3] = -1;
  EXPECT_EQ(program.ask(collision), Status::invalid_argument);

  program.start_torques();
  EXPECT_EQ(program.ask(SetJointImpedanceRequest{}), Status::not_possible);
  EXPECT_EQ(program.ask(AutomaticErrorRecoveryRequest{}), Status::not_possible);
  EXPECT_EQ(program.ask(GetRobotModelRequest{}), Status::success);  // programs load it while they move
  EXPECT_GT(program.rest().size(), 1000u);
}

TEST_F(OneArm, olderVersionsHaveTheirOwnRequests) {
  {
    TestProgram program(place(), 5);
    program.read();
    EXPECT_EQ(program.ask(GetCartesianLimitRequest{}), Status::success);
    EXPECT_EQ(program.rest().size(), 153u);
    EXPECT_EQ(program.ask(SetFiltersRequest{100, 100, 100, 100, 100}), Status::success);
    EXPECT_EQ(program.ask(SetFiltersRequest{100, 100, 100, 100, -1}), Status::invalid_argument);
    EXPECT_EQ(program.ask(LoadModelLibraryRequest{LibraryArchitecture::arm64, LibrarySystem::linux_os}),
              Status::error);
    EXPECT_EQ(program.ask(LoadModelLibraryRequest{}), Status::success);
    ASSERT_GT(program.rest().size(), 4u);
    EXPECT_EQ(program.rest()[1], std::byte{'E'});  // an ELF file
  }
  TestProgram program(place(), 10);  // has none of them
  program.read();
  EXPECT_EQ(program.ask(GetRobotModelRequest{}), Status::success);
  const std::string text(reinterpret_cast<const char*>(program.rest().data()), program.rest().size());
  EXPECT_NE(text.find("<robot"), std::string::npos);
  EXPECT_NE(text.find("position_based_velocity_limits"), std::string::npos);
}

// Commands are counted from a motion's first one on, and 20 missing in a row are too many.
TEST_F(OneArm, lostAnswersStopTheArmAtTheTwentieth) {
  TestProgram program(place());
  RobotState state = program.start_torques();
  state = program.exchange(state);
  // In each direction: no answer arrives within its period.
  ASSERT_TRUE(arms_.set_faults(0, {.latency_s = 0.0006}));
  int periods = 0;
  while (in_mode(state, RobotMode::move) && ++periods < 100) state = program.exchange(state);
  EXPECT_TRUE(in_mode(state, RobotMode::reflex));
  EXPECT_EQ(error_bits(state.errors), error_bit(ArmError::communication_constraints_violation));
  // The faults begin within the first exchanges; after that it is exactly 20.
  EXPECT_EQ(counts().commands_missed, 20u);
  EXPECT_EQ(counts().commands_late, 20u);
  EXPECT_EQ(program.reply(program.move()), Status::reflex_aborted);
}

TEST_F(OneArm, lossDuplicatesAndReorderingAreSurvived) {
  TestProgram program(place());
  RobotState state = program.start_torques();
  ASSERT_TRUE(arms_.set_faults(0, {.latency_s = 0.0003, .loss = 0.1, .duplicate = 0.2, .reorder = 0.05}));
  std::uint64_t first = state.message_id, newest = first;
  while (newest < first + 500) {
    program.command(program.torques(state));
    do {
      state = program.read();
      ASSERT_GT(program.size(), 0u);
    } while (state.message_id <= newest);  // as in libfranka: older ones are skipped
    newest = state.message_id;
    ASSERT_TRUE(in_mode(state, RobotMode::move));
  }
  EXPECT_GT(counts().commands_missed, 60u);  // 1 - 0.9^2 (1 - 0.05)^2 of 500: 134
  EXPECT_LT(counts().commands_missed, 220u);
  EXPECT_GT(state.control_command_success_rate, 0.5);
  EXPECT_LT(state.control_command_success_rate, 1.0);
}

TEST_F(OneArm, anArmHoldsAfterItsProgramDisconnects) {
  {
    TestProgram program(place());
    RobotState state = program.start_torques();
    RobotCommand command;
    for (int i = 0; i < 30; ++i) {
      command = program.torques(state);
      command.tau_J_d[0] = 0.5 * i;  // it turns
      program.command(command);
      state = program.read();
    }
    EXPECT_GT(state.dq[0], 0.01);
  }
  TestProgram next(place());
  const auto state = next.read_until([](const auto& s) { return std::abs(s.dq[0]) < 1e-3; });
  EXPECT_TRUE(is_idle(state));
  EXPECT_TRUE(in_mode(next.start_torques(), RobotMode::move));
}

TEST_F(OneArm, invalidMessagesEndOnlyTheConnection) {
  {
    TestProgram program(place());
    program.read();
    program.send(ConnectRequest{});  // a second time
    EXPECT_TRUE(program.is_closed());
  }
  TestProgram program(place());
  RobotState state = program.start_torques();
  RobotCommand command = program.torques(state);
  command.message_id += 1000;  // of a state that does not exist yet
  program.command(command);
  state = program.exchange(state);
  EXPECT_TRUE(in_mode(state, RobotMode::move));
  EXPECT_EQ(counts().bad_datagrams, 1u);
  EXPECT_EQ(counts().bad_requests, 1u);
}

TEST_F(OneArm, injectedFreezeAndClosing) {
  TestProgram program(place());
  std::uint64_t before = program.read_newest().message_id, gap = 0;
  ASSERT_TRUE(arms_.freeze(0, 0.03));
  for (int i = 0; i < 100; ++i) {
    const auto id = program.read().message_id;
    gap = std::max(gap, id - before);
    before = id;
  }
  EXPECT_EQ(gap, 30u);
  EXPECT_EQ(program.ask(StopMoveRequest{}), Status::success);  // it listens again
  ASSERT_TRUE(arms_.close_connection(0));
  EXPECT_TRUE(program.is_closed());
}

// In real time. Nothing here depends on how late this program is: only on which state it answers.
class RealTimeArm : public testing::Test {
 protected:
  static VirtualArmOptions options(bool strict, std::vector<ClockOffset> clocks = {}) {
    VirtualArmOptions options{.pace = WorldPace::realtime, .strict = strict, .clocks = std::move(clocks)};
    options.places = {{.address = test::own_address(0), .port = 0, .gripper_port = 0, .vacuum_port = 0}};
    return options;
  }
  static Scene scene() { return multipanda::test::scene_of({multipanda::test::arm_named("left")}); }
};

// Back in a torque motion, if the machine was so slow that the arm stopped without commands.
RobotState in_torque_motion(TestProgram& program, const RobotState& state) {
  if (in_mode(state, RobotMode::move)) return state;
  if (in_mode(state, RobotMode::reflex)) {
    EXPECT_EQ(program.reply(program.move()), Status::reflex_aborted);
    EXPECT_EQ(program.ask(AutomaticErrorRecoveryRequest{}), Status::success);
  }
  return program.begin_torques();
}

TEST_F(RealTimeArm, strictDropsTheAnswerToTheStateBeforeTheLast) {
  VirtualArms arms(scene(), options(true));
  arms.start();
  TestProgram program(arms.place(0));
  ASSERT_TRUE(program.connected());
  RobotState state = program.read();
  bool dropped = false;
  for (int k = 0; k < 1000 && !dropped; ++k) {
    state = in_torque_motion(program, state);
    program.command(program.torques(state));  // the first command of a motion may be late
    (void)program.read_newest();
    state = program.read();
    const RobotState next = program.read();
    const PortStatistics before = arms.statistics(0);
    program.command(program.torques(state));  // its successor has been sent
    state = program.read_newest();
    state = program.read();  // sent after the answer arrived
    const PortStatistics after = arms.statistics(0);
    EXPECT_EQ(after.commands_used, before.commands_used);
    dropped = in_mode(next, RobotMode::move) && after.commands_late > before.commands_late;
  }
  EXPECT_TRUE(dropped);
}

// Its own numbers follow each other, whatever the world's steps are, and the torque of an answer is in the
// next state.
TEST_F(RealTimeArm, anArmWithAClockOfItsOwnIsControlledAsAnyOther) {
  VirtualArms arms(scene(), options(true, {{.phase_s = 4e-4, .drift_ppm = -5000}}));
  arms.start();
  TestProgram program(arms.place(0));
  ASSERT_TRUE(program.connected());
  RobotState state = program.read();
  bool seen = false;
  for (int k = 0; k < 20000 && !seen; ++k) {  // on a busy machine some answers are late
    state = in_torque_motion(program, state);
    RobotCommand command = program.torques(state);
    command.tau_J_d[6] = 0.25;
    program.command(command);
    const RobotState next = program.read();
    ASSERT_GT(next.message_id, state.message_id);
    seen = next.message_id == state.message_id + 1 && std::abs(next.tau_J_d[6] - 0.25) < 1e-6;
    state = next;
  }
  EXPECT_TRUE(seen);
}

TEST(ArmClocks, driftByTheirRateAndNeverShortenAnAnswersTime) {
  const HostTime begin{5'000'000'000};
  for (const double ppm : {-50.0, 0.0, 50.0, 400.0}) {
    ArmClock clock({.phase_s = 3e-4, .drift_ppm = ppm}, begin);
    EXPECT_EQ(clock.due().ns, begin.ns + 300'000);
    constexpr int kCount = 1'000'000;
    for (int k = 0; k < kCount; ++k) clock.sent(clock.due());
    // After a thousand of its own seconds the world's clock shows so much less.
    const double elapsed = 1e-9 * static_cast<double>(clock.due().ns - begin.ns) - 3e-4;
    EXPECT_NEAR(elapsed * (1 + 1e-6 * ppm), 1000, 1e-6) << ppm;
    EXPECT_EQ(clock.set_back_ns(), 0u);
  }
  ArmClock clock({}, begin);
  std::mt19937 random(3);
  std::exponential_distribution<double> late(1 / 2e5);  // [ns]
  for (int k = 0; k < 10000; ++k) {
    const HostTime sent{clock.due().ns + static_cast<std::int64_t>(late(random))};
    clock.sent(sent);
    ASSERT_GE(clock.due().ns - sent.ns, ArmClock::kLeastNs - 1);
  }
  EXPECT_GT(clock.set_back_ns(), 0u);
}

TEST_F(OneArm, declaresTheManufacturersHandAndRoundsRotations) {
  TestProgram program(place());
  const RobotState state = program.read();
  EXPECT_FLOAT_EQ(static_cast<float>(state.m_ee), 0.73f);
  const std::array<double, 3> com{-0.01, 0, 0.03};
  for (std::size_t i = 0; i < 3; ++i) EXPECT_NEAR(state.F_x_Cee[i], com[i], 1e-8);
  EXPECT_NEAR(state.F_T_NE[0], 0.7071, 1e-7) << "not 0.70710678";
  for (std::size_t i = 0; i < 16; ++i) EXPECT_NEAR(state.F_T_EE[i], state.F_T_NE[i], 1e-7);
}

}  // namespace
}  // namespace multipanda::fci::arm_port_test
