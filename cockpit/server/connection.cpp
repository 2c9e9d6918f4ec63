#include "cockpit/server/connection.hpp"

#include <arpa/inet.h>
#include <array>
#include <cerrno>
#include <cstring>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <stdexcept>
#include <sys/socket.h>
#include <unistd.h>

#include <fmt/format.h>

namespace multipanda::cockpit {

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
      // The other side is gone, but its last words may still be unread: a stop, for example.
      broken_ = true;
      sent_ = out_.size();
    }
  }
  constexpr std::size_t kKept = 64 * 1024;  // already sent, before the rest is moved
  if (sent_ == out_.size() || sent_ > kKept) {
    out_.erase(0, sent_);
    sent_ = 0;
  }
}

std::pair<int, std::uint16_t> listen_on_loopback(std::uint16_t port) {
  const int file = socket(AF_INET, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
  const int on = 1;
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(port);
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  auto* place = reinterpret_cast<sockaddr*>(&address);
  socklen_t size = sizeof(address);
  if (file < 0 || setsockopt(file, SOL_SOCKET, SO_REUSEADDR, &on, sizeof(on)) != 0 ||
      bind(file, place, size) != 0 || ::listen(file, SOMAXCONN) != 0 ||
      getsockname(file, place, &size) != 0) {
    const std::string reason = std::strerror(errno);
    if (file >= 0) close(file);
    throw std::runtime_error(
        fmt::format("the cockpit cannot listen on 127.0.0.1:{}: {}; name another port, or 0 for any free one",
                    port, reason));
  }
  return {file, ntohs(address.sin_port)};
}

}  // namespace multipanda::cockpit
