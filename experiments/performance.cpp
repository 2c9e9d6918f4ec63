// Runs the conditions of a performance experiment in order, since parallel runs would
// disturb the measurement.
#include <algorithm>
#include <filesystem>
#include <memory>
#include <sys/resource.h>

#include <fmt/format.h>

#include "common/machine.hpp"
#include "common/text.hpp"
#include "experiments/arm_steps.hpp"
#include "experiments/on_arms.hpp"
#include "experiments/performance_runs.hpp"
#include "experiments/processes.hpp"
#include "experiments/task_runs.hpp"
#include "scene/build.hpp"

namespace multipanda {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

constexpr double kSwitching_s = 3;  // about, of all trials

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
  const std::vector<std::string> known = names_in(settings.conditions);
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

// The person's steps around the runs on arms; each run is first simulated, which shows how far the arms will
// move. Without arms it does nothing.
class OnArms {
 public:
  OnArms(const Experiment& experiment, const ExperimentOptions& options, const PerformanceRun& run)
      : active_(options.backend.kind == BackendKind::fci),
        experiment_(experiment),
        options_(paced(options)),
        run_(run),
        registry_(build_registry({})),
        steps_(experiment_, options_, run.progress, registry_) {
    if (!active_) return;
    if (options.person == nullptr)
      throw std::invalid_argument(experiment.name + ": a run on arms requires a person to confirm its steps");
    check_addresses_of_all(scene(run.settings.scene, {}), options.backend);
    check_no_recovery(scene(run.settings.scene, {}));
    if (run.settings.switching) {
      const Scene switching = scene(run.settings.switching->scene, {});
      (void)backend_of(switching, options.backend);
      check_no_recovery(switching);
    }
  }

  bool active() const { return active_; }

  void check_list(std::size_t runs, double seconds) {
    if (!active_) return;
    const Scene first = scene(run_.settings.scene, run_.settings.conditions.front().set);
    steps_.check_list(with_connections(first, backend_of(first, options_.backend)), runs, seconds);
  }

  // `rehearse`: runs the same in simulation and returns its record.
  template <typename Rehearse>
  void before(const std::string& name, const std::string& scene_path, const std::vector<Override>& set,
              double seconds, Rehearse rehearse) {
    if (!active_) return;
    if (run_.progress.line) run_.progress.line("  " + name + ": simulating first; the arms do not move");
    PerformanceRun simulated = run_;
    simulated.backend = {.kind = BackendKind::mujoco};
    simulated.viewer = nullptr;
    simulated.rehearsal = true;
    const Json record = rehearse(simulated);
    if (run_.progress.stopped()) throw ExperimentInterrupted("stopped");
    if (!record["faults"].empty())
      throw ExperimentInterrupted(fmt::format("{}: its simulation failed ({}), so it does not run on arms",
                                              name, record["faults"].front().get<std::string>()));
    const Scene given = scene(scene_path, set);
    expected_ = record["extent"];
    steps_.before_run(with_connections(given, backend_of(given, options_.backend)), name, seconds, expected_);
  }

  // Ends the experiment if a run on arms had faults.
  void after(const std::string& name, const Json& record) const {
    if (!active_ || run_.progress.stopped() || record["faults"].empty()) return;
    throw ExperimentInterrupted(
        fmt::format("{}: {}; no further run is started", name, record["faults"].front().get<std::string>()));
  }

  PerformanceRun run(const std::string& scene_path) const {
    PerformanceRun run = run_;
    if (active_) {
      run.backend = backend_of(scene(scene_path, {}), options_.backend);
      run.expected = expected_;
    }
    return run;
  }

 private:
  static ExperimentOptions paced(ExperimentOptions options) {
    options.fast = false;  // only shortens the run here
    return options;
  }
  Scene scene(const std::string& path, const std::vector<Override>& set) const {
    return changed_scene(experiment_, path, run_.settings.plant, set).scene;
  }

  const bool active_;
  const Experiment& experiment_;
  const ExperimentOptions options_;
  const PerformanceRun& run_;
  const Registry registry_;
  ArmSteps steps_;
  Json expected_;  // the extent of the last rehearsal
};

// The runs and their settings: an experiment can only be resumed with the settings of its start.
Json identity(const Experiment& experiment, const ExperimentOptions& options,
              const PerformanceSettings& settings,
              const std::vector<PerformanceSettings::Condition>& conditions) {
  std::string scenes;
  for (const auto& condition : conditions)
    scenes +=
        condition.name + '\n' + changed_scene_text(experiment, settings.scene, settings.plant, condition.set);
  if (settings.switching)
    scenes += changed_scene_text(experiment, settings.switching->scene, settings.plant, {});
  Json what = what_decides(experiment, options, scenes);
  what["generator"] = options.ros ? "ros" : "socket";
  what["pace"] = options.backend.lockstep ? "lockstep" : "realtime";
  return what;
}

}  // namespace

