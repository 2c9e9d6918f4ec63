#include "fci/server/end_effector_port.hpp"

#include <sys/epoll.h>
#include <sys/socket.h>
#include <system_error>

namespace multipanda::fci {
namespace {

// A program without a Connect request is replaced by the next one after this time.
constexpr std::chrono::seconds kConnectPatience{2};

constexpr int kAcceptsPerRound = 8;  // limits the work of the arms' loop

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
  if (client_ && reader_.waiting() > 0) read_requests();  // requests left from the last round
  answer_finished();
  if (--state_in_ <= 0) publish();
}

}  // namespace multipanda::fci
