// Runs the conditions of a performance experiment in order, since parallel runs would
// disturb the measurement.
#include <algorithm>
#include <filesystem>
#include <memory>
#include <sys/resource.h>

#include <fmt/format.h>

#include "experiments/performance_runs.hpp"
#include "experiments/process_usage.hpp"
#include "support/spelling.hpp"

namespace multipanda {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

// Raises the priority of the threads around the loop (live input, relay, generator) above other programs
// during its lifetime. The loop has its own priority, but delayed threads around it lose set-points.
class Preferred {
 public:
  Preferred() : before_(getpriority(PRIO_PROCESS, 0)), granted_(setpriority(PRIO_PROCESS, 0, kNice) == 0) {}
  ~Preferred() { (void)setpriority(PRIO_PROCESS, 0, before_); }
  Preferred(const Preferred&) = delete;
  Json described() const {
    return {{"what", fmt::format("nice {}", kNice)},
            {"done", granted_},
            {"reason", granted_ ? "" : "not permitted; requires the capability CAP_SYS_NICE"}};
  }

 private:
  static constexpr int kNice = -15;
  int before_;
  bool granted_;
};

std::vector<PerformanceSettings::Condition> chosen(const Experiment& experiment,
                                                   const PerformanceSettings& settings,
                                                   const std::vector<std::string>& only) {
  if (only.empty()) return settings.conditions;
  std::vector<std::string> known;
  for (const auto& condition : settings.conditions) known.push_back(condition.name);
  std::vector<PerformanceSettings::Condition> list;
  for (const auto& name : only) {
    const auto found = std::find(known.begin(), known.end(), name);
    if (found == known.end())
      throw std::invalid_argument(experiment.name + ": unknown condition '" + name + "'" +
                                  name_hint(name, known, "there are none"));
    list.push_back(settings.conditions[static_cast<std::size_t>(found - known.begin())]);
  }
  return list;
}

}  // namespace

ExperimentResult run_performance(const Experiment& experiment, const ExperimentOptions& options,
                                 const ExperimentProgress& progress) {
  const PerformanceSettings settings = performance_settings(experiment);
  const auto conditions = chosen(experiment, settings, options.only);
  for (const auto& condition : settings.conditions)  // refuses an invalid scene before anything runs
    (void)changed_scene(experiment, settings.scene, settings.plant, condition.set);
  const std::size_t repeats = options.repeats.value_or(experiment.repeats);
  const PerformanceRun run{.experiment = experiment,
                           .settings = settings,
                           .progress = progress,
                           .folder = options.directory / "data",
                           .fast = options.fast,
                           .backend = options.backend,
                           .viewer = options.viewer,
                           .ros = options.ros};
  fs::create_directories(run.folder);
  const auto say = [&](const std::string& text) {
    if (progress.line) progress.line("  " + text);
  };
  const auto stopped = [&] { return ExperimentResult{.name = experiment.name, .stopped = true}; };

  Json plan = describe(experiment);
  plan["fast"] = options.fast;
  plan["backend"] = name_of(options.backend.kind);
  plan["pace"] = options.backend.lockstep ? "lockstep" : "realtime";
  plan["generator"] = options.ros ? "ros" : "socket";
  plan["repeats"] = repeats;
  plan["duration_s"] = options.fast ? settings.fast_duration_s : settings.duration_s;
  plan["machine"]["memory_mb"] = fmt::format("{:.0f}", machine_memory_mb());
  plan["load_before"] = machine_usage().load_1min;
  plan["conditions"] = Json::array();
  for (const auto& condition : conditions)
    plan["conditions"].push_back({{"name", condition.name}, {"label", condition.label}});

  auto preferred = std::make_unique<Preferred>();
  plan["priority"] = preferred->described();
  plan["runs"] = Json::array();
  // Repeats in the outer loop, so that a lasting disturbance of the machine affects all conditions.
  for (std::size_t repeat = 1; repeat <= repeats; ++repeat) {
    for (const auto& condition : conditions) {
      Json record = run_condition(run, condition, repeat);
      if (progress.stopped()) return stopped();
      say(fmt::format("{:<6} repeat {}  {} cycles, {} lost", condition.name, repeat,
                      record["samples"].get<std::size_t>(), record["overruns"].get<std::uint64_t>()));
      plan["runs"].push_back(std::move(record));
    }
  }
  plan["delay_checks"] = Json::array();
  if (settings.delay_check) {
    for (const double delay_s : settings.delay_check->delays_s) {
      if (progress.stopped()) return stopped();
      plan["delay_checks"].push_back(run_delay_check(run, delay_s));
    }
    say(fmt::format("command delay measured with {} known delays", plan["delay_checks"].size()));
  }
  if (settings.switching) {
    plan["switching"] = run_switching(run);
    if (progress.stopped()) return stopped();
    say(fmt::format("{} switches", plan["switching"]["list"].size()));
  }
  preferred.reset();
  plan["load_after"] = machine_usage().load_1min;
  ExperimentResult result = evaluate(experiment, plan, options);
  if (!options.keep_data) {
    std::error_code ignored;
    fs::remove_all(run.folder, ignored);
  }
  return result;
}

}  // namespace multipanda
