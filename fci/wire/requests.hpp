#pragma once

#include <array>
#include <span>

#include "fci/wire/archive.hpp"
#include "fci/wire/commands.hpp"
#include "fci/wire/robot_state.hpp"
#include "fci/wire/statuses.hpp"

// Payloads of the arm's requests and replies. Names, units and frames of libfranka; matrices are
// column-major. Numbers are sent as doubles and are not checked: the receiver refuses a value that is out of
// range or not finite with Status::invalid_argument.
namespace multipanda::fci {

// In a Move request; the state's enumerations differ (MotionGeneratorMode, ControllerMode).
enum class MoveController : std::uint32_t { joint_impedance, cartesian_impedance, external };
enum class MoveGenerator : std::uint32_t {
  joint_position,
  joint_velocity,
  cartesian_position,
  cartesian_velocity,
  none
};

// Modes in the state while such a motion runs.
constexpr ControllerMode published(MoveController controller) {
  return static_cast<ControllerMode>(controller);
}
constexpr MotionGeneratorMode published(MoveGenerator generator) {
  return static_cast<MotionGeneratorMode>(static_cast<std::uint32_t>(generator) + 1);
}

// The same in every version, because it negotiates the version.
struct ConnectRequest {
  static constexpr Command kCommand = Command::connect;
  std::uint16_t version = kNewestVersion;
  std::uint16_t udp_port = 0;  // where the program receives states
};

struct MoveRequest {
  static constexpr Command kCommand = Command::move;
  struct Deviation {
    double translation = 0, rotation = 0, elbow = 0;  // [m], [rad], [rad]
  };
  MoveController controller = MoveController::external;
  MoveGenerator generator = MoveGenerator::none;
  // The values always sent by libfranka, too large to have an effect.
  Deviation maximum_path_deviation{10, 3.12, 6.283185307179586};
  Deviation maximum_goal_pose_deviation{10, 3.12, 6.283185307179586};
  bool use_async_motion_generator = false;
  std::array<double, 7> maximum_velocity{};  // of asynchronous motion [rad/s]
};

struct StopMoveRequest {
  static constexpr Command kCommand = Command::stop_move;
};

struct GetCartesianLimitRequest {
  static constexpr Command kCommand = Command::get_cartesian_limit;
  std::int32_t id = 0;
};
struct CartesianLimit {
  std::array<double, 3> object_p_max{};  // size of the virtual wall's box [m]
  std::array<double, 16> object_frame{};
  bool object_activation = false;
};

// Thresholds [N m], [N, N m]: lower ones report a contact, upper ones stop the arm; `acceleration` while the
// arm accelerates, `nominal` otherwise.
struct SetCollisionBehaviorRequest {
  static constexpr Command kCommand = Command::set_collision_behavior;
  std::array<double, 7> lower_torque_thresholds_acceleration{}, upper_torque_thresholds_acceleration{},
      lower_torque_thresholds_nominal{}, upper_torque_thresholds_nominal{};
  std::array<double, 6> lower_force_thresholds_acceleration{}, upper_force_thresholds_acceleration{},
      lower_force_thresholds_nominal{}, upper_force_thresholds_nominal{};
};

struct SetJointImpedanceRequest {
  static constexpr Command kCommand = Command::set_joint_impedance;
  std::array<double, 7> K_theta{};  // [N m/rad], 0 to 14250
};

struct SetCartesianImpedanceRequest {
  static constexpr Command kCommand = Command::set_cartesian_impedance;
  std::array<double, 6> K_x{};  // [N/m] 10 to 3000, [N m/rad] 1 to 300
};

struct SetGuidingModeRequest {
  static constexpr Command kCommand = Command::set_guiding_mode;
  std::array<std::uint8_t, 6> guiding_mode{};  // x y z roll pitch yaw: 1 may be moved by hand
  bool nullspace = false;
};

struct SetEEToKRequest {
  static constexpr Command kCommand = Command::set_ee_to_k;
  std::array<double, 16> EE_T_K{};
};

struct SetNEToEERequest {
  static constexpr Command kCommand = Command::set_ne_to_ee;
  std::array<double, 16> NE_T_EE{};
};

struct SetLoadRequest {
  static constexpr Command kCommand = Command::set_load;
  double m_load = 0;                  // [kg]
  std::array<double, 3> F_x_Cload{};  // [m], in the flange frame
  std::array<double, 9> I_load{};     // [kg m^2], about the load's center
};

struct SetFiltersRequest {
  static constexpr Command kCommand = Command::set_filters;
  // Cut-off frequencies [Hz]
  double joint_position = 0, joint_velocity = 0, cartesian_position = 0, cartesian_velocity = 0,
         controller = 0;
};

struct AutomaticErrorRecoveryRequest {
  static constexpr Command kCommand = Command::automatic_error_recovery;
};

enum class LibraryArchitecture : std::uint8_t { x64, x86, arm, arm64 };
enum class LibrarySystem : std::uint8_t { linux_os, windows };  // `linux` is a macro of some compilers
struct LoadModelLibraryRequest {
  static constexpr Command kCommand = Command::load_model_library;
  LibraryArchitecture architecture = LibraryArchitecture::x64;
  LibrarySystem system = LibrarySystem::linux_os;
};

struct GetRobotModelRequest {
  static constexpr Command kCommand = Command::get_robot_model;
};

// --- one description per message, for both directions ---

constexpr void carry(auto& a, MessageOf<ConnectRequest> auto& r, const Dialect&) {
  a.integer("version", r.version);
  a.integer("udp_port", r.udp_port);
}

constexpr void carry(auto& a, MessageOf<MoveRequest> auto& r, const Dialect& d) {
  a.choice("controller_mode", r.controller, MoveController::external);
  a.choice("motion_generator_mode", r.generator,
           d.has_none_generator() ? MoveGenerator::none : MoveGenerator::cartesian_velocity);
  for (auto* deviation : {&r.maximum_path_deviation, &r.maximum_goal_pose_deviation}) {
    a.number("translation", deviation->translation);
    a.number("rotation", deviation->rotation);
    a.number("elbow", deviation->elbow);
  }
  if (!d.has_asynchronous_motion()) return;
  a.flag("use_async_motion_generator", r.use_async_motion_generator);
  a.numbers("maximum_velocity", r.maximum_velocity);
}

constexpr void carry(auto& a, MessageOf<GetCartesianLimitRequest> auto& r, const Dialect&) {
  a.integer("id", r.id);
}

constexpr void carry(auto& a, MessageOf<CartesianLimit> auto& r, const Dialect&) {
  a.numbers("object_p_max", r.object_p_max);
  a.numbers("object_frame", r.object_frame);
  a.flag("object_activation", r.object_activation);
}

constexpr void carry(auto& a, MessageOf<SetCollisionBehaviorRequest> auto& r, const Dialect&) {
  a.numbers("lower_torque_thresholds_acceleration", r.lower_torque_thresholds_acceleration);
  a.numbers("upper_torque_thresholds_acceleration", r.upper_torque_thresholds_acceleration);
  a.numbers("lower_torque_thresholds_nominal", r.lower_torque_thresholds_nominal);
  a.numbers("upper_torque_thresholds_nominal", r.upper_torque_thresholds_nominal);
  a.numbers("lower_force_thresholds_acceleration", r.lower_force_thresholds_acceleration);
  a.numbers("upper_force_thresholds_acceleration", r.upper_force_thresholds_acceleration);
  a.numbers("lower_force_thresholds_nominal", r.lower_force_thresholds_nominal);
  a.numbers("upper_force_thresholds_nominal", r.upper_force_thresholds_nominal);
}

constexpr void carry(auto& a, MessageOf<SetJointImpedanceRequest> auto& r, const Dialect&) {
  a.numbers("K_theta", r.K_theta);
}

constexpr void carry(auto& a, MessageOf<SetCartesianImpedanceRequest> auto& r, const Dialect&) {
  a.numbers("K_x", r.K_x);
}

constexpr void carry(auto& a, MessageOf<SetGuidingModeRequest> auto& r, const Dialect&) {
  a.flags("guiding_mode", r.guiding_mode, r.guiding_mode.size());
  a.flag("nullspace", r.nullspace);
}

constexpr void carry(auto& a, MessageOf<SetEEToKRequest> auto& r, const Dialect&) {
  a.numbers("EE_T_K", r.EE_T_K);
}

constexpr void carry(auto& a, MessageOf<SetNEToEERequest> auto& r, const Dialect&) {
  a.numbers("NE_T_EE", r.NE_T_EE);
}

constexpr void carry(auto& a, MessageOf<SetLoadRequest> auto& r, const Dialect&) {
  a.number("m_load", r.m_load);
  a.numbers("F_x_Cload", r.F_x_Cload);
  a.numbers("I_load", r.I_load);
}

constexpr void carry(auto& a, MessageOf<SetFiltersRequest> auto& r, const Dialect&) {
  a.number("joint_position", r.joint_position);
  a.number("joint_velocity", r.joint_velocity);
  a.number("cartesian_position", r.cartesian_position);
  a.number("cartesian_velocity", r.cartesian_velocity);
  a.number("controller", r.controller);
}

constexpr void carry(auto& a, MessageOf<LoadModelLibraryRequest> auto& r, const Dialect&) {
  a.choice("architecture", r.architecture, LibraryArchitecture::arm64);
  a.choice("system", r.system, LibrarySystem::windows);
}

// Requests without payload
constexpr void carry(auto&, MessageOf<StopMoveRequest> auto&, const Dialect&) {}
constexpr void carry(auto&, MessageOf<AutomaticErrorRecoveryRequest> auto&, const Dialect&) {}
constexpr void carry(auto&, MessageOf<GetRobotModelRequest> auto&, const Dialect&) {}

// [bytes], without the header
template <class R>
constexpr std::size_t payload_size(const Dialect& d) {
  Measure a;
  const R r{};
  carry(a, r, d);
  return a.size();
}

// Whole requests, header included [bytes]
template <class R>
constexpr std::size_t request_size(const Dialect& d) {
  return kArmHeader + payload_size<R>(d);
}
static_assert(request_size<ConnectRequest>(*dialect(10)) == 16);
static_assert(request_size<MoveRequest>(*dialect(4)) == 68 && request_size<MoveRequest>(*dialect(9)) == 68);
static_assert(request_size<MoveRequest>(*dialect(10)) == 125);
static_assert(request_size<StopMoveRequest>(*dialect(10)) == 12);
static_assert(request_size<GetCartesianLimitRequest>(*dialect(5)) == 16);
static_assert(payload_size<CartesianLimit>(*dialect(5)) + 1 == 154);
static_assert(request_size<SetCollisionBehaviorRequest>(*dialect(10)) == 428);
static_assert(request_size<SetJointImpedanceRequest>(*dialect(10)) == 68);
static_assert(request_size<SetCartesianImpedanceRequest>(*dialect(10)) == 60);
static_assert(request_size<SetGuidingModeRequest>(*dialect(10)) == 19);
static_assert(request_size<SetEEToKRequest>(*dialect(10)) == 140);
static_assert(request_size<SetNEToEERequest>(*dialect(10)) == 140);
static_assert(request_size<SetLoadRequest>(*dialect(10)) == 116);
static_assert(request_size<SetFiltersRequest>(*dialect(5)) == 52);
static_assert(request_size<AutomaticErrorRecoveryRequest>(*dialect(10)) == 12);
static_assert(request_size<LoadModelLibraryRequest>(*dialect(5)) == 14);
static_assert(request_size<GetRobotModelRequest>(*dialect(10)) == 12);

// The largest request of any version: the space a server needs per message.
inline constexpr std::size_t kMaxRequestSize = request_size<SetCollisionBehaviorRequest>(kDialects.back());
// Replies with a fixed length are at most this long.
inline constexpr std::size_t kMaxPlainReplySize =
    kArmHeader + 1 + payload_size<CartesianLimit>(kDialects.front());

// Payload to request. The payload must have exactly the request's size. On errors `request` is partly filled.
template <class R>
[[nodiscard]] WireResult decode_request(const Dialect& d, std::span<const std::byte> payload, R& request) {
  Reader a(payload);
  carry(a, request, d);
  return a.result(true);
}

// A whole message, header included. 0: the version does not know the request, or `to` is too small.
template <class R>
std::size_t encode_request(const Dialect& d, std::uint32_t command_id_, const R& request,
                           std::span<std::byte> to) {
  const auto command = command_id(d, R::kCommand);
  const std::size_t size = request_size<R>(d);
  if (!command || to.size() < size) return 0;
  encode(HeaderKind::arm, {*command, command_id_, static_cast<std::uint32_t>(size)}, to);
  Writer a(to.subspan(kArmHeader));
  carry(a, request, d);
  return size;
}

// --- replies ---

// Header and status, 13 bytes, followed by `more` bytes of the caller: the text of GetRobotModel, the
// library, a CartesianLimit. A status that the version cannot express becomes the nearest one.
// Returns 0 in the cases of encode_request().
std::size_t encode_reply(const Dialect& d, Command command, std::uint32_t command_id, Status status,
                         std::span<std::byte> to, std::size_t more = 0);

// The answer to Connect, 15 bytes: `version` is the server's.
std::size_t encode_connect_reply(std::uint32_t command_id, Status status, std::uint16_t version,
                                 std::span<std::byte> to);

std::size_t encode(const Dialect& d, const CartesianLimit& limit, std::span<std::byte> to);

// A reply's payload: status first; the remainder is returned in `rest`.
[[nodiscard]] WireResult decode_reply(const Dialect& d, Command command, std::span<const std::byte> payload,
                                      Status& status, std::span<const std::byte>& rest);
[[nodiscard]] WireResult decode_connect_reply(std::span<const std::byte> payload, Status& status,
                                              std::uint16_t& version);

}  // namespace multipanda::fci
