#include "cli/key_watch.hpp"

#include <cstdint>
#include <poll.h>
#include <sys/eventfd.h>
#include <unistd.h>

namespace multipanda::cli {

KeyWatch::KeyWatch(std::function<void(char)> on_key) : on_key_(std::move(on_key)) {
  // A background process must not change the terminal: it would be suspended.
  if (isatty(STDIN_FILENO) == 0 || tcgetpgrp(STDIN_FILENO) != getpgrp()) return;
  if (tcgetattr(STDIN_FILENO, &before_) != 0) return;
  end_file_ = eventfd(0, EFD_CLOEXEC);
  if (end_file_ < 0) return;
  termios keys = before_;
  keys.c_lflag &= ~static_cast<tcflag_t>(ICANON | ECHO);
  if (tcsetattr(STDIN_FILENO, TCSANOW, &keys) != 0) return;
  thread_ = std::thread([this] { watch(); });
}

KeyWatch::~KeyWatch() {
  if (thread_.joinable()) {
    const std::uint64_t one = 1;
    (void)!write(end_file_, &one, sizeof(one));
    thread_.join();
    tcsetattr(STDIN_FILENO, TCSANOW, &before_);
  }
  if (end_file_ >= 0) close(end_file_);
}

void KeyWatch::watch() {
  while (true) {
    pollfd files[2] = {{STDIN_FILENO, POLLIN, 0}, {end_file_, POLLIN, 0}};
    if (poll(files, 2, -1) < 0) continue;
    if (files[1].revents != 0) return;
    char key = 0;
    if (read(STDIN_FILENO, &key, 1) != 1) return;  // the terminal was closed
    on_key_(key);
  }
}

}  // namespace multipanda::cli
