#include "fci/client/arm_link.hpp"

#include <algorithm>
#include <chrono>
#include <poll.h>
#include <stdexcept>
#include <thread>

#include "fci/wire/error_flags.hpp"

namespace multipanda::fci {
namespace {

std::array<double, 16> column_major(const Pose& X) {
  std::array<double, 16> T{};
  for (std::size_t column = 0; column < 3; ++column) {
    for (std::size_t row = 0; row < 3; ++row) {
      T[4 * column + row] = X.rotation(static_cast<Eigen::Index>(row), static_cast<Eigen::Index>(column));
    }
    T[12 + column] = X.position[static_cast<Eigen::Index>(column)];
  }
  T[15] = 1;
  return T;
}

MoveController wire_controller(ArmController controller) {
  switch (controller) {
    case ArmController::joint_impedance:
      return MoveController::joint_impedance;
    case ArmController::cartesian_impedance:
      return MoveController::cartesian_impedance;
    case ArmController::external:
      return MoveController::external;
    case ArmController::other:
      break;
  }
  throw std::invalid_argument(
      "a motion needs a controller: joint_impedance, cartesian_impedance or external");
}

MoveGenerator wire_generator(MotionGenerator generator, const Dialect& dialect) {
  switch (generator) {
    case MotionGenerator::joint_position:
      return MoveGenerator::joint_position;
    case MotionGenerator::joint_velocity:
      return MoveGenerator::joint_velocity;
    case MotionGenerator::cartesian_pose:
      return MoveGenerator::cartesian_position;
    case MotionGenerator::cartesian_velocity:
      return MoveGenerator::cartesian_velocity;
    case MotionGenerator::none:
      return dialect.torque_only_needs_generator() ? MoveGenerator::joint_velocity : MoveGenerator::none;
    case MotionGenerator::idle:
      break;
  }
  throw std::invalid_argument("a motion needs a generator; `none` for torques only");
}

bool is_idle(const RobotState& state) {
  const auto generator = static_cast<MotionGeneratorMode>(state.motion_generator_mode);
  return (generator == MotionGeneratorMode::idle || generator == MotionGeneratorMode::none) &&
         static_cast<ControllerMode>(state.controller_mode) != ControllerMode::external;
}

std::string who(const ArmLinkOptions& options) {
  return options.name.empty() ? "arm at " + options.address : "arm " + options.name;
}

}  // namespace

ArmLink::ArmLink(ArmLinkOptions options)
    : options_(std::move(options)), channel_(HeaderKind::arm, who(options_)) {
  if (options_.name.empty()) options_.name = options_.address;
  if (options_.version != 0 && fci::dialect(static_cast<std::uint16_t>(options_.version)) == nullptr) {
    throw std::invalid_argument("arm '" + options_.name + "': protocol version " +
                                std::to_string(options_.version) +
                                " is not spoken here: 4 to 10, or 0 to ask");
  }
}

void ArmLink::refuse(LinkError::Kind kind, const std::string& text) const {
  throw LinkError(kind, who(options_) + ": " + text);
}

// ----------------------------------------------------------------------------------------------- connection

void ArmLink::connect() {
  close();
  int version = options_.version != 0 ? options_.version : kNewestVersion, offered = 0;
  if (!try_version(version, offered)) {
    const bool spoken = offered > 0 && fci::dialect(static_cast<std::uint16_t>(offered)) != nullptr;
    if (options_.version != 0 || !spoken) {
      close();
      refuse(LinkError::Kind::incompatible,
             "it speaks version " + std::to_string(offered) + " of the protocol, asked for was " +
                 std::to_string(version) +
                 (spoken ? ": leave the version out, or set it to " + std::to_string(offered)
                         : "; 4 to 10 are known here: update the arm's system or this program"));
    }
    version = offered;
    if (!try_version(version, offered)) {
      close();
      refuse(LinkError::Kind::incompatible, "it offers version " + std::to_string(version) +
                                                " of the protocol and refuses it: is it an arm?");
    }
  }
  try {
    (void)next_state(1);
  } catch (const LinkError&) {
    close();
    refuse(LinkError::Kind::timeout,
           "it agreed to a connection, but no state came for 1 s: does a firewall keep UDP from port " +
               std::to_string(port_.number()) + " of this computer?");
  }
}

bool ArmLink::try_version(int version, int& offered) {
  motion_.reset();
  channel_.connect(options_.address, options_.port, options_.connect_timeout_s);
  dialect_ = fci::dialect(static_cast<std::uint16_t>(version));
  if (options_.loop_reads_states)
    (void)copies_.take();  // a copy of the last connection is no state of this one
  port_.expect(dialect_, channel_.peer_address());
  const ConnectRequest request{.version = dialect_->version, .udp_port = port_.number()};
  const std::uint32_t id = post(request, "Connect");
  const auto reply = channel_.wait(id, options_.reply_timeout_s, "Connect");
  Status status{};
  std::uint16_t answered = 0;
  if (decode_connect_reply(reply.payload, status, answered) != WireResult::ok) {
    close();
    refuse(LinkError::Kind::protocol, "its answer to Connect is none: is it an arm?");
  }
  offered = answered;
  if (status == Status::success) return true;
  close();
  return false;
}

void ArmLink::close() noexcept {
  channel_.close();
  port_.expect(nullptr, 0);
  motion_.reset();
  seen_ = {};
}

// --------------------------------------------------------------------------------------------------- states

bool ArmLink::receive() noexcept {
  const bool fresh = port_.receive();
  if (fresh && options_.loop_reads_states) copies_.write(port_.state());
  return fresh;
}

bool ArmLink::look_for_state(double timeout_s) {
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
      std::this_thread::sleep_for(std::chrono::microseconds(200));
    } else {
      pollfd watched{.fd = port_.file(), .events = POLLIN, .revents = 0};
      (void)::poll(&watched, 1, std::max(1, static_cast<int>(left * 1e3)));
    }
  }
}

