#include "cockpit/server/hub.hpp"

#include <algorithm>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/eventfd.h>
#include <sys/socket.h>
#include <unistd.h>

#include <fmt/format.h>

#include "cockpit/server/token.hpp"

namespace multipanda::cockpit {
namespace {

using nlohmann::json;

constexpr double kFarewell = 1;  // for the last bytes of a closed connection [s]
constexpr double kShare =
    5e-3;  // of a turn for the messages of one client: they must not delay the dead man [s]
constexpr int kAcceptedPerTurn = 64;      // connections
constexpr std::size_t kFrameRoom = 1024;  // heads and control frames beside a message [bytes]
constexpr std::string_view kText = "text/plain; charset=utf-8";
constexpr const char* kNoPage =
    "This build has no cockpit page: it was built without the page's bundle (docs/cockpit.md says how to add "
    "it).\nEverything else of the cockpit works, for programs too.\n";

std::string dumped(const json& message) {
  return message.dump(-1, ' ', false, json::error_handler_t::replace);
}

}  // namespace

// --- one connection ---

Hub::Peer::Peer(int file, ClientId id, const HubLimits& limits, HostTime now)
    : connection(file),
      id_(id),
      frames(limits.first_message),
      begun(now),
      heard(now),
      filled(now),
      allowance(limits.burst) {}

void Hub::Peer::send(const json& message) {
  if (state != State::client) return;
  const std::string text = dumped(message);
  connection.send(frame_head(Opcode::text, text.size()));
  connection.send(text);
}

void Hub::Peer::send_numbers(std::string_view bytes) {
  if (state != State::client) return;
  connection.send(frame_head(Opcode::binary, bytes.size()));
  connection.send(bytes);
}

void Hub::Peer::close(CloseCode code, std::string reason) {
  if (state == State::closing) return;
  if (state != State::http) connection.send(close_frame(code, reason));
  state = State::closing;
  more = false;
  closed = host_now();
}

// --- the hub ---

Hub::Hub(std::uint16_t port, std::string token, PageFiles files, Handler& handler, HubLimits limits)
    : token_(std::move(token)), files_(std::move(files)), limits_(limits), handler_(handler) {
  std::tie(listening_, port_) = listen_on_loopback(port);
  wake_ = eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK);
  if (wake_ < 0) {
    ::close(listening_);
    throw std::runtime_error("cannot open an eventfd");
  }
  thread_ = std::thread([this] { run(); });
}

Hub::~Hub() {
  ending_.store(true, std::memory_order_release);
  const std::uint64_t one = 1;
  while (write(wake_, &one, sizeof(one)) < 0 && errno == EINTR) {
  }
  thread_.join();
  ::close(listening_);
  ::close(wake_);
}

std::string Hub::address() const { return fmt::format("http://127.0.0.1:{}/#{}", port_, token_); }

void Hub::run() {
  std::chrono::nanoseconds longest{0};
  while (!ending_.load(std::memory_order_acquire)) {
    wait(longest);
    const HostTime now = host_now();
    for (Peer& peer : peers_) watch(peer, now);
    longest = handler_.turn(now);
    for (Peer& peer : peers_) peer.connection.flush();
    std::erase_if(peers_, [&](Peer& peer) {
      // The other side closes first: closing with unread bytes would destroy what it has not read yet.
      const bool closing = peer.state == Peer::State::closing;
      if (closing && peer.connection.unsent() == 0) shutdown(peer.connection.file(), SHUT_WR);
      const bool done =
          (peer.connection.ended() && !peer.more) || (closing && seconds(now - peer.closed) > kFarewell);
      if (done && peer.joined) handler_.leave(peer);
      return done;
    });
  }
  for (Peer& peer : peers_) {
    peer.close(CloseCode::going_away, "the run has ended");
    peer.connection.flush();
  }
}

