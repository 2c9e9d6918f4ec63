#include "cli/reduced_run.hpp"

#include <algorithm>
#include <cstdint>
#include <cstdlib>
#include <fstream>
#include <iterator>
#include <system_error>

#include <fmt/format.h>

namespace multipanda::cli {
namespace {

// Below the usual bounds: for somebody who sees for the first time what a scene does on arms.
constexpr ContactBounds kReduced{.hand_speed = 0.1, .spring_force = 30, .spring_moment = 7.5};

bool has_physical_arms(const Scene& scene) {
  return std::any_of(scene.arms.begin(), scene.arms.end(), is_physical);
}

// A scene that was changed is another one, and so is one whose plug-ins were: its laws are in them. FNV-1a,
// which stays the same between builds.
std::string key_of(const Scene& scene) {
  std::uint64_t hash = 0xcbf29ce484222325u;
  const auto add = [&hash](char c) { hash = (hash ^ static_cast<unsigned char>(c)) * 0x100000001b3u; };
  for (const char c : scene.text) add(c);
  for (const auto& plugin : scene.plugins) {
    std::ifstream file(plugin, std::ios::binary);
    std::for_each(std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>(), add);
  }
  return fmt::format("{:016x} {}", hash, scene.name);
}

bool contains(const std::filesystem::path& file, const std::string& key) {
  std::ifstream in(file);
  for (std::string line; std::getline(in, line);) {
    if (line == key) return true;
  }
  return false;
}

}  // namespace

std::filesystem::path ReducedRun::first_runs_file() {
  if (const char* state = std::getenv("XDG_STATE_HOME"); state != nullptr && *state == '/') {
    return std::filesystem::path(state) / "multipanda/first_runs";
  }
  const char* home = std::getenv("HOME");
  return home != nullptr && *home == '/' ? std::filesystem::path(home) / ".local/state/multipanda/first_runs"
                                         : std::filesystem::path();
}

ReducedRun::ReducedRun(const Scene& scene, Reduction reduction, std::filesystem::path memory)
    : memory_(std::move(memory)) {
  const bool physical = has_physical_arms(scene);
  if (physical) key_ = key_of(scene);
  if (reduction == Reduction::asked) {
    why_ = "as asked";
  } else if (reduction == Reduction::as_usual && physical && !contains(memory_, key_)) {
    why_ = "the first run of this scene on physical arms; --full-speed lifts it";
  }
  if (reduced()) {
    text_ = fmt::format("reduced: hands at most {:g} m/s, springs at most {:g} N and {:g} N m ({})",
                        kReduced.hand_speed, kReduced.spring_force, kReduced.spring_moment, why_);
  } else if (reduction == Reduction::refused && physical) {
    text_ = "--full-speed: the bounds of the scene, also in its first run";
  }
}

void ReducedRun::apply(Scene& scene) const {
  if (!reduced()) return;
  const auto lower = [](ContactBounds& bounds) {
    bounds.hand_speed = std::min(bounds.hand_speed, kReduced.hand_speed);
    bounds.spring_force = std::min(bounds.spring_force, kReduced.spring_force);
    bounds.spring_moment = std::min(bounds.spring_moment, kReduced.spring_moment);
  };
  lower(scene.contact_bounds);
  for (auto& controllet : scene.controllets) lower(controllet.contact);
  scene.lifted.clear();
}

std::string ReducedRun::remember(const SeenRun& seen) const {
  if (key_.empty() || memory_.empty() || contains(memory_, key_)) return {};
  if (const std::string missing = seen.missing(); !missing.empty())
    return fmt::format("does not count as the first run of this scene on physical arms: it {}", missing);
  std::error_code error;
  std::filesystem::create_directories(memory_.parent_path(), error);
  std::ofstream(memory_, std::ios::app) << key_ << '\n';
  return {};
}

}  // namespace multipanda::cli
