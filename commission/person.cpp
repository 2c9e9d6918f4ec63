#include "commission/person.hpp"

#include <cerrno>
#include <cmath>
#include <cstdlib>
#include <poll.h>
#include <termios.h>
#include <unistd.h>

#include <fmt/format.h>

namespace multipanda::commission {
namespace {

std::string trimmed(const std::string& text) {
  const auto first = text.find_first_not_of(" \t\r"), last = text.find_last_not_of(" \t\r");
  return first == std::string::npos ? std::string() : text.substr(first, last - first + 1);
}

}  // namespace

std::optional<std::string> Person::line() {
  if (!options_.named && isatty(options_.file) != 0) forget_keys();
  for (;;) {
    if (const auto end = rest_.find('\n'); end != std::string::npos) {
      std::string found = trimmed(rest_.substr(0, end));
      rest_.erase(0, end + 1);
      // Comments and empty lines of a file answer nothing; on a terminal an empty line is a key.
      if (options_.named && (found.empty() || found.front() == '#')) continue;
      return found;
    }
    if (options_.meanwhile) options_.meanwhile();
    pollfd waiting{options_.file, POLLIN, 0};
    constexpr int kLook_ms = 100;
    const int ready = ::poll(&waiting, 1, kLook_ms);
    if (ready < 0 && errno != EINTR) throw Ended(options_.source + " cannot be read any more");
    if (ready <= 0) continue;
    char bytes[256];
    const auto count = ::read(options_.file, bytes, sizeof(bytes));
    if (count < 0 && errno == EINTR) continue;
    if (count <= 0) return std::nullopt;  // also Ctrl-D: nobody is there
    rest_.append(bytes, static_cast<std::size_t>(count));
  }
}

bool Person::is_answered() const {
  pollfd waiting{options_.file, POLLIN, 0};
  return !rest_.empty() || (::poll(&waiting, 1, 0) > 0 && (waiting.revents & POLLIN) != 0);
}

// A key that was pressed before the question was read answers nothing, nor one that bounces, is pressed twice
// or kept down: keys count from a pause on.
void Person::forget_keys() {
  constexpr int kLook_ms = 100, kLooks = 3;
  for (int quiet = 0; quiet < kLooks;) {
    if (options_.meanwhile) options_.meanwhile();
    (void)tcflush(options_.file, TCIFLUSH);
    pollfd waiting{options_.file, POLLIN, 0};
    const bool pressed = ::poll(&waiting, 1, kLook_ms) > 0 && (waiting.revents & POLLIN) != 0;
    quiet = pressed ? 0 : quiet + 1;
  }
  rest_.clear();
}

std::string Person::answer(const std::string& id, const std::string& text) {
  if (options_.named && !options_.early && is_answered()) {
    throw Ended(
        fmt::format("{}: an answer was there before '{}' was asked; with real arms each answer comes after "
                    "its question, from a terminal or a pipe",
                    options_.source, id));
  }
  options_.show(id, text);
  const std::optional<std::string> read = line();
  if (!read) {
    throw Ended(fmt::format("{} end before '{}': nobody answers for the person, and nothing is assumed",
                            options_.source, id));
  }
  const std::string& found = *read;
  if (!options_.named) {
    if (found == "quit" || found == "q") throw Ended("ended on request at '" + id + "'");
    return found;
  }
  const auto colon = found.find(':');
  if (colon == std::string::npos || trimmed(found.substr(0, colon)) != id) {
    throw Ended(fmt::format("{}: expected '{}: ...', found '{}'; the answers keep the order of the questions",
                            options_.source, id, found));
  }
  std::string said = trimmed(found.substr(colon + 1));
  if (said == "quit") throw Ended("ended on request at '" + id + "'");
  return said;
}

void Person::refuse(const std::string& id, const std::string& found, const std::string& expected) const {
  const std::string text = fmt::format("'{}': expected {}, found '{}'", id, expected, found);
  if (options_.named) throw Ended(options_.source + ": " + text);
  options_.show(id, text);
}

void Person::ready(const std::string& id, const std::string& text) {
  for (;;) {
    const std::string said = answer(id, text + (options_.named ? "" : "\n  Enter: go, quit: end here > "));
    if (said == "go" || (said.empty() && !options_.named)) return;
    refuse(id, said, "go or quit");
  }
}

bool Person::yes(const std::string& id, const std::string& text) {
  for (;;) {
    const std::string said = answer(id, text + (options_.named ? "" : " [yes/no/quit] > "));
    if (said == "yes" || said == "y") return true;
    if (said == "no" || said == "n") return false;
    refuse(id, said, "yes, no or quit");
  }
}

double Person::number(const std::string& id, const std::string& text, double low, double high) {
  for (;;) {
    const std::string said = answer(id, text + (options_.named ? "" : " > "));
    char* end = nullptr;
    const double value = std::strtod(said.c_str(), &end);
    if (end != said.c_str() && *end == '\0' && value >= low && value <= high) return value;
    refuse(id, said, fmt::format("a number from {:g} to {:g}", low, high));
  }
}

}  // namespace multipanda::commission