void Hub::wait(std::chrono::nanoseconds longest) {
  // Clients' limits are looked at this often. [ns]
  constexpr std::chrono::nanoseconds kWatch = std::chrono::milliseconds(250);
  longest = std::clamp(longest, std::chrono::nanoseconds(0), kWatch);
  std::vector<pollfd> files{{wake_, POLLIN, 0}, {listening_, POLLIN, 0}};
  constexpr std::size_t kFixed = 2;
  for (const Peer& peer : peers_) {
    int events = POLLIN;
    if (peer.connection.unsent() > 0) events |= POLLOUT;
    if (peer.more) longest = {};
    files.push_back({peer.connection.file(), static_cast<short>(events), 0});
  }
  const timespec spec{.tv_sec = longest.count() / 1'000'000'000, .tv_nsec = longest.count() % 1'000'000'000};
  if (ppoll(files.data(), files.size(), &spec, nullptr) < 0) return;
  std::size_t k = kFixed;
  for (Peer& peer : peers_) {
    const short events = files[k++].revents;
    if ((events & POLLOUT) != 0) peer.connection.flush();
    if (peer.more || (events & (POLLIN | POLLHUP | POLLERR)) != 0) serve(peer);
  }
  if (files[1].revents != 0) accept_all();
}

void Hub::accept_all() {
  for (int n = 0; n < kAcceptedPerTurn; ++n) {
    const int file = accept4(listening_, nullptr, nullptr, SOCK_NONBLOCK | SOCK_CLOEXEC);
    if (file < 0) return;
    const int on = 1;  // states are small and must not wait for each other
    setsockopt(file, IPPROTO_TCP, TCP_NODELAY, &on, sizeof(on));
    if (peers_.size() >= limits_.connections) {
      // The oldest one without a token makes room: whoever holds connections open without a word locks nobody
      // out. Clients with a token stay.
      const auto oldest = std::ranges::find_if(peers_, [](const Peer& peer) { return !peer.joined; });
      ++refused_;
      if (oldest == peers_.end()) {
        ::close(file);
        continue;
      }
      peers_.erase(oldest);
    }
    peers_.emplace_back(file, next_id_++, limits_, host_now());
  }
}

void Hub::serve(Peer& peer) {
  if (peer.state == Peer::State::closing) {
    peer.connection.received().clear();
    peer.connection.receive(limits_.message);  // not used; its end counts
    return;
  }
  const std::size_t longest =
      peer.state == Peer::State::http ? 2 * HttpReader::kLongest : limits_.message + kFrameRoom;
  if (peer.connection.receive(longest)) {
    peer.heard = host_now();
    peer.pinged = false;
  }
  if (peer.state == Peer::State::http) serve_http(peer);
  if (peer.state == Peer::State::token || peer.state == Peer::State::client) serve_frames(peer);
}

// --- HTTP ---

void Hub::serve_http(Peer& peer) {
  while (peer.state == Peer::State::http) {
    const auto result = peer.http.take(peer.connection.received());
    if (result == HttpReader::Result::incomplete) return;
    if (result == HttpReader::Result::refused) return refuse(peer, peer.http.status(), peer.http.reason());
    answer_http(peer, peer.http.request());
    peer.begun = host_now();
    if (peer.connection.unsent() > limits_.unsent) return refuse(peer, 503, "the answers are not read");
  }
}

void Hub::refuse(Peer& peer, int status, const std::string& reason) {
  ++refused_;
  peer.connection.send(http_answer(status, kText, reason + "\n", false));
  peer.close(CloseCode::policy, "");
}

void Hub::answer_http(Peer& peer, const HttpRequest& request) {
  const std::string& host = request.field("host");
  if (!is_own_host(host))
    return refuse(peer, 403, "this server answers to 127.0.0.1, localhost and [::1] only");
  if (request.has("origin") && !is_own_origin(request.field("origin"), host))
    return refuse(peer, 403, "a page of another origin has no access");
  if (request.path == "/ws") return begin_websocket(peer, request);
  const auto file = files_.find(request.path);
  const bool head = request.method == "HEAD";
  if (file != files_.end()) {
    peer.connection.send(http_answer(200, file->second.type, file->second.data, request.keep_alive, head));
  } else {
    const bool no_page = files_.empty() && (request.path == "/" || request.path == "/index.html");
    peer.connection.send(
        http_answer(404, kText, no_page ? kNoPage : "There is no such file.\n", request.keep_alive, head));
  }
  if (!request.keep_alive) peer.close(CloseCode::normal, "");
}

