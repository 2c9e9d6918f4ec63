// One arm's connection against a fake arm whose answers the test sets.
#include "fci/client/arm_connection.hpp"

#include <netinet/in.h>
#include <random>
#include <sys/socket.h>
#include <thread>
#include <unistd.h>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "fci/client/testing/fake_arm.hpp"

namespace multipanda::fci::arm_connection_test {
namespace {

using testing::HasSubstr;

// Waits that succeed early cost nothing; the whole machine may stand still for seconds.
constexpr double kPatience = 20;

ArmConnectionOptions options_for(const FakeArm& arm) {
  return {.name = "left",
          .address = arm.address(),
          .port = arm.port(),
          .connect_timeout_s = kPatience,
          .state_timeout_s = kPatience,
          .reply_timeout_s = kPatience,
          .recovery_timeout_s = kPatience,
          .model_timeout_s = kPatience};
}

// The message of the refusal.
template <class Call>
ConnectionError refusal(Call&& call) {
  try {
    call();
  } catch (const ConnectionError& error) {
    return error;
  }
  ADD_FAILURE() << "nothing was thrown";
  return {ConnectionError::Kind::lost, ""};
}

class EveryVersion : public testing::TestWithParam<int> {};

TEST_P(EveryVersion, IsDetectedAndUsedAutomatically) {
  FakeArm arm(GetParam());
  ArmConnection link(options_for(arm));
  link.connect();
  EXPECT_EQ(link.version(), GetParam());
  EXPECT_GT(link.last_state().message_id, 0u);
  EXPECT_EQ(arm.last<ConnectRequest>().version, GetParam());
  EXPECT_NEAR(link.next_state().q[3], -2.356194490192345, 1e-6);
}

TEST_P(EveryVersion, TorquesOnlyBeginRunAndFinishAsThatVersionsLibraryDoes) {
  FakeArm arm(GetParam());
  ArmConnection link(options_for(arm));
  link.connect();
  link.start_motion({});
  const auto move = arm.last<MoveRequest>();
  EXPECT_EQ(move.controller, MoveController::external);
  EXPECT_EQ(move.generator, GetParam() >= 10 ? MoveGenerator::none : MoveGenerator::joint_velocity);
  EXPECT_EQ(move.maximum_path_deviation.translation, 10);
  link.wait_until_running();
  EXPECT_EQ(link.last_state().robot_mode, static_cast<int>(RobotMode::move));

  RobotCommand torque;
  torque.tau_J_d = {1, 2, 3, 4, 5, 6, 7};
  const std::uint64_t id = link.newest().message_id;
  ASSERT_TRUE(link.send(torque));
  const auto got = arm.command();
  ASSERT_TRUE(got);
  EXPECT_EQ(got->message_id, id);
  EXPECT_EQ(got->tau_J_d, torque.tau_J_d);
  EXPECT_EQ(got->dq_c, (std::array<double, 7>{}));
  EXPECT_FALSE(got->motion_generation_finished || got->torque_command_finished);

  std::thread finisher([&arm] {
    const auto last = arm.command();
    ASSERT_TRUE(last);
    EXPECT_EQ(last->tau_J_d[6], 7);
    EXPECT_EQ(last->torque_command_finished, GetParam() >= 10);
    EXPECT_EQ(last->motion_generation_finished, GetParam() < 10);
    arm.end_motion(Status::success, RobotMode::idle);
  });
  const MotionOutcome end = link.finish(torque, kPatience);
  finisher.join();
  EXPECT_EQ(end.status, Status::success);
  EXPECT_FALSE(link.has_motion());
}

INSTANTIATE_TEST_SUITE_P(Protocol, EveryVersion, testing::Range(4, 11));

TEST(ArmConnection, RefusesVersionsWithTheRemedy) {
  FakeArm arm(5);
  ArmConnectionOptions options = options_for(arm);
  options.version = 10;
  ArmConnection link(options);
  const ConnectionError error = refusal([&] { link.connect(); });
  EXPECT_EQ(error.kind(), ConnectionError::Kind::incompatible);
  EXPECT_THAT(error.what(), HasSubstr("version 5"));
  EXPECT_THAT(error.what(), HasSubstr("arm left"));
  EXPECT_FALSE(link.is_connected());
  options.version = 3;
  EXPECT_THROW(ArmConnection{options}, std::invalid_argument);
}

TEST(ArmConnection, ReportsWhyTheArmIsNotReachable) {
  std::uint16_t port = 0;
  {
    FakeArm gone(10);
    port = gone.port();
  }
  ArmConnection link({.name = "left", .address = "127.0.0.1", .port = port});
  ConnectionError error = refusal([&] { link.connect(); });
  EXPECT_EQ(error.kind(), ConnectionError::Kind::unreachable);
  EXPECT_THAT(error.what(), HasSubstr("FCI is activated"));
  error = refusal([&] { link.stop(); });
  EXPECT_THAT(error.what(), HasSubstr("connect first"));
}

TEST(ArmConnection, EverySettingArrivesUnchanged) {
  std::mt19937_64 random(5);
  std::uniform_real_distribution<double> any(1, 100);
  const auto draw = [&](auto& values) {
    for (auto& v : values) v = any(random);
    return values;
  };
  for (const int version : {5, 10}) {
    FakeArm arm(version);
    ArmConnection link(options_for(arm));
    link.connect();
    std::array<double, 7> a{}, b{};
    std::array<double, 6> c{}, d{};
    link.set_collision_behavior(draw(a), draw(b), draw(c), draw(d));
    const auto thresholds = arm.last<SetCollisionBehaviorRequest>();
    EXPECT_EQ(thresholds.lower_torque_thresholds_acceleration, a);
    EXPECT_EQ(thresholds.upper_torque_thresholds_nominal, b);
    EXPECT_EQ(thresholds.lower_force_thresholds_nominal, c);
    EXPECT_EQ(thresholds.upper_force_thresholds_acceleration, d);
    link.set_joint_impedance(draw(a));
    EXPECT_EQ(arm.last<SetJointImpedanceRequest>().K_theta, a);
    link.set_cartesian_impedance(draw(c));
    EXPECT_EQ(arm.last<SetCartesianImpedanceRequest>().K_x, c);
    link.set_guiding_mode({true, false, true, false, false, true}, true);
    const auto guiding = arm.last<SetGuidingModeRequest>();
    EXPECT_EQ(guiding.guiding_mode, (std::array<std::uint8_t, 6>{1, 0, 1, 0, 0, 1}));
    EXPECT_TRUE(guiding.nullspace);

    const Pose X{rotation_from_rpy({0.3, -0.7, 1.9}), Vector3(0.1, 0.2, 0.3)};
    link.set_EE(X);
    const auto T = arm.last<SetNEToEERequest>().NE_T_EE;
    EXPECT_EQ(T[4], X.rotation(0, 1)) << "column-major";
    EXPECT_EQ(T[12], 0.1);
    EXPECT_EQ(T[15], 1.0);
    EXPECT_TRUE(link.wait_for_state([](const RobotState& s) { return s.F_T_EE[12] > 0.09; }));
    link.set_K(X);
    EXPECT_EQ(arm.last<SetEEToKRequest>().EE_T_K, T);
    Load load{.mass = 1.5, .p_FC = {0.01, 0.02, 0.03}};
    load.inertia_C << 1, 0.1, 0.2, 0.1, 2, 0.3, 0.2, 0.3, 2.5;
    link.set_load(load);
    const auto told = arm.last<SetLoadRequest>();
    EXPECT_EQ(told.m_load, 1.5);
    EXPECT_EQ(told.F_x_Cload, (std::array<double, 3>{0.01, 0.02, 0.03}));
    EXPECT_EQ(told.I_load[5], 0.3);

    if (version == 5) {
      link.set_filters({10, 20, 30, 40, 50});
      EXPECT_EQ(arm.last<SetFiltersRequest>().cartesian_velocity, 40);
      const CartesianLimit wall = link.cartesian_limit(3);
      EXPECT_EQ(arm.last<GetCartesianLimitRequest>().id, 3);
      EXPECT_EQ(wall.object_p_max[1], 0.2);
      EXPECT_TRUE(wall.object_activation);
      arm.set_model("library");
      EXPECT_EQ(link.model_library().size(), 7u);
      EXPECT_THAT(refusal([&] { (void)link.robot_model(); }).what(),
                  HasSubstr("is not available in version 5"));
    } else {
      arm.set_model("<robot/>");
      EXPECT_EQ(link.robot_model(), "<robot/>");
      EXPECT_EQ(refusal([&] { link.set_filters({}); }).kind(), ConnectionError::Kind::refused);
      EXPECT_TRUE(link.is_connected()) << "nothing was sent";
    }
  }
}

TEST(ArmConnection, RefusalsNameModeAndRemedy) {
  FakeArm arm(10);
  ArmConnection link(options_for(arm));
  link.connect();
  arm.change([](RobotState& s) {
    s.robot_mode = static_cast<std::uint8_t>(RobotMode::reflex);
    s.errors[6] = 1;
  });
  ASSERT_TRUE(link.wait_for_state([](const RobotState& s) { return s.errors[6] != 0; }));
  arm.answer(Command::move, Status::not_possible);
  const ConnectionError error = refusal([&] { link.start_motion({}); });
  EXPECT_THAT(error.what(), HasSubstr("mode reflex"));
  EXPECT_THAT(error.what(), HasSubstr("joint_reflex"));
  EXPECT_THAT(error.what(), HasSubstr("ctl recover left"));
  EXPECT_FALSE(error.is_fatal());
  arm.answer(Command::set_load, Status::invalid_argument);
  EXPECT_THAT(refusal([&] { link.set_load({}); }).what(), HasSubstr("does not accept the values"));
  arm.answer(Command::automatic_error_recovery, Status::manual_recovery_required);
  EXPECT_THAT(refusal([&] { link.recover(); }).what(), HasSubstr("by hand"));
  arm.answer(Command::automatic_error_recovery, Status::success);
  link.recover();
  EXPECT_EQ(link.last_state().robot_mode, static_cast<int>(RobotMode::idle));
  arm.answer(Command::move, Status::singular);
  EXPECT_THAT(refusal([&] { link.start_motion({}); }).what(), HasSubstr("singular"));
}

TEST(ArmConnection, EveryKindOfMotionIsRequestedByItsModes) {
  FakeArm arm(10);
  ArmConnection link(options_for(arm));
  link.connect();
  const std::pair<MotionGenerator, MotionGeneratorMode> generators[] = {
      {MotionGenerator::joint_position, MotionGeneratorMode::joint_position},
      {MotionGenerator::joint_velocity, MotionGeneratorMode::joint_velocity},
      {MotionGenerator::cartesian_pose, MotionGeneratorMode::cartesian_position},
      {MotionGenerator::cartesian_velocity, MotionGeneratorMode::cartesian_velocity}};
  for (const auto controller :
       {ArmController::joint_impedance, ArmController::cartesian_impedance, ArmController::external}) {
    for (const auto& [generator, mode] : generators) {
      link.start_motion({.controller = controller, .generator = generator});
      link.wait_until_running();
      EXPECT_EQ(link.last_state().motion_generator_mode, static_cast<int>(mode));
      EXPECT_EQ(link.last_state().controller_mode, static_cast<int>(controller));
      link.stop();
      EXPECT_FALSE(link.has_motion()) << "the motion's own end was taken, too";
    }
  }
  link.start_motion({.controller = ArmController::joint_impedance,
                     .generator = MotionGenerator::joint_position,
                     .asynchronous = true,
                     .dq_max = JointVector::Constant(7, 0.5)});
  const auto asynchronous = arm.last<MoveRequest>();
  EXPECT_TRUE(asynchronous.use_async_motion_generator);
  EXPECT_EQ(asynchronous.maximum_velocity[6], 0.5);
  link.stop();
  EXPECT_THROW(link.start_motion({.controller = ArmController::joint_impedance}), std::invalid_argument);
  EXPECT_THROW(link.start_motion({.generator = MotionGenerator::idle}), std::invalid_argument);
}

TEST(ArmConnection, AMotionThatEndsByItselfIsReportedOnce) {
  FakeArm arm(10);
  ArmConnection link(options_for(arm));
  link.connect();
  link.start_motion({});
  link.wait_until_running();
  EXPECT_FALSE(link.poll_motion());
  arm.end_motion(Status::reflex_aborted, RobotMode::reflex, 6);
  const MotionOutcome end = link.wait_for_end(kPatience);
  EXPECT_EQ(end.status, Status::reflex_aborted);
  EXPECT_FALSE(end.text.empty());
  EXPECT_FALSE(link.poll_motion());
}

TEST(ArmConnection, RepliesMayComeInAnyOrder) {
  FakeArm arm(10);
  arm.answer_in_pairs();
  TcpChannel channel(HeaderKind::arm, "arm left");
  channel.connect(arm.address(), arm.port(), kPatience);
  const auto ask = [&](const auto& request) {
    std::array<std::byte, kMaxRequestSize> message;
    const std::uint32_t id = channel.next_id();
    const std::size_t size = encode_request(*dialect(10), id, request, message);
    channel.send(std::span(message).first(size), kPatience);
    return id;
  };
  const std::uint32_t first = ask(SetJointImpedanceRequest{}), second = ask(SetCartesianImpedanceRequest{});
  EXPECT_EQ(second, first + 1);
  EXPECT_EQ(channel.wait(first, kPatience, "the first").command,
            command_id(*dialect(10), Command::set_joint_impedance));
  EXPECT_EQ(channel.wait(second, kPatience, "the second").command_id, second);
  EXPECT_FALSE(channel.take(first)) << "each reply once";
}

TEST(ArmConnection, SilenceGarbageAndDisconnectsEndTheConnectionWithAReason) {
  FakeArm arm(10);
  ArmConnectionOptions options = options_for(arm);
  options.recovery_timeout_s = 0.05;
  ArmConnection link(options);
  link.connect();
  arm.withhold(Command::automatic_error_recovery);
  ConnectionError error = refusal([&] { link.recover(); });
  EXPECT_EQ(error.kind(), ConnectionError::Kind::timeout);
  EXPECT_TRUE(error.is_fatal());
  EXPECT_FALSE(link.is_connected());

  link.connect();  // the same object again
  arm.send_bytes(std::vector<std::byte>(64, std::byte{0xFF}));
  error = refusal([&] {
    while (true) (void)link.wait_for_end(0), (void)link.poll_motion();
  });
  EXPECT_EQ(error.kind(), ConnectionError::Kind::protocol);

  link.connect();
  arm.hang_up();
  error = refusal([&] {
    while (true) (void)link.poll_motion();
  });
  EXPECT_EQ(error.kind(), ConnectionError::Kind::lost);
  EXPECT_THAT(error.what(), HasSubstr("reconnect"));
}

TEST(ArmConnection, WaitsForAStateAsLongAsItsOptionsSay) {
  FakeArm arm(10);
  arm.set_automatic(false);  // one state per answer, none by itself
  ArmConnectionOptions options = options_for(arm);
  options.state_timeout_s = 0.05;
  ArmConnection link(options);
  while (!link.is_connected()) {  // on a machine that stands still, the first state may be late, too
    try {
      link.connect();
    } catch (const ConnectionError& late) {
      ASSERT_THAT(late.what(), HasSubstr("no state for 0.05 s"));
    }
  }
  const ConnectionError error = refusal([&] { (void)link.next_state(); });
  EXPECT_EQ(error.kind(), ConnectionError::Kind::timeout);
  EXPECT_FALSE(link.wait_for_state([](const RobotState&) { return false; }));
  const std::uint64_t id = arm.publish();
  EXPECT_EQ(link.next_state(kPatience).message_id, id);  // the call's own time comes first
}

TEST(ArmConnection, CountsLostAndLateDatagrams) {
  FakeArm arm(10);
  arm.set_automatic(false);
  ArmConnection link(options_for(arm));
  link.connect();
  const ConnectionStatistics start = link.statistics();
  const std::uint64_t id = arm.publish();
  EXPECT_EQ(link.next_state().message_id, id);
  arm.publish(3);  // three lost
  EXPECT_EQ(link.next_state().message_id, id + 4);
  EXPECT_EQ(link.statistics().lost - start.lost, 3u);
  EXPECT_EQ(link.statistics().lost_in_a_row, 3u);
  // One of them was only late; a duplicated state is not new; the rest counts as foreign.
  arm.publish_number(id + 2);
  arm.publish_number(id + 4);
  arm.send_datagram(std::vector<std::byte>(100), "127.0.0.1");
  arm.send_datagram(std::vector<std::byte>(1377), "127.0.0.9");
  EXPECT_EQ(arm.publish(), id + 5);
  EXPECT_EQ(link.next_state().message_id, id + 5);
  const ConnectionStatistics end = link.statistics();
  EXPECT_EQ(end.lost - start.lost, 2u);
  EXPECT_EQ(end.lost_in_a_row, 0u);
  EXPECT_EQ(end.lost_in_a_row_max, 3u);
  EXPECT_EQ(end.foreign - start.foreign, 2u);
  // The newest state counts, whatever else is pending.
  arm.publish();
  arm.publish();
  const std::uint64_t newest = arm.publish();
  EXPECT_EQ(link.next_state().message_id, newest);
}

// A full buffer keeps the oldest datagrams: what it held is not to be acted on, what comes next is.
TEST(ArmConnection, AStateOfAnOverflowedBufferIsStale) {
  FakeArm arm(5);
  ArmConnection link(options_for(arm));
  link.connect();
  arm.set_automatic(false);
  (void)link.receive();
  EXPECT_FALSE(link.is_stale());
  for (int k = 0; k < 400; ++k) (void)arm.publish();  // more than the buffer holds
  EXPECT_FALSE(link.receive());
  EXPECT_TRUE(link.is_stale());
  EXPECT_FALSE(link.receive());
  EXPECT_TRUE(link.is_stale()) << "nothing has come since";
  const std::uint64_t newest = arm.publish();
  EXPECT_TRUE(link.receive());
  EXPECT_FALSE(link.is_stale());
  EXPECT_EQ(link.newest().message_id, newest);
}

TEST(ArmConnection, TakesStatesOnlyFromTheArmsPort) {
  FakeArm arm(10);
  arm.set_automatic(false);
  ArmConnection link(options_for(arm));
  link.connect();
  const std::uint64_t id = arm.publish();
  ASSERT_EQ(link.next_state().message_id, id);
  const auto foreign = link.statistics().foreign;
  // The same address, another port: not the arm, and no command may go there.
  arm.send_datagram(arm.state_with(id + 1), "127.0.0.1");
  ASSERT_EQ(arm.publish(1), id + 2);
  EXPECT_EQ(link.next_state().message_id, id + 2);
  EXPECT_EQ(link.statistics().foreign, foreign + 1);
  EXPECT_EQ(link.statistics().lost_in_a_row, 1u) << "the foreign one was not taken for it";
  RobotCommand command;
  EXPECT_TRUE(link.send(command));
  EXPECT_EQ(arm.command().value().message_id, id + 2);
  // Another connection may come from another port.
  link.connect();
  EXPECT_GT(link.last_state().message_id, 0u);
}

TEST(ArmConnection, ASingleWrongNumberDoesNotDeafenIt) {
  constexpr std::uint64_t kHuge = 1ull << 60;
  FakeArm arm(10);
  arm.set_automatic(false);
  ArmConnection link(options_for(arm));
  link.connect();
  std::uint64_t id = arm.publish();
  ASSERT_EQ(link.next_state().message_id, id);
  id = arm.publish();
  ASSERT_EQ(link.next_state().message_id, id);
  arm.publish_number(kHuge);
  id = arm.publish();
  EXPECT_EQ(link.next_state().message_id, id);
  EXPECT_EQ(link.statistics().lost_in_a_row, 0u);
  // An arm that was silent for a while is believed when its next state confirms the jump.
  arm.publish(5000);
  id = arm.publish();
  EXPECT_EQ(link.next_state().message_id, id);
}

TEST(ArmConnection, AWrongFirstNumberIsGivenUpForTwoThatFollowEachOther) {
  UdpPort port;
  const auto socket = ::socket(AF_INET, SOCK_DGRAM, 0);
  ASSERT_GE(socket, 0);
  sockaddr_in to{};
  to.sin_family = AF_INET;
  to.sin_port = htons(port.number());
  to.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  port.expect(dialect(10), to.sin_addr.s_addr);
  const auto takes = [&](std::uint64_t id) {
    RobotState state;
    state.message_id = id;
    std::array<std::byte, kMaxStateSize> bytes;
    const std::size_t size = encode(*dialect(10), state, bytes);
    EXPECT_GT(::sendto(socket, bytes.data(), size, 0, reinterpret_cast<const sockaddr*>(&to), sizeof(to)), 0);
    return port.receive();
  };
  constexpr std::uint64_t kHuge = ~0ull - 5;
  EXPECT_TRUE(takes(kHuge));
  EXPECT_FALSE(takes(kHuge)) << "a duplicate";
  EXPECT_FALSE(takes(1000));
  EXPECT_TRUE(takes(1001));
  EXPECT_EQ(port.state().message_id, 1001u);
  EXPECT_EQ(port.gap(), 0u);
  EXPECT_TRUE(takes(1004));
  EXPECT_EQ(port.gap(), 2u);
  for (const std::uint64_t wrong : {kHuge, std::uint64_t{5000}, std::uint64_t{90000}}) {
    EXPECT_FALSE(takes(wrong)) << "they do not follow each other";
  }
  EXPECT_FALSE(takes(3)) << "old";
  EXPECT_TRUE(takes(1005));
  ::close(socket);
}

// An arm that refuses a version may close or reset the connection before this end has looked.
class ClosedByTheArm : public testing::TestWithParam<bool> {};
INSTANTIATE_TEST_SUITE_P(, ClosedByTheArm, testing::Bool());
TEST_P(ClosedByTheArm, AReplyIsReadAlthoughTheConnectionIsClosed) {
  const int listener = ::socket(AF_INET, SOCK_STREAM, 0);
  sockaddr_in here{
      .sin_family = AF_INET, .sin_port = 0, .sin_addr = {htonl(INADDR_LOOPBACK)}, .sin_zero = {}};
  socklen_t size = sizeof(here);
  ASSERT_EQ(::bind(listener, reinterpret_cast<const sockaddr*>(&here), size), 0);
  ASSERT_EQ(::listen(listener, 1), 0);
  ASSERT_EQ(::getsockname(listener, reinterpret_cast<sockaddr*>(&here), &size), 0);
  TcpChannel channel(HeaderKind::arm, "left");
  channel.connect("127.0.0.1", ntohs(here.sin_port), kPatience);
  const int arm = ::accept(listener, nullptr, nullptr);
  std::array<std::byte, kMaxPlainReplySize> bytes{};
  const std::size_t length = encode_connect_reply(0, Status::incompatible_version, 5, bytes);
  ASSERT_EQ(::send(arm, bytes.data(), length, 0), static_cast<ssize_t>(length));
  const linger at_once{.l_onoff = GetParam() ? 1 : 0, .l_linger = 0};
  ASSERT_EQ(::setsockopt(arm, SOL_SOCKET, SO_LINGER, &at_once, sizeof(at_once)), 0);
  ::close(arm);
  ::close(listener);
  EXPECT_EQ(channel.wait(0, kPatience, "Connect").payload.size(), length - header_size(HeaderKind::arm));
  EXPECT_EQ(refusal([&] { channel.wait(1, kPatience, "Move"); }).kind(), ConnectionError::Kind::lost);
}

TEST(ArmConnection, TheVersionIsFoundWithRetriesAndRemembered) {
  FakeArm arm(5);
  ArmConnection link(options_for(arm));
  arm.hang_up_on(1, 2);  // after the refusal of version 10 the arm needs a moment
  link.connect();
  EXPECT_EQ(link.version(), 5);
  const auto connects = [&] {
    std::vector<int> versions;
    for (const auto& asked : arm.asked()) {
      ConnectRequest request;
      if (asked.command != Command::connect) continue;
      if (decode_request(*dialect(5), asked.payload, request) == WireResult::ok)
        versions.push_back(request.version);
    }
    return versions;
  };
  EXPECT_EQ(connects(), (std::vector<int>{10, 5}));
  link.connect();
  EXPECT_EQ(connects(), (std::vector<int>{10, 5, 5})) << "not asked again";
}

TEST(ArmConnection, LateEndsOfStoppedMotionsDoNotPileUp) {
  FakeArm arm(10);
  arm.report_ends_late();
  ArmConnection link(options_for(arm));
  link.connect();
  for (int k = 0; k < 300; ++k) {
    link.start_motion({});
    link.stop();
    ASSERT_FALSE(link.has_motion()) << k;
  }
  EXPECT_TRUE(link.is_connected());
}

}  // namespace
}  // namespace multipanda::fci::arm_connection_test