const RobotState& ArmLink::look() {
  (void)look_for_state(0);
  return seen_;
}

const RobotState& ArmLink::next_state(double timeout_s) {
  if (!look_for_state(timeout_s)) {
    refuse(LinkError::Kind::timeout, "no state came: check cable and arm, then reconnect");
  }
  return seen_;
}

bool ArmLink::wait_for_state(const std::function<bool(const RobotState&)>& condition, double timeout_s) {
  const HostTime begun = host_now();
  if (seen_.message_id != 0 && condition(seen_)) return true;
  while (true) {
    const double left = timeout_s - seconds(host_now() - begun);
    if (left <= 0 || !look_for_state(left)) return false;
    if (condition(seen_)) return true;
  }
}

// ------------------------------------------------------------------------------------------------- requests

template <class Request>
std::uint32_t ArmLink::post(const Request& request, const char* what) {
  if (dialect_ == nullptr || !is_connected()) {
    refuse(LinkError::Kind::lost, "there is no connection: connect first");
  }
  std::array<std::byte, kMaxRequestSize> message;
  const std::uint32_t id = channel_.next_id();
  const std::size_t size = encode_request(*dialect_, id, request, message);
  if (size == 0) {
    refuse(LinkError::Kind::refused, std::string(what) + " does not exist in version " +
                                         std::to_string(version()) + " of the protocol");
  }
  channel_.send(std::span(message).first(size), options_.reply_timeout_s);
  return id;
}

Status ArmLink::status_of_reply(Command command, const TcpChannel::Reply& reply,
                                std::span<const std::byte>& rest) {
  Status status{};
  if (reply.command != command_id(*dialect_, command) ||
      decode_reply(*dialect_, command, reply.payload, status, rest) != WireResult::ok) {
    close();
    refuse(LinkError::Kind::protocol, "its answer to " + std::string(info(command).name) +
                                          " is none of version " + std::to_string(dialect_->version));
  }
  return status;
}