void Hub::begin_websocket(Peer& peer, const HttpRequest& request) {
  if (!request.has("origin")) return refuse(peer, 403, "expected the header Origin: http:// and the host");
  const Handshake hands = shake_hands(request);
  if (hands.status != 101) return refuse(peer, hands.status, hands.reason);
  peer.connection.send(hands.answer);
  peer.state = Peer::State::token;
}

// --- WebSocket ---

void Hub::serve_frames(Peer& peer) {
  const HostTime begun = host_now();
  peer.more = false;
  while (peer.state == Peer::State::token || peer.state == Peer::State::client) {
    if (seconds(host_now() - begun) > kShare) {
      peer.more = true;
      return;
    }
    auto message = peer.frames.take(peer.connection.received());
    if (peer.frames.fault()) {
      ++refused_;
      return peer.close(peer.frames.fault()->code, peer.frames.fault()->reason);
    }
    if (!message) return;
    if (!may_send(peer, host_now())) {
      ++refused_;
      return peer.close(CloseCode::policy, "too many messages");
    }
    switch (message->opcode) {
      case Opcode::text:
        take_text(peer, message->data);
        break;
      case Opcode::binary:
        return peer.close(CloseCode::unsupported, "messages are texts");
      case Opcode::close:
        return peer.close(CloseCode::normal, "");
      case Opcode::ping:
        peer.connection.send(frame_head(Opcode::pong, message->data.size()) + message->data);
        break;
      default:  // a pong
        break;
    }
  }
}

void Hub::take_text(Peer& peer, const std::string& text) {
  json message;
  try {
    message = json::parse(text);
  } catch (const json::exception&) {
    message = nullptr;
  }
  if (peer.state == Peer::State::token) return take_token(peer, message);
  handler_.take(peer, message);
}

void Hub::take_token(Peer& peer, const json& message) {
  const auto text_of = [&](const char* key) {
    const bool has = message.is_object() && message.contains(key) && message.at(key).is_string();
    return has ? message.at(key).get<std::string>() : std::string();
  };
  if (text_of("do") != "hello" || !same_token(text_of("token"), token_)) {
    ++refused_;
    return peer.close(CloseCode::wrong_token,
                      "the first message has the token of the address that the run printed");
  }
  if (client_count() >= limits_.clients) {
    ++refused_;
    return peer.close(CloseCode::policy, fmt::format("{} pages are open: close one first", limits_.clients));
  }
  peer.state = Peer::State::client;
  peer.joined = true;
  peer.frames.set_longest(limits_.message);
  json id = message.contains("id") ? message.at("id") : json();
  if (id.is_structured()) id = nullptr;
  handler_.join(peer, id);
}

// --- limits ---

bool Hub::may_send(Peer& peer, HostTime now) {
  peer.allowance =
      std::min(limits_.burst, peer.allowance + limits_.messages_per_s * seconds(now - peer.filled));
  peer.filled = now;
  peer.allowance -= 1;
  return peer.allowance >= 0;
}

void Hub::watch(Peer& peer, HostTime now) {
  if (peer.state == Peer::State::closing) return;
  if (peer.state != Peer::State::client) {
    if (seconds(now - peer.begun) <= limits_.first_s) return;
    const bool idle = peer.state == Peer::State::http && peer.connection.received().empty();
    if (!idle) ++refused_;
    return peer.close(CloseCode::policy, "expected the token");
  }
  if (peer.connection.unsent() > limits_.unsent) {
    ++refused_;
    return peer.close(CloseCode::policy, "messages are not read");
  }
  const double silence = seconds(now - peer.heard);
  if (silence > limits_.silent_s) return peer.close(CloseCode::policy, "nothing was heard");
  if (silence > limits_.ping_s && !peer.pinged) {
    peer.pinged = true;
    peer.connection.send(frame_head(Opcode::ping, 0));
  }
}

std::size_t Hub::client_count() const {
  return static_cast<std::size_t>(
      std::ranges::count_if(peers_, [](const Peer& peer) { return peer.joined; }));
}

}  // namespace multipanda::cockpit
