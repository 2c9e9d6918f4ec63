#include "fci/client/arm_connection.hpp"

#include <algorithm>
#include <array>
#include <chrono>
#include <cstdio>
#include <poll.h>
#include <stdexcept>
#include <thread>

#include "fci/client/arm_connection_ask.hpp"

namespace multipanda::fci {
namespace {

std::string who(const ArmConnectionOptions& options) {
  return options.name.empty() ? "arm at " + options.address : "arm " + options.name;
}

}  // namespace

ArmConnection::ArmConnection(ArmConnectionOptions options)
    : options_(std::move(options)), channel_(HeaderKind::arm, who(options_)) {
  if (options_.name.empty()) options_.name = options_.address;
  if (options_.version != 0 && fci::dialect(static_cast<std::uint16_t>(options_.version)) == nullptr) {
    throw std::invalid_argument("arm '" + options_.name + "': protocol version " +
                                std::to_string(options_.version) +
                                " is not supported: expected 4 to 10, or 0 to ask the arm");
  }
}

void ArmConnection::refuse(ConnectionError::Kind kind, const std::string& text) const {
  throw ConnectionError(kind, who(options_) + ": " + text);
}

// --- connection ---

void ArmConnection::connect() {
  close();
  int version = options_.version != 0  ? options_.version
                : spoken_version_ != 0 ? spoken_version_
                                       : kNewestVersion;
  int offered = 0;
  if (!try_version(version, offered)) {
    const bool spoken = offered > 0 && fci::dialect(static_cast<std::uint16_t>(offered)) != nullptr;
    if (options_.version != 0 || !spoken) {
      close();
      refuse(ConnectionError::Kind::incompatible,
             "it has version " + std::to_string(offered) + " of the protocol, but the scene requests " +
                 std::to_string(version) +
                 (spoken ? ": omit the version, or set it to " + std::to_string(offered)
                         : "; versions 4 to 10 are supported: update the arm's system or this program"));
    }
    version = offered;
    if (!try_offered_version(version, offered)) {
      close();
      refuse(ConnectionError::Kind::incompatible,
             "it offers version " + std::to_string(version) +
                 " of the protocol and refuses it: check that the address is an arm's");
    }
  }
  spoken_version_ = version;
  try {
    (void)next_state();
  } catch (const ConnectionError&) {
    close();
    refuse(ConnectionError::Kind::timeout, "it accepted the connection, but sent no state for " +
                                               in_seconds(options_.state_timeout_s) +
                                               ": check that no firewall blocks UDP to port " +
                                               std::to_string(port_.number()) + " of this computer");
  }
}

// The refusal of the first version closed the connection; an arm may need a moment before it accepts the
// next one.
bool ArmConnection::try_offered_version(int version, int& offered) {
  constexpr int kTries = 10;
  constexpr std::chrono::milliseconds kPause{100};
  for (int tries = 1;; ++tries) {
    try {
      return try_version(version, offered);
    } catch (const ConnectionError& error) {
      const bool passes =
          error.kind() == ConnectionError::Kind::unreachable || error.kind() == ConnectionError::Kind::lost;
      if (!passes || tries == kTries) throw;
    }
    std::this_thread::sleep_for(kPause);
  }
}

bool ArmConnection::try_version(int version, int& offered) {
  motion_.reset();
  channel_.connect(options_.address, options_.port, options_.connect_timeout_s);
  dialect_ = fci::dialect(static_cast<std::uint16_t>(version));
  if (options_.loop_reads_states) (void)copies_.take();  // discard a state of the previous connection
  port_.expect(dialect_, channel_.peer_address());
  const ConnectRequest request{.version = dialect_->version, .udp_port = port_.number()};
  const std::uint32_t id = post(request, "Connect");
  const auto reply = channel_.wait(id, options_.reply_timeout_s, "Connect");
  Status status{};
  std::uint16_t answered = 0;
  if (decode_connect_reply(reply.payload, status, answered) != WireResult::ok) {
    close();
    refuse(ConnectionError::Kind::protocol,
           "its answer to Connect is invalid: check that the address is an arm's");
  }
  offered = answered;
  if (status == Status::success) return true;
  close();
  return false;
}

void ArmConnection::close() noexcept {
  channel_.close();
  port_.expect(nullptr, 0);
  motion_.reset();
  seen_ = {};
}

// --- states ---

bool ArmConnection::receive() noexcept {
  const bool fresh = port_.receive();
  if (fresh && options_.loop_reads_states) copies_.write(port_.state());
  return fresh;
}

bool ArmConnection::look_for_state(double timeout_s) {
  const HostTime begun = host_now();
  while (true) {
    if (options_.loop_reads_states) {
      if (copies_.take()) {
        seen_ = copies_.value();
        return true;
      }
    } else if (receive()) {
      seen_ = port_.state();
      return true;
    }
    const double left = timeout_s - seconds(host_now() - begun);
    if (left <= 0) return false;
    if (options_.loop_reads_states) {
      (void)gaps().look();
      std::this_thread::sleep_for(std::chrono::microseconds(200));
      (void)gaps().look();
    } else {
      pollfd watched{.fd = port_.file(), .events = POLLIN, .revents = 0};
      (void)::poll(&watched, 1, std::max(1, static_cast<int>(left * 1e3)));
    }
  }
}

const RobotState& ArmConnection::look() {
  (void)look_for_state(0);
  return seen_;
}

const RobotState& ArmConnection::next_state(std::optional<double> timeout_s) {
  if (!look_for_state(timeout_s.value_or(options_.state_timeout_s))) {
    refuse(ConnectionError::Kind::timeout, "no state arrived: check cable and arm, then reconnect");
  }
  return seen_;
}

bool ArmConnection::wait_for_state(const std::function<bool(const RobotState&)>& condition,
                                   std::optional<double> timeout_s) {
  const HostTime begun = host_now();
  const double longest = timeout_s.value_or(options_.state_timeout_s);
  if (seen_.message_id != 0 && condition(seen_)) return true;
  while (true) {
    const double left = longest - seconds(host_now() - begun);
    if (left <= 0 || !look_for_state(left)) return false;
    if (condition(seen_)) return true;
  }
}

// --- requests ---

Status ArmConnection::status_of_reply(Command command, const TcpChannel::Reply& reply,
                                      std::span<const std::byte>& rest) {
  Status status{};
  if (reply.command != command_id(*dialect_, command) ||
      decode_reply(*dialect_, command, reply.payload, status, rest) != WireResult::ok) {
    close();
    refuse(ConnectionError::Kind::protocol, "its answer to " + std::string(info(command).name) +
                                                " is not valid in version " +
                                                std::to_string(dialect_->version));
  }
  return status;
}

void ArmConnection::set_collision_behavior(const SetCollisionBehaviorRequest& thresholds) {
  (void)ask(thresholds, "set collision thresholds", options_.reply_timeout_s);
}

void ArmConnection::set_collision_behavior(const std::array<double, 7>& lower_torque,
                                           const std::array<double, 7>& upper_torque,
                                           const std::array<double, 6>& lower_force,
                                           const std::array<double, 6>& upper_force) {
  set_collision_behavior({.lower_torque_thresholds_acceleration = lower_torque,
                          .upper_torque_thresholds_acceleration = upper_torque,
                          .lower_torque_thresholds_nominal = lower_torque,
                          .upper_torque_thresholds_nominal = upper_torque,
                          .lower_force_thresholds_acceleration = lower_force,
                          .upper_force_thresholds_acceleration = upper_force,
                          .lower_force_thresholds_nominal = lower_force,
                          .upper_force_thresholds_nominal = upper_force});
}

void ArmConnection::set_joint_impedance(const std::array<double, 7>& K_theta) {
  (void)ask(SetJointImpedanceRequest{K_theta}, "set joint stiffness", options_.reply_timeout_s);
}

void ArmConnection::set_cartesian_impedance(const std::array<double, 6>& K_x) {
  (void)ask(SetCartesianImpedanceRequest{K_x}, "set Cartesian stiffness", options_.reply_timeout_s);
}

void ArmConnection::set_guiding_mode(const std::array<bool, 6>& axes, bool elbow) {
  SetGuidingModeRequest request;
  for (std::size_t i = 0; i < axes.size(); ++i) request.guiding_mode[i] = axes[i] ? 1 : 0;
  request.nullspace = elbow;
  (void)ask(request, "set guiding mode", options_.reply_timeout_s);
}

void ArmConnection::set_K(const Pose& X_EK) {
  (void)ask(SetEEToKRequest{column_major(X_EK)}, "set stiffness frame", options_.reply_timeout_s);
}

void ArmConnection::set_EE(const Pose& X_NE_E) {
  (void)ask(SetNEToEERequest{column_major(X_NE_E)}, "set end-effector frame", options_.reply_timeout_s);
}

void ArmConnection::set_load(const Load& load) {
  SetLoadRequest request{.m_load = load.mass};
  Eigen::Map<Vector3>(request.F_x_Cload.data()) = load.p_FC;
  Eigen::Map<Matrix3>(request.I_load.data()) = load.inertia_C;
  (void)ask(request, "set load", options_.reply_timeout_s);
}

void ArmConnection::set_filters(const SetFiltersRequest& cut_off) {
  (void)ask(cut_off, "set filters", options_.reply_timeout_s);
}

CartesianLimit ArmConnection::cartesian_limit(int id) {
  const auto bytes = ask(GetCartesianLimitRequest{id}, "get a virtual wall", options_.reply_timeout_s);
  CartesianLimit limit;
  Reader reader(bytes);
  carry(reader, limit, *dialect_);
  if (reader.result(false) != WireResult::ok) {
    close();
    refuse(ConnectionError::Kind::protocol, "its answer to GetCartesianLimit is too short");
  }
  return limit;
}

std::string ArmConnection::robot_model() {
  const auto bytes = ask(GetRobotModelRequest{}, "get the arm's model", options_.model_timeout_s);
  return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}

std::vector<std::byte> ArmConnection::model_library(LibraryArchitecture architecture, LibrarySystem system) {
  return ask(LoadModelLibraryRequest{architecture, system}, "get the arm's model library",
             options_.model_timeout_s);
}

void ArmConnection::recover() {
  (void)ask(AutomaticErrorRecoveryRequest{}, "recover", options_.recovery_timeout_s);
  (void)wait_for_state([](const RobotState& s) { return s.robot_mode == static_cast<int>(RobotMode::idle); });
}

}  // namespace multipanda::fci
