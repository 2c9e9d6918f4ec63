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
  explicit OneArm(VirtualArmOptions options = {}, Scene world = scene())
      : arms_(std::move(world), with_place(std::move(options))) {
    arms_.start();
  }
  static Scene scene() { return multipanda::test::scene_of({multipanda::test::arm_named("left")}); }
  static VirtualArmOptions with_place(VirtualArmOptions options) {
    options.places = {{.address = test::own_address(0),
                       .port = 0,
                       .gripper_port = 0,
                       .vacuum_port = 0,
                       .versions = VersionRange{}}};
    options.pace = WorldPace::lockstep;
    return options;
  }
  const ArmPlace& place() const { return arms_.place(0); }
  void recover_at_speed();
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
    // A gap that docs/like_a_real_arm.md states.
    EXPECT_EQ(state.accelerometer_top, RobotState().accelerometer_top);
    EXPECT_EQ(state.accelerometer_bottom, RobotState().accelerometer_bottom);
  }
  for (const std::uint16_t version : std::to_array<std::uint16_t>({3, 11, 65535})) {
    TestProgram program(place(), version);
    EXPECT_EQ(program.answer(), Status::incompatible_version) << version;
    EXPECT_EQ(program.server_version(), kNewestVersion);
    EXPECT_TRUE(program.is_closed());
  }
}

