// Runs a task's sessions, several at once unless they are paced by the wall clock.
#include <algorithm>
#include <cmath>
#include <fstream>
#include <functional>
#include <map>
#include <mutex>
#include <thread>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "common/machine.hpp"
#include "experiments/arm_steps.hpp"
#include "experiments/kinds.hpp"
#include "experiments/motion_extent.hpp"
#include "experiments/on_arms.hpp"
#include "experiments/task_runs.hpp"
#include "logs/export.hpp"
#include "logs/npz.hpp"
#include "scene/build.hpp"

namespace multipanda {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

constexpr std::uint64_t kModelEvery = 5;    // cycles: poses at 200 Hz
constexpr std::uint64_t kObjectsEvery = 2;  // cycles

// Poses of the free objects, recorded on the loop's thread, because logs contain only the arms.
class ObjectTrace {
 public:
  ObjectTrace(const Scene& scene, double duration_s) {
    for (std::size_t i = 0; i < scene.objects.size(); ++i) {
      if (!scene.objects[i].fixed) tracks_.push_back({.name = scene.objects[i].name, .values = {}});
    }
    const auto rows = static_cast<std::size_t>(duration_s * 1000 / kObjectsEvery) + 100;
    for (auto& track : tracks_) track.values.reserve(rows * kWidth);
  }

  bool empty() const { return tracks_.empty(); }

  void take(const Tick& tick, const Backend& backend) {
    if (tick.cycle % kObjectsEvery != 0) return;
    for (auto& track : tracks_) {
      const auto X_WO = backend.object_pose(track.name);
      if (!X_WO) continue;
      track.values.push_back(tick.t.seconds());
      for (const double value : X_WO->values()) track.values.push_back(value);
    }
  }

  // "box/pose": t, x y z, quaternion w x y z.
  void write(const fs::path& file) const {
    std::vector<NpzWriter::Array> arrays;
    for (const auto& track : tracks_)
      arrays.push_back(
          {track.name + "/pose", NpzWriter::Kind::real, track.values.size() / kWidth, kWidth, true});
    NpzWriter writer(file, std::move(arrays));
    for (std::size_t i = 0; i < tracks_.size(); ++i) {
      const auto& values = tracks_[i].values;
      for (std::size_t row = 0; row + kWidth <= values.size(); row += kWidth)
        writer.add(i, std::vector<double>(values.begin() + static_cast<std::ptrdiff_t>(row),
                                          values.begin() + static_cast<std::ptrdiff_t>(row + kWidth)));
    }
    writer.close();
  }

 private:
  static constexpr std::size_t kWidth = 8;
  struct Track {
    std::string name;
    std::vector<double> values;
  };
  std::vector<Track> tracks_;
};

std::string scenes_of(const Experiment& experiment, const std::vector<TaskRun>& runs) {
  std::string scenes;
  for (const auto& run : runs) scenes += run.name() + '\n' + task_scene_text(experiment, run);
  return scenes;
}

class TaskRunner {
 public:
  TaskRunner(const Experiment& experiment, const ExperimentOptions& options,
             const ExperimentProgress& progress)
      : on_arms_(options.backend.kind == BackendKind::fci),
        experiment_(on_arms_ ? for_arms(experiment, left_out_) : experiment),
        options_(options),
        progress_(progress),
        repeats_(options.repeats.value_or(experiment.repeats)),
        runs_(ordered(task_runs(experiment_, repeats_, options.only))),
        registry_(build_registry(scene_plugins(task_scene_text(experiment_, runs_.at(0)), experiment.scene))),
        finished_runs_(options.directory, what_decides(experiment_, options, scenes_of(experiment_, runs_)),
                       options.resume) {
    if (on_arms_ && options.person == nullptr)
      throw std::invalid_argument(experiment.name + ": a run on arms requires a person to confirm its steps");
    // All scenes are read before the first run, so that an invalid variant is refused at once.
    for (const auto& run : runs_) {
      const bool measured = run.plant == kMeasured;
      if (run.repeat != 1 && !on_arms_) continue;
      const Scene scene = task_scene(experiment_, run, registry_);
      if (on_arms_) scenes_.emplace(run.name(), scene);
      if (scene.duration_s == 0)
        throw std::invalid_argument(experiment_.scene + ": the scene of an experiment needs a duration_s");
      if (!measured) continue;
      check_for_arms(scene, run.variant->name);
      check_addresses_of_all(scene, options_.backend);
      (void)with_connections(scene, options_.backend);
    }
    done_.resize(runs_.size());
    beside_ = beside_logs(options.beside, chosen_variants(experiment_, options.only));
    if (!beside_.empty() && on_arms_)
      throw std::invalid_argument(experiment.name +
                                  ": runs on arms are shown with their simulation; omit --beside");
  }

