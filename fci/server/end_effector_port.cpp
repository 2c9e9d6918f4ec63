#include "fci/server/end_effector_port.hpp"

#include <algorithm>
#include <cmath>
#include <sys/epoll.h>
#include <sys/socket.h>
#include <system_error>

#include "core/cycle/requests.hpp"

namespace multipanda::fci {
namespace {

// A program without a Connect request is replaced by the next one after this time.
constexpr std::chrono::seconds kConnectPatience{2};

constexpr int kAcceptsPerRound = 8;  // limits the work of the arms' loop

constexpr std::uint16_t kTemperature = 30;  // [deg C] of an idle hand

constexpr std::uint8_t kProfiles = 4;
double seconds(std::int64_t milliseconds) { return 1e-3 * static_cast<double>(milliseconds); }

}  // namespace

struct EndEffectorPort::Client {
  Client(Accepted accepted, Poll& poll, Port& port)
      : stream(std::move(accepted.socket), accepted.peer, poll, port), since(host_now()) {}
  TcpStream stream;
  HostTime since;
  Socket udp;  // none before Connect
};

EndEffectorPort::EndEffectorPort(std::string name, std::string address, std::uint16_t port,
                                 std::size_t max_request)
    : name_(std::move(name)),
      address_(std::move(address)),
      port_(port),
      reader_(HeaderKind::gripper, max_request) {}

EndEffectorPort::~EndEffectorPort() {
  client_.reset();
  if (listener_) poll_->remove(listener_.file());
}

void EndEffectorPort::close_connection() { client_.reset(); }

void EndEffectorPort::open(Poll& poll) {
  listener_ = listen_on(address_, port_, name_);
  port_ = port_of(listener_);
  poll_ = &poll;
  poll.add(listener_.file(), EPOLLIN, *this);
}

void EndEffectorPort::ready(int file, std::uint32_t events) {
  if (file == listener_.file()) return accept();
  if (!client_ || file != client_->stream.file()) return;
  if ((events & EPOLLOUT) != 0) client_->stream.flush();
  if ((events & (EPOLLIN | EPOLLHUP | EPOLLERR)) != 0) read_requests();
}

void EndEffectorPort::accept() {
  for (int i = 0; i < kAcceptsPerRound; ++i) {
    auto accepted = accept_from(listener_);
    if (!accepted) return;
    // A disconnect and a new connection may arrive in the same round.
    if (client_ && client_->stream.peer_has_closed()) client_.reset();
    if (client_ && !client_->udp && host_now() - client_->since > kConnectPatience) client_.reset();
    if (client_) continue;  // refused: closed at once
    reader_.reset();
    pending_.reset();
    client_ = std::make_unique<Client>(std::move(*accepted), *poll_, *this);
  }
}

void EndEffectorPort::read_requests() {
  constexpr int kMostPerRound = 16;  // no client keeps the arms' loop busy
  bool fine = true;
  for (int i = 0; i < kMostPerRound && fine; ++i) {
    Message message;
    switch (reader_.next(message)) {
      case FrameReader::Next::message:
        fine = serve_request(message);
        break;
      case FrameReader::Next::bad_size:
        fine = false;
        break;
      case FrameReader::Next::incomplete: {
        const std::size_t count = client_->stream.receive(reader_.room());
        if (count == 0) {
          if (client_->stream.broken()) client_.reset();
          return;
        }
        reader_.received(count);
        break;
      }
    }
    if (client_ && client_->stream.broken()) fine = false;
  }
  if (!fine) client_.reset();
}

bool EndEffectorPort::connect(const Message& message) {
  GripperConnectRequest request;
  if (client_->udp || decode_gripper(message.payload, request) != WireResult::ok || request.udp_port == 0) {
    return false;
  }
  const bool speaks = request.version == version();
  std::array<std::byte, kGripperConnectReplySize> bytes{};
  encode_gripper_connect_reply(message.command_id, speaks ? GripperStatus::success : GripperStatus::fail,
                               version(), bytes);
  client_->stream.send(bytes);
  if (!speaks) return true;  // the program reads the reason and disconnects
  sockaddr_in peer = client_->stream.peer();
  peer.sin_port = htons(request.udp_port);
  try {
    client_->udp = udp_between(address_, peer);
  } catch (const std::system_error&) {
    return false;  // no socket available
  }
  publish();  // the program waits for a state
  return true;
}

bool EndEffectorPort::serve_request(const Message& message) {
  if (message.command == 0) return connect(message);
  if (!client_->udp) return false;
  const Served served = serve(message);
  answer_finished();  // answer the aborted motion first
  const Pending request{static_cast<std::uint16_t>(message.command), message.command_id, served.ticket};
  switch (served.what) {
    case Served::What::motion:
      pending_ = request;
      return true;
    case Served::What::done:
      answer(request, GripperStatus::success);
      return true;
    case Served::What::refused:
      answer(request, GripperStatus::fail);
      return true;
    case Served::What::nonsense:
      break;
  }
  return false;
}

void EndEffectorPort::answer(const Pending& pending, GripperStatus status) {
  std::array<std::byte, kGripperReplySize> bytes{};
  encode_gripper_reply(pending.command, pending.command_id, status, bytes);
  client_->stream.send(bytes);
}

void EndEffectorPort::answer_finished() {
  if (!client_ || !pending_) return;
  const GripperResult end = result(pending_->ticket);
  if (end == GripperResult::running) return;
  answer(*pending_, end == GripperResult::success        ? GripperStatus::success
                    : end == GripperResult::unsuccessful ? GripperStatus::unsuccessful
                                                         : GripperStatus::aborted);
  pending_.reset();
}

void EndEffectorPort::publish() {
  if (!client_ || !client_->udp) return;
  std::array<std::byte, 64> bytes{};
  const std::size_t size = encode_state(++message_id_, bytes);
  ::send(client_->udp.file(), bytes.data(), size,
         MSG_DONTWAIT | MSG_NOSIGNAL);  // a lost state is replaced by the next
  state_in_ = kStatePeriods;
}

void EndEffectorPort::stepped(std::int64_t) {
  if (client_ && reader_.waiting() > 0) read_requests();  // remaining requests of the last round
  answer_finished();
  if (--state_in_ <= 0) publish();
}

EndEffectorPort::Served GripperPort::serve(const Message& message) {
  using What = Served::What;
  const auto motion = [this](const auto& request) { return Served{What::motion, gripper_.start(request)}; };
  switch (static_cast<GripperCommand>(message.command)) {
    case GripperCommand::homing: {
      GripperHomingRequest r;
      if (decode_gripper(message.payload, r) != WireResult::ok) return {};
      return motion(GripperHoming{});
    }
    case GripperCommand::move: {
      GripperMoveRequest r;
      if (decode_gripper(message.payload, r) != WireResult::ok) return {};
      const GripperMove move{r.width, r.speed};
      return check(move).empty() ? motion(move) : Served{What::refused};
    }
    case GripperCommand::grasp: {
      GripperGraspRequest r;
      if (decode_gripper(message.payload, r) != WireResult::ok) return {};
      const GripperGrasp grasp{r.width, r.speed, r.force, r.epsilon_inner, r.epsilon_outer};
      return check(grasp).empty() ? motion(grasp) : Served{What::refused};
    }
    case GripperCommand::stop: {
      GripperStopRequest r;
      if (decode_gripper(message.payload, r) != WireResult::ok) return {};
      gripper_.stop();
      return {What::done};
    }
    case GripperCommand::connect:
      break;
  }
  return {};
}

std::size_t GripperPort::encode_state(std::uint32_t message_id, std::span<std::byte> to) const {
  const auto& state = gripper_.state();
  return encode_gripper(GripperState{message_id, state.width, state.max_width, state.grasped, kTemperature},
                        to);
}

EndEffectorPort::Served VacuumPort::serve(const Message& message) {
  using What = Served::What;
  switch (static_cast<VacuumCommand>(message.command)) {
    case VacuumCommand::vacuum: {
      VacuumRequest r;
      if (decode_gripper(message.payload, r) != WireResult::ok) return {};
      const VacuumOn on{std::clamp(10.0 * r.vacuum, 50.0, 1000.0), seconds(r.timeout)};
      if (r.profile >= kProfiles || !check(on).empty()) return {What::refused};
      return {What::motion, vacuum_.start(on)};
    }
    case VacuumCommand::drop_off: {
      VacuumDropOffRequest r;
      if (decode_gripper(message.payload, r) != WireResult::ok) return {};
      const VacuumDrop drop{seconds(r.timeout)};
      if (!check(drop).empty()) return {What::refused};
      return {What::motion, vacuum_.start(drop)};
    }
    case VacuumCommand::stop: {
      VacuumStopRequest r;
      if (decode_gripper(message.payload, r) != WireResult::ok) return {};
      vacuum_.stop();
      return {What::done};
    }
    case VacuumCommand::connect:
      break;
  }
  return {};
}

std::size_t VacuumPort::encode_state(std::uint32_t message_id, std::span<std::byte> to) const {
  const SimulatedVacuum::State& state = vacuum_.state();
  return encode_gripper(VacuumState{.message_id = message_id,
                                    .in_control_range = state.in_control_range,
                                    .part_detached = state.part_detached,
                                    .part_present = state.part_present,
                                    .actual_power = state.power_percent,
                                    .vacuum = static_cast<std::int32_t>(std::lround(state.vacuum_mbar))},
                        to);
}

}  // namespace multipanda::fci
