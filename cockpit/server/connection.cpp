#include "cockpit/server/connection.hpp"

#include <array>
#include <cerrno>
#include <sys/socket.h>
#include <unistd.h>

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
