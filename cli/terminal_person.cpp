#include "cli/terminal_person.hpp"

#include <cerrno>
#include <poll.h>
#include <termios.h>
#include <unistd.h>

namespace multipanda::cli {
namespace {

constexpr int kLook_ms = 100;

}  // namespace

bool TerminalPerson::present() { return isatty(STDIN_FILENO) != 0 && tcgetpgrp(STDIN_FILENO) == getpgrp(); }

bool TerminalPerson::confirm(const Question& question, const std::function<bool()>& withdrawn) {
  console_.line(question.text);
  for (;;) {
    // An Enter that was meant for an earlier question, or pressed by mistake while an arm moved, confirms
    // nothing.
    if (tcflush(STDIN_FILENO, TCIFLUSH) != 0) return false;
    console_.raw("  [Enter: yes, q: stop] > ");
    for (;;) {
      if (withdrawn()) {
        console_.line("withdrawn");
        return false;
      }
      pollfd input{STDIN_FILENO, POLLIN, 0};
      const int ready = poll(&input, 1, kLook_ms);
      if (ready < 0 && errno != EINTR) return false;
      if (ready > 0) break;
    }
    char text[256];
    const ssize_t size = read(STDIN_FILENO, text, sizeof(text));
    if (size <= 0) return false;
    const std::string line(text, static_cast<std::size_t>(size));
    const auto first = line.find_first_not_of(" \t\r\n");
    if (first == std::string::npos) return !withdrawn();
    if (line[first] == 'q' || line[first] == 'Q' || line[first] == 'n' || line[first] == 'N') return false;
    console_.line("  not understood: Enter alone confirms, q stops");
  }
}

}  // namespace multipanda::cli