// Unless a version is named: as the systems of Pandas and of Franka Research 3 have had them (docs/fci.md).
TEST(Protocol, anArmRefusesVersionsThatItsSystemDoesNotHave) {
  struct Case {
    const char* model;
    int of_scene;  // 0: not named
    std::optional<VersionRange> of_place;
    VersionRange expected;
  };
  for (const auto& [model, of_scene, of_place, expected] :
       {Case{"fer", 0, {}, {4, 5}}, Case{"fr3", 0, {}, {6, 10}}, Case{"fr3v2", 0, {}, {6, 10}},
        Case{"fer", 4, {}, {4, 4}}, Case{"fr3", 8, VersionRange{9, 9}, {9, 9}}}) {
    SceneArm arm = multipanda::test::arm_named("arm");
    arm.model = model;
    if (of_scene != 0) arm.fci = FciConnection{.version = of_scene};
    VirtualArmOptions options{.pace = WorldPace::lockstep};
    options.places = {{.address = test::own_address(0),
                       .port = 0,
                       .gripper_port = 0,
                       .vacuum_port = 0,
                       .versions = of_place}};
    VirtualArms arms(multipanda::test::scene_of({arm}), options);
    arms.start();
    for (std::uint16_t version = 4; version <= 10; ++version) {
      TestProgram program(arms.place(0), version);
      const bool accepted = version >= expected.oldest && version <= expected.newest;
      EXPECT_EQ(program.answer(), accepted ? Status::success : Status::incompatible_version)
          << model << ", " << version;
      EXPECT_EQ(program.server_version(), accepted ? version : expected.newest);
    }
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

void OneArm::recover_at_speed() {
  TestProgram program(place());
  RobotState state = program.start_torques();
  for (double tau = 0; state.dq[0] < 1; tau = std::min(20.0, tau + 0.9)) {
    RobotCommand command = program.torques(state);
    command.tau_J_d[0] = tau;
    program.command(command);
    state = program.read();
    ASSERT_TRUE(in_mode(state, RobotMode::move));
  }
  ASSERT_TRUE(arms_.raise(0, ArmError::joint_reflex));
  while (in_mode(state, RobotMode::move)) state = program.exchange(state);
  EXPECT_EQ(program.reply(program.move()), Status::reflex_aborted);
  ASSERT_GT(state.dq[0], 0.5) << "it brakes";
  const auto recovery = program.send(AutomaticErrorRecoveryRequest{});
  state = program.read_until([](const auto& s) { return in_mode(s, RobotMode::automatic_error_recovery); });
  EXPECT_EQ(error_bits(state.errors), 0u);
  state = program.read_until(is_idle);
  for (const double v : state.dq) EXPECT_LT(std::abs(v), 0.03);
  EXPECT_EQ(program.reply(recovery), Status::success);
  state = program.begin_positions();
  const auto q = state.q_d;
  for (int i = 0; i < 50; ++i) {
    program.command({.message_id = state.message_id, .q_c = q});
    state = program.read();
    ASSERT_TRUE(in_mode(state, RobotMode::move)) << i;
  }
}

TEST_F(OneArm, recoveryIsAnsweredWhenTheArmIsAtRest) { recover_at_speed(); }

class StandingArm : public OneArm {
 protected:
  StandingArm() : OneArm({.idle_stands_still = true}) {}
};
TEST_F(StandingArm, recoversToo) { recover_at_speed(); }

// At rest, too: real arms take 0.2 s at least, ideal ones the period until the next state.
class RestingArm : public OneArm, public testing::WithParamInterface<bool> {
 protected:
  RestingArm() : OneArm({.idle_stands_still = true}, plant(GetParam())) {}
  static Scene plant(bool real) {
    Scene world = scene();
    if (real) world.plant = PlantFidelity::realistic();
    return world;
  }
};
TEST_P(RestingArm, recoversInTheTimeOfARealArm) {
  TestProgram program(place());
  RobotState state = program.start_torques();
  ASSERT_TRUE(arms_.raise(0, ArmError::joint_reflex));
  while (in_mode(state, RobotMode::move)) state = program.exchange(state);
  EXPECT_EQ(program.reply(program.move()), Status::reflex_aborted);
  const auto recovery = program.send(AutomaticErrorRecoveryRequest{});
  int recovering = 0;
  state = program.read_until([&](const auto& s) {
    recovering += in_mode(s, RobotMode::automatic_error_recovery) ? 1 : 0;
    return is_idle(s);
  });
  EXPECT_EQ(program.reply(recovery), Status::success);
  if (GetParam())
    EXPECT_GE(recovering, 199);
  else
    EXPECT_LE(recovering, 1);
  EXPECT_TRUE(in_mode(program.start_torques(), RobotMode::move));
}
INSTANTIATE_TEST_SUITE_P(Plants, RestingArm, testing::Bool());

class StretchedArm : public OneArm {
 protected:
  StretchedArm() : OneArm({}, stretched()) {}
  static Scene stretched() {
    Scene world = scene();
    world.arms[0].q_start << 0, 1.28, 0, -0.5415, 0, 2.74, 0;
    return world;
  }
};

// As users of real arms report: as an error of the motion, not of the request.
TEST_F(StretchedArm, refusesCartesianMotionsAfterTheyHaveStarted) {
  TestProgram program(place());
  program.read();
  const auto id = program.send(MoveRequest{.controller = MoveController::joint_impedance,
                                           .generator = MoveGenerator::cartesian_position});
  EXPECT_EQ(program.reply(id), Status::motion_started);
  EXPECT_EQ(program.reply(id), Status::singular);
  EXPECT_TRUE(is_idle(program.read_newest()));
  EXPECT_TRUE(in_mode(program.begin_positions(), RobotMode::move)) << "out of it by joints";
  EXPECT_EQ(counts().motions, 1u);
}

// Programs write cos 45 degrees as 0.7071, and so does the arm: columns whose length is 1 within 1e-5 become
// the rotation that was meant.
TEST_F(OneArm, framesOfFourDigitsAreAcceptedAsRotations) {
  TestProgram program(place());
  const auto turned = [](double c) {
    return std::array<double, 16>{c, -c, 0, 0, c, c, 0, 0, 0, 0, 1, 0, 0, 0, 0.05, 1};
  };
  EXPECT_EQ(program.ask(SetNEToEERequest{turned(0.7071)}), Status::success);
  EXPECT_EQ(program.ask(SetEEToKRequest{turned(0.7071)}), Status::success);
  const auto shown =
      program.read_until([](const auto& s) { return s.EE_T_K[14] > 0.04 && s.NE_T_EE[14] > 0.04; });
  for (const auto* frame : {&shown.O_T_EE, &shown.EE_T_K, &shown.NE_T_EE}) {
    const Matrix3 R = pose_of(*frame).rotation;
    EXPECT_LT((R * R.transpose() - Matrix3::Identity()).cwiseAbs().maxCoeff(), 1e-6)
        << "single precision; four digits are off by 2e-5";
  }
  EXPECT_NEAR(shown.EE_T_K[0], std::sqrt(0.5), 1e-7);
  // The nominal end effector that the arm shows, inverted: E at the flange.
  const Pose X_FNE = pose_of(program.read().F_T_NE);
  EXPECT_EQ(program.ask(SetNEToEERequest{column_major(X_FNE.inverse())}), Status::success);
  EXPECT_EQ(program.ask(SetNEToEERequest{turned(0.707)}), Status::invalid_argument);
  EXPECT_EQ(program.ask(SetEEToKRequest{turned(0.70715)}), Status::invalid_argument);
}

TEST_F(OneArm, aLoadIsRefusedInAReflex) {
  TestProgram program(place());
  program.read();
  const SetLoadRequest load{.m_load = 0.5, .F_x_Cload = {0, 0, 0.05}, .I_load = {}};
  EXPECT_TRUE(arms_.request(0, SetUserStop{true}).get().success);
  program.read_until([](const auto& s) { return in_mode(s, RobotMode::user_stopped); });
  EXPECT_EQ(program.ask(load), Status::not_possible);
  EXPECT_TRUE(arms_.request(0, SetUserStop{false}).get().success);
  program.read_until(is_idle);
  EXPECT_EQ(program.ask(load), Status::success);
}

TEST_F(OneArm, settersShowInTheStateAndAreRefusedInMotion) {
  TestProgram program(place());
  program.read();
  SetLoadRequest load{
      .m_load = 0.5, .F_x_Cload = {0.01, 0.02, 0.03}, .I_load = {2e-3, 0, 0, 0, 3e-3, 0, 0, 0, 4e-3}};
  EXPECT_EQ(program.ask(load), Status::success);
  SetEEToKRequest k;
  k.EE_T_K = column_major(Pose{rotation_from_rpy({0.1, 0.2, 0.3}), {0.01, 0.02, 0.05}});
  EXPECT_EQ(program.ask(k), Status::success);
  SetNEToEERequest ne;
  ne.NE_T_EE = column_major(Pose{rotation_from_rpy({0, 0, 0.5}), {0, 0, 0.1}});
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
  // What socket and ROS refuse: more than the arm carries, a gravity vector as center of mass.
  EXPECT_EQ(program.ask(SetLoadRequest{.m_load = 5, .F_x_Cload = {0, 0, 0.1}, .I_load = {}}),
            Status::invalid_argument);
  EXPECT_EQ(program.ask(SetLoadRequest{.m_load = 0.4, .F_x_Cload = {0, 0, -9.81}, .I_load = {}}),
            Status::invalid_argument);
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
    options.places = {{.address = test::own_address(0),
                       .port = 0,
                       .gripper_port = 0,
                       .vacuum_port = 0,
                       .versions = VersionRange{}}};
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

// The period of a late set-point has been extrapolated; taken one period later it would stop the motion for a
// millisecond: 0.1 rad/s are 100 rad/s^2. Joint 1 follows a curve over the arm's own time, at first with
// 0.1 rad/s^2, so that whatever is extrapolated lies on it.
TEST_F(RealTimeArm, lateSetPointsAreDropped) {
  VirtualArms arms(scene(), options(false));
  arms.start();
  TestProgram program(arms.place(0));
  ASSERT_TRUE(program.connected());
  int series = 0;  // of six answers, each to the state before the last
  for (int motions = 0; motions < 20 && series < 6; ++motions) {
    RobotState state = program.begin_positions();
    const RobotState first = state;
    const auto answer = [&](const RobotState& to) {
      const double t = 1e-3 * static_cast<double>(to.message_id - first.message_id);
      RobotCommand command{.message_id = to.message_id, .q_c = first.q_d};
      command.q_c[0] += t < 1 ? 0.05 * t * t : 0.1 * t - 0.05;
      program.command(command);
    };
    std::uint64_t late = 0;
    while (in_mode(state, RobotMode::move) && series < 6) {
      const bool cruises = state.message_id > first.message_id + 1100;
      const int lags = cruises && state.message_id > late + 100 ? 6 : 0;
      for (int i = 0; i < lags; ++i) {
        const RobotState next = program.read();
        answer(state);
        state = next;
      }
      if (lags > 0) {
        late = state.message_id;
        if (in_mode(state, RobotMode::move)) ++series;
      }
      answer(state);
      state = program.read_newest();
    }
    const std::uint64_t silence = error_bit(ArmError::communication_constraints_violation);
    ASSERT_EQ(error_bits(state.errors) & ~silence, 0u) << "after " << series << " series";
    if (in_mode(state, RobotMode::move)) break;
    EXPECT_EQ(program.reply(program.move()), Status::reflex_aborted);  // the machine was too slow
    EXPECT_EQ(program.ask(AutomaticErrorRecoveryRequest{}), Status::success);
  }
  EXPECT_EQ(series, 6);
  EXPECT_GE(arms.statistics(0).commands_late, 36u);
}

// One thread with two arms reads a state of the second one that is one period old, forever: a state is left
// out for it, before its set-points have been dropped 20 times.
TEST_F(RealTimeArm, aProgramThatStaysOneStateBehindIsSetRight) {
  VirtualArmOptions both = options(false);
  both.places.push_back(both.places[0]);
  both.places[1].address = test::own_address(1);
  VirtualArms arms(
      multipanda::test::scene_of({multipanda::test::arm_named("left"),
                                  multipanda::test::arm_named("right", multipanda::test::pose(0, 1, 0))}),
      both);
  arms.start();
  TestProgram left(arms.place(0)), right(arms.place(1));
  bool moves = false;
  for (int tries = 0; tries < 20 && !moves; ++tries) {  // a slow machine loses more
    right.read_newest();
    RobotState r = right.begin_positions();
    const auto q = r.q_d;
    left.read_newest();
    for (int i = 0; i < 200; ++i) {
      left.read();
      right.command({.message_id = r.message_id, .q_c = q});
      r = right.read();
    }
    moves = in_mode(r, RobotMode::move);
    if (!moves) {
      EXPECT_EQ(right.reply(right.move()), Status::reflex_aborted);
      EXPECT_EQ(right.ask(AutomaticErrorRecoveryRequest{}), Status::success);
    }
  }
  EXPECT_TRUE(moves);
  EXPECT_GT(arms.statistics(1).commands_late, 0u);
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
