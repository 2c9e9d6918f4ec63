#include "ros/adapter/state/loop_topics.hpp"

#include <chrono>

#include <fmt/format.h>

#include "backends/arm/arm_error.hpp"
#include "core/state/arm_words.hpp"
#include "ros/adapter/state/messages.hpp"
#include "runtime/request_words.hpp"

namespace multipanda::ros {
namespace {

constexpr double kSilence_s = 0.5;  // without a record, the loop is thought to stand

std::string us(double s) { return fmt::format("{:.1f}", 1e6 * s); }

Diagnostic::Level level_of(const ArmSample& sample) {
  const auto mode = static_cast<ArmMode>(sample.mode);
  if (sample.errors != 0 || mode == ArmMode::reflex || mode == ArmMode::disconnected)
    return Diagnostic::Level::error;
  return mode == ArmMode::move ? Diagnostic::Level::ok : Diagnostic::Level::warn;
}

}  // namespace

LoopTopics::LoopTopics(const AdapterWorld& world)
    : world_(world),
      words_(*world.layout),
      every_(world.options->rates_hz.loop_statistics, period_of(world)),
      every_window_(every_.off() ? 1 : 1000, period_of(world)),
      switches_(*world.node, "~/switch_events", Qos::latched(50),
                Doc{"on change", "Every change of the active controllets, and every refusal."}),
      events_(
          *world.node, "~/events", Qos::latched(50),
          Doc{"on change",
              "What else happened: interventions of the safety stage, parameters, goals, features, stops, "
              "arms' modes and settings. Those who come late get the newest 50."}) {
  newest_.arms.resize(world.layout->arms.size());
  if (every_.off()) return;
  statistics_.emplace(
      *world.node, "~/loop_statistics", Qos::reliable(),
      Doc{every_.words(period_of(world)),
          "Rate, periods and work of the loop's cycles since the message before; overruns; how "
          "publishing and taking in fare."});
}

void LoopTopics::take(const CycleRecord& record) {
  window_.add(record);
  // The very first turn would be a window of one cycle.
  const bool look = (every_.off() ? every_window_ : every_).due(record.cycle) && record.cycle > 1;
  std::optional<LoopWindow::Figures> figures;
  if (look) figures = window_.look();
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
  out.stamp = to_time(world_.stamps.of(record));
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
  const AdapterCounters& counters = *world_.counters;
  out.records_dropped = counters.records_dropped;
  out.messages_published = world_.node->published();
  out.publish_failures = world_.node->publish_failures();
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
    words_.fill_switch(event, out);
    switches_.publish(out);
    return;
  }
  multipanda_msgs::msg::Event out;
  out.stamp = to_time(event.t.ns);
  words_.fill(event, out);
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
    line.message = "has not begun";
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
  Diagnostic line{.name = world_.layout->arms[arm].name};
  if (!newest.any) {
    line.level = Diagnostic::Level::warn;
    line.message = "nothing is known of it yet";
    return line;
  }
  const bool stopped = world_.modes->stopped().contains(static_cast<ArmIndex>(arm));
  line.level = level_of(sample);
  line.message = std::string(to_string(static_cast<ArmMode>(sample.mode)));
  if (sample.errors != 0) line.message += ": " + error_names(sample.errors);
  if (stopped && line.level == Diagnostic::Level::ok) {
    line.level = Diagnostic::Level::warn;
    line.message = "stopped: held until resumed";
  }
  const auto& instances = world_.layout->instances;
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
  const AdapterCounters& counters = *world_.counters;
  Diagnostic line{.name = "ros"};
  const std::uint64_t dropped = counters.records_dropped, failed = world_.node->publish_failures();
  if (dropped > 0 || failed > 0) {
    line.level = Diagnostic::Level::warn;
    line.message = fmt::format(
        "{} cycles were not published in time, {} messages not taken by the middleware", dropped, failed);
  } else {
    line.message = "all cycles were published in time";
  }
  line.values = {{"cycles dropped", std::to_string(dropped)},
                 {"messages published", std::to_string(world_.node->published())},
                 {"publish failures", std::to_string(failed)},
                 {"samples accepted", std::to_string(counters.samples_accepted)},
                 {"samples refused", std::to_string(counters.samples_refused)},
                 {"requests", std::to_string(counters.requests)},
                 {"requests refused", std::to_string(counters.requests_refused)}};
  return line;
}

DiagnosticsTopic::DiagnosticsTopic(const AdapterWorld& world) : world_(world) {
  const double rate = world.options->rates_hz.diagnostics;
  if (rate <= 0) return;
  publisher_.emplace(*world.node, "/diagnostics", Qos::reliable(),
                     Doc{fmt::format("{:.4g} Hz", rate),
                         "The loop, each arm, publishing, each input: as diagnostic tools show it. In this "
                         "computer's time."});
  timer_ = world.executor->add_timer(std::chrono::nanoseconds(LoopTime::from_seconds(1 / rate).ns),
                                     [this] { publish(); });
}

DiagnosticsTopic::~DiagnosticsTopic() {
  if (timer_) world_.executor->remove_timer(*timer_);
}

void DiagnosticsTopic::publish() {
  if (publisher_->subscribers() == 0) return;
  diagnostic_msgs::msg::DiagnosticArray out;
  out.header.stamp = system_time();
  for (const Diagnostic& line : world_.diagnostics()) {
    auto& status = out.status.emplace_back();
    status.level = static_cast<unsigned char>(line.level);
    status.name = world_.node->name() + ": " + line.name;
    status.hardware_id = world_.scene->name;
    status.message = line.message;
    for (const auto& [key, value] : line.values) {
      auto& pair = status.values.emplace_back();
      pair.key = key;
      pair.value = value;
    }
  }
  publisher_->publish(out);
}

}  // namespace multipanda::ros
