#include "cli/seen_run.hpp"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include "support/address.hpp"

namespace multipanda::cli {
namespace {

constexpr double kLongestStep = 0.01;  // [s] lost records show no motion

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

}  // namespace multipanda::cli
