#include <algorithm>
#include <poll.h>
#include <stdexcept>

#include "fci/client/arm_connection_ask.hpp"

// Starts, monitors and ends motions.
namespace multipanda::fci {
namespace {

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
  throw std::invalid_argument("a motion needs a generator; use `none` for torque control");
}

bool is_idle(const RobotState& state) {
  const auto generator = static_cast<MotionGeneratorMode>(state.motion_generator_mode);
  return (generator == MotionGeneratorMode::idle || generator == MotionGeneratorMode::none) &&
         static_cast<ControllerMode>(state.controller_mode) != ControllerMode::external;
}

}  // namespace

void ArmConnection::start_motion(const MotionRequest& request) {
  if (dialect_ == nullptr || !is_connected()) {
    refuse(ConnectionError::Kind::lost, "there is no connection: connect first");
  }
  MoveRequest move{.controller = wire_controller(request.controller),
                   .generator = wire_generator(request.generator, *dialect_)};
  if (request.generator == MotionGenerator::none && request.controller != ArmController::external) {
    throw std::invalid_argument("a motion without a generator needs the external controller");
  }
  if (request.asynchronous) {
    if (!dialect_->has_asynchronous_motion()) {
      refuse(ConnectionError::Kind::refused, "asynchronous motion is not available in version " +
                                                 std::to_string(version()) + " of the protocol");
    }
    if (move.generator != MoveGenerator::joint_position ||
        move.controller != MoveController::joint_impedance || request.dq_max.size() != 7) {
      throw std::invalid_argument(
          "asynchronous motion needs joint positions, joint impedance and seven maximum velocities");
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
    why = "the arm is in a singular pose (stretched or folded): move its joints away from there first";
  } else if (status == Status::invalid_argument) {
    why = "the arm does not support this combination of controller and generator";
  } else {
    why = text(status);
  }
  refuse(ConnectionError::Kind::refused, "start a motion: " + why);
}

void ArmConnection::wait_until_running(std::optional<double> timeout_s) {
  const HostTime begun = host_now();
  const double longest = timeout_s.value_or(options_.state_timeout_s);
  while (motion_) {
    if (seen_.motion_generator_mode == static_cast<std::uint8_t>(motion_->generator) &&
        seen_.controller_mode == static_cast<std::uint8_t>(motion_->controller)) {
      return;
    }
    if (const auto end = poll_motion()) {
      refuse(ConnectionError::Kind::aborted, "the motion ended before it started: " + end->text);
    }
    const double left = longest - seconds(host_now() - begun);
    if (left <= 0)
      refuse(ConnectionError::Kind::timeout, "it accepted a motion, but its state does not show it");
    (void)look_for_state(std::min(left, 0.05));
  }
  refuse(ConnectionError::Kind::aborted, "no motion was started");
}

MotionOutcome ArmConnection::outcome(Status status) const {
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
      result.text = "a command was invalid";
      break;
    default:
      result.text = fci::text(status);
  }
  return result;
}

std::optional<MotionOutcome> ArmConnection::poll_motion() {
  channel_.read_available();
  if (!motion_) return std::nullopt;
  const auto reply = channel_.take(motion_->command_id);
  if (!reply) return std::nullopt;
  std::span<const std::byte> rest;
  const Status status = status_of_reply(Command::move, *reply, rest);
  motion_.reset();
  return outcome(status);
}

MotionOutcome ArmConnection::wait_for_end(double timeout_s) {
  const HostTime begun = host_now();
  while (motion_) {
    if (auto end = poll_motion()) return *end;
    const double left = timeout_s - seconds(host_now() - begun);
    if (left <= 0) break;
    pollfd watched{.fd = channel_.file(), .events = POLLIN, .revents = 0};
    (void)::poll(&watched, 1, std::max(1, static_cast<int>(left * 1e3)));
  }
  if (!motion_) return {.status = Status::success, .text = {}};
  refuse(ConnectionError::Kind::timeout, "the motion is still running: stop it");
}

void ArmConnection::stop() {
  (void)ask(StopMoveRequest{}, "stop", options_.reply_timeout_s);
  (void)wait_for_state(is_idle);
  (void)poll_motion();
  if (!motion_) return;
  channel_.forget(motion_->command_id);  // its end may be reported later or never
  motion_.reset();
}

void ArmConnection::mark_finished(const Dialect& dialect, bool has_generator,
                                  RobotCommand& command) noexcept {
  if (has_generator || dialect.torque_only_needs_generator()) {
    command.motion_generation_finished = true;
  } else {
    command.torque_command_finished = true;
  }
}

MotionOutcome ArmConnection::finish(RobotCommand last, double timeout_s) {
  if (options_.loop_reads_states || !motion_) {
    refuse(ConnectionError::Kind::refused, "there is no running motion to finish");
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

}  // namespace multipanda::fci
