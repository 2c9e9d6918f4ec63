#include "cli/terminal_person.hpp"

#include <cerrno>
#include <poll.h>
#include <termios.h>
#include <unistd.h>

namespace multipanda::cli {
namespace {

constexpr int kLook_ms = 100;
constexpr int kQuietLooks = 10;  // no key for this long before a question can be answered

// Discards what is typed until nothing was for a while: the second Enter of a double press, or one that is
// held down, would confirm a question that nobody has read. False: withdrawn, or the terminal is gone.
bool wait_for_quiet(const std::function<bool()>& withdrawn) {
  for (int quiet = 0; quiet < kQuietLooks;) {
    if (withdrawn() || tcflush(STDIN_FILENO, TCIFLUSH) != 0) return false;
    pollfd input{STDIN_FILENO, POLLIN, 0};
    const int ready = poll(&input, 1, kLook_ms);
    if (ready < 0 && errno != EINTR) return false;
    if (ready > 0 && (input.revents & (POLLHUP | POLLERR)) != 0) return false;
    quiet = ready > 0 ? 0 : quiet + 1;
  }
  return true;
}

}  // namespace

bool TerminalPerson::present() { return isatty(STDIN_FILENO) != 0 && tcgetpgrp(STDIN_FILENO) == getpgrp(); }

bool TerminalPerson::confirm(const Question& question, const std::function<bool()>& withdrawn) {
  console_.line(question.text);
  for (;;) {
    // An Enter for an earlier question, or one that was pressed while an arm moved, confirms nothing.
    if (!wait_for_quiet(withdrawn)) return false;
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
