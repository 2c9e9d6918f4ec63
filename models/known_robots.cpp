#include "models/known_robots.hpp"

#include <fstream>
#include <iterator>

namespace multipanda {
namespace {

std::string text_of(const std::filesystem::path& file) {
  std::ifstream stream(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(stream), std::istreambuf_iterator<char>()};
}

}  // namespace

std::optional<RobotDescription> KnownRobots::find(const std::filesystem::path& file) {
  const std::scoped_lock lock(mutex_);
  const auto found = known_.find(file);
  if (found == known_.end()) return std::nullopt;
  for (const auto& [path, text] : found->second.texts) {
    if (text_of(path) != text) return std::nullopt;
  }
  return found->second.robot;
}

void KnownRobots::keep(const std::filesystem::path& file, const std::vector<std::filesystem::path>& files,
                       const RobotDescription& robot) {
  Entry entry{.robot = robot, .texts = {}};
  for (const auto& path : files) entry.texts.emplace_back(path, text_of(path));
  const std::scoped_lock lock(mutex_);
  known_.insert_or_assign(file, std::move(entry));
}

KnownRobots& known_robots() {
  static KnownRobots robots;
  return robots;
}

}  // namespace multipanda