  ExperimentResult run() {
    fs::create_directories(options_.directory / "logs");
    fs::create_directories(options_.directory / "data");
    for (const auto& name : left_out_)
      say("  variant " + name + " changes the simulated plant and is left out on arms");
    std::size_t simulated = runs_.size();
    if (on_arms_) {
      simulated = static_cast<std::size_t>(
          std::ranges::count_if(runs_, [](const TaskRun& run) { return run.plant != kMeasured; }));
      say(fmt::format("simulating the {} runs first; the arms are not connected yet", simulated));
    } else {
      say(fmt::format("simulating {} runs; --only or --repeats for fewer", simulated));
    }
    run_simulated(simulated);
    if (failure_) std::rethrow_exception(failure_);
    if (progress_.stopped()) return {.name = experiment_.name, .stopped = true};
    if (on_arms_) {
      try {
        run_on_arms(simulated);
      } catch (const std::exception& error) {
        return {.name = experiment_.name, .stopped = true, .why_stopped = error.what()};
      }
    }
    Json plan = describe(experiment_);
    plan["repeats"] = repeats_;
    plan["fast"] = options_.fast;
    plan["backend"] = name_of(options_.backend.kind);
    plan["left_out"] = left_out_;
    plan["arms"] = Json::array();
    for (const auto& [arm, address] : options_.backend.addresses)
      plan["arms"].push_back(
          {{"arm", arm}, {"address", address}, {"on_this_computer", is_on_this_computer(address)}});
    plan["runs"] = Json::array();
    for (auto& done : done_) plan["runs"].push_back(std::move(done));
    add_beside(plan);
    ExperimentResult result = evaluate(experiment_, plan, options_);
    finished_runs_.remove_file();
    if (!options_.keep_data) {
      std::error_code ignored;
      fs::remove_all(options_.directory / "data", ignored);
    }
    return result;
  }

 private:
  // On arms, all simulations come first.
  static std::vector<TaskRun> ordered(std::vector<TaskRun> runs) {
    std::stable_partition(runs.begin(), runs.end(),
                          [](const TaskRun& run) { return run.plant != kMeasured; });
    return runs;
  }

  void run_simulated(std::size_t count) {
    end_ = count;
    const bool alone = !(options_.fast || on_arms_) || (options_.viewer != nullptr && !on_arms_);
    const std::size_t workers = alone ? 1
                                      : std::clamp<std::size_t>(std::thread::hardware_concurrency(), 1,
                                                                std::min<std::size_t>(count, 8));
    std::vector<std::jthread> threads;
    for (std::size_t i = 1; i < workers; ++i) threads.emplace_back([this] { work(); });
    work();
  }