ExperimentResult run_performance(const Experiment& experiment, const ExperimentOptions& options,
                                 const ExperimentProgress& progress) {
  const PerformanceSettings settings = performance_settings(experiment);
  const auto conditions = chosen(experiment, settings, options.only);
  for (const auto& condition : settings.conditions)  // refuses an invalid scene before anything runs
    (void)changed_scene(experiment, settings.scene, settings.plant, condition.set);
  const auto beside = beside_traces(options.beside, names_in(conditions));
  const std::size_t repeats = options.repeats.value_or(experiment.repeats);
  const PerformanceRun run{.experiment = experiment,
                           .settings = settings,
                           .progress = progress,
                           .folder = options.directory / "data",
                           .fast = options.fast,
                           .backend = options.backend,
                           .viewer = options.viewer,
                           .ros = options.ros};
  FinishedRuns finished(options.directory, identity(experiment, options, settings, conditions),
                        options.resume);
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

  plan["beside"] = Json::array();
  for (const auto& trace : beside)
    plan["beside"].push_back({{"condition", trace.condition}, {"npz", trace.file.string()}});

  OnArms arms(experiment, options, run);
  plan["arms"] = Json::array();
  for (const auto& [arm, address] : options.backend.addresses)
    plan["arms"].push_back(
        {{"arm", arm}, {"address", address}, {"on_this_computer", is_on_this_computer(address)}});
  const double duration_s = plan["duration_s"].get<double>() + settings.lead_s;
  try {
    arms.check_list(conditions.size() * repeats + (settings.switching ? 1 : 0),
                    static_cast<double>(conditions.size() * repeats) * duration_s);
  } catch (const ExperimentInterrupted& interrupted) {
    return {.name = experiment.name, .stopped = true, .why_stopped = interrupted.what()};
  }
  auto preferred = std::make_unique<Preferred>();
  plan["priority"] = preferred->described();
  plan["runs"] = Json::array();
  try {
    // Repeats in the outer loop, so that a lasting disturbance of the machine affects all conditions.
    for (std::size_t repeat = 1; repeat <= repeats; ++repeat) {
      for (const auto& condition : conditions) {
        const std::string name = fmt::format("{}_{}", condition.name, repeat);
        if (const Json* before = finished.find(name)) {
          plan["runs"].push_back(*before);
          continue;
        }
        arms.before(
            condition.name, settings.scene, condition.set, duration_s,
            [&](const PerformanceRun& simulated) { return run_condition(simulated, condition, repeat); });
        Json record = run_condition(arms.run(settings.scene), condition, repeat);
        if (progress.stopped()) return stopped();
        arms.after(condition.name, record);
        say(fmt::format("{:<6} repeat {}  {} cycles, {} lost", condition.name, repeat,
                        record["samples"].get<std::size_t>(), record["overruns"].get<std::uint64_t>()));
        finished.add(name, record);
        plan["runs"].push_back(std::move(record));
      }
    }
    plan["delay_checks"] = Json::array();
    if (settings.delay_check && !arms.active()) {  // the delay of an arm is unknown, so it cannot be checked
      for (const double delay_s : settings.delay_check->delays_s) {
        if (progress.stopped()) return stopped();
        plan["delay_checks"].push_back(run_delay_check(run, delay_s));
      }
      say(fmt::format("command delay measured with {} known delays", plan["delay_checks"].size()));
    }
    if (settings.switching) {
      arms.before("switching", settings.switching->scene, {}, kSwitching_s,
                  [](const PerformanceRun& simulated) { return run_switching(simulated); });
      plan["switching"] = run_switching(arms.run(settings.switching->scene));
      if (progress.stopped()) return stopped();
      arms.after("switching", plan["switching"]);
      say(fmt::format("{} switches", plan["switching"]["list"].size()));
    }
  } catch (const ExperimentInterrupted& interrupted) {
    return {.name = experiment.name, .stopped = true, .why_stopped = interrupted.what()};
  }
  preferred.reset();
  plan["load_after"] = machine_usage().load_1min;
  ExperimentResult result = evaluate(experiment, plan, options);
  finished.remove_file();
  if (!options.keep_data) {
    std::error_code ignored;
    fs::remove_all(run.folder, ignored);
  }
  return result;
}

}  // namespace multipanda
