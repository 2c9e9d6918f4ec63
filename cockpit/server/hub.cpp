#include "cockpit/server/hub.hpp"

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <poll.h>
#include <sys/eventfd.h>
#include <sys/socket.h>
#include <unistd.h>

#include <fmt/format.h>

#include "common/own_files.hpp"

namespace multipanda::cockpit {

namespace {

namespace fs = std::filesystem;
using nlohmann::json;

constexpr double kShare = 1e-3;  // of a turn for the messages of one client: they must not delay a stop [s]
constexpr std::size_t kRead = 1u << 20;         // unread bytes of the page server [bytes]
constexpr std::size_t kMostUnread = 64u << 20;  // unread bytes from which on it counts as hung [bytes]
constexpr std::size_t kHead = 4 + 1 + 8 + 8;    // of a frame, as in page_server.py [bytes]
constexpr int kPatience = 20'000;  // until it listens, and until it has told its clients of the end [ms]
constexpr std::chrono::milliseconds kFarewell{1500};

template <class T>
T read_at(const std::string& bytes, std::size_t at) {
  T value;
  std::memcpy(&value, bytes.data() + at, sizeof(value));
  return value;
}

// Null: it is none.
json parsed(const std::string& text) {
  json message = json::parse(text, nullptr, false);
  return message.is_discarded() ? json() : message;
}

}  // namespace

// --- clients ---

void Hub::Peer::send(char kind, std::string_view payload) {
  if (closing || left) return;
  sent += payload.size();
  hub_.put({kind, id_, 0, std::string(payload)});
}

void Hub::Peer::send(const json& message) {
  send('T', message.dump(-1, ' ', false, json::error_handler_t::replace));
}

void Hub::Peer::close(CloseCode code, std::string reason) {
  if (closing) return;
  hub_.put({'C', id_, static_cast<std::int64_t>(code), std::move(reason)});
  closing = true;
  waiting.clear();
  waiting_bytes = 0;
}

// --- frames ---

void Hub::put(const Frame& frame) {
  std::array<char, kHead> head;
  const auto size = static_cast<std::uint32_t>(frame.payload.size());
  std::memcpy(head.data(), &size, 4);
  head[4] = frame.kind;
  std::memcpy(head.data() + 5, &frame.client, 8);
  std::memcpy(head.data() + 13, &frame.number, 8);
  channel_->send({head.data(), head.size()});
  channel_->send(frame.payload);
}

std::optional<Hub::Frame> Hub::next_frame() {
  std::string& in = channel_->received();
  if (in.size() < kHead) return {};
  const std::size_t size = read_at<std::uint32_t>(in, 0);
  if (in.size() < kHead + size) return {};
  Frame frame{in[4], read_at<std::uint64_t>(in, 5), read_at<std::int64_t>(in, 13), in.substr(kHead, size)};
  in.erase(0, kHead + size);
  return frame;
}

// --- the hub ---

Hub::Hub(const Options& options, Handler& handler) : limits_(options.limits), handler_(handler) {
  const fs::path python = page_python(), script = share_folder() / "cockpit/server/page_server.py";
  if (!fs::exists(python) || !fs::exists(script))
    throw std::runtime_error(fmt::format("the cockpit needs {} and {}; {}", python.string(), script.string(),
                                         page_packages_cure()));
  const json limits = {{"connections", limits_.connections},
                       {"first_message", limits_.first_message},
                       {"message", limits_.message},
                       {"messages_per_s", limits_.messages_per_s},
                       {"burst", limits_.burst},
                       {"first_s", limits_.first_s},
                       {"ping_s", limits_.ping_s},
                       {"silent_s", limits_.silent_s}};
  // -E: keeps PYTHONPATH of a sourced ROS 2 from hiding the interpreter's packages.
  std::vector<std::string> words{"-E",       "-B",          script.string(), options.page.string(),
                                 "--limits", limits.dump(), "--port",        std::to_string(options.port)};
  if (options.or_any) words.emplace_back("--or-any");
  int ends[2];
  if (socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, ends) != 0)
    throw std::runtime_error(fmt::format("no socket pair: {}", std::strerror(errno)));
  channel_ = std::make_unique<Connection>(ends[0]);
  Connection theirs(ends[1]);  // closed once the server has it
  server_ = std::make_unique<ChildProcess>(ChildProcess::Options{
      .program = python, .arguments = words, .output = {}, .errors = {}, .channel = ends[1]});
  learn_address();
  wake_ = eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK);
  if (wake_ < 0) throw std::runtime_error("cannot open an eventfd");
  thread_ = std::thread([this] { run(); });
}

void Hub::learn_address() {
  pollfd file{channel_->file(), POLLIN, 0};
  std::optional<Frame> frame;
  while (!frame && !channel_->ended() && poll(&file, 1, kPatience) > 0) {
    channel_->receive(kRead);
    frame = next_frame();
  }
  const json ready = frame ? parsed(frame->payload) : json();
  if (ready.contains("error")) throw std::runtime_error(ready["error"].get<std::string>());
  if (!frame)
    throw std::runtime_error(
        fmt::format("the cockpit's page server did not start: see its messages above; it needs "
                    "{} with the package websockets",
                    page_python().string()));
  port_ = ready.at("port").get<std::uint16_t>();
  token_ = ready.at("token").get<std::string>();
  has_page_ = ready.at("page").get<bool>();
}

Hub::~Hub() {
  ending_.store(true, std::memory_order_release);
  const std::uint64_t one = 1;
  while (write(wake_, &one, sizeof(one)) < 0 && errno == EINTR) {
  }
  thread_.join();
  shutdown(channel_->file(), SHUT_WR);  // the server tells its clients, and ends
  const HostTime begun = host_now();
  while (server_->running() && host_now() - begun < kFarewell)
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
  ::close(wake_);
}

