#include "runtime/live_input/line_connection.hpp"

#include <array>
#include <cerrno>
#include <sys/socket.h>
#include <unistd.h>

namespace multipanda {

LineConnection::~LineConnection() { close(file_); }

void LineConnection::receive() {
  std::array<char, 16 * 1024> block;
  while (!input_ended_ && in_.size() <= longest_) {
    const ssize_t n = recv(file_, block.data(), block.size(), MSG_DONTWAIT);
    if (n > 0) {
      in_.append(block.data(), static_cast<std::size_t>(n));
      continue;
    }
    if (n < 0 && errno == EINTR) continue;
    if (n < 0 && (errno == EAGAIN || errno == EWOULDBLOCK)) return;
    input_ended_ = true;
    broken_ = broken_ || n < 0;
  }
}

std::optional<LineConnection::Line> LineConnection::next() {
  for (;;) {
    if (input_ended_ && !in_.empty() && in_.back() != '\n') in_ += '\n';
    const std::size_t end = in_.find('\n', scanned_);
    if (end == std::string::npos) {
      scanned_ = in_.size();
      if (in_.size() <= longest_) return {};
      in_.clear();
      scanned_ = 0;
      if (skipping_) return {};
      skipping_ = true;
      return Line{.text = "", .too_long = true};
    }
    Line line{.text = in_.substr(0, end), .too_long = false};
    in_.erase(0, end + 1);
    scanned_ = 0;
    if (skipping_) {  // the end of a line that was too long
      skipping_ = false;
      continue;
    }
    if (line.text.size() > longest_) return Line{.text = "", .too_long = true};
    if (!line.text.empty() && line.text.back() == '\r') line.text.pop_back();
    return line;
  }
}

bool LineConnection::has_line() const {
  return in_.find('\n', scanned_) != std::string::npos || (input_ended_ && !in_.empty());
}

void LineConnection::send(const std::string& line) {
  out_ += line;
  out_ += '\n';
}

void LineConnection::flush() {
  while (sent_ < out_.size() && !broken_) {
    const ssize_t n = ::send(file_, out_.data() + sent_, out_.size() - sent_, MSG_NOSIGNAL | MSG_DONTWAIT);
    if (n > 0) {
      sent_ += static_cast<std::size_t>(n);
    } else if (n < 0 && (errno == EAGAIN || errno == EWOULDBLOCK)) {
      break;
    } else if (!(n < 0 && errno == EINTR)) {
      broken_ = true;
    }
  }
  if (sent_ == out_.size() || sent_ > longest_) {
    out_.erase(0, sent_);
    sent_ = 0;
  }
}

}  // namespace multipanda
