#include "cli/input_end.hpp"

#include <cerrno>
#include <cstdint>
#include <poll.h>
#include <sys/eventfd.h>
#include <system_error>
#include <unistd.h>

namespace multipanda::cli {

InputEndWatch::InputEndWatch(std::function<void()> on_end) : on_end_(std::move(on_end)) {
  end_file_ = eventfd(0, EFD_CLOEXEC);
  if (end_file_ < 0) throw std::system_error(errno, std::generic_category(), "eventfd");
  thread_ = std::thread([this] { watch(); });
}

InputEndWatch::~InputEndWatch() {
  const std::uint64_t one = 1;
  (void)!write(end_file_, &one, sizeof(one));
  thread_.join();
  close(end_file_);
}

void InputEndWatch::watch() {
  for (;;) {
    pollfd files[2] = {{STDIN_FILENO, POLLIN, 0}, {end_file_, POLLIN, 0}};
    if (poll(files, 2, -1) < 0) continue;
    if (files[1].revents != 0) return;
    char discarded[256];
    const ssize_t size = read(STDIN_FILENO, discarded, sizeof(discarded));
    if (size > 0 || (size < 0 && (errno == EINTR || errno == EAGAIN))) continue;
    on_end_();
    return;
  }
}

}  // namespace multipanda::cli