// Sends, waits, and throws unless the answer is yes. What follows the status is returned.
template <class Request>
std::vector<std::byte> ArmLink::ask(const Request& request, const char* what, double timeout_s) {
  const std::uint32_t id = post(request, what);
  const auto reply = channel_.wait(id, timeout_s, what);
  std::span<const std::byte> rest;
  const Status status = status_of_reply(Request::kCommand, reply, rest);
  if (status == Status::success) return {rest.begin(), rest.end()};
  (void)look_for_state(0);
  std::string why;
  switch (status) {
    case Status::not_possible:
      why = refusal_in_mode(options_.name, seen_);
      break;
    case Status::invalid_argument:
      why = "the arm does not accept the values: see the ranges in docs/real_arms.md";
      break;
    case Status::rejected_by_safety:
      why = "a safety function of the arm forbids it: look at the safety settings in the arm's web interface";
      break;
    case Status::manual_recovery_required:
      why =
          "the arm must be moved by hand first (it stands beyond a limit, or was pushed there): unlock it in "
          "the "
          "arm's web interface, move it, then recover again";
      break;
    default:
      why = text(status);
  }
  refuse(LinkError::Kind::refused, std::string(what) + ": " + why);
}

void ArmLink::set_collision_behavior(const SetCollisionBehaviorRequest& thresholds) {
  (void)ask(thresholds, "set collision thresholds", options_.reply_timeout_s);
}

