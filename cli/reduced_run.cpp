#include "cli/reduced_run.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <fstream>
#include <iterator>
#include <system_error>

#include <fmt/format.h>

#include "common/machine.hpp"
#include "models/robot_description.hpp"

namespace multipanda::cli {
namespace {

constexpr double kLongestStep = 0.01;  // lost records show no motion [s]

double duration_of(const TimelineEvent& event) {
  if (event.what == TimelineEvent::What::set_reference) return event.duration_s;
  if (event.what == TimelineEvent::What::set_motion) return event.period_s * event.cycles + event.ramp_s;
  return 0;
}

// Speed of the fastest joint [rad/s]; not finite if one is not.
double speed_of(const ArmSample& arm, std::size_t joints) {
  double speed = 0;
  for (std::size_t j = 0; j < joints; ++j) {
    if (!std::isfinite(arm.dq[j])) return arm.dq[j];
    speed = std::max(speed, std::abs(arm.dq[j]));
  }
  return speed;
}

// At the start or by the timeline.
bool is_started(const Scene& scene, const std::string& name) {
  const auto names = [&](const std::vector<std::string>& list) {
    return std::find(list.begin(), list.end(), name) != list.end();
  };
  return names(scene.active) ||
         std::any_of(scene.timeline.begin(), scene.timeline.end(),
                     [&](const TimelineEvent& event) { return names(event.activate); });
}

// Below the usual bounds: for a person who sees the scene on arms for the first time.
constexpr ContactBounds kReduced{.hand_speed = 0.1, .spring_force = 30, .spring_moment = 7.5};

bool has_physical_arms(const Scene& scene) {
  return std::any_of(scene.arms.begin(), scene.arms.end(), is_physical);
}

// A scene counts as another one if it, its plug-ins or its models changed, or if it runs on other arms, since
// all of them define laws and limits. FNV-1a, which stays the same between builds.
std::string key_of(const Scene& scene) {
  std::uint64_t hash = 0xcbf29ce484222325u;
  const auto add = [&hash](char c) { hash = (hash ^ static_cast<unsigned char>(c)) * 0x100000001b3u; };
  const auto add_text = [&add](const std::string& text) { std::ranges::for_each(text, add); };
  const auto add_file = [&add](const std::filesystem::path& path) {
    std::ifstream file(path, std::ios::binary);
    std::for_each(std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>(), add);
  };
  add_text(scene.text);
  for (const auto& plugin : scene.plugins) add_file(plugin);
  for (const auto& arm : scene.arms) {
    for (const auto& file : robot_files(arm.model)) add_file(file);
    add_text(arm.fci ? arm.fci->address + '\n' : "\n");
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

bool is_physical(const SceneArm& arm) { return arm.fci && !is_on_this_computer(arm.fci->address); }

SeenRun::SeenRun(const Scene& scene) : follows_(scene.arms.size()), moving_s_(scene.arms.size()) {
  for (const auto& config : scene.controllets) {
    const bool leads_its_own = config.type == "teleoperation";
    if (config.observes.empty() && !leads_its_own) continue;
    followers_.insert(config.name);
    for (std::size_t i = leads_its_own ? 1 : 0; i < config.arms.size(); ++i)
      follows_[config.arms[i]] = follows_[config.arms[i]] || is_started(scene, config.name);
  }
  for (const auto& arm : scene.arms) {
    names_.push_back(arm.name);
    physical_.push_back(is_physical(arm));
  }
  for (const auto& event : scene.timeline) {
    timeline_ends_s_ = std::max(timeline_ends_s_, event.at_s + duration_of(event));
    timeline_moves_ = timeline_moves_ || event.what == TimelineEvent::What::set_reference ||
                      event.what == TimelineEvent::What::set_motion;
  }
}

void SeenRun::begin(const RecordLayout& layout) {
  for (const auto& arm : layout.arms) joints_.push_back(arm.joint_count);
  for (const auto& instance : layout.instances)
    commanded_.push_back(!instance.inputs.empty() || followers_.contains(instance.name));
}

void SeenRun::take(const CycleRecord& record) {
  const double dt = std::clamp(record.t.seconds() - t_s_, 0.0, kLongestStep);
  t_s_ = record.t.seconds();
  bool rest = true;
  for (std::size_t i = 0; i < physical_.size() && i < record.arms.size() && i < joints_.size(); ++i) {
    const ArmSample& arm = record.arms[i];
    if (!physical_[i]) continue;
    const double speed = speed_of(arm, joints_[i]);
    rest = rest && speed <= kMoving;
    if (speed > kMoving && std::isfinite(speed) && arm.owner < commanded_.size() && commanded_[arm.owner])
      moving_s_[i] += dt;
  }
  rest_s_ = rest && t_s_ >= timeline_ends_s_ ? rest_s_ + dt : 0;
}

std::string SeenRun::missing() const {
  if (timeline_moves_ && t_s_ < timeline_ends_s_)
    return fmt::format("ended at {:.1f} s, and the timeline's last motion at {:.1f} s", t_s_,
                       timeline_ends_s_);
  double most = 0;
  for (std::size_t i = 0; i < physical_.size(); ++i) {
    if (!physical_[i]) continue;
    most = std::max(most, moving_s_[i]);
    if (timeline_moves_ && follows_[i] && moving_s_[i] < kTimelineMotion_s) {
      return fmt::format("moved arm '{}', which follows, for {:.1f} s; expected {:g} s", names_[i],
                         moving_s_[i], kTimelineMotion_s);
    }
    if (!timeline_moves_ && moving_s_[i] < kCommandedMotion_s) {
      return fmt::format("moved arm '{}' for {:.1f} s; expected {:g} s for each arm", names_[i], moving_s_[i],
                         kCommandedMotion_s);
    }
  }
  if (!timeline_moves_) return {};
  if (most < kTimelineMotion_s)
    return fmt::format("moved the arms for {:.1f} s; expected {:g} s", most, kTimelineMotion_s);
  if (rest_s_ < kRest_s) return "ended before the arms came to rest";
  return {};
}

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
