#include "runtime/live_input/latest_state.hpp"

#include <algorithm>

#include "core/record/arm_config.hpp"
#include "core/types/codes.hpp"

namespace multipanda {

std::string rule_name(Intervention rule) {
  std::string name(rule == Intervention::none ? "" : to_string(rule));
  std::ranges::replace(name, ' ', '_');
  return name;
}

LatestState::LatestState(std::size_t arm_count) { newest_.arms.resize(arm_count); }

void LatestState::take(const CycleRecord& record) {
  constexpr auto kWindow = std::chrono::milliseconds(500);
  const std::lock_guard lock(mutex_);
  if (newest_.cycle == 0) {
    window_begin_ = Clock::now();
    window_cycle_ = record.cycle;
  }
  newest_.cycle = record.cycle;
  newest_.t = record.t;
  newest_.start = record.start;
  newest_.overruns = record.overruns;
  newest_.cycle_us = static_cast<double>(record.stages.total) * 1e-3;
  for (std::size_t arm = 0; arm < newest_.arms.size(); ++arm) {
    newest_.arms[arm].sample = record.arms[arm];
    newest_.arms[arm].success.take(record.arms[arm]);
    if (record.arms[arm].errors == 0) newest_.arms[arm].stop_reason.clear();
  }
  const auto window = Clock::now() - window_begin_;
  if (window < kWindow) return;
  newest_.rate_hz =
      static_cast<double>(record.cycle - window_cycle_) / std::chrono::duration<double>(window).count();
  window_begin_ += window;
  window_cycle_ = record.cycle;
}

void LatestState::take(const Event& event) {
  const std::lock_guard lock(mutex_);
  for (std::size_t i = 0; i < newest_.arms.size(); ++i) note_removal(event, i, newest_.arms[i].removed_by);
  if (event.arm >= newest_.arms.size()) return;
  Arm& arm = newest_.arms[event.arm];
  if (event.kind == EventKind::intervention) arm.last_intervention = rule_name(event.intervention);
  Load tool, load;
  read_arm_config(event, arm.frames, tool, load);
}

void LatestState::take_stop_reason(std::size_t arm, std::string reason) {
  const std::lock_guard lock(mutex_);
  newest_.arms.at(arm).stop_reason = std::move(reason);
}

void LatestState::copy(Snapshot& snapshot) const {
  const std::lock_guard lock(mutex_);
  snapshot = newest_;
}

ArmSample LatestState::sample(std::size_t arm) const {
  const std::lock_guard lock(mutex_);
  return newest_.arms.at(arm).sample;
}

}  // namespace multipanda
