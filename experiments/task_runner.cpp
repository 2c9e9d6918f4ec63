// Runs a task's sessions, several at once unless they are paced by the wall clock.
#include <algorithm>
#include <fstream>
#include <mutex>
#include <thread>

#include <fmt/format.h>

#include "experiments/kinds.hpp"
#include "experiments/run_data.hpp"
#include "experiments/task_runs.hpp"
#include "logs/npz.hpp"
#include "scene/build.hpp"

namespace multipanda {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

constexpr std::uint64_t kModelEvery = 5;    // cycles: poses at 200 Hz
constexpr std::uint64_t kObjectsEvery = 2;  // cycles

// Poses of the free objects, recorded on the loop's thread, since logs contain only the arms.
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
      const Quaternion q = X_WO->quaternion();
      const auto& p = X_WO->position;
      for (const double value : {tick.t.seconds(), p.x(), p.y(), p.z(), q.w(), q.x(), q.y(), q.z()})
        track.values.push_back(value);
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

class TaskRunner {
 public:
  TaskRunner(const Experiment& experiment, const ExperimentOptions& options,
             const ExperimentProgress& progress)
      : experiment_(experiment),
        options_(options),
        progress_(progress),
        repeats_(options.repeats.value_or(experiment.repeats)),
        runs_(task_runs(experiment, repeats_, options.only)),
        registry_(build_registry(scene_plugins(task_scene_text(experiment, runs_.at(0)), experiment.scene))) {
    // All scenes are read before the first run, so that an invalid variant is refused at once.
    for (const auto& run : runs_) {
      if (run.repeat == 1) (void)task_scene(experiment_, run, registry_);
    }
    done_.resize(runs_.size());
  }

  ExperimentResult run() {
    fs::create_directories(options_.directory / "logs");
    fs::create_directories(options_.directory / "data");
    const std::size_t workers = options_.fast && options_.viewer == nullptr
                                    ? std::clamp<std::size_t>(std::thread::hardware_concurrency(), 1,
                                                              std::min<std::size_t>(runs_.size(), 8))
                                    : 1;
    {
      std::vector<std::jthread> threads;
      for (std::size_t i = 1; i < workers; ++i) threads.emplace_back([this] { work(); });
      work();
    }
    if (failure_) std::rethrow_exception(failure_);
    if (progress_.stopped()) return {.name = experiment_.name, .stopped = true};
    Json plan = describe(experiment_);
    plan["repeats"] = repeats_;
    plan["fast"] = options_.fast;
    plan["backend"] = name_of(options_.backend.kind);
    plan["runs"] = Json::array();
    for (auto& done : done_) plan["runs"].push_back(std::move(done));
    ExperimentResult result = evaluate(experiment_, plan, options_);
    if (!options_.keep_data) {
      std::error_code ignored;
      fs::remove_all(options_.directory / "data", ignored);
    }
    return result;
  }

 private:
  void work() {
    for (;;) {
      const std::size_t index = next_.fetch_add(1);
      if (index >= runs_.size() || progress_.stopped()) return;
      try {
        done_[index] = run_one(runs_[index]);
      } catch (...) {
        const std::lock_guard lock(mutex_);
        if (!failure_) failure_ = std::current_exception();
        next_ = runs_.size();
      }
    }
  }

  Json run_one(const TaskRun& run) {
    Scene scene = task_scene(experiment_, run, registry_);
    if (scene.duration_s == 0)
      throw std::invalid_argument(experiment_.scene + ": the scene of an experiment needs a duration_s");
    const std::string name = run.name();
    const fs::path scratch = options_.directory / "logs" / (name + ".part");
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
    session_options.log_every.model = kModelEvery;
    if (!objects.empty())
      session_options.on_loop = [&objects](const Tick& tick, const Backend& backend) {
        objects.take(tick, backend);
      };
    if (options_.viewer != nullptr) options_.viewer->prepare(scene, session_options);
    std::optional<RunData> data;
    session_options.observer = [&data](const CycleRecord& cycle) { data->take(cycle); };
    Session session(std::move(scene), registry_, std::move(session_options));
    data.emplace(session.scene(), session.layout(), session.models(), kModelEvery);
    const Viewed viewed(options_.viewer, session);
    if (progress_.stopped()) {
      std::error_code ignored;
      fs::remove_all(scratch, ignored);
      return {};
    }
    session.start();
    while (!session.wait_for_end(0.1)) {
      if (progress_.stopped()) session.stop();
    }
    const RunSummary summary = session.finish();

    const fs::path log = options_.directory / "logs" / (name + ".mcap");
    fs::rename(summary.log, log);
    fs::remove_all(scratch);
    const fs::path arrays = options_.directory / "data" / (name + ".npz");
    data->write(arrays);
    record["log"] = fs::relative(log, options_.directory).string();
    record["npz"] = fs::relative(arrays, options_.directory).string();
    if (!objects.empty()) {
      const fs::path file = options_.directory / "data" / (name + "_objects.npz");
      objects.write(file);
      record["objects"] = fs::relative(file, options_.directory).string();
    }
    record["cycles"] = summary.cycles;
    record["time_s"] = summary.time_s;
    record["elapsed_s"] = summary.elapsed_s;
    record["overruns"] = summary.overruns;
    record["faults"] = summary.faults();
    record["interventions"] = Json::array();
    for (const auto& seen : summary.interventions)
      record["interventions"].push_back(
          {{"arm", seen.arm}, {"rule", to_string(seen.rule)}, {"count", seen.count}});
    say(run, summary);
    return record;
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

  const Experiment& experiment_;
  const ExperimentOptions& options_;
  const ExperimentProgress& progress_;
  const std::size_t repeats_;
  const std::vector<TaskRun> runs_;
  const Registry registry_;
  std::vector<Json> done_;
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
