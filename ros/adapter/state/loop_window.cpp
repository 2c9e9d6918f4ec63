#include "ros/adapter/state/loop_window.hpp"

#include <limits>

#include "core/types/statistics.hpp"

namespace multipanda::ros {

LoopWindow::LoopWindow() {
  periods_.reserve(kKept);
  cycle_times_.reserve(kKept);
}

void LoopWindow::keep(std::vector<double>& values, double value) const {
  if (values.size() < kKept) {
    values.push_back(value);
  } else {
    values[added_ % kKept] = value;
  }
}

void LoopWindow::add(const CycleRecord& record) {
  if (!any_) {
    any_ = true;
    first_cycle_ = record.cycle - 1;  // this is the first cycle of the window
    first_start_ = record.start;
    first_overruns_ = record.overruns;
  } else if (record.cycle == last_cycle_ + 1) {  // otherwise records are missing in between
    keep(periods_, seconds(record.start - last_start_));
  }
  keep(cycle_times_, 1e-9 * record.stages.total);
  last_cycle_ = record.cycle;
  last_start_ = record.start;
  last_overruns_ = record.overruns;
  ++added_;
}

// Ranks are rounded up: with fewer than 100 values the 99th percentile is the worst.
LoopWindow::Durations LoopWindow::durations(std::vector<double>& values) {
  if (values.empty()) {
    constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
    return {kNone, kNone, kNone};
  }
  return {quantile(values, 0.5), quantile(values, 0.99), quantile(values, 1)};
}

LoopWindow::Figures LoopWindow::finish() {
  Figures figures;
  figures.window_s = seconds(last_start_ - first_start_);
  figures.cycle = last_cycle_;
  figures.cycles = last_cycle_ - first_cycle_;
  const auto intervals = static_cast<double>(figures.cycles) - (counts_first_ ? 1 : 0);
  if (figures.window_s > 0) figures.rate_hz = intervals / figures.window_s;
  figures.period = durations(periods_);
  figures.cycle_time = durations(cycle_times_);
  figures.overruns = last_overruns_;
  figures.overruns_window = last_overruns_ - first_overruns_;

  periods_.clear();
  cycle_times_.clear();
  added_ = 0;
  counts_first_ = false;
  first_cycle_ = last_cycle_;
  first_start_ = last_start_;
  first_overruns_ = last_overruns_;
  return figures;
}

}  // namespace multipanda::ros
