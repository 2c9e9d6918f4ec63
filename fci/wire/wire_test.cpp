#include <bit>
#include <cstring>
#include <limits>
#include <random>
#include <set>

#include <gmock/gmock.h>

#include "fci/wire/error_flags.hpp"
#include "fci/wire/requests.hpp"
#include "fci/wire/state_layout.hpp"
#include "fci/wire/vacuum.hpp"

namespace multipanda::fci::wire_test {
namespace {

using testing::ElementsAreArray;

struct Place {
  std::string_view name;
  std::size_t count, v10, v5;  // numbers; offsets [bytes]
  double* (*of)(RobotState&);
};

#define FIELD(name, count, v10, v5)                                     \
  {                                                                     \
#name, count, v10, v5, [](RobotState & s) { return first(s.name); } \
  }
double* first(double& value) { return &value; }
template <std::size_t N>
double* first(std::array<double, N>& values) {
  return values.data();
}

// Literal numbers from the published structures, not computed.
const Place kPlaces[] = {
    FIELD(O_T_EE, 16, 8, 8),
    FIELD(O_T_EE_d, 16, 72, 136),
    FIELD(F_T_EE, 16, 136, 264),
    FIELD(EE_T_K, 16, 200, 392),
    FIELD(F_T_NE, 16, 264, 520),
    FIELD(NE_T_EE, 16, 328, 648),
    FIELD(m_ee, 1, 392, 776),
    FIELD(I_ee, 9, 396, 784),
    FIELD(F_x_Cee, 3, 432, 856),
    FIELD(m_load, 1, 444, 880),
    FIELD(I_load, 9, 448, 888),
    FIELD(F_x_Cload, 3, 484, 960),
    FIELD(elbow, 2, 496, 984),
    FIELD(elbow_d, 2, 504, 1000),
    FIELD(tau_J, 7, 512, 1016),
    FIELD(tau_J_d, 7, 540, 1072),
    FIELD(dtau_J, 7, 568, 1128),
    FIELD(q, 7, 596, 1184),
    FIELD(q_d, 7, 624, 1240),
    FIELD(dq, 7, 652, 1296),
    FIELD(dq_d, 7, 680, 1352),
    FIELD(ddq_d, 7, 708, 1408),
    FIELD(joint_contact, 7, 736, 1464),
    FIELD(cartesian_contact, 6, 764, 1520),
    FIELD(joint_collision, 7, 788, 1568),
    FIELD(cartesian_collision, 6, 816, 1624),
    FIELD(tau_ext_hat_filtered, 7, 840, 1672),
    FIELD(O_F_ext_hat_K, 6, 868, 1728),
    FIELD(K_F_ext_hat_K, 6, 892, 1776),
    FIELD(O_dP_EE_d, 6, 916, 1824),
    FIELD(O_ddP_O, 3, 940, 1872),
    FIELD(elbow_c, 2, 952, 1896),
    FIELD(delbow_c, 2, 960, 1912),
    FIELD(ddelbow_c, 2, 968, 1928),
    FIELD(O_T_EE_c, 16, 976, 1944),
    FIELD(O_dP_EE_c, 6, 1040, 2072),
    FIELD(O_ddP_EE_c, 6, 1064, 2120),
    FIELD(theta, 7, 1088, 2168),
    FIELD(dtheta, 7, 1116, 2224),
    FIELD(accelerometer_top, 18, 1144, 0),
    FIELD(accelerometer_bottom, 18, 1216, 0),
    FIELD(control_command_success_rate, 1, 1373, 2365),
};

// Every number has a different value, exact also as a float.
RobotState numbered_state() {
  RobotState s;
  s.message_id = 0x0102030405060708;
  double next = 1;
  for (const Place& place : kPlaces)
    for (std::size_t i = 0; i < place.count; ++i) place.of(s)[i] = (next += 0.25);
  s.motion_generator_mode = 4;
  s.controller_mode = 2;
  s.robot_mode = 6;
  for (std::size_t i = 0; i < kErrorCount; ++i) {
    s.errors[i] = i % 3 == 0;
    s.reflex_reason[i] = i % 5 == 1;
  }
  return s;
}

double number_at(std::span<const std::byte> bytes, std::size_t at, bool single) {
  if (!single) {
    double value = 0;
    std::memcpy(&value, bytes.data() + at, sizeof value);
    return value;
  }
  float value = 0;
  std::memcpy(&value, bytes.data() + at, sizeof value);
  return static_cast<double>(value);
}

class EveryVersion : public testing::TestWithParam<std::uint16_t> {
 protected:
  const Dialect& d = *dialect(GetParam());
};
INSTANTIATE_TEST_SUITE_P(Wire, EveryVersion,
                         testing::Range<std::uint16_t>(kOldestVersion, kNewestVersion + 1));

TEST(Wire, KnowsOnlyItsVersions) {
  EXPECT_EQ(dialect(3), nullptr);
  EXPECT_EQ(dialect(11), nullptr);
  EXPECT_EQ(dialect(0xffff), nullptr);
}

TEST_P(EveryVersion, StateHasTheOffsetsOfLibfranka) {
  RobotState s = numbered_state();
  std::array<std::byte, kMaxStateSize> bytes{};
  const std::size_t size = encode(d, s, bytes);
  const std::uint16_t v = GetParam();
  EXPECT_EQ(size, v == 10 ? 1377u : v >= 5 ? 2373u : 2341u);
  EXPECT_EQ(std::to_integer<int>(bytes[0]), 8);  // little-endian
  EXPECT_EQ(std::to_integer<int>(bytes[7]), 1);
  const std::size_t flags = v >= 5 ? 41 : 37;
  for (const Place& place : kPlaces) {
    std::size_t at = v == 10 ? place.v10 : place.v5;
    if (v < 10 && at == 0) continue;  // no accelerometers
    if (v == 4) {
      if (place.name == "O_ddP_O") continue;
      if (at > 1872) at -= 24;
      if (at > 2282) at -= 8;  // twice four flags fewer
    }
    EXPECT_EQ(state_offset(d, place.name), at) << place.name;
    for (std::size_t i = 0; i < place.count; ++i)
      EXPECT_EQ(number_at(bytes, at + i * (v == 10 ? 4 : 8), v == 10), place.of(s)[i])
          << place.name << ' ' << i;
  }
  const std::size_t modes = v == 10 ? 1288 : v >= 5 ? 2280 : 2256;
  EXPECT_EQ(std::to_integer<int>(bytes[modes]), 4);
  EXPECT_EQ(std::to_integer<int>(bytes[modes + 1]), 2);
  for (std::size_t i = 0; i < flags; ++i) {
    EXPECT_EQ(std::to_integer<int>(bytes[modes + 2 + i]), i % 3 == 0);
    EXPECT_EQ(std::to_integer<int>(bytes[modes + 2 + flags + i]), i % 5 == 1);
  }
  EXPECT_EQ(std::to_integer<int>(bytes[modes + 2 + 2 * flags]), 6);
}

TEST_P(EveryVersion, StateSurvivesARoundTrip) {
  RobotState sent = numbered_state();
  std::array<std::byte, kMaxStateSize + 8> bytes{};
  const std::size_t size = encode(d, sent, bytes);
  const std::span<const std::byte> all(bytes);
  RobotState back;
  ASSERT_EQ(decode(d, all.first(size), back), WireResult::ok);
  for (const Place& place : kPlaces) {
    const bool carried = state_offset(d, place.name) != Measure::kNowhere;
    for (std::size_t i = 0; i < place.count; ++i)
      EXPECT_EQ(place.of(back)[i], carried ? place.of(sent)[i] : 0) << place.name;
  }
  EXPECT_EQ(back.message_id, sent.message_id);
  EXPECT_EQ(back.robot_mode, 6);
  EXPECT_EQ(error_bits(back.errors) & 0x1fffffffff, error_bits(sent.errors) & 0x1fffffffff);
  EXPECT_EQ(decode(d, all.first(size + 8), back), WireResult::ok) << "longer states are fine";
  for (std::size_t shorter = 0; shorter < size; ++shorter)
    EXPECT_EQ(decode(d, all.first(shorter), back), WireResult::too_short);
  for (std::size_t room = 0; room < size; room += 13) {
    std::array<std::byte, kMaxStateSize> small{};
    EXPECT_EQ(encode(d, sent, std::span(small).first(room)), 0u);
  }
  const std::size_t mode = state_offset(d, "robot_mode");
  bytes[mode] = std::byte{7};
  EXPECT_EQ(decode(d, all.first(size), back), WireResult::bad_value);
}

TEST_P(EveryVersion, CommandHasTheOffsetsOfLibfranka) {
  RobotCommand c;
  c.message_id = 77;
  double next = 0;
  const auto number = [&](auto& values) {
    for (double& value : values) value = next += 0.1;  // needs a double
  };
  number(c.q_c);
  number(c.dq_c);
  number(c.O_T_EE_c);
  number(c.O_dP_EE_c);
  number(c.elbow_c);
  number(c.tau_J_d);
  c.motion_generation_finished = c.torque_command_finished = true;
  std::array<std::byte, kMaxCommandSize + 1> bytes{};
  const std::size_t size = encode(d, c, bytes);
  EXPECT_EQ(size, GetParam() >= 7 ? 371u : 370u);
  const auto expect = [&](std::size_t at, const auto& values) {
    for (std::size_t i = 0; i < values.size(); ++i) EXPECT_EQ(number_at(bytes, at + 8 * i, false), values[i]);
  };
  expect(8, c.q_c);
  expect(64, c.dq_c);
  expect(120, c.O_T_EE_c);
  expect(248, c.O_dP_EE_c);
  expect(296, c.elbow_c);
  expect(314, c.tau_J_d);
  EXPECT_EQ(bytes[312], std::byte{0});
  EXPECT_EQ(bytes[313], std::byte{1});
  if (size == 371) {
    EXPECT_EQ(bytes[370], std::byte{1});
  }

  RobotCommand back;
  ASSERT_EQ(decode(d, std::span(bytes).first(size), back), WireResult::ok);
  EXPECT_EQ(back.message_id, 77u);
  EXPECT_EQ(back.q_c, c.q_c);
  EXPECT_EQ(back.O_T_EE_c, c.O_T_EE_c);
  EXPECT_EQ(back.tau_J_d, c.tau_J_d);
  EXPECT_EQ(back.torque_command_finished, size == 371);
  EXPECT_EQ(decode(d, std::span(bytes).first(size + 1), back), WireResult::too_long);
  EXPECT_EQ(decode(d, std::span(bytes).first(size - 1), back), WireResult::too_short);
  c.q_c[2] = std::numeric_limits<double>::quiet_NaN();
  encode(d, c, bytes);
  ASSERT_EQ(decode(d, std::span(bytes).first(size), back), WireResult::ok);
  EXPECT_TRUE(std::isnan(back.q_c[2]));
}

// A request filled with seeded bytes survives a round trip; one byte more or less is refused.
template <class R>
void expect_round_trip(const Dialect& d, const R& request, const auto& same) {
  std::array<std::byte, kMaxRequestSize> bytes{};
  const std::size_t size = encode_request(d, 42, request, bytes);
  if (!command_id(d, R::kCommand)) {
    EXPECT_EQ(size, 0u);
    return;
  }
  ASSERT_EQ(size, request_size<R>(d)) << info(R::kCommand).name;
  MessageHeader header;
  ASSERT_EQ(decode(HeaderKind::arm, bytes, header), WireResult::ok);
  EXPECT_EQ(command_of(d, header.command), R::kCommand);
  EXPECT_EQ(header.command_id, 42u);
  EXPECT_EQ(header.size, size);
  const auto payload = std::span(bytes).first(size).subspan(kArmHeader);
  R back;
  ASSERT_EQ(decode_request(d, payload, back), WireResult::ok);
  EXPECT_TRUE(same(back)) << info(R::kCommand).name;
  std::array<std::byte, kMaxRequestSize + 1> longer{};
  EXPECT_EQ(decode_request(d, std::span(longer).first(payload.size() + 1), back), WireResult::too_long);
  if (!payload.empty()) {
    EXPECT_EQ(decode_request(d, payload.first(payload.size() - 1), back), WireResult::too_short);
  }
  EXPECT_EQ(encode_request(d, 1, request, std::span(bytes).first(size - 1)), 0u);
}

TEST_P(EveryVersion, RequestsSurviveARoundTrip) {
  const auto always = [](const auto&) { return true; };
  expect_round_trip(d, ConnectRequest{GetParam(), 50123},
                    [](const auto& r) { return r.version >= 4 && r.udp_port == 50123; });
  MoveRequest move{
      MoveController::cartesian_impedance, MoveGenerator::cartesian_velocity, {1, 2, 3}, {4, 5, 6}};
  move.use_async_motion_generator = true;
  move.maximum_velocity = {1, 2, 3, 4, 5, 6, 7};
  expect_round_trip(d, move, [&](const MoveRequest& r) {
    return r.controller == move.controller && r.generator == move.generator &&
           r.maximum_path_deviation.elbow == 3 && r.maximum_goal_pose_deviation.translation == 4 &&
           r.use_async_motion_generator == (GetParam() == 10) &&
           (r.maximum_velocity == move.maximum_velocity) == (GetParam() == 10);
  });
  expect_round_trip(d, StopMoveRequest{}, always);
  expect_round_trip(d, GetCartesianLimitRequest{-3}, [](const auto& r) { return r.id == -3; });
  SetCollisionBehaviorRequest collision;
  collision.upper_torque_thresholds_nominal[6] = 1;
  collision.lower_force_thresholds_acceleration[0] = 2;
  collision.upper_force_thresholds_nominal[5] = 3;
  expect_round_trip(d, collision, [](const auto& r) {
    return r.upper_torque_thresholds_nominal[6] == 1 && r.lower_force_thresholds_acceleration[0] == 2 &&
           r.upper_force_thresholds_nominal[5] == 3 && r.lower_torque_thresholds_acceleration[0] == 0;
  });
  expect_round_trip(d, SetJointImpedanceRequest{{1, 2, 3, 4, 5, 6, 7}},
                    [](const auto& r) { return r.K_theta[6] == 7; });
  expect_round_trip(d, SetCartesianImpedanceRequest{{1, 2, 3, 4, 5, 6}},
                    [](const auto& r) { return r.K_x[5] == 6; });
  expect_round_trip(d, SetGuidingModeRequest{{1, 0, 1, 0, 1, 0}, true}, [](const auto& r) {
    return r.guiding_mode[4] == 1 && r.guiding_mode[5] == 0 && r.nullspace;
  });
  expect_round_trip(d, SetEEToKRequest{{1, 2}}, [](const auto& r) { return r.EE_T_K[1] == 2; });
  expect_round_trip(d, SetNEToEERequest{{1, 2}}, [](const auto& r) { return r.NE_T_EE[1] == 2; });
  expect_round_trip(d, SetLoadRequest{1.5, {1, 2, 3}, {4}},
                    [](const auto& r) { return r.m_load == 1.5 && r.F_x_Cload[2] == 3 && r.I_load[0] == 4; });
  expect_round_trip(d, SetFiltersRequest{1, 2, 3, 4, 5}, [](const auto& r) { return r.controller == 5; });
  expect_round_trip(d, AutomaticErrorRecoveryRequest{}, always);
  expect_round_trip(d, LoadModelLibraryRequest{LibraryArchitecture::arm64, LibrarySystem::windows},
                    [](const auto& r) { return r.system == LibrarySystem::windows; });
  expect_round_trip(d, GetRobotModelRequest{}, always);
}

TEST_P(EveryVersion, RefusesUndefinedEnumerators) {
  std::array<std::byte, kMaxRequestSize> bytes{};
  const std::size_t size = encode_request(d, 1, MoveRequest{}, bytes);
  MoveRequest move;
  // `none` came with version 7
  EXPECT_EQ(decode_request(d, std::span(bytes).first(size).subspan(kArmHeader), move),
            GetParam() >= 7 ? WireResult::ok : WireResult::bad_value);
  bytes[kArmHeader] = std::byte{3};
  EXPECT_EQ(decode_request(d, std::span(bytes).first(size).subspan(kArmHeader), move), WireResult::bad_value);
}

// Numbers of requests and replies, as literals.
TEST(Wire, NumbersOfRequests) {
  const auto id = [](std::uint16_t v, Command c) {
    return static_cast<int>(command_id(*dialect(v), c).value_or(99));
  };
  for (const std::uint16_t v : std::initializer_list<std::uint16_t>{4, 5}) {
    EXPECT_EQ(id(v, Command::get_cartesian_limit), 3);
    EXPECT_EQ(id(v, Command::set_collision_behavior), 4);
    EXPECT_EQ(id(v, Command::set_load), 10);
    EXPECT_EQ(id(v, Command::set_filters), 11);
    EXPECT_EQ(id(v, Command::automatic_error_recovery), 12);
    EXPECT_EQ(id(v, Command::load_model_library), 13);
    EXPECT_EQ(id(v, Command::get_robot_model), 99);
  }
  for (const std::uint16_t v : std::initializer_list<std::uint16_t>{6, 7, 8, 9, 10}) {
    EXPECT_EQ(id(v, Command::get_cartesian_limit), 99);
    EXPECT_EQ(id(v, Command::set_collision_behavior), 3);
    EXPECT_EQ(id(v, Command::set_guiding_mode), 6);
    EXPECT_EQ(id(v, Command::set_load), 9);
    EXPECT_EQ(id(v, Command::automatic_error_recovery), 10);
    EXPECT_EQ(id(v, Command::load_model_library), v == 10 ? 99 : 11);
    EXPECT_EQ(id(v, Command::get_robot_model), v == 10 ? 11 : v >= 8 ? 12 : 99);
  }
}

TEST_P(EveryVersion, StatusesSurviveARoundTripOrBecomeTheNearest) {
  for (const CommandInfo& command : kCommands) {
    std::set<std::uint8_t> seen;
    for (std::size_t i = 0; i < kStatusCount; ++i) {
      const auto status = static_cast<Status>(i);
      const std::uint8_t byte = status_byte(d, command.command, status);
      const auto back = status_of(d, command.command, byte);
      ASSERT_TRUE(back);
      if (exact_status_byte(d, command.command, status)) {
        EXPECT_EQ(*back, status);
        EXPECT_TRUE(seen.insert(byte).second);
      } else {
        EXPECT_NE(*back, Status::success) << "a refusal must stay one: " << text(status);
        EXPECT_NE(*back, Status::motion_started);
      }
    }
    EXPECT_EQ(status_of(d, command.command, static_cast<std::uint8_t>(seen.size())), std::nullopt);
    EXPECT_EQ(status_of(d, command.command, 255), std::nullopt);
  }
}

TEST(Wire, NumbersOfStatuses) {
  const auto byte = [](std::uint16_t v, Command c, Status s) {
    return static_cast<int>(status_byte(*dialect(v), c, s));
  };
  EXPECT_EQ(byte(5, Command::move, Status::not_possible), 3);
  EXPECT_EQ(byte(5, Command::move, Status::reflex_aborted), 6);
  EXPECT_EQ(byte(5, Command::move, Status::emergency_aborted), 7);
  EXPECT_EQ(byte(5, Command::move, Status::preempted_by_safety), 2);
  EXPECT_EQ(byte(10, Command::move, Status::not_possible), 5);
  EXPECT_EQ(byte(10, Command::move, Status::invalid_argument), 7);
  EXPECT_EQ(byte(10, Command::move, Status::reflex_aborted), 8);
  EXPECT_EQ(byte(10, Command::move, Status::aborted), 11);
  EXPECT_EQ(byte(5, Command::stop_move, Status::reflex_aborted), 3);
  EXPECT_EQ(byte(6, Command::stop_move, Status::reflex_aborted), 4);
  EXPECT_EQ(byte(5, Command::automatic_error_recovery, Status::manual_recovery_required), 2);
  EXPECT_EQ(byte(10, Command::automatic_error_recovery, Status::manual_recovery_required), 3);
  EXPECT_EQ(byte(10, Command::set_load, Status::invalid_argument), 2);
  EXPECT_EQ(byte(10, Command::set_load, Status::rejected_by_safety), 3);
  EXPECT_EQ(byte(10, Command::get_robot_model, Status::rejected_by_safety), 2);
  EXPECT_EQ(byte(5, Command::load_model_library, Status::error), 1);
  EXPECT_EQ(byte(10, Command::connect, Status::incompatible_version), 1);
}

TEST_P(EveryVersion, Replies) {
  std::array<std::byte, 16> bytes{};
  EXPECT_EQ(encode_reply(d, Command::move, 9, Status::reflex_aborted, bytes), 13u);
  MessageHeader header;
  ASSERT_EQ(decode(HeaderKind::arm, bytes, header), WireResult::ok);
  EXPECT_EQ(header.command, 1u);
  EXPECT_EQ(header.command_id, 9u);
  EXPECT_EQ(header.size, 13u);
  Status status = Status::success;
  std::span<const std::byte> rest;
  ASSERT_EQ(decode_reply(d, Command::move, std::span(bytes).subspan(12, 1), status, rest), WireResult::ok);
  EXPECT_EQ(status, Status::reflex_aborted);
  EXPECT_TRUE(rest.empty());
  EXPECT_EQ(decode_reply(d, Command::move, {}, status, rest), WireResult::too_short);
  if (GetParam() >= 8) {
    EXPECT_EQ(encode_reply(d, Command::get_robot_model, 9, Status::success, bytes, 1000), 13u);
    ASSERT_EQ(decode(HeaderKind::arm, bytes, header), WireResult::ok);
    EXPECT_EQ(header.size, 1013u);
  }
  EXPECT_EQ(encode_connect_reply(3, Status::success, GetParam(), bytes), 15u);
  std::uint16_t version = 0;
  ASSERT_EQ(decode_connect_reply(std::span(bytes).subspan(12, 3), status, version), WireResult::ok);
  EXPECT_EQ(version, GetParam());
  EXPECT_EQ(decode_connect_reply(std::span(bytes).subspan(12, 2), status, version), WireResult::too_short);
}

TEST(Wire, ModesOfMoveAsTheStateShowsThem) {
  EXPECT_EQ(published(MoveGenerator::joint_position), MotionGeneratorMode::joint_position);
  EXPECT_EQ(published(MoveGenerator::cartesian_velocity), MotionGeneratorMode::cartesian_velocity);
  EXPECT_EQ(published(MoveGenerator::none), MotionGeneratorMode::none);
  EXPECT_EQ(published(MoveController::joint_impedance), ControllerMode::joint_impedance);
  EXPECT_EQ(published(MoveController::external), ControllerMode::external);
}

TEST(Wire, ErrorFlags) {
  EXPECT_EQ(kErrorNames[25], "communication_constraints_violation");
  EXPECT_EQ(kErrorNames[32], "controller_torque_discontinuity");
  EXPECT_EQ(kErrorNames[36], "joint_move_in_wrong_direction");
  EXPECT_EQ(std::set(kErrorNames.begin(), kErrorNames.end()).size(), 41u);
  const std::uint64_t bits = 1ull << 40 | 1ull << 25 | 1;
  EXPECT_EQ(error_bits(error_flags(bits)), bits);
}

// The gripper's bytes, as literals.
TEST(Wire, Gripper) {
  std::array<std::byte, kMaxGripperRequestSize> bytes{};
  ASSERT_EQ(encode_gripper_request(5, GripperGraspRequest{0.04, 0.005, 0.006, 0.1, 30}, bytes), 50u);
  const std::array<int, 10> header{2, 0, 5, 0, 0, 0, 50, 0, 0, 0};
  for (std::size_t i = 0; i < 10; ++i) EXPECT_EQ(std::to_integer<int>(bytes[i]), header[i]);
  EXPECT_EQ(number_at(bytes, 10, false), 0.04);
  EXPECT_EQ(number_at(bytes, 26, false), 0.006);
  EXPECT_EQ(number_at(bytes, 42, false), 30);
  GripperGraspRequest grasp;
  ASSERT_EQ(decode_gripper(std::span(bytes).subspan(10), grasp), WireResult::ok);
  EXPECT_EQ(grasp.speed, 0.1);
  EXPECT_EQ(decode_gripper(std::span(bytes).subspan(11), grasp), WireResult::too_short);
  EXPECT_EQ(encode_gripper_request(5, GripperMoveRequest{}, std::span(bytes).first(25)), 0u);

  std::array<std::byte, 14> reply{};
  ASSERT_EQ(encode_gripper_reply(3, 6, GripperStatus::unsuccessful, reply), 12u);
  EXPECT_EQ(reply[10], std::byte{2});
  GripperStatus status{};
  ASSERT_EQ(decode_gripper_reply(std::span(reply).subspan(10, 2), status), WireResult::ok);
  EXPECT_EQ(status, GripperStatus::unsuccessful);
  reply[11] = std::byte{1};
  EXPECT_EQ(decode_gripper_reply(std::span(reply).subspan(10, 2), status), WireResult::bad_value);
  ASSERT_EQ(encode_gripper_connect_reply(0, GripperStatus::success, 3, reply), 14u);
  std::uint16_t version = 0;
  ASSERT_EQ(decode_gripper_connect_reply(std::span(reply).subspan(10), status, version), WireResult::ok);
  EXPECT_EQ(version, 3);

  std::array<std::byte, kGripperStateSize> state{};
  ASSERT_EQ(encode_gripper(GripperState{7, 0.03, 0.08, true, 35}, state), 23u);
  EXPECT_EQ(number_at(state, 4, false), 0.03);
  EXPECT_EQ(number_at(state, 12, false), 0.08);
  EXPECT_EQ(state[20], std::byte{1});
  EXPECT_EQ(state[21], std::byte{35});
  GripperState back;
  ASSERT_EQ(decode_gripper(state, back, false), WireResult::ok);
  EXPECT_EQ(back.message_id, 7u);
  EXPECT_EQ(back.temperature, 35);
}

TEST(Wire, Vacuum) {
  std::array<std::byte, kMaxVacuumRequestSize> bytes{};
  ASSERT_EQ(encode_gripper_request(5, VacuumRequest{100, 3, 0x0102}, bytes), 20u);
  const std::array<int, 20> expected{1, 0, 5, 0, 0, 0, 20, 0, 0, 0, 100, 3, 2, 1, 0, 0, 0, 0, 0, 0};
  for (std::size_t i = 0; i < 20; ++i) EXPECT_EQ(std::to_integer<int>(bytes[i]), expected[i]) << i;
  ASSERT_EQ(encode_gripper_request(5, VacuumDropOffRequest{9}, bytes), 18u);
  std::array<std::byte, kVacuumStateSize> state{};
  ASSERT_EQ(encode_gripper(VacuumState{1, false, true, false, VacuumDeviceStatus::orange, 80, -700}, state),
            16u);
  EXPECT_EQ(state[5], std::byte{1});
  EXPECT_EQ(state[7], std::byte{2});
  EXPECT_EQ(state[8], std::byte{80});
  VacuumState back;
  ASSERT_EQ(decode_gripper(state, back, false), WireResult::ok);
  EXPECT_EQ(back.vacuum, -700);
  EXPECT_TRUE(back.part_detached);
  state[7] = std::byte{4};
  EXPECT_EQ(decode_gripper(state, back, false), WireResult::bad_value);
}

}  // namespace
}  // namespace multipanda::fci::wire_test