  // In sequence, each confirmed. Throws ExperimentInterrupted, or the exception of a session.
  void run_on_arms(std::size_t first) {
    std::size_t left = 0;
    double seconds = 0;
    std::optional<Scene> first_scene;
    for (std::size_t i = first; i < runs_.size(); ++i) {
      if (finished_runs_.find(runs_[i].name()) != nullptr) continue;
      Scene scene = with_connections(scene_of(runs_[i]), options_.backend);
      seconds += scene.duration_s;
      ++left;
      if (!first_scene) first_scene = std::move(scene);
    }
    ArmSteps steps(experiment_, options_, progress_, registry_);
    if (first_scene) steps.check_list(*first_scene, left, seconds);
    for (std::size_t i = first; i < runs_.size(); ++i) {
      const TaskRun& run = runs_[i];
      if (const Json* finished = finished_runs_.find(run.name())) {
        done_[i] = *finished;
        ++finished_;
        continue;
      }
      const auto twin = std::ranges::find_if(done_, [&](const Json& done) {
        return done.is_object() && done["plant"] != kMeasured && done["variant"] == run.variant->name &&
               done["repeat"] == run.repeat;
      });
      if (!(*twin)["faults"].empty())
        throw ExperimentInterrupted(fmt::format("{}: its simulation failed ({}), so it does not run on arms",
                                                run.name(), (*twin)["faults"].front().get<std::string>()));
      const Scene scene = with_connections(scene_of(run), options_.backend);
      steps.before_run(scene, fmt::format("{}, repeat {}", run.variant->label, run.repeat), scene.duration_s,
                       (*twin)["extent"]);
      expected_ = (*twin)["extent"];
      done_[i] = run_one(run);
      if (progress_.stopped()) throw ExperimentInterrupted("stopped during " + run.name());
      if (const Json& faults = done_[i]["faults"]; !faults.empty())
        throw ExperimentInterrupted(
            fmt::format("{}: {}", run.name(), fmt::join(faults.get<std::vector<std::string>>(), "; ")));
      finished_runs_.add(run.name(), done_[i]);
    }
  }

  // On arms, the scene as read at the start: later edits of its file have no effect. Model files are
  // read again.
  Scene scene_of(const TaskRun& run) const {
    const auto read = scenes_.find(run.name());
    return read != scenes_.end() ? read->second : task_scene(experiment_, run, registry_);
  }

  void work() {
    for (;;) {
      const std::size_t index = next_.fetch_add(1);
      if (index >= end_ || progress_.stopped()) return;
      try {
        {
          const std::lock_guard lock(mutex_);
          // Runs on arms repeat every simulation first: files may have changed meanwhile.
          const Json* finished = on_arms_ ? nullptr : finished_runs_.find(runs_[index].name());
          if (finished != nullptr) {
            done_[index] = *finished;
            ++finished_;
            continue;
          }
        }
        done_[index] = run_one(runs_[index]);
        if (progress_.stopped()) return;
        const std::lock_guard lock(mutex_);
        finished_runs_.add(runs_[index].name(), done_[index]);
      } catch (...) {
        const std::lock_guard lock(mutex_);
        if (!failure_) failure_ = std::current_exception();
        next_ = end_;
      }
    }
  }

