#include "fci/client/tcp_channel.hpp"

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <cmath>
#include <cstring>
#include <fcntl.h>
#include <netdb.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include "core/types/time.hpp"

namespace multipanda::fci {
namespace {

// Remaining part of `timeout_s` since `begun`, in whole milliseconds for poll(), rounded up.
int left_ms(HostTime begun, double timeout_s) {
  const double left = timeout_s - seconds(host_now() - begun);
  return left <= 0 ? 0 : static_cast<int>(std::ceil(left * 1e3));
}

std::string cure_for(int error) {
  switch (error) {
    case ECONNREFUSED:
      return "connection refused: the computer there has no control interface. Check that the FCI is "
             "activated on the arm, or that the virtual arm is running";
    case ETIMEDOUT:
      return "no answer: check that the arm is switched on, the cable is plugged into the arm's controller, "
             "and the address is correct";
    case EHOSTUNREACH:
    case ENETUNREACH:
      return "no route to this address: check that this computer has an address in the arm's network";
    default:
      return std::strerror(error);
  }
}

}  // namespace

in_addr resolve(const std::string& address, const std::string& who) {
  addrinfo hints{};
  hints.ai_family = AF_INET;
  hints.ai_socktype = SOCK_STREAM;
  addrinfo* found = nullptr;
  if (const int error = ::getaddrinfo(address.c_str(), nullptr, &hints, &found); error != 0) {
    throw ConnectionError(ConnectionError::Kind::unreachable,
                          who + ": '" + address + "' cannot be resolved (" + ::gai_strerror(error) +
                              "): write its IPv4 address, as shown in its network settings");
  }
  const in_addr result = reinterpret_cast<const sockaddr_in*>(found->ai_addr)->sin_addr;
  ::freeaddrinfo(found);
  return result;
}

std::string in_seconds(double duration_s) {
  std::string text = std::to_string(duration_s);
  text.erase(std::min(text.find('.') + 2, text.size()));
  return text + " s";
}

void TcpChannel::fail(ConnectionError::Kind kind, const std::string& text) {
  close();
  throw ConnectionError(kind, who_ + ": " + text);
}

void TcpChannel::close() noexcept {
  if (file_ >= 0) ::close(file_);
  file_ = -1;
  buffer_.clear();
  replies_.clear();
  forgotten_.clear();
}

void TcpChannel::connect(const std::string& address, std::uint16_t port, double timeout_s) {
  close();
  next_id_ = 0;
  const in_addr ip = resolve(address, who_);
  gaps_.restart();  // a name server may be slow
  const auto unreachable = [&](int error) {
    fail(ConnectionError::Kind::unreachable,
         "no connection to " + address + " port " + std::to_string(port) + ": " + cure_for(error));
  };
  file_ = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
  if (file_ < 0) unreachable(errno);
  // No delay for single messages; keep-alive detects dead peers.
  const auto set = [this](int level, int name, int value) {
    (void)::setsockopt(file_, level, name, &value, sizeof(value));
  };
  set(IPPROTO_TCP, TCP_NODELAY, 1);
  set(SOL_SOCKET, SO_KEEPALIVE, 1);
  set(IPPROTO_TCP, TCP_KEEPIDLE, 1);
  set(IPPROTO_TCP, TCP_KEEPCNT, 3);
  set(IPPROTO_TCP, TCP_KEEPINTVL, 1);

  sockaddr_in to{};
  to.sin_family = AF_INET;
  to.sin_port = htons(port);
  to.sin_addr = ip;
  if (::connect(file_, reinterpret_cast<const sockaddr*>(&to), sizeof(to)) != 0) {
    if (errno != EINPROGRESS) unreachable(errno);
    if (!wait_for(POLLOUT, timeout_s)) unreachable(ETIMEDOUT);
    int error = 0;
    socklen_t size = sizeof(error);
    (void)::getsockopt(file_, SOL_SOCKET, SO_ERROR, &error, &size);
    if (error != 0) unreachable(error);
  }
  peer_address_ = ip.s_addr;
}

bool TcpChannel::wait_for(short events, double timeout_s) const {
  const HostTime begun = host_now();
  pollfd watched{.fd = file_, .events = events, .revents = 0};
  constexpr int kSliceMs = 100;
  while (true) {
    const int left = left_ms(begun, timeout_s);
    (void)gaps_.look();
    const int n = ::poll(&watched, 1, std::min(left, kSliceMs));
    (void)gaps_.look();
    if (n > 0) return true;
    if ((n == 0 && left <= kSliceMs) || (n < 0 && errno != EINTR)) return false;
  }
}

void TcpChannel::send(std::span<const std::byte> message, double timeout_s) {
  if (!is_open()) fail(ConnectionError::Kind::lost, "there is no connection: connect first");
  const HostTime begun = host_now();
  std::size_t done = 0;
  while (done < message.size()) {
    const ssize_t n = ::send(file_, message.data() + done, message.size() - done, MSG_NOSIGNAL);
    if (n > 0) {
      done += static_cast<std::size_t>(n);
    } else if (errno == EAGAIN) {
      if (!wait_for(POLLOUT, timeout_s - seconds(host_now() - begun))) {
        fail(ConnectionError::Kind::timeout,
             "it accepts no more requests: switch it off and on, then reconnect");
      }
    } else if (errno != EINTR) {
      fail(ConnectionError::Kind::lost, std::string("the connection is lost (") + std::strerror(errno) +
                                            "): check cable and arm, then reconnect");
    }
  }
  ++next_id_;
}

void TcpChannel::read_available() {
  std::array<std::byte, 16384> chunk;
  bool received = false;
  while (is_open()) {
    const ssize_t n = ::recv(file_, chunk.data(), chunk.size(), 0);
    if (n > 0) {
      buffer_.insert(buffer_.end(), chunk.begin(), chunk.begin() + n);
      parse();
      received = true;
    } else if (n < 0 && errno == EINTR) {
      continue;
    } else if (received || (n < 0 && errno == EAGAIN)) {
      return;  // an arm that refuses a version closes or resets at once: first its reply, then the end
    } else if (n == 0) {
      fail(ConnectionError::Kind::lost,
           "the arm closed the connection: another program may have taken it over, the FCI may have been "
           "deactivated, or the arm was switched off; then reconnect");
    } else {
      fail(ConnectionError::Kind::lost, std::string("the connection is lost (") + std::strerror(errno) +
                                            "): check cable and arm, then reconnect");
    }
  }
}

// Extracts complete messages from the buffer.
void TcpChannel::parse() {
  const std::size_t header_bytes = header_size(kind_);
  std::size_t at = 0;
  while (buffer_.size() - at >= header_bytes) {
    MessageHeader header;
    const auto rest = std::span<const std::byte>(buffer_).subspan(at);
    if (decode(kind_, rest.first(header_bytes), header) != WireResult::ok || header.size < header_bytes ||
        header.size > kMaxMessage || replies_.size() >= kMaxReplies) {
      fail(ConnectionError::Kind::protocol, "it sent an invalid reply: check that the address is an arm's");
    }
    if (rest.size() < header.size) break;
    const auto payload = rest.subspan(header_bytes, header.size - header_bytes);
    at += header.size;
    if (std::erase(forgotten_, header.command_id) > 0) continue;
    replies_.push_back({header.command, header.command_id, {payload.begin(), payload.end()}});
  }
  buffer_.erase(buffer_.begin(), buffer_.begin() + static_cast<std::ptrdiff_t>(at));
}

void TcpChannel::forget(std::uint32_t command_id) {
  if (take(command_id)) return;
  if (forgotten_.size() >= kMaxForgotten) forgotten_.pop_front();
  forgotten_.push_back(command_id);
}

std::optional<TcpChannel::Reply> TcpChannel::take(std::uint32_t command_id) {
  const auto it = std::find_if(replies_.begin(), replies_.end(),
                               [&](const Reply& reply) { return reply.command_id == command_id; });
  if (it == replies_.end()) return std::nullopt;
  Reply reply = std::move(*it);
  replies_.erase(it);
  return reply;
}

TcpChannel::Reply TcpChannel::wait(std::uint32_t command_id, double timeout_s, const char* what) {
  const HostTime begun = host_now();
  while (true) {
    if (auto reply = take(command_id)) return std::move(*reply);
    if (!is_open()) fail(ConnectionError::Kind::lost, "there is no connection: connect first");
    read_available();
    if (auto reply = take(command_id)) return std::move(*reply);
    const double left = timeout_s - seconds(host_now() - begun);
    if (left <= 0 || !wait_for(POLLIN, left)) {
      fail(ConnectionError::Kind::timeout, std::string("no answer to ") + what + " within " +
                                               in_seconds(timeout_s) +
                                               ": the arm or the network does not respond; reconnect");
    }
  }
}

}  // namespace multipanda::fci
