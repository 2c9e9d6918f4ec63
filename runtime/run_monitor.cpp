#include "runtime/run_monitor.hpp"

#include <algorithm>
#include <bit>
#include <cmath>

#include <fmt/format.h>

#include "arm_interface/arm_error.hpp"

namespace multipanda {
namespace {

double microseconds(std::int64_t ns) { return static_cast<double>(ns) * 1e-3; }

}  // namespace

RunMonitor::RunMonitor(RecordLayout layout, std::vector<JointVector> tau_max, Counted counted)
    : success_(layout.arms.size()),
      layout_(std::move(layout)),
      tau_max_(std::move(tau_max)),
      counted_(std::move(counted)),
      last_(layout_.arms.size(), layout_.max_references, layout_.output_count),
      torque_use_(layout_.arms.size(), 0),
      begin_(std::chrono::steady_clock::now()),
      published_(begin_) {
  publish();
}

void RunMonitor::take(const CycleRecord& record) {
  if (cycles_++ == 0) begin_ = published_ = std::chrono::steady_clock::now();
  cycle_times_.add(record.stages.total);
  for (std::size_t arm = 0; arm < record.arms.size(); ++arm) {
    for (Eigen::Index j = 0; j < tau_max_[arm].size(); ++j) {
      const double use = std::abs(record.arms[arm].tau_cmd[static_cast<std::size_t>(j)]) / tau_max_[arm][j];
      torque_use_[arm] = std::max(torque_use_[arm], use);
    }
    success_[arm].take(record.arms[arm]);
  }
  last_ = record;
}

void RunMonitor::note_refusal(const Event& event) {
  const bool refused = event.kind == EventKind::switch_refused || event.verdict != Verdict::accepted;
  if (!refused || event.ticket != 0 || !refusal_.empty()) return;
  refusal_ = fmt::format("at {:.3f} s the loop refused {} ({})", event.t.seconds(),
                         event.kind == EventKind::parameter_set ? "a parameter"
                         : event.kind == EventKind::feature_set ? "a feature"
                         : event.kind == EventKind::target_set  ? "a set-point"
                                                                : "a switch",
                         to_string(event.verdict));
}

void RunMonitor::take(const Event& event) {
  note_refusal(event);
  switch (event.kind) {
    case EventKind::switched:
    case EventKind::switch_refused:
      add_switch(event);
      break;
    case EventKind::intervention:
      add_intervention(event);
      break;
    case EventKind::parameter_set: {
      if (event.verdict != Verdict::accepted) {
        add(event.t, fmt::format("{}: parameter refused ({})", instance_name(event.instance),
                                 to_string(event.verdict)));
        break;
      }
      const auto& names = layout_.instances.at(event.instance).parameters;
      add(event.t, fmt::format("{}: {} set", instance_name(event.instance),
                               event.index < names.size() ? names[event.index] : "parameter"));
      break;
    }
    case EventKind::feature_set: {
      const auto& names = layout_.instances.at(event.instance).features;
      add(event.t, fmt::format("{}: {} {}", instance_name(event.instance),
                               event.index < names.size() ? names[event.index] : "feature",
                               event.verdict != Verdict::accepted ? "refused"
                               : event.values[0] > 0.5            ? "on"
                                                                  : "off"));
      break;
    }
    case EventKind::target_set:
      if (event.verdict != Verdict::accepted) {
        add(event.t, fmt::format("{}: set-point refused ({})", instance_name(event.instance),
                                 to_string(event.verdict)));
      }
      break;  // accepted ones would flood the messages
    case EventKind::stopped:
      add(event.t, "stop: " + arm_names(event.arms));
      break;
    case EventKind::resumed:
      add(event.t, "resume: " + arm_names(event.arms));
      break;
    case EventKind::arm_config:
    case EventKind::arm_mode:
    case EventKind::goal_ended:
      break;
  }
}

void RunMonitor::add_switch(const Event& event) {
  SwitchReport change;
  change.t = event.t;
  change.cycle = event.cycle;
  change.verdict = event.verdict;
  change.started = instance_names(event.started);
  change.stopped = instance_names(event.stopped);
  change.kept = instance_names(event.kept);
  if (event.intervention != Intervention::none) {
    change.cause = to_string(event.intervention);
  } else {
    change.cause = event.ticket != 0 ? "request" : event.cycle <= 1 ? "start" : "timeline";
    change.waiting_us = microseconds((event.taken - event.received).count());
    change.computing_us = microseconds((event.first_torque - event.taken).count());
    for (std::size_t arm = 0; arm < layout_.arms.size(); ++arm) {
      if ((event.arms >> arm & 1u) == 0 || 2 * arm + 1 >= event.size) continue;
      change.steps.push_back({layout_.arms[arm].name, event.values[2 * arm], event.values[2 * arm + 1]});
    }
  }
  std::string text = describe(change);
  if (event.intervention != Intervention::none) text += fmt::format(" ({})", change.cause);
  add(event.t, text);
  switches_.push_back(std::move(change));
}

void RunMonitor::add_intervention(const Event& event) {
  if (event.arm >= layout_.arms.size()) return;
  const std::string& arm = layout_.arms[event.arm].name;
  const auto known = std::find_if(interventions_.begin(), interventions_.end(), [&](const auto& i) {
    return i.arm == arm && i.rule == event.intervention;
  });
  if (known != interventions_.end()) {
    ++known->episodes;
    return;
  }
  const std::string controllet = instance_name(event.instance);
  interventions_.push_back({.arm = arm,
                            .rule = event.intervention,
                            .episodes = 1,
                            .first_s = event.t.seconds(),
                            .controllet = controllet});
  const std::string joint = event.joint == 0xFFFF ? "" : fmt::format(", joint {}", event.joint + 1);
  add(event.t, fmt::format("{}: {}{} ({})", arm, to_string(event.intervention), joint, controllet), event.arm,
      event.intervention);
}

void RunMonitor::add(LoopTime t, const std::string& text, std::size_t arm, Intervention rule) {
  ++events_;
  news_.push_back({fmt::format("{:9.3f} s  {}", t.seconds(), text), arm, rule});
  if (news_.size() > kNews) news_.pop_front();
}

void RunMonitor::add_news(const std::string& text) {
  const std::lock_guard lock(mutex_);
  posted_.push_back(text);
}

std::vector<std::string> RunMonitor::instance_names(std::uint64_t bits) const {
  std::vector<std::string> names;
  for (; bits != 0; bits &= bits - 1) {
    names.push_back(instance_name(static_cast<std::uint16_t>(std::countr_zero(bits))));
  }
  return names;
}

std::string RunMonitor::instance_name(std::uint16_t index) const {
  return index < layout_.instances.size() ? layout_.instances[index].name : std::string();
}

std::string RunMonitor::arm_names(std::uint32_t bits) const {
  std::string names;
  for (std::size_t arm = 0; arm < layout_.arms.size(); ++arm) {
    if ((bits >> arm & 1u) == 0) continue;
    if (!names.empty()) names += ", ";
    names += layout_.arms[arm].name;
  }
  return names;
}

// The error in an output of the arm's owner whose name ends in `suffix`. A controllet of several arms with
// one such output per arm lists them in the order of its arms; otherwise the largest error counts.
std::optional<double> RunMonitor::output_error(std::size_t arm, std::string_view suffix) const {
  const auto owner = last_.arms[arm].owner;
  if (owner >= layout_.instances.size()) return {};
  const auto& instance = layout_.instances[owner];
  std::vector<double> errors;
  for (const auto& output : instance.outputs) {
    if (!output.name.ends_with(suffix)) continue;
    double square = 0;
    for (std::size_t i = 0; i < output.size; ++i) {
      square += last_.outputs[output.offset + i] * last_.outputs[output.offset + i];
    }
    errors.push_back(std::sqrt(square));
  }
  if (errors.empty()) return {};
  const auto arms_of_owner = static_cast<std::size_t>(std::popcount(instance.arms));
  if (errors.size() == arms_of_owner) {
    const std::uint32_t before = instance.arms & ((1u << arm) - 1u);
    return errors[static_cast<std::size_t>(std::popcount(before))];
  }
  return *std::max_element(errors.begin(), errors.end());
}

ArmStatus RunMonitor::arm_status(std::size_t arm) const {
  ArmStatus status{.arm = layout_.arms[arm].name, .torque_use = torque_use_[arm]};
  if (cycles_ == 0) return status;
  status.controllet = instance_name(last_.arms[arm].owner);
  status.interventions = last_.arms[arm].interventions;
  status.mode = static_cast<ArmMode>(last_.arms[arm].mode);
  if (last_.arms[arm].errors != 0) status.errors = error_names(last_.arms[arm].errors);
  if (const auto error = output_error(arm, "position_error_m")) {
    status.tracking_error = error;
    status.tracking_unit = "m";
  } else if (const auto joint_error = output_error(arm, "error_rad")) {
    status.tracking_error = joint_error;
    status.tracking_unit = "rad";
  }
  return status;
}

void RunMonitor::publish_if_due() {
  if (std::chrono::steady_clock::now() - published_ >= kPeriod) publish();
}

void RunMonitor::publish() {
  const auto now = std::chrono::steady_clock::now();
  std::vector<std::string> posted;
  {
    const std::lock_guard lock(mutex_);
    posted.swap(posted_);
  }
  for (const auto& text : posted) add(last_.t, text);
  RunStatus next;
  next.time_s = last_.t.seconds();
  next.elapsed_s = std::chrono::duration<double>(now - begin_).count();
  const double window_s = std::chrono::duration<double>(now - published_).count();
  next.rate_hz = window_s > 0 ? static_cast<double>(last_.cycle - cycles_published_) / window_s : 0;
  next.cycle_us = microseconds(cycle_times_.percentile(0.5));
  next.cycle_us_worst = microseconds(cycle_times_.max());
  next.cycles = last_.cycle;
  next.overruns = last_.overruns;
  for (std::size_t arm = 0; arm < layout_.arms.size(); ++arm) next.arms.push_back(arm_status(arm));
  next.events = events_;
  next.refusal = refusal_;
  for (const auto& news : news_) {
    const std::uint64_t count = news.rule == Intervention::none ? 0 : counted_(news.arm, news.rule);
    next.news.push_back(count > 1 ? fmt::format("{}, {} cycles so far", news.text, count) : news.text);
  }
  published_ = now;
  cycles_published_ = last_.cycle;
  std::fill(torque_use_.begin(), torque_use_.end(), 0.0);
  const std::lock_guard lock(mutex_);
  status_ = std::move(next);
}

RunStatus RunMonitor::status() const {
  const std::lock_guard lock(mutex_);
  return status_;
}

}  // namespace multipanda