  Json run_one(const TaskRun& run) {
    Scene scene = scene_of(run);
    const std::string name = run.name();
    const bool measured = run.plant == kMeasured;
    const fs::path scratch = options_.directory / "logs" / (name + ".part");
    fs::remove_all(scratch);  // left by an interrupted run
    ObjectTrace objects(scene, scene.duration_s);
    Json instance_arms = Json::object();
    for (const auto& instance : scene.controllets) {
      for (const ArmIndex arm : instance.arms)
        instance_arms[instance.name].push_back(scene.arms.at(arm).name);
    }
    Json record{{"name", name},
                {"variant", run.variant->name},
                {"plant", run.plant},
                {"repeat", run.repeat},
                {"seed", scene.seed},
                {"scene_text", scene.text},
                {"instance_arms", instance_arms},
                {"timeline", timeline_of(scene.text)}};

    SessionOptions session_options{.paced = !options_.fast, .backend = options_.backend, .record = scratch};
    if (on_arms_ && !measured) {
      session_options.paced = false;
      session_options.backend = {.kind = BackendKind::mujoco};
    }
    session_options.log_every.model = kModelEvery;
    const bool traced = !objects.empty() && !measured;  // there is no measurement of objects beside arms
    if (traced)
      session_options.on_loop = [&objects](const Tick& tick, const Backend& backend) {
        objects.take(tick, backend);
      };
    SessionViewer* viewer = on_arms_ && !measured ? nullptr : options_.viewer;
    if (viewer != nullptr) viewer->prepare(session_options);
    RunWatch watch;
    session_options.observer = [&watch](const CycleRecord& cycle) { watch.take(cycle); };
    Session session(std::move(scene), registry_, std::move(session_options));
    if (measured)
      watch.arms.emplace(session.scene(), session.layout(), session.models(), expected_);
    else if (on_arms_)
      watch.extent.emplace(session.scene(), session.models());
    const Viewed viewed(viewer, session);
    if (progress_.stopped()) {
      std::error_code ignored;
      fs::remove_all(scratch, ignored);
      return {};
    }
    session.start();
    while (!session.wait_for_end(measured ? 0.02 : 0.1)) {
      if (!watch.stopped(session) && progress_.stopped()) session.stop();
    }
    std::string& trouble = watch.trouble;
    if (measured) {
      for (const auto& news : session.status().news) say("  " + news);
    }
    const RunSummary summary = session.finish();
    if (measured && trouble.empty() && summary.end != RunEnd::duration && !progress_.stopped())
      trouble = "it ended early";

    const bool cut = measured && (!trouble.empty() || progress_.stopped());
    const fs::path log = options_.directory / "logs" / (name + (cut ? "_interrupted.mcap" : ".mcap"));
    fs::rename(summary.log, log);
    fs::remove_all(scratch);
    const fs::path arrays = options_.directory / "data" / (name + ".npz");
    (void)export_npz(log, arrays);
    record["log"] = fs::relative(log, options_.directory).string();
    record["npz"] = fs::relative(arrays, options_.directory).string();
    if (traced) {
      const fs::path file = options_.directory / "data" / (name + "_objects.npz");
      objects.write(file);
      record["objects"] = fs::relative(file, options_.directory).string();
    }
    record["cycles"] = summary.cycles;
    record["time_s"] = summary.time_s;
    record["elapsed_s"] = summary.elapsed_s;
    record["overruns"] = summary.overruns;
    record["faults"] = summary.faults();
    if (!trouble.empty()) record["faults"].insert(record["faults"].begin(), trouble);
    if (watch.extent) record["extent"] = watch.extent->json();
    if (watch.arms) record["extent"] = watch.arms->extent().json();
    record["interventions"] = Json::array();
    for (const auto& seen : summary.interventions)
      record["interventions"].push_back(
          {{"arm", seen.arm}, {"rule", to_string(seen.rule)}, {"count", seen.count}});
    say(run, summary);
    return record;
  }

  // Logs measured elsewhere, as runs of an additional plant.
  void add_beside(Json& plan) const {
    if (beside_.empty()) return;
    plan["plants"].push_back(kMeasured);
    for (const auto& log : beside_) {
      const auto like = std::ranges::find_if(
          plan["runs"], [&](const Json& run) { return run["variant"] == log.variant->name; });
      plan["runs"].push_back(beside_run(log, *like, options_.directory));
    }
  }

  void say(const std::string& text) const {
    if (progress_.line) progress_.line(text);
  }

  void say(const TaskRun& run, const RunSummary& summary) {
    const std::lock_guard lock(mutex_);
    ++finished_;
    if (!progress_.line) return;
    std::string line =
        fmt::format("  {:>3}/{}  {:<9} {:<28} repeat {}  {:5.1f} s in {:5.2f} s", finished_, runs_.size(),
                    run.plant, run.variant->name, run.repeat, summary.time_s, summary.elapsed_s);
    for (const auto& fault : summary.faults()) line += "  failed: " + fault;
    progress_.line(line);
  }

  const bool on_arms_;
  std::vector<std::string> left_out_;  // variants that cannot run on arms
  const Experiment experiment_;
  const ExperimentOptions& options_;
  const ExperimentProgress& progress_;
  const std::size_t repeats_;
  const std::vector<TaskRun> runs_;
  const Registry registry_;
  FinishedRuns finished_runs_;
  std::map<std::string, Scene> scenes_;  // of the runs on arms and their simulations
  std::vector<BesideLog> beside_;
  Json expected_;  // the extent of the simulation of the run on arms
  std::vector<Json> done_;
  std::size_t end_ = 0;  // end of the runs for the workers
  std::atomic<std::size_t> next_{0};
  std::mutex mutex_;
  std::size_t finished_ = 0;
  std::exception_ptr failure_;
};

}  // namespace

ExperimentResult run_task(const Experiment& experiment, const ExperimentOptions& options,
                          const ExperimentProgress& progress) {
  return TaskRunner(experiment, options, progress).run();
}

}  // namespace multipanda
