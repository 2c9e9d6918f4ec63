#include "runtime/summary.hpp"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <nlohmann/json.hpp>

namespace multipanda {

std::string_view to_string(RunEnd end) {
  switch (end) {
    case RunEnd::duration:
      return "duration";
    case RunEnd::stopped:
      return "stopped";
    case RunEnd::backend:
      return "backend";
  }
  return "?";
}

std::vector<std::string> RunSummary::faults() const {
  std::vector<std::string> faults = problems;
  for (const auto& i : interventions) {
    const bool expected = std::find(expected_interventions.begin(), expected_interventions.end(),
                                    std::pair(i.arm, i.rule)) != expected_interventions.end();
    if (i.deactivates() && !expected && i.controllet == i.arm + "_hold") {
      // No fallback exists after a hold: its arm had only its gravity compensation.
      faults.push_back(fmt::format("arm '{}': {}: its hold had no torque in {} cycle{}, first at {:.3f} s",
                                   i.arm, to_string(i.rule), i.count, i.count == 1 ? "" : "s", i.first_s));
    } else if (i.deactivates() && !expected) {
      faults.push_back(fmt::format(
          "arm '{}': {} deactivated {} at {:.3f} s", i.arm, to_string(i.rule),
          i.controllet.empty() ? std::string("its controllet") : fmt::format("'{}'", i.controllet),
          i.first_s));
    }
  }
  for (const auto& reflex : reflexes) {
    const std::pair rule(reflex.arm, Intervention::arm_not_ready);
    if (std::find(expected_interventions.begin(), expected_interventions.end(), rule) !=
        expected_interventions.end())
      continue;
    faults.push_back(reflex.headline());
  }
  for (const auto& s : switches) {
    if (!s.accepted()) {
      faults.push_back(
          fmt::format("the switch at {:.3f} s was refused: {}", s.t.seconds(), to_string(s.verdict)));
    }
  }
  for (const auto& text : missing) faults.push_back("the log is incomplete: " + text);
  return faults;
}

bool RunSummary::success() const { return faults().empty(); }

std::string describe(const SwitchReport& change) {
  const auto list = [](const std::vector<std::string>& names) {
    return fmt::format("{}", fmt::join(names, ", "));
  };
  if (!change.accepted()) return fmt::format("switch refused ({})", to_string(change.verdict));
  if (change.started.empty() && change.stopped.empty()) return "switch without a change";
  std::string text = change.started.empty() ? "" : list(change.started) + " on";
  if (!change.stopped.empty()) text += (text.empty() ? "" : ", ") + list(change.stopped) + " off";
  return text;
}

namespace {

// Rounded for readability; null if not finite, since JSON has no NaN.
nlohmann::ordered_json number(double value, double step) {
  if (!std::isfinite(value)) return nullptr;
  return std::round(value / step) * step == 0
             ? 0.0
             : std::stod(fmt::format("{:.10g}", std::round(value / step) * step));
}

// "torque not finite" becomes torque_not_finite.
std::string code(std::string_view text) {
  std::string word(text);
  std::replace(word.begin(), word.end(), ' ', '_');
  return word;
}

nlohmann::ordered_json path_or_null(const std::filesystem::path& path) {
  if (path.empty()) return nullptr;
  return path.string();
}

nlohmann::ordered_json to_json_value(const SwitchReport& s) {
  nlohmann::ordered_json step_requested = nlohmann::ordered_json::object(), step_sent = step_requested;
  for (const auto& step : s.steps) {
    step_requested[step.arm] = number(step.requested_nm, 1e-6);
    step_sent[step.arm] = number(step.sent_nm, 1e-6);
  }
  return {{"t_s", number(s.t.seconds(), 1e-6)},
          {"cycle", s.cycle},
          {"cause", code(s.cause)},
          {"accepted", s.accepted()},
          {"verdict", code(to_string(s.verdict))},
          {"started", s.started},
          {"stopped", s.stopped},
          {"kept", s.kept},
          {"waiting_us", number(s.waiting_us, 1e-3)},
          {"computing_us", number(s.computing_us, 1e-3)},
          {"torque_step_computed_nm", step_requested},
          {"torque_step_nm", step_sent}};
}

nlohmann::ordered_json to_json_value(const ReflexReport& r) {
  nlohmann::ordered_json first = nullptr;
  if (r.why.detail) {
    first = {{"error", std::string(to_string(r.why.detail.error))},
             {"index", r.why.detail.index < 0 ? nlohmann::ordered_json(nullptr)
                                              : nlohmann::ordered_json(int{r.why.detail.index})},
             {"value", number(r.why.detail.value, 1e-9)},
             {"limit", number(r.why.detail.limit, 1e-9)}};
  }
  return {{"arm", r.arm},
          {"t_s", number(r.t_s, 1e-6)},
          {"cycle", r.cycle},
          {"errors", error_list(r.errors)},
          {"first", std::move(first)},
          {"explanation", r.why.sentences},
          {"next", r.why.cures},
          {"answered", number(r.why.answered, 1e-4)},
          {"missed_in_row", r.why.missed_in_row},
          {"file", path_or_null(r.file)}};
}

}  // namespace

std::string to_json(const RunSummary& summary) {
  nlohmann::ordered_json json;
  json["scene"] = summary.scene;
  json["backend"] = summary.backend;
  json["success"] = summary.success();
  json["faults"] = summary.faults();
  json["ended_by"] = std::string(to_string(summary.end));
  json["paced"] = summary.paced;
  json["cycles"] = summary.cycles;
  json["overruns"] = summary.overruns;
  json["time_s"] = number(summary.time_s, 1e-6);
  json["elapsed_s"] = number(summary.elapsed_s, 1e-6);
  json["rate_hz"] = number(summary.rate_hz(), 1e-3);
  json["cycle_us"] = {{"median", number(summary.cycle_us.median, 1e-3)},
                      {"p99", number(summary.cycle_us.p99, 1e-3)},
                      {"p999", number(summary.cycle_us.p999, 1e-3)},
                      {"worst", number(summary.cycle_us.worst, 1e-3)}};
  json["switches"] = nlohmann::ordered_json::array();
  for (const auto& s : summary.switches) json["switches"].push_back(to_json_value(s));
  json["interventions"] = nlohmann::ordered_json::array();
  for (const auto& i : summary.interventions) {
    json["interventions"].push_back({{"arm", i.arm},
                                     {"rule", code(to_string(i.rule))},
                                     {"count", i.count},
                                     {"episodes", i.episodes},
                                     {"first_s", number(i.first_s, 1e-6)},
                                     {"controllet", i.controllet}});
  }
  json["connections"] = nlohmann::ordered_json::array();
  for (const auto& c : summary.connections) {
    json["connections"].push_back({{"arm", c.arm},
                                   {"received", c.packets.received},
                                   {"lost", c.packets.lost},
                                   {"late", c.packets.superseded},
                                   {"commands_missed", c.commands_missed}});
  }
  json["reflexes"] = nlohmann::ordered_json::array();
  for (const auto& r : summary.reflexes) json["reflexes"].push_back(to_json_value(r));
  json["records_lost"] = summary.records_lost;
  json["missing"] = summary.missing;
  json["log"] = path_or_null(summary.log);
  json["kept"] = nlohmann::ordered_json::array();
  for (const auto& log : summary.kept) json["kept"].push_back(log.string());
  json["report"] = path_or_null(summary.report);
  json["thread"] = nlohmann::ordered_json::array();
  for (const auto& step : summary.thread) {
    json["thread"].push_back({{"what", step.what}, {"done", step.done}, {"reason", step.reason}});
  }
  return json.dump();
}

}  // namespace multipanda