void ArmLink::set_collision_behavior(const std::array<double, 7>& lower_torque,
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

void ArmLink::set_joint_impedance(const std::array<double, 7>& K_theta) {
  (void)ask(SetJointImpedanceRequest{K_theta}, "set joint stiffness", options_.reply_timeout_s);
}

void ArmLink::set_cartesian_impedance(const std::array<double, 6>& K_x) {
  (void)ask(SetCartesianImpedanceRequest{K_x}, "set Cartesian stiffness", options_.reply_timeout_s);
}

void ArmLink::set_guiding_mode(const std::array<bool, 6>& axes, bool elbow) {
  SetGuidingModeRequest request;
  for (std::size_t i = 0; i < axes.size(); ++i) request.guiding_mode[i] = axes[i] ? 1 : 0;
  request.nullspace = elbow;
  (void)ask(request, "set guiding mode", options_.reply_timeout_s);
}

void ArmLink::set_K(const Pose& X_EK) {
  (void)ask(SetEEToKRequest{column_major(X_EK)}, "set stiffness frame", options_.reply_timeout_s);
}

void ArmLink::set_EE(const Pose& X_NE_E) {
  (void)ask(SetNEToEERequest{column_major(X_NE_E)}, "set end-effector frame", options_.reply_timeout_s);
}

void ArmLink::set_load(const Load& load) {
  SetLoadRequest request{.m_load = load.mass};
  Eigen::Map<Vector3>(request.F_x_Cload.data()) = load.p_FC;
  Eigen::Map<Matrix3>(request.I_load.data()) = load.inertia_C;
  (void)ask(request, "set load", options_.reply_timeout_s);
}

void ArmLink::set_filters(const SetFiltersRequest& cut_off) {
  (void)ask(cut_off, "set filters", options_.reply_timeout_s);
}

CartesianLimit ArmLink::cartesian_limit(int id) {
  const auto bytes = ask(GetCartesianLimitRequest{id}, "get a virtual wall", options_.reply_timeout_s);
  CartesianLimit limit;
  Reader reader(bytes);
  carry(reader, limit, *dialect_);
  if (reader.result(false) != WireResult::ok) {
    close();
    refuse(LinkError::Kind::protocol, "its answer to GetCartesianLimit is too short");
  }
  return limit;
}

std::string ArmLink::robot_model() {
  const auto bytes = ask(GetRobotModelRequest{}, "get the arm's model", options_.model_timeout_s);
  return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}

std::vector<std::byte> ArmLink::model_library(LibraryArchitecture architecture, LibrarySystem system) {
  return ask(LoadModelLibraryRequest{architecture, system}, "get the arm's model library",
             options_.model_timeout_s);
}

void ArmLink::recover() {
  (void)ask(AutomaticErrorRecoveryRequest{}, "recover", options_.recovery_timeout_s);
  (void)wait_for_state([](const RobotState& s) { return s.robot_mode == static_cast<int>(RobotMode::idle); });
}

// --------------------------------------------------------------------------------------------------- motion

void ArmLink::start_motion(const MotionRequest& request) {
  if (dialect_ == nullptr || !is_connected()) {
    refuse(LinkError::Kind::lost, "there is no connection: connect first");
  }
  MoveRequest move{.controller = wire_controller(request.controller),
                   .generator = wire_generator(request.generator, *dialect_)};
  if (request.generator == MotionGenerator::none && request.controller != ArmController::external) {
    throw std::invalid_argument("a motion without generator needs the external controller: torques only");
  }
  if (request.asynchronous) {
    if (!dialect_->has_asynchronous_motion()) {
      refuse(LinkError::Kind::refused, "asynchronous motion does not exist in version " +
                                           std::to_string(version()) + " of the protocol");
    }
    if (move.generator != MoveGenerator::joint_position ||
        move.controller != MoveController::joint_impedance || request.dq_max.size() != 7) {
      throw std::invalid_argument(
          "asynchronous motion is of joint positions, by the arm's joint impedance, with seven largest "
          "velocities");
    }
    move.use_async_motion_generator = true;
    Eigen::Map<Eigen::Matrix<double, 7, 1>>(move.maximum_velocity.data()) = request.dq_max;
  }
  const std::uint32_t id = post(move, "start a motion");
  const auto reply = channel_.wait(id, options_.reply_timeout_s, "Move");
  std::span<const std::byte> rest;
  const Status status = status_of_reply(Command::move, reply, rest);
  if (status == Status::motion_started) {
    motion_ = Motion{id, published(move.generator), published(move.controller)};
    return;
  }
  (void)look_for_state(0);
  std::string why;
  if (status == Status::not_possible) {
    why = refusal_in_mode(options_.name, seen_);
  } else if (status == Status::singular) {
    why = "the arm stands in a singular pose (stretched or folded): move its joints away from there first";
  } else if (status == Status::invalid_argument) {
    why = "the arm does not know this combination of controller and generator";
  } else {
    why = text(status);
  }
  refuse(LinkError::Kind::refused, "start a motion: " + why);
}

void ArmLink::wait_until_running(double timeout_s) {
  const HostTime begun = host_now();
  while (motion_) {
    if (seen_.motion_generator_mode == static_cast<std::uint8_t>(motion_->generator) &&
        seen_.controller_mode == static_cast<std::uint8_t>(motion_->controller)) {
      return;
    }
    if (const auto end = poll_motion()) {
      refuse(LinkError::Kind::aborted, "the motion ended before it began: " + end->text);
    }
    const double left = timeout_s - seconds(host_now() - begun);
    if (left <= 0) refuse(LinkError::Kind::timeout, "it agreed to a motion, but no state shows it");
    (void)look_for_state(std::min(left, 0.05));
  }
  refuse(LinkError::Kind::aborted, "no motion was started");
}

MotionOutcome ArmLink::outcome(Status status) const {
  MotionOutcome result{.status = status, .text = {}};
  switch (status) {
    case Status::success:
      break;
    case Status::preempted:
      result.text = "the motion was stopped on request";
      break;
    case Status::preempted_by_safety:
      result.text = "a safety function of the arm stopped the motion";
      break;
    case Status::reflex_aborted:
      result.text = "a reflex stopped the motion";
      break;
    case Status::emergency_aborted:
      result.text = "the user stop was pressed";
      break;
    case Status::input_error_aborted:
      result.text = "a command was no command";
      break;
    default:
      result.text = fci::text(status);
  }
  return result;
}

std::optional<MotionOutcome> ArmLink::poll_motion() {
  channel_.read_available();
  if (!motion_) return std::nullopt;
  const auto reply = channel_.take(motion_->command_id);
  if (!reply) return std::nullopt;
  std::span<const std::byte> rest;
  const Status status = status_of_reply(Command::move, *reply, rest);
  motion_.reset();
  return outcome(status);
}

MotionOutcome ArmLink::wait_for_end(double timeout_s) {
  const HostTime begun = host_now();
  while (motion_) {
    if (auto end = poll_motion()) return *end;
    const double left = timeout_s - seconds(host_now() - begun);
    if (left <= 0) break;
    pollfd watched{.fd = channel_.file(), .events = POLLIN, .revents = 0};
    (void)::poll(&watched, 1, std::max(1, static_cast<int>(left * 1e3)));
  }
  if (!motion_) return {.status = Status::success, .text = {}};
  throw LinkError(LinkError::Kind::timeout, who(options_) + ": the motion still runs: stop it");
}

void ArmLink::stop() {
  (void)ask(StopMoveRequest{}, "stop", options_.reply_timeout_s);
  (void)wait_for_state(is_idle);
  (void)poll_motion();
}

void ArmLink::mark_finished(const Dialect& dialect, bool has_generator, RobotCommand& command) noexcept {
  if (has_generator || dialect.torque_only_needs_generator()) {
    command.motion_generation_finished = true;
  } else {
    command.torque_command_finished = true;
  }
}

MotionOutcome ArmLink::finish(RobotCommand last, double timeout_s) {
  if (options_.loop_reads_states || !motion_) {
    refuse(LinkError::Kind::refused, "there is no motion to be finished from here");
  }
  const HostTime begun = host_now();
  mark_finished(*dialect_, motion_->generator != MotionGeneratorMode::none, last);
  (void)send(last);
  while (seconds(host_now() - begun) < timeout_s) {
    if (is_idle(next_state(timeout_s))) break;
    (void)send(last);
  }
  return wait_for_end(std::max(0.1, timeout_s - seconds(host_now() - begun)));
}

// ---------------------------------------------------------------------------------------------------- words

std::string_view mode_name(std::uint8_t robot_mode) {
  switch (static_cast<RobotMode>(robot_mode)) {
    case RobotMode::other:
      return "other";
    case RobotMode::idle:
      return "idle";
    case RobotMode::move:
      return "move";
    case RobotMode::guiding:
      return "guiding";
    case RobotMode::reflex:
      return "reflex";
    case RobotMode::user_stopped:
      return "user stopped";
    case RobotMode::automatic_error_recovery:
      return "recovering";
  }
  return "unknown";
}

std::string error_list(const RobotState& state) {
  std::string list;
  for (std::size_t i = 0; i < kErrorCount; ++i) {
    if (state.errors[i] == 0) continue;
    list += (list.empty() ? "" : ", ") + std::string(kErrorNames[i]);
  }
  return list.empty() ? list : "(" + list + ") ";
}

std::string refusal_in_mode(const std::string& arm, const RobotState& state) {
  const std::string text = "not possible in mode " + std::string(mode_name(state.robot_mode)) + ": ";
  switch (static_cast<RobotMode>(state.robot_mode)) {
    case RobotMode::move:
      return text + "stop the motion first";
    case RobotMode::guiding:
      return text + "let go of the guiding buttons";
    case RobotMode::reflex:
      return text + error_list(state) + "run `multipanda ctl recover " + arm + "`";
    case RobotMode::user_stopped:
      return text + "release the stop button, then run `multipanda ctl recover " + arm + "`";
    case RobotMode::automatic_error_recovery:
      return text + "wait until it is done";
    case RobotMode::other:
      return text + "are the joints unlocked (brakes open) and the FCI activated in the arm's web interface?";
    case RobotMode::idle:
      break;
  }
  return text + "look at the arm's web interface";
}

}  // namespace multipanda::fci
