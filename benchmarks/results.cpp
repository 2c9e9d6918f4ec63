#include "benchmarks/results.hpp"

#include <algorithm>
#include <cmath>
#include <fstream>
#include <stdexcept>
#include <thread>

#include <fmt/format.h>

#include "benchmarks/cases.hpp"
#include "common/machine.hpp"
#include "core/types/statistics.hpp"
#include "core/types/time.hpp"

namespace multipanda::bench {

namespace {

using Json = nlohmann::ordered_json;

constexpr double kTimingBudget = 26, kSimulationBudget = 6;  // [s]
constexpr std::size_t kTrials = 50;

Json number(double value) { return std::round(value * 1e4) / 1e4; }

Json json_of(const std::vector<double>& values) {
  const Figures f = figures_of(values);
  return {{"median", number(f.median)}, {"p999", number(f.p999)}, {"worst", number(f.worst)}};
}

std::string first_line(const std::string& path) {
  std::ifstream file(path);
  std::string line;
  std::getline(file, line);
  return line;
}

Json machine() {
  const auto info = describe_machine();
  const auto known = [&](const char* key) {
    const auto it = info.find(key);
    return it == info.end() ? std::string("unknown") : it->second;
  };
  const std::string governor = first_line("/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor");
  const bool real_time = first_line("/sys/kernel/realtime") == "1" ||
                         first_line("/proc/version").find("PREEMPT_RT") != std::string::npos;
  return {{"cpu", known("processor")},
          {"cores", std::thread::hardware_concurrency()},
          {"kernel", known("kernel")},
          {"real_time_kernel", real_time},
          {"governor", governor.empty() ? Json(nullptr) : Json(governor)},
          {"load_at_start", first_line("/proc/loadavg").substr(0, first_line("/proc/loadavg").find(' '))},
          {"compiler", known("compiler")},
          {"build_type", MULTIPANDA_BUILD_TYPE},
          {"version", known("multipanda")}};
}

// cost[a] / cost[b], or null where one was not measured.
Json ratio(const Json& top, const Json& bottom) {
  if (!top.is_object() || !bottom.is_object()) return nullptr;
  return number(top["median"].get<double>() / bottom["median"].get<double>());
}

Json at(const Json& object, const std::string& key) { return object.contains(key) ? object[key] : Json(); }

}  // namespace

nlohmann::ordered_json measure_all(const Effort& effort) {
  const Filter selected(effort.filter);
  const Registry registry = Registry::with_builtins();
  Json results = {{"cycle_us", Json::object()},
                  {"features_us", Json::object()},
                  {"feature_adds_us", Json::object()},
                  {"loop_calls", Json::object()},
                  {"switch_ms", Json::object()},
                  {"ros_us", Json::object()},
                  {"realtime_factor", Json::object()},
                  {"limits_us", Json::object()},
                  {"ratios", Json::object()},
                  {"samples", 0},
                  {"machine", machine()}};
  const Arms arms(registry);

  std::vector<Case> cases = cycle_cases(arms, registry, selected);
  for (Case& limit : bare_cases(arms, registry, selected)) cases.push_back(std::move(limit));
  for (Case& feature : feature_cases(registry, selected)) cases.push_back(std::move(feature));
  measure_in_turns(cases, effort.samples, kTimingBudget);
  for (const Case& c : cases) {
    const std::size_t slash = c.name.find('/');
    results[c.name.substr(0, slash)][c.name.substr(slash + 1)] = json_of(c.durations);
  }
  if (!cases.empty()) results["samples"] = cases.front().durations.size();
  cases.clear();
  for (const auto& [name, figures] : results["features_us"].items()) {
    const Json& none = at(results["features_us"], "none");
    if (name == "none" || none.is_null()) continue;
    results["feature_adds_us"][name] = number(figures["median"].get<double>() - none["median"].get<double>());
  }
  for (const auto& [name, calls] : count_feature_calls(registry, selected)) {
    results["loop_calls"][name] = {{"heap", calls.heap}, {"locks", calls.locks}};
  }

  if (selected("switch_ms/controllet") || selected("switch_ms/feature")) {
    const auto times = measure_switching(arms, registry, std::min(kTrials, effort.samples), selected);
    for (const auto& [what, trials] : times.trials_ms) {
      if (!trials.empty()) results["switch_ms"][what] = json_of(trials);
    }
    for (const SetupStep& step : times.loop_thread) {
      results["machine"]["loop_thread"].push_back(step.done ? step.what : step.what + ": " + step.reason);
    }
  }
  if (selected("switch_ms/ros_service") || selected("ros_us")) {
    const RosTimes times = measure_ros(registry, std::min(kTrials, effort.samples));
    if (!times.missing.empty()) {
      results["machine"]["ros"] = times.missing;
    } else {
      results["switch_ms"]["ros_service"] = json_of(times.switch_ms);
      results["ros_us"] = {{"adapter_in_loop", json_of(times.adapter_us)},
                           {"cycle_with_adapter", json_of(times.with_us)},
                           {"cycle_without", json_of(times.without_us)}};
      results["ratios"]["cycle with the ROS adapter to without"] =
          ratio(results["ros_us"]["cycle_with_adapter"], results["ros_us"]["cycle_without"]);
    }
  }
  const std::size_t cycles = std::min<std::size_t>(250, effort.samples);
  const std::size_t chunks = std::max<std::size_t>(1, std::min<std::size_t>(20, effort.samples / 1000));
  for (const auto& run : measure_realtime_factor(registry, chunks, cycles, kSimulationBudget, selected)) {
    results["realtime_factor"][run.name] = number(run.factor);
  }

  const Json& cycle = results["cycle_us"];
  const Json per_arm = ratio(at(cycle, "cartesian_impedance/16"), at(cycle, "cartesian_impedance/1"));
  if (!per_arm.is_null()) {
    results["ratios"]["cartesian_impedance per arm, 16 arms to 1"] = number(per_arm.get<double>() / 16);
  }
  const Json to_bare =
      ratio(at(cycle, "dual_cartesian_impedance/2"), at(results["limits_us"], "dual_cartesian_impedance"));
  if (!to_bare.is_null()) results["ratios"]["dual_cartesian_impedance/2 to bare math"] = to_bare;
  const Json hulls = ratio(at(results["features_us"], "collision_avoidance+hulls"),
                           at(results["features_us"], "collision_avoidance"));
  if (!hulls.is_null())
    results["ratios"]["cycle with collision_avoidance, with base hulls to without"] = hulls;
  return results;
}

std::string ratios_text(const nlohmann::ordered_json& results) {
  std::string text;
  for (const auto& [name, value] : results["ratios"].items()) {
    text += fmt::format("{}: {:.3f}\n", name, value.get<double>());
  }
  return text;
}

std::string markdown_of(const nlohmann::ordered_json& results) {
  std::string text;
  const auto figures = [&](const char* section, const char* title, const char* unit) {
    if (results[section].empty()) return;
    text += fmt::format("### {}\n\n| | median [{}] | p99.9 [{}] | worst [{}] |\n|---|---:|---:|---:|\n",
                        title, unit, unit, unit);
    for (const auto& [key, f] : results[section].items()) {
      text += fmt::format("| `{}` | {:.2f} | {:.2f} | {:.2f} |\n", key, f["median"].get<double>(),
                          f["p999"].get<double>(), f["worst"].get<double>());
    }
    text += "\n";
  };
  figures("cycle_us", "Control cycle", "µs");
  figures("features_us", "Control cycle of two arms whose hands nearly meet, by feature", "µs");
  figures("limits_us", "Libraries alone", "µs");
  figures("switch_ms", "Switching", "ms");
  figures("ros_us", "Two arms with the ROS adapter: the loop's thread", "µs");
  const auto numbers = [&](const char* section, const char* title, const char* format) {
    if (results[section].empty()) return;
    text += fmt::format("### {}\n\n| | |\n|---|---:|\n", title);
    for (const auto& [key, value] : results[section].items()) {
      text += fmt::format("| {} | {} |\n", key, fmt::format(fmt::runtime(format), value.get<double>()));
    }
    text += "\n";
  };
  numbers("feature_adds_us", "Additional cycle time of each feature [µs]", "{:.2f}");
  numbers("realtime_factor", "Real-time factor of the simulation, by number of arms", "{:.1f}");
  numbers("ratios", "Ratios", "{:.3f}");
  text += fmt::format("### Machine\n\n| | |\n|---|---|\n| samples of each call | {} |\n",
                      results["samples"].get<std::size_t>());
  for (const auto& [key, value] : results["machine"].items()) {
    std::string shown = value.is_string() ? value.get<std::string>() : value.dump();
    if (value.is_array()) {
      shown.clear();
      for (const auto& item : value) shown += (shown.empty() ? "" : "; ") + item.get<std::string>();
    }
    text += fmt::format("| {} | {} |\n", key, shown);
  }
  return text;
}

namespace {

constexpr std::size_t kBlock = 100;  // consecutive calls of one case

}  // namespace

Figures figures_of(std::vector<double> values) {
  if (values.empty()) throw std::logic_error("no measurement was made");
  return {quantile(values, 0.5), quantile(values, 0.999), quantile(values, 1)};
}

void measure_in_turns(std::vector<Case>& cases, std::size_t samples, double budget_s) {
  for (Case& c : cases) {
    c.durations.reserve(samples);
    for (std::size_t i = 0; i < kBlock; ++i)
      c.once();  // until a steady state is reached and pages are
                 // mapped
  }
  const HostTime begin = host_now();
  for (std::size_t done = 0; done < samples && seconds(host_now() - begin) < budget_s;) {
    const std::size_t block = std::min(kBlock, samples - done);
    for (Case& c : cases) {
      for (std::size_t i = 0; i < block; ++i) {
        const HostTime before = host_now();
        c.once();
        c.durations.push_back(static_cast<double>((host_now() - before).count()) * 1e-3);
      }
    }
    done += block;
  }
  for (Case& c : cases) {
    if (c.verify) c.verify();
  }
}

}  // namespace multipanda::bench
