#include "runtime/live_input/line_connection.hpp"

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

namespace multipanda {
namespace {

// As send(), with a descriptor beside the first byte; -1: none.
ssize_t send_bytes(int file, const char* bytes, std::size_t count, int passed) {
  if (passed < 0) return ::send(file, bytes, count, MSG_NOSIGNAL | MSG_DONTWAIT);
  iovec part{.iov_base = const_cast<char*>(bytes), .iov_len = count};
  alignas(cmsghdr) std::array<char, CMSG_SPACE(sizeof(int))> control{};
  msghdr message{};
  message.msg_iov = &part;
  message.msg_iovlen = 1;
  message.msg_control = control.data();
  message.msg_controllen = control.size();
  cmsghdr* head = CMSG_FIRSTHDR(&message);
  head->cmsg_level = SOL_SOCKET;
  head->cmsg_type = SCM_RIGHTS;
  head->cmsg_len = CMSG_LEN(sizeof(int));
  std::memcpy(CMSG_DATA(head), &passed, sizeof(int));
  return sendmsg(file, &message, MSG_NOSIGNAL | MSG_DONTWAIT);
}

}  // namespace

LineConnection::~LineConnection() { close(file_); }

bool LineConnection::hung_up() const {
  pollfd watched{.fd = file_, .events = 0, .revents = 0};
  return poll(&watched, 1, 0) > 0 && (watched.revents & (POLLHUP | POLLERR)) != 0;
}

bool LineConnection::receive() {
  in_.erase(0, begin_);
  scanned_ -= begin_;
  begin_ = 0;
  const std::size_t before = in_.size();
  std::array<char, 16 * 1024> block;
  while (!input_ended_ && in_.size() <= longest_) {
    const ssize_t n = recv(file_, block.data(), block.size(), MSG_DONTWAIT);
    if (n > 0) {
      in_.append(block.data(), static_cast<std::size_t>(n));
      continue;
    }
    if (n < 0 && errno == EINTR) continue;
    if (n < 0 && (errno == EAGAIN || errno == EWOULDBLOCK)) break;
    input_ended_ = true;
    broken_ = broken_ || n < 0;
  }
  return in_.size() > before;
}

std::optional<LineConnection::Line> LineConnection::next() {
  for (;;) {
    if (input_ended_ && !in_.empty() && in_.back() != '\n') in_ += '\n';
    const std::size_t end = in_.find('\n', scanned_);
    if (end == std::string::npos) {
      scanned_ = in_.size();
      if (in_.size() - begin_ <= longest_) return {};
      in_.clear();
      begin_ = scanned_ = 0;
      if (skipping_) return {};
      skipping_ = true;
      return Line{.text = "", .too_long = true};
    }
    Line line{.text = in_.substr(begin_, end - begin_), .too_long = false};
    begin_ = scanned_ = end + 1;
    if (skipping_) {  // the end of a line that was too long
      skipping_ = false;
      continue;
    }
    if (line.text.size() > longest_) return Line{.text = "", .too_long = true};
    if (!line.text.empty() && line.text.back() == '\r') line.text.pop_back();
    return line;
  }
}

void LineConnection::send(const std::string& line) {
  out_ += line;
  out_ += '\n';
}

void LineConnection::send_with(const std::string& line, int passed) {
  passed_ = passed;
  passed_from_ = out_.size();
  send(line);
}

void LineConnection::flush() {
  while (sent_ < out_.size() && !broken_) {
    const bool here = passed_ >= 0 && sent_ == passed_from_;
    const std::size_t end = passed_ >= 0 && sent_ < passed_from_ ? passed_from_ : out_.size();
    const ssize_t n = send_bytes(file_, out_.data() + sent_, end - sent_, here ? passed_ : -1);
    if (n > 0) {
      if (here) passed_ = -1;
      sent_ += static_cast<std::size_t>(n);
    } else if (n < 0 && (errno == EAGAIN || errno == EWOULDBLOCK)) {
      break;
    } else if (!(n < 0 && errno == EINTR)) {
      broken_ = true;
    }
  }
  if (sent_ == out_.size() || sent_ > longest_) {
    out_.erase(0, sent_);
    passed_from_ -= std::min(passed_from_, sent_);
    sent_ = 0;
  }
}

}  // namespace multipanda