std::string Hub::address() const { return fmt::format("http://127.0.0.1:{}/#{}", port_, token_); }

void Hub::run() {
  std::chrono::nanoseconds longest{0};
  while (!ending_.load(std::memory_order_acquire)) {
    wait(longest);
    for (Peer& peer : peers_) {
      take_waiting(peer);
      if (peer.unsent() > limits_.unsent) peer.close(CloseCode::policy, "messages are not read");
    }
    // Without a server there are no clients. A hung server is ended: it would continue with clients that no
    // longer count.
    const bool gone = said_ || channel_->ended() || channel_->unsent() > kMostUnread;
    std::erase_if(peers_, [&](Peer& peer) {
      if (peer.left || gone) handler_.leave(peer);
      return peer.left || gone;
    });
    longest = handler_.turn(host_now());
    channel_->flush();
    if (gone && !std::exchange(said_, true)) {
      server_->stop({});
      fmt::print(stderr, "the cockpit's page server has ended: the run continues without its page\n");
    }
  }
}

void Hub::wait(std::chrono::nanoseconds longest) {
  constexpr std::chrono::nanoseconds kWatch = std::chrono::milliseconds(250);
  longest = std::clamp(longest, std::chrono::nanoseconds(0), kWatch);
  if (std::ranges::any_of(peers_, [](const Peer& peer) { return !peer.waiting.empty(); })) longest = {};
  const bool over = channel_->ended();
  const short events = channel_->unsent() > 0 ? POLLIN | POLLOUT : POLLIN;
  std::array<pollfd, 2> files{pollfd{wake_, POLLIN, 0}, pollfd{over ? -1 : channel_->file(), events, 0}};
  const timespec spec{.tv_sec = longest.count() / 1'000'000'000, .tv_nsec = longest.count() % 1'000'000'000};
  if (ppoll(files.data(), files.size(), &spec, nullptr) < 0) return;
  if ((files[1].revents & POLLOUT) != 0) channel_->flush();
  if ((files[1].revents & (POLLIN | POLLHUP | POLLERR)) == 0) return;
  channel_->receive(kRead);
  while (auto frame = next_frame()) take(*frame);
}

void Hub::take(Frame& frame) {
  if (frame.kind == 'J')
    return handler_.join(peers_.emplace_back(*this, frame.client), parsed(frame.payload));
  const auto peer = std::ranges::find(peers_, frame.client, &Peer::id_);
  if (peer == peers_.end()) return;
  switch (frame.kind) {
    case 'M':
    case 'U':
      return take_text(*peer, std::move(frame.payload), {frame.number}, frame.kind == 'U');
    case 'W':
      peer->written += static_cast<std::size_t>(frame.number);
      return;
    default:
      // Only the newest: others' stops wait meanwhile.
      if (constexpr std::size_t kMostLast = 16; peer->waiting.size() > kMostLast)
        peer->waiting.erase(peer->waiting.begin(), peer->waiting.end() - kMostLast);
      for (const Peer::Waiting& last : std::exchange(peer->waiting, {}))
        if (handler_.outlasts(last.text)) handler_.take(*peer, parsed(last.text), last.arrived);
      peer->left = true;
  }
}

// Urgent messages at once, also while the connection closes; the others in turn.
void Hub::take_text(Peer& peer, std::string text, HostTime arrived, bool beyond_limits) {
  if (handler_.is_urgent(text)) return handler_.take(peer, parsed(text), arrived);
  if (peer.closing || beyond_limits) return;
  peer.waiting.push_back({std::move(text), arrived});
  peer.waiting_bytes += peer.waiting.back().bytes();
  if (peer.waiting_bytes > limits_.waiting) peer.close(CloseCode::policy, "too many messages");
}

void Hub::take_waiting(Peer& peer) {
  const HostTime begun = host_now();
  while (!peer.waiting.empty() && !peer.left && seconds(host_now() - begun) < kShare) {
    const Peer::Waiting next = std::move(peer.waiting.front());
    peer.waiting.pop_front();
    peer.waiting_bytes -= next.bytes();
    handler_.take(peer, parsed(next.text), next.arrived);
  }
}

Connection::~Connection() { close(file_); }

bool Connection::receive(std::size_t longest) {
  bool came = false;
  std::array<char, 16 * 1024> block;
  while (!ended_ && in_.size() < longest) {
    const ssize_t n = recv(file_, block.data(), std::min(block.size(), longest - in_.size()), MSG_DONTWAIT);
    if (n > 0) {
      in_.append(block.data(), static_cast<std::size_t>(n));
      came = true;
    } else if (n < 0 && (errno == EAGAIN || errno == EWOULDBLOCK)) {
      break;
    } else if (!(n < 0 && errno == EINTR)) {
      ended_ = true;
    }
  }
  return came;
}

void Connection::flush() {
  while (sent_ < out_.size()) {
    const ssize_t n = ::send(file_, out_.data() + sent_, out_.size() - sent_, MSG_NOSIGNAL | MSG_DONTWAIT);
    if (n > 0) {
      sent_ += static_cast<std::size_t>(n);
    } else if (n < 0 && (errno == EAGAIN || errno == EWOULDBLOCK)) {
      break;
    } else if (!(n < 0 && errno == EINTR)) {
      // The other side has closed, but its last data may still be unread: a stop, for example.
      broken_ = true;
      sent_ = out_.size();
    }
  }
  constexpr std::size_t kKept = 64 * 1024;  // sent bytes that are kept before the rest is moved
  if (sent_ == out_.size() || sent_ > kKept) {
    out_.erase(0, sent_);
    sent_ = 0;
  }
}

}  // namespace multipanda::cockpit
