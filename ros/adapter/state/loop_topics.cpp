#include "ros/adapter/state/loop_topics.hpp"

#include <chrono>
#include <limits>

#include <fmt/format.h>

#include "arm_interface/arm_error.hpp"
#include "core/state/arm_state.hpp"
#include "core/types/statistics.hpp"
#include "ros/adapter/state/messages.hpp"
#include "runtime/request_text.hpp"

namespace multipanda::ros {

namespace {

constexpr double kSilence_s = 0.5;  // without a record for this long, the loop counts as stopped

std::string us(double s) { return fmt::format("{:.1f}", 1e6 * s); }

Diagnostic::Level level_of(const ArmSample& sample) {
  const auto mode = static_cast<ArmMode>(sample.mode);
  if (sample.errors != 0 || mode == ArmMode::reflex || mode == ArmMode::disconnected)
    return Diagnostic::Level::error;
  return mode == ArmMode::move ? Diagnostic::Level::ok : Diagnostic::Level::warn;
}

}  // namespace

LoopTopics::LoopTopics(const AdapterContext& run)
    : run_(run),
      text_(*run.layout),
      every_(run.options->rates_hz.loop_statistics, period_of(run)),
      every_window_(every_.off() ? 1 : 1000, period_of(run)),
      switches_(*run.node, "~/switch_events", Qos::latched(50),
                Doc{"on change", "Every change of the active controllets, and every refusal."}),
      events_(*run.node, "~/events", Qos::latched(50),
              Doc{"on change",
                  "Other events: interventions of the safety stage, parameters, goals, features, stops, "
                  "modes and settings of arms. Late subscribers get the newest 50."}) {
  newest_.arms.resize(run.layout->arms.size());
  if (every_.off()) return;
  statistics_.emplace(*run.node, "~/loop_statistics", Qos::reliable(),
                      Doc{every_.text(period_of(run)),
                          "Rate, period and cycle time of the loop since the previous message; overruns; "
                          "counters of publishing and of inputs."});
}

void LoopTopics::take(const CycleRecord& record) {
  window_.add(record);
  // Skips the first call, whose window would be a single cycle.
  const bool due = (every_.off() ? every_window_ : every_).due(record.cycle) && record.cycle > 1;
  std::optional<LoopWindow::Figures> figures;
  if (due) figures = window_.finish();
  {
    const std::lock_guard lock(mutex_);
    newest_.any = true;
    newest_.start = record.start;
    newest_.arms = record.arms;
    if (figures) newest_.figures = *figures;
  }
  if (figures && statistics_) publish(*figures, record);
}

void LoopTopics::publish(const LoopWindow::Figures& figures, const CycleRecord& record) {
  multipanda_msgs::msg::LoopStatistics out;
  out.stamp = to_time(run_.stamps.of(record));
  out.cycle = figures.cycle;
  out.window = figures.window_s;
  out.cycles = figures.cycles;
  out.rate = figures.rate_hz;
  out.period_median = figures.period.median;
  out.period_p99 = figures.period.p99;
  out.period_worst = figures.period.worst;
  out.cycle_time_median = figures.cycle_time.median;
  out.cycle_time_p99 = figures.cycle_time.p99;
  out.cycle_time_worst = figures.cycle_time.worst;
  out.overruns = figures.overruns;
  out.overruns_window = figures.overruns_window;
  const AdapterCounters& counters = *run_.counters;
  out.records_dropped = counters.records_dropped;
  out.messages_published = run_.node->published();
  out.publish_failures = run_.node->publish_failures();
  out.samples_accepted = counters.samples_accepted;
  out.samples_refused = counters.samples_refused;
  out.requests = counters.requests;
  out.requests_refused = counters.requests_refused;
  statistics_->publish(out);
}

void LoopTopics::take(const Event& event) {
  if (event.kind == EventKind::switched || event.kind == EventKind::switch_refused) {
    multipanda_msgs::msg::Switch out;
    out.stamp = to_time(event.t.ns);
    text_.fill_switch(event, out);
    switches_.publish(out);
    return;
  }
  multipanda_msgs::msg::Event out;
  out.stamp = to_time(event.t.ns);
  text_.fill(event, out);
  events_.publish(out);
}

std::vector<Diagnostic> LoopTopics::diagnostics() const {
  Newest newest;
  {
    const std::lock_guard lock(mutex_);
    newest = newest_;
  }
  std::vector<Diagnostic> lines{about_loop(newest)};
  for (std::size_t arm = 0; arm < newest.arms.size(); ++arm) lines.push_back(about_arm(arm, newest));
  lines.push_back(about_publishing());
  return lines;
}

Diagnostic LoopTopics::about_loop(const Newest& newest) const {
  Diagnostic line{.name = "loop"};
  const LoopWindow::Figures& figures = newest.figures;
  const double silence = newest.any ? seconds(host_now() - newest.start) : 0;
  if (!newest.any) {
    line.level = Diagnostic::Level::warn;
    line.message = "has not started";
  } else if (silence > kSilence_s) {
    line.level = Diagnostic::Level::error;
    line.message = fmt::format("no cycle for {:.1f} s", silence);
  } else if (figures.overruns_window > 0) {
    line.level = Diagnostic::Level::warn;
    line.message = fmt::format("{} overruns in the last {:.1f} s", figures.overruns_window, figures.window_s);
  } else {
    line.message = "running";
  }
  line.values = {{"cycle", std::to_string(figures.cycle)},
                 {"rate [Hz]", fmt::format("{:.1f}", figures.rate_hz)},
                 {"period median [us]", us(figures.period.median)},
                 {"period 99 % [us]", us(figures.period.p99)},
                 {"period worst [us]", us(figures.period.worst)},
                 {"cycle time median [us]", us(figures.cycle_time.median)},
                 {"cycle time 99 % [us]", us(figures.cycle_time.p99)},
                 {"cycle time worst [us]", us(figures.cycle_time.worst)},
                 {"overruns", std::to_string(figures.overruns)}};
  return line;
}

Diagnostic LoopTopics::about_arm(std::size_t arm, const Newest& newest) const {
  const ArmSample& sample = newest.arms[arm];
  Diagnostic line{.name = run_.layout->arms[arm].name};
  if (!newest.any) {
    line.level = Diagnostic::Level::warn;
    line.message = "no state received yet";
    return line;
  }
  const bool stopped = run_.modes->stopped().contains(static_cast<ArmIndex>(arm));
  line.level = level_of(sample);
  line.message = std::string(to_string(static_cast<ArmMode>(sample.mode)));
  if (sample.errors != 0) line.message += ": " + error_names(sample.errors);
  if (stopped && line.level == Diagnostic::Level::ok) {
    line.level = Diagnostic::Level::warn;
    line.message = "stopped: held until resumed";
  }
  const auto& instances = run_.layout->instances;
  line.values = {{"owner", sample.owner < instances.size() ? instances[sample.owner].name : ""},
                 {"mode", std::string(to_string(static_cast<ArmMode>(sample.mode)))},
                 {"errors", error_names(sample.errors)},
                 {"stopped", stopped ? "true" : "false"},
                 {"interventions", std::to_string(sample.interventions)},
                 {"age of the state [us]", us(sample.age_s)},
                 {"command success rate", fmt::format("{:.3f}", sample.command_success_rate)}};
  return line;
}

Diagnostic LoopTopics::about_publishing() const {
  const AdapterCounters& counters = *run_.counters;
  Diagnostic line{.name = "ros"};
  const std::uint64_t dropped = counters.records_dropped, failed = run_.node->publish_failures();
  if (dropped > 0 || failed > 0) {
    line.level = Diagnostic::Level::warn;
    line.message = fmt::format("{} cycles were not published in time, the middleware rejected {} messages",
                               dropped, failed);
  } else {
    line.message = "all cycles were published in time";
  }
  line.values = {{"cycles dropped", std::to_string(dropped)},
                 {"messages published", std::to_string(run_.node->published())},
                 {"publish failures", std::to_string(failed)},
                 {"samples accepted", std::to_string(counters.samples_accepted)},
                 {"samples refused", std::to_string(counters.samples_refused)},
                 {"requests", std::to_string(counters.requests)},
                 {"requests refused", std::to_string(counters.requests_refused)}};
  return line;
}

DiagnosticsTopic::DiagnosticsTopic(const AdapterContext& run) : run_(run) {
  const double rate = run.options->rates_hz.diagnostics;
  if (rate <= 0) return;
  publisher_.emplace(*run.node, "/diagnostics", Qos::reliable(),
                     Doc{fmt::format("{:.4g} Hz", rate),
                         "The loop, each arm, publishing and each input, for diagnostic tools. Stamped with "
                         "this computer's time."});
  timer_ = run.executor->add_timer(std::chrono::nanoseconds(LoopTime::from_seconds(1 / rate).ns),
                                   [this] { publish(); });
}

DiagnosticsTopic::~DiagnosticsTopic() {
  if (timer_) run_.executor->remove_timer(*timer_);
}

void DiagnosticsTopic::publish() {
  if (publisher_->subscribers() == 0) return;
  diagnostic_msgs::msg::DiagnosticArray out;
  out.header.stamp = system_time();
  for (const Diagnostic& line : run_.diagnostics()) {
    auto& status = out.status.emplace_back();
    status.level = static_cast<unsigned char>(line.level);
    status.name = run_.node->name() + ": " + line.name;
    status.hardware_id = run_.scene->name;
    status.message = line.message;
    for (const auto& [key, value] : line.values) {
      auto& pair = status.values.emplace_back();
      pair.key = key;
      pair.value = value;
    }
  }
  publisher_->publish(out);
}

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
