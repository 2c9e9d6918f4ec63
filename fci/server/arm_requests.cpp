#include <system_error>

#include "fci/server/arm_port.hpp"
#include "fci/server/wire.hpp"

// Requests on an arm's TCP connection.
namespace multipanda::fci {
namespace {

// Limits for one program in one round of the loop.
constexpr int kReadsPerRound = 4, kRequestsPerRound = 8;

}  // namespace

void ArmPort::read_requests() {
  for (int i = 0; i < kReadsPerRound && client_; ++i) {
    // Serve complete messages first, so that the buffer stays small.
    if (serve_waiting()) return;
    if (!client_) return;
    const auto room = reader_.room();
    const std::size_t received = client_->stream.receive(room);
    if (received == 0) break;
    reader_.received(received);
  }
  if (client_) serve_waiting();
  if (client_ && client_->stream.broken()) drop_client();
}

// True: more requests may be waiting.
bool ArmPort::serve_waiting() {
  for (int i = 0; i < kRequestsPerRound; ++i) {
    if (client_->closing) return true;
    Message message;
    switch (reader_.next(message)) {
      case FrameReader::Next::incomplete:
        return false;
      case FrameReader::Next::message:
        if (serve(message)) break;
        [[fallthrough]];
      case FrameReader::Next::bad_size:
        counts_.bad_requests.add();
        drop_client();
        return false;
    }
    if (!client_) return false;
  }
  return true;
}

// False: an invalid request; the connection ends.
bool ArmPort::serve(const Message& message) {
  if (client_->dialect == nullptr) return message.command == 0 && connect(message);
  const Dialect& dialect = *client_->dialect;
  const auto command = command_of(dialect, message.command);
  if (!command) return false;
  const auto take = [&]<typename Request>(Request request, auto then) {
    switch (decode_request(dialect, message.payload, request)) {
      case WireResult::ok:
        then(request);
        return true;
      case WireResult::bad_value:
        reply(*command, message.command_id, Status::invalid_argument);
        return true;
      case WireResult::too_short:
      case WireResult::too_long:
        break;
    }
    return false;
  };
  const auto set = [&](const auto& request) {
    reply(*command, message.command_id, apply(arm_request(request)));
  };
  switch (*command) {
    case Command::connect:
      return false;
    case Command::move:
      return take(MoveRequest{}, [&](const MoveRequest& r) { move(message.command_id, r); });
    case Command::stop_move:
      return take(StopMoveRequest{}, [&](const auto&) { stop_move(message.command_id); });
    case Command::automatic_error_recovery:
      return take(AutomaticErrorRecoveryRequest{}, [&](const auto&) { recover(message.command_id); });
    case Command::set_collision_behavior:
      return take(SetCollisionBehaviorRequest{}, set);
    case Command::set_joint_impedance:
      return take(SetJointImpedanceRequest{}, set);
    case Command::set_cartesian_impedance:
      return take(SetCartesianImpedanceRequest{}, set);
    case Command::set_guiding_mode:
      return take(SetGuidingModeRequest{}, set);
    case Command::set_ee_to_k:
      return take(SetEEToKRequest{}, set);
    case Command::set_ne_to_ee:
      return take(SetNEToEERequest{}, [&](const auto& r) {
        reply(*command, message.command_id, apply(arm_request(r, config_.fixed.X_FNE)));
      });
    case Command::set_load:
      return take(SetLoadRequest{}, set);
    case Command::set_filters:
      return take(SetFiltersRequest{}, [&](const SetFiltersRequest& r) {
        // Cut-off frequencies of filters that a simulated arm does not have.
        bool sound = !motion_.runs;
        for (const double f :
             {r.joint_position, r.joint_velocity, r.cartesian_position, r.cartesian_velocity, r.controller}) {
          sound = sound && f >= 0 && f <= 1000;
        }
        reply(*command, message.command_id,
              sound          ? Status::success
              : motion_.runs ? Status::not_possible
                             : Status::invalid_argument);
      });
    case Command::get_cartesian_limit:
      return take(GetCartesianLimitRequest{}, [&](const auto&) {
        CartesianLimit limit;  // there is no virtual wall
        limit.object_frame = column_major(Pose{});
        std::array<std::byte, kMaxPlainReplySize> bytes{};
        const std::size_t size = encode(dialect, limit, bytes);
        reply(*command, message.command_id, Status::success, {bytes.data(), size});
      });
    case Command::get_robot_model:
      return take(GetRobotModelRequest{}, [&](const auto&) {
        reply(*command, message.command_id, Status::success, std::as_bytes(std::span(config_.model.urdf)));
      });
    case Command::load_model_library:
      return take(LoadModelLibraryRequest{}, [&](const LoadModelLibraryRequest& r) {
        const auto& library = config_.model.library;
        const bool have = !library.empty() && r.architecture == LibraryArchitecture::x64 &&
                          r.system == LibrarySystem::linux_os;
        reply(*command, message.command_id, have ? Status::success : Status::error,
              have ? std::span<const std::byte>(library) : std::span<const std::byte>{});
      });
  }
  return false;
}

void ArmPort::reply(Command command, std::uint32_t command_id, Status status,
                    std::span<const std::byte> more) {
  std::array<std::byte, kMaxPlainReplySize> head{};
  const std::size_t size = encode_reply(*client_->dialect, command, command_id, status, head, more.size());
  client_->stream.send({head.data(), size}, more);
}

bool ArmPort::connect(const Message& message) {
  ConnectRequest request;
  if (decode_request(kDialects.back(), message.payload, request) != WireResult::ok) return false;
  const VersionRange& own = config_.fixed.versions;
  const bool accepted = request.version >= own.oldest && request.version <= own.newest;
  const Dialect* spoken = accepted ? dialect(request.version) : nullptr;
  std::array<std::byte, kMaxPlainReplySize> bytes{};
  // A real arm reports its only version. A virtual one may support several, and reports the program's if it
  // is supported.
  const std::size_t size = encode_connect_reply(
      message.command_id, spoken != nullptr ? Status::success : Status::incompatible_version,
      spoken != nullptr ? spoken->version : own.newest, bytes);
  client_->stream.send({bytes.data(), size});
  if (spoken == nullptr) {
    client_->closing = true;
    return true;
  }
  if (request.udp_port == 0) return false;
  sockaddr_in states_to = client_->stream.peer();
  states_to.sin_port = htons(request.udp_port);
  try {
    client_->udp = udp_between(config_.address, states_to);
  } catch (const std::system_error&) {
    return false;  // no socket available
  }
  client_->dialect = spoken;
  counts_.clients.add();
  watch_datagrams();
  if (config_.lockstep) publish();  // the program waits for a state while the world may be paused
  return true;
}

void ArmPort::move(std::uint32_t command_id, const MoveRequest& request) {
  // The program has read the first reply to its last Move, otherwise it would not start another one.
  if (motion_.end) {
    reply(Command::move, motion_.command_id, *motion_.end);
    motion_.end.reset();
  }
  if (motion_.runs) return reply(Command::move, command_id, Status::not_possible);
  const MotionRequest requested = motion_request(request);
  const MotionStart start = arm_.start_motion(requested);
  // An arm reports a singular pose after it has accepted the motion: libfranka then throws ControlException.
  const bool singular = start == MotionStart::singular;
  reply(Command::move, command_id, singular ? Status::motion_started : status_of(start));
  if (start != MotionStart::started && !singular) return;
  if (!singular) counts_.motions.add();
  motions_ended_ = arm_.motions_ended();
  motion_ = {.runs = !singular,
             .command_id = command_id,
             .first_state = message_id_ + 1,
             .asynchronous = requested.asynchronous,
             .started = host_now()};
  if (singular) motion_.end = status_of(start);
  has_pending_ = answered_ = silent_ = lagging_ = false;
  newest_command_ = latest_late_ = left_out_ = 0;
  mark_state_due();
}

// Always succeeds, even without a motion: libfranka requests it during cleanup, and some versions terminate
// the program on a refusal.
void ArmPort::stop_move(std::uint32_t command_id) {
  motion_.stop_requested = true;
  arm_.stop_motion();
  notice_end();
  if (!motion_.end || stops_.count == stops_.ids.size()) {
    return reply(Command::stop_move, command_id, Status::success);
  }
  stops_.ids[stops_.count++] = command_id;  // sent after the reply to the Move
  mark_state_due();
}

void ArmPort::recover(std::uint32_t command_id) {
  if (motion_.runs || recoveries_.count == recoveries_.ids.size()) {
    return reply(Command::automatic_error_recovery, command_id, Status::not_possible);
  }
  arm_.apply(RecoverFromError{});
  const ArmMode mode = arm_.mode();
  if (mode == ArmMode::idle || mode == ArmMode::recovering) {
    // The program may move as soon as it gets the answer, so the arm must be ready before.
    recoveries_.ids[recoveries_.count++] = command_id;
    mark_state_due();
    return;
  }
  reply(Command::automatic_error_recovery, command_id, Status::not_possible);  // stop button, guiding
}

Status ArmPort::apply(const std::optional<ArmRequest>& request) {
  if (motion_.runs) return Status::not_possible;
  if (!request || !check_request(*request, arm_.model()).empty()) return Status::invalid_argument;
  return arm_.apply(*request) == ArmReply::done ? Status::success : Status::not_possible;
}

}  // namespace multipanda::fci
