#include "motion_generators/publish.hpp"

#include <algorithm>

#include "core/rt/pacer.hpp"

namespace multipanda {
namespace {

using circular_field::CourseRun;

constexpr double kLongestBrake = 1;        // [s]
constexpr double kLongestRehearsal = 600;  // [s]

// A histogram of times in microseconds, since a publication may last for days.
class Microseconds {
 public:
  void add(std::chrono::nanoseconds t) {
    worst_ = std::max(worst_, t);
    const auto bin = static_cast<std::size_t>(std::max<std::int64_t>(t.count(), 0) / 1000);
    ++bins_[std::min(bin, bins_.size() - 1)];
    ++count_;
  }
  double worst() const { return static_cast<double>(worst_.count()) * 1e-3; }
  double quantile(double q) const {
    const auto rank = static_cast<std::uint64_t>(q * static_cast<double>(count_));
    std::uint64_t seen = 0;
    for (std::size_t bin = 0; bin < bins_.size(); ++bin) {
      seen += bins_[bin];
      if (seen > rank) return bin + 1 == bins_.size() ? worst() : static_cast<double>(bin);
    }
    return worst();
  }

 private:
  std::vector<std::uint64_t> bins_ = std::vector<std::uint64_t>(20'001);
  std::uint64_t count_ = 0;
  std::chrono::nanoseconds worst_{0};
};

// Plans one period and updates the report.
void plan(CourseRun& run, double dt, PublishReport& report) {
  run.step(dt);
  report.clearance_m = std::min(report.clearance_m, run.clearance());
  for (std::size_t i = 0; i < run.planner().hand_count(); ++i) {
    report.speed_m_per_s = std::max(report.speed_m_per_s, run.planner().hand(i).velocity.norm());
  }
}

// The reason to end; empty to continue.
std::string ending(double time, bool finished, const PublishOptions& options) {
  if (options.stop != nullptr && options.stop->load()) return "stopped";
  if (options.seconds > 0 && time >= options.seconds - 0.5 * seconds(options.period)) return "duration";
  if (options.seconds == 0 && finished) return "goals";
  return "";
}

void count_goals(const CourseRun& run, PublishReport& report) {
  for (std::size_t i = 0; i < run.planner().hand_count(); ++i)
    report.goals_reached.push_back(run.goals_reached(i));
}

}  // namespace

void publish(const Publication& what, const PublishOptions& options, PublishReport& report) {
  const double dt = seconds(options.period);
  Microseconds late, step;
  double brake_since = 0;
  std::uint64_t unsent_in_a_row = 0;
  Pacer pacer(options.period);
  pacer.start();
  const HostTime begin = host_now();
  for (;;) {
    const std::uint64_t missed_before = pacer.overruns();
    pacer.wait();
    late.add(pacer.lateness());
    const HostTime woke = host_now();
    for (std::uint64_t k = missed_before; k <= pacer.overruns(); ++k) what.step(dt);
    step.add(host_now() - woke);
    const std::size_t unsent = what.send(woke.ns);
    report.unsent += unsent;
    unsent_in_a_row = unsent < what.per_period ? 0 : unsent_in_a_row + 1;
    ++report.samples;
    if (static_cast<double>(unsent_in_a_row) * dt > options.patience_s) {
      report.ended_by = "nobody_listens";
      break;
    }
    if (report.ended_by.empty()) {
      report.ended_by = ending(what.time(), what.finished(), options);
      if (report.ended_by.empty()) continue;
      what.brake();
      brake_since = what.time();
    }
    if (what.at_rest() || what.time() - brake_since > kLongestBrake) break;
  }
  report.missed = pacer.overruns();
  report.elapsed_s = seconds(host_now() - begin);
  report.rate_hz = static_cast<double>(report.samples) / report.elapsed_s;
  report.late_median_us = late.quantile(0.5);
  report.late_p99_us = late.quantile(0.99);
  report.late_worst_us = late.worst();
  report.step_median_us = step.quantile(0.5);
  report.step_worst_us = step.worst();
}

PublishReport publish_course(CourseRun& run, PoseSink& sink, const PublishOptions& options) {
  PublishReport report;
  report.clearance_m = run.clearance();
  const std::size_t hands = run.planner().hand_count();
  publish({.per_period = hands,
           .step = [&](double dt) { plan(run, dt, report); },
           .send =
               [&](std::int64_t now_ns) {
                 std::size_t unsent = 0;
                 for (std::size_t i = 0; i < hands; ++i)
                   unsent += sink.publish(i, run.planner().hand(i).X_W, now_ns) ? 0 : 1;
                 return unsent;
               },
           .time = [&] { return run.time(); },
           .finished = [&] { return run.finished(); },
           .brake = [&] { run.brake(); },
           .at_rest = [&] { return run.at_rest(); }},
          options, report);
  count_goals(run, report);
  return report;
}

PublishReport rehearse_course(CourseRun& run, const PublishOptions& options) {
  PublishReport report;
  report.clearance_m = run.clearance();
  const double dt = seconds(options.period);
  Microseconds step;
  const HostTime begin = host_now();
  while (report.ended_by.empty()) {
    const HostTime before = host_now();
    plan(run, dt, report);
    step.add(host_now() - before);
    ++report.samples;
    report.ended_by = ending(run.time(), run.finished(), options);
    if (report.ended_by.empty() && run.time() >= kLongestRehearsal) report.ended_by = "duration";
  }
  report.elapsed_s = seconds(host_now() - begin);
  report.step_median_us = step.quantile(0.5);
  report.step_worst_us = step.worst();
  count_goals(run, report);
  return report;
}

}  // namespace multipanda
