#include "logs/log_choice.hpp"

#include <array>
#include <charconv>
#include <stdexcept>
#include <utility>

namespace multipanda {
namespace {

constexpr std::array<std::pair<std::string_view, std::uint64_t LogEvery::*>, 9> kGroups{
    {{"state", &LogEvery::state},
     {"command", &LogEvery::command},
     {"wrench", &LogEvery::wrench},
     {"references", &LogEvery::references},
     {"outputs", &LogEvery::outputs},
     {"timing", &LogEvery::timing},
     {"model", &LogEvery::model},
     {"report", &LogEvery::report},
     {"objects", &LogEvery::objects}}};
constexpr std::uint64_t kMost = 1'000'000;

}  // namespace

void LogEvery::set(const std::string& choice) {
  const auto wrong = [&] {
    std::string names;
    for (const auto& [name, place] : kGroups) names += std::string(name) + ", ";
    throw std::invalid_argument(
        "'" + choice + "': expected GROUP=N, every Nth cycle or 0 for never; groups: " + names + "all");
  };
  const std::size_t equals = choice.find('=');
  if (equals == std::string::npos) wrong();
  const std::string group = choice.substr(0, equals);
  const char *begin = choice.data() + equals + 1, *end = choice.data() + choice.size();
  std::uint64_t every = 0;
  const auto read = std::from_chars(begin, end, every);
  if (read.ec != std::errc() || read.ptr != end || every > kMost) wrong();
  bool known = false;
  for (const auto& [name, place] : kGroups) {
    if (group != "all" && group != name) continue;
    this->*place = every;
    known = true;
  }
  if (!known) wrong();
}

std::string LogEvery::text() const {
  std::string text;
  for (const auto& [name, place] : kGroups) {
    if (this->*place == LogEvery().*place) continue;
    text += (text.empty() ? "" : " ") + std::string(name) + "=" + std::to_string(this->*place);
  }
  return text;
}

const std::vector<std::string>& episode_marks() {
  static const std::vector<std::string> names{"start", "success", "failure", "discard"};
  return names;
}

std::string_view to_string(EpisodeMark::Kind kind) {
  return episode_marks().at(static_cast<std::size_t>(kind));
}

}  // namespace multipanda
