#include "common/person.hpp"

#include <cerrno>
#include <cstdlib>
#include <fcntl.h>
#include <poll.h>
#include <termios.h>
#include <unistd.h>

#include <fmt/format.h>

#include "common/text.hpp"

namespace multipanda {
namespace {

constexpr int kLook_ms = 100;
constexpr int kQuietLooks = 10;  // pause without keys before a question can be answered

}  // namespace

Person::Options Person::source(const std::string& answers) {
  Options options;
  if (answers.empty()) {
    if (isatty(STDIN_FILENO) == 0 || tcgetpgrp(STDIN_FILENO) != getpgrp())
      throw std::invalid_argument(
          "there is no terminal; a person must confirm before anything moves: on a terminal, or with "
          "--answers FILE");
    options.source = "the terminal";
    return options;
  }
  options.named = true;
  options.source = "the answers of " + answers;
  if (answers != "-") options.file = ::open(answers.c_str(), O_RDONLY | O_CLOEXEC);
  if (options.file < 0) throw std::invalid_argument("--answers: cannot open " + answers);
  return options;
}

short Person::wait_for_input(int timeout_ms) {
  pollfd input{options_.file, POLLIN, 0};
  const int ready = ::poll(&input, 1, timeout_ms);
  if (ready < 0 && errno != EINTR) throw Ended(options_.source + " became unreadable");
  return ready > 0 ? input.revents : short{0};
}

std::optional<std::string> Person::line() {
  for (;;) {
    if (const auto end = rest_.find('\n'); end != std::string::npos) {
      std::string found(trimmed(std::string_view(rest_).substr(0, end)));
      rest_.erase(0, end + 1);
      // Comments and empty lines of a file are no answers; on a terminal an empty line is one.
      if (options_.named && (found.empty() || found.front() == '#')) continue;
      return found;
    }
    meanwhile_();
    if (wait_for_input(kLook_ms) == 0) continue;
    char bytes[256];
    const auto count = ::read(options_.file, bytes, sizeof(bytes));
    if (count < 0 && errno == EINTR) continue;
    if (count <= 0) return std::nullopt;  // also Ctrl-D: end of input
    rest_.append(bytes, static_cast<std::size_t>(count));
  }
}

// A key pressed before the question was read is no answer, nor is a bouncing, repeated or held key: only keys
// after a pause count.
void Person::forget_keys() {
  for (int quiet = 0; quiet < kQuietLooks;) {
    meanwhile_();
    (void)tcflush(options_.file, TCIFLUSH);
    const short seen = wait_for_input(kLook_ms);
    if ((seen & (POLLHUP | POLLERR | POLLNVAL)) != 0) throw Ended(options_.source + " is closed");
    quiet = seen != 0 ? 0 : quiet + 1;
  }
  rest_.clear();
}

std::string Person::answer(const std::string& id, const std::string& text, const std::string& choices) {
  if (options_.named && !options_.early && (!rest_.empty() || (wait_for_input(0) & POLLIN) != 0)) {
    throw Ended(
        fmt::format("{}: an answer arrived before the question '{}'; with real arms each answer must follow "
                    "its question, from a terminal or a pipe",
                    options_.source, id));
  }
  options_.show(id, text);
  if (!options_.named && isatty(options_.file) != 0) forget_keys();
  if (options_.prompt)
    options_.prompt(options_.named ? fmt::format("  expected: '{}: ...'\n", id) : "  [" + choices + "] > ");
  const std::optional<std::string> read = line();
  meanwhile_();
  if (!read) {
    throw Ended(fmt::format("{} end before '{}': without an answer nothing is assumed", options_.source, id));
  }
  std::string said = *read;
  if (options_.named) {
    const auto colon = said.find(':');
    if (colon == std::string::npos || trimmed(said.substr(0, colon)) != id) {
      throw Ended(
          fmt::format("{}: expected '{}: ...', found '{}'; answers must be in the order of the questions",
                      options_.source, id, said));
    }
    said = trimmed(said.substr(colon + 1));
  }
  if (said == "quit" || (said == "q" && !options_.named)) throw Ended("ended on request at '" + id + "'");
  return said;
}

void Person::refuse(const std::string& id, const std::string& found, const std::string& expected) const {
  const std::string text = fmt::format("'{}': expected {}, found '{}'", id, expected, found);
  if (options_.named) throw Ended(options_.source + ": " + text);
  options_.show(id, text);
}

void Person::ready(const std::string& id, const std::string& text) {
  for (;;) {
    const std::string said = answer(id, text, "Enter: go, q: quit");
    if (said == "go" || (said.empty() && !options_.named)) return;
    refuse(id, said, "go or quit");
  }
}

bool Person::yes(const std::string& id, const std::string& text) {
  for (;;) {
    const std::string said = answer(id, text, "yes, no, q: quit");
    if (said == "yes" || said == "y") return true;
    if (said == "no" || said == "n") return false;
    refuse(id, said, "yes, no or quit");
  }
}

double Person::number(const std::string& id, const std::string& text, double low, double high) {
  for (;;) {
    const std::string said = answer(id, text, fmt::format("{:g} to {:g}, q: quit", low, high));
    char* end = nullptr;
    const double value = std::strtod(said.c_str(), &end);
    if (end != said.c_str() && *end == '\0' && value >= low && value <= high) return value;
    refuse(id, said, fmt::format("a number from {:g} to {:g}", low, high));
  }
}

}  // namespace multipanda
