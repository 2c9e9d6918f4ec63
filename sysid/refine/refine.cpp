#include "sysid/refine/refine.hpp"

#include <algorithm>
#include <fstream>
#include <mutex>
#include <numbers>
#include <thread>

#include <fmt/format.h>
#include <yaml-cpp/yaml.h>

#include "experiments/processes.hpp"
#include "experiments/task_runs.hpp"
#include "models/write_robot.hpp"
#include "scene/build.hpp"
#include "scene/rewrite.hpp"
#include "sysid/refine/tool_place.hpp"

namespace multipanda {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

constexpr double kDegrees = 180 / std::numbers::pi;
constexpr double kPlacing = 5;  // share of the window used for tools that hold an object [s]

const ExperimentVariant& chosen_variant(const Experiment& experiment, const std::string& name) {
  if (experiment.kind != "task" || experiment.variants.empty()) {
    throw std::invalid_argument(experiment.name +
                                ": only experiments of the kind 'task' can be refined; this one is of "
                                "the kind '" +
                                experiment.kind + "'");
  }
  if (!name.empty()) {
    const auto chosen = chosen_variants(experiment, {name});
    if (chosen.size() == 1) return *chosen[0];
    throw std::invalid_argument(fmt::format("{}: '{}' names {} variants; expected the name of one",
                                            experiment.name, name, chosen.size()));
  }
  for (const auto& variant : experiment.variants) {
    if (!variant.reported) return variant;
  }
  return experiment.variants.front();
}

class RefinementRun {
 public:
  RefinementRun(const Experiment& experiment, const RefineOptions& options, const RefineProgress& progress)
      : experiment_(experiment),
        options_(options),
        progress_(progress),
        variant_(chosen_variant(experiment, options.variant)),
        registry_(build_registry(scene_plugins(task_text(1), experiment.scene))),
        scene_(parse_scene(task_text(1), experiment.scene, registry_)) {
    refuse_carried_arms(scene_, "multipanda refine");
    settings_ = {.target = options.target,
                 .scene_path = experiment.scene,
                 .program = options.program.empty() ? own_program() : options.program,
                 .logs = options.directory / "logs",
                 .workers = options.workers,
                 .stop = progress.stop};
    fs::create_directories(settings_.logs);
    if (options.excitations.size() > 1 && options.excitations.size() != scene_.arms.size()) {
      throw std::invalid_argument(
          fmt::format("refine: {} excitations for {} arms; expected one, or one for each",
                      options.excitations.size(), scene_.arms.size()));
    }
    for (std::size_t i = 0; i < scene_.arms.size(); ++i) {
      priors_.push_back(robot_of(scene_.arms[i]));
      const auto& given = options.excitations;
      excitations_.push_back(read_excitation(given.empty()       ? excitation_path(scene_.arms[i].model)
                                             : given.size() == 1 ? given[0]
                                                                 : given.at(i),
                                             registry_));
    }
    read_window();
  }

  RefineResult run() {
    RefineResult result;
    result.variant = variant_.name;
    say(fmt::format("{}, variant {}: {} repeats on {}, and in simulation ({})", experiment_.name,
                    variant_.name, options_.repeats, options_.target.words(), options_.plant));
    std::vector<ArmRun> runs;
    for (std::size_t k = 1; k <= options_.repeats; ++k) {
      if (!options_.target.addresses.empty()) {
        runs.push_back({fmt::format("approach_{}", k), approach_scene(task_scene_of(k)), true});
      }
      runs.push_back({fmt::format("target_{}", k), task_text(k), true});
      runs.push_back({fmt::format("nominal_{}", k), task_text(k), false});
    }
    if (!go(runs, result)) return stopped();
    const auto real = logs_of("target");
    result.before = compare_all(real, logs_of("nominal"));
    say_distances("nominal simulation", result.before, nullptr);

    std::vector<std::vector<MeasuredLog>> data(scene_.arms.size());
    for (std::size_t round = 1; round <= options_.rounds; ++round) {
      if (!collect(round, data, result)) return stopped();
      RefineRound done;
      done.arms = identify_all(round, data);
      if (has_surface() && !place_tools(round, real, done, result)) return stopped();
      if (holds_object() && !place_held(round, real, done, result)) return stopped();
      runs.clear();
      for (std::size_t k = 1; k <= options_.repeats; ++k) {
        runs.push_back({fmt::format("refined_{}_{}", round, k), task_text(k, &done.arms), false});
      }
      if (!go(runs, result)) return stopped();
      done.comparisons = compare_all(real, logs_of(fmt::format("refined_{}", round)));
      for (std::size_t i = 0; i < scene_.arms.size(); ++i) {
        done.changes.push_back(change(result.before[i], done.comparisons[i]));
      }
      say_distances(fmt::format("round {}", round), done.comparisons, &done.changes);
      result.rounds.push_back(std::move(done));
    }
    write_results(result);
    return result;
  }

 private:
  void say(const std::string& text) const {
    if (progress_.line) progress_.line(text);
  }

  RefineResult stopped() const {
    RefineResult result;
    result.stopped = true;
    return result;
  }

  // Scene of the k-th repeat with these models as plants, optionally shortened.
  std::string task_text(std::size_t repeat, const std::vector<RefinedArm>* models = nullptr,
                        std::optional<double> duration_s = {}) const {
    const TaskRun run{&variant_, options_.plant, repeat};
    if (models == nullptr) return task_scene_text(experiment_, run);
    YAML::Node root = YAML::Load(task_scene_text(experiment_, run));
    for (const auto& model : *models) {
      put(root, {.key = "arms." + model.arm + ".plant_model", .value = model.model.string(), .place = {}});
    }
    if (duration_s) put(root, {.key = "duration_s", .value = fmt::format("{}", *duration_s), .place = {}});
    return yaml_text(root) + "\n";
  }

  Scene task_scene_of(std::size_t repeat) const {
    return parse_scene(task_text(repeat), experiment_.scene, registry_);
  }

  // The experiment's window, unless it depends on contact.
  void read_window() {
    const auto window = experiment_.measure.find("window");
    if (window == experiment_.measure.end()) return;
    const std::string after = window->value("after", "start");
    double begin = window->value("offset_s", 0.0);
    if (after == "contact") return;
    if (after == "motion") {
      const auto motion = std::find_if(scene_.timeline.begin(), scene_.timeline.end(), [](const auto& event) {
        return event.what == TimelineEvent::What::set_motion;
      });
      if (motion == scene_.timeline.end()) return;
      begin += motion->at_s;
    }
    compare_options_.window_s = {begin, begin + window->value("duration_s", 10.0)};
  }

  bool go(const std::vector<ArmRun>& runs, RefineResult& result) {
    const auto finished = [&](const ArmRunResult& run) {
      std::string line = fmt::format("  {:<16} {:5.1f} s in {:5.2f} s", run.name, run.time_s, run.elapsed_s);
      for (const auto& fault : run.faults) {
        line += "  failed: " + fault;
        result.faults.push_back(run.name + ": " + fault);
      }
      say(line);
    };
    return run_all(runs, settings_, finished).size() == runs.size();
  }

  // [arm][repeat]
  std::vector<std::vector<MeasuredLog>> logs_of(const std::string& name) const {
    std::vector<std::vector<MeasuredLog>> logs(scene_.arms.size());
    for (std::size_t k = 1; k <= options_.repeats; ++k) {
      read_into(settings_.logs / fmt::format("{}_{}.mcap", name, k), logs);
    }
    return logs;
  }

  void read_into(const fs::path& file, std::vector<std::vector<MeasuredLog>>& logs) const {
    for (auto& log : read_measured(file)) {
      for (std::size_t i = 0; i < scene_.arms.size(); ++i) {
        if (scene_.arms[i].name == log.arm) logs[i].push_back(std::move(log));
      }
    }
  }

  std::vector<Comparison> compare_all(const std::vector<std::vector<MeasuredLog>>& real,
                                      const std::vector<std::vector<MeasuredLog>>& sim) const {
    std::vector<Comparison> list;
    for (std::size_t i = 0; i < real.size(); ++i) list.push_back(compare(real[i], sim[i], compare_options_));
    return list;
  }

  // Adds another excitation of every arm to `data`, and from round 2 on the logs of tasks without contact.
  bool collect(std::size_t round, std::vector<std::vector<MeasuredLog>>& data, RefineResult& result) {
    say(fmt::format("round {}: excitation", round));
    std::vector<ArmRun> runs;
    std::vector<ExcitationRun> plans;
    for (std::size_t k = 1; k <= options_.excitation_repeats; ++k) {
      const std::uint64_t seed = 1000 * round + k;
      plans.push_back(excitation_run(scene_, excitations_, priors_, seed));
      runs.push_back({fmt::format("excitation_{}_{}", round, k), plans.back().scene, true});
    }
    if (!go(runs, result)) return false;
    for (std::size_t k = 0; k < runs.size(); ++k) {
      std::vector<std::vector<MeasuredLog>> logs(scene_.arms.size());
      read_into(settings_.logs / (runs[k].name + ".mcap"), logs);
      for (std::size_t i = 0; i < logs.size(); ++i) {
        const auto& window = plans[k].windows[i];
        for (const auto& log : logs[i]) data[i].push_back(cut(log, window.begin, window.end));
      }
    }
    if (round == 2 && !experiment_.measure.contains("force") && !experiment_.measure.contains("grasp")) {
      for (std::size_t k = 1; k <= options_.repeats; ++k) {
        read_into(settings_.logs / fmt::format("target_{}.mcap", k), data);
      }
    }
    return true;
  }

  std::vector<RefinedArm> identify_all(std::size_t round, const std::vector<std::vector<MeasuredLog>>& data) {
    std::vector<RefinedArm> arms(scene_.arms.size());
    for (std::size_t i = 0; i < arms.size(); ++i) {
      arms[i] = identify_arm(
          scene_.arms[i], priors_[i], data[i],
          {.family = options_.family,
           .file = fs::absolute(options_.directory) / fmt::format("{}_{}.yaml", scene_.arms[i].name, round),
           .threads = options_.workers});
      say(fmt::format("  {}: {}", scene_.arms[i].name, in_words(arms[i])));
      for (const auto& warning : arms[i].warnings) say("    " + warning);
    }
    return arms;
  }

  // Whether the task touches a fixed object.
  bool has_surface() const {
    return experiment_.measure.contains("force") && !experiment_.measure.contains("grasp");
  }

  // Tool poses need contact: runs the task once with the models so far, then moves the tools.
  bool place_tools(std::size_t round, const std::vector<std::vector<MeasuredLog>>& real, RefineRound& done,
                   RefineResult& result) {
    const std::string name = fmt::format("placing_{}_1", round);
    if (!go({{name, task_text(1, &done.arms), false}}, result)) return false;
    std::vector<std::vector<MeasuredLog>> sim(scene_.arms.size());
    read_into(settings_.logs / (name + ".mcap"), sim);
    for (std::size_t i = 0; i < done.arms.size(); ++i) {
      const auto d = tool_offset(std::span(real[i]).first(1), sim[i], scene_.arms[i], compare_options_,
                                 surface_compliance(scene_));
      if (!d) continue;
      const RobotDescription robot = load_robot(done.arms[i].model.string());
      write_robot(with_tool_offset(robot, scene_.arms[i], *d), priors_[i], done.arms[i].model);
      done.arms[i].found["tool_offset_m"] = {(*d)[0], (*d)[1], (*d)[2]};
      say(fmt::format("  {}: the tool is off by {:.1f}, {:.1f}, {:.1f} mm in the flange", scene_.arms[i].name,
                      1e3 * (*d)[0], 1e3 * (*d)[1], 1e3 * (*d)[2]));
    }
    return true;
  }

  bool holds_object() const { return experiment_.measure.contains("grasp"); }

  // For arms that hold an object together: many runs of the task with slightly displaced tools.
  bool place_held(std::size_t round, const std::vector<std::vector<MeasuredLog>>& real, RefineRound& done,
                  RefineResult& result) {
    say(fmt::format("round {}: estimating the tool poses from simulations with displaced tools", round));
    std::vector<MeasuredLog> first;
    for (const auto& logs : real) first.push_back(logs.at(0));
    const auto place_all = [&](const ToolPlaces& places, const std::string& suffix) {
      std::vector<RefinedArm> arms = done.arms;
      for (std::size_t i = 0; i < arms.size(); ++i) {
        const RobotDescription robot = load_robot(arms[i].model.string());
        arms[i].model.replace_filename(arms[i].model.stem().string() + suffix + ".yaml");
        write_robot(with_tool_place(robot, scene_.arms[i], places[i]), priors_[i], arms[i].model);
      }
      return arms;
    };
    // Half the window is as informative about a tool as all of it, and shorter runs save time.
    AlignOptions options = compare_options_;
    double duration = scene_.duration_s;
    if (options.window_s) {
      options.window_s->second = std::min(options.window_s->second, options.window_s->first + kPlacing);
      duration = std::min(duration, options.window_s->second + 2 / options.low_pass_hz + 0.1);
    }
    bool whole = true;
    std::size_t number = 0;
    const PlaceRuns simulate = [&](const std::vector<ToolPlaces>& candidates) {
      std::vector<ArmRun> runs;
      std::vector<fs::path> files;
      for (const auto& places : candidates) {
        const std::string name = fmt::format("placing_{}_{}", round, ++number);
        const auto arms = place_all(places, "_" + name);
        runs.push_back({name, task_text(1, &arms, duration), false});
        files.push_back(settings_.logs / (name + ".mcap"));
        for (const auto& arm : arms) files.push_back(arm.model);
      }
      std::vector<std::vector<MeasuredLog>> logs;
      whole = go(runs, result);
      for (std::size_t k = 0; whole && k < runs.size(); ++k) {
        std::vector<std::vector<MeasuredLog>> arms(scene_.arms.size());
        read_into(settings_.logs / (runs[k].name + ".mcap"), arms);
        logs.emplace_back();
        for (auto& arm : arms) logs.back().push_back(std::move(arm.at(0)));
      }
      for (const auto& file : files) fs::remove(file);  // these logs are only useful together
      return logs;
    };
    const auto fit = fit_places(first, simulate, options);
    if (!fit) return whole;
    // The tool poses fit this grasp; the models without them may be closer in another one.
    for (const auto& arm : done.arms) {
      fs::path believed = arm.model;
      believed.replace_filename(arm.model.stem().string() + "_tools_as_believed.yaml");
      fs::copy_file(arm.model, believed, fs::copy_options::overwrite_existing);
    }
    place_all(fit->places, "");
    for (std::size_t i = 0; i < done.arms.size(); ++i) {
      const Vector3 &d = fit->places[i].shift, &turn = fit->places[i].turn;
      done.arms[i].found["tool_shift_m"] = {d[0], d[1], d[2]};
      done.arms[i].found["tool_turn_rad"] = {turn[0], turn[1], turn[2]};
      say(
          fmt::format("  {}: the end effector is off by {:.1f}, {:.1f}, {:.1f} mm, turned by {:.2f}, {:.2f}, "
                      "{:.2f} degrees",
                      scene_.arms[i].name, 1e3 * d[0], 1e3 * d[1], 1e3 * d[2], kDegrees * turn[0],
                      kDegrees * turn[1], kDegrees * turn[2]));
    }
    say(fmt::format("  weighted sum of squared differences: {:.3g} before, {:.3g} after", fit->before,
                    fit->after));
    return true;
  }

  void say_distances(const std::string& what, const std::vector<Comparison>& comparisons,
                     const std::vector<std::vector<QuantityChange>>* changes) const {
    for (std::size_t i = 0; i < comparisons.size(); ++i) {
      std::string line = fmt::format("{}, {}:", what, scene_.arms[i].name);
      for (const auto& quantity : comparisons[i].quantities) {
        if (quantity.available())
          line += fmt::format("  {} {:.3g} {}", quantity.name, quantity.mean(), quantity.unit);
      }
      say(line);
      if (changes == nullptr) continue;
      line = "  relative to before:";
      for (const auto& one : (*changes)[i]) {
        line += fmt::format("  {} {:.0f} %{}", one.name, 100 * one.ratio, one.worse ? " (worse)" : "");
      }
      say(line);
    }
  }

  void write_results(RefineResult& result) {
    result.json = refine_json(experiment_, variant_, options_, result);
    const fs::path file = options_.directory / "refine.json";
    std::ofstream out(file);
    out << result.json.dump(1) << '\n';
    out.close();
    if (!out) throw std::runtime_error("cannot write " + file.string());
    if (options_.page) result.page = make_refine_page(file);
  }

  const Experiment& experiment_;
  const RefineOptions& options_;
  const RefineProgress& progress_;
  const ExperimentVariant& variant_;
  const Registry registry_;
  const Scene scene_;  // of the first repeat
  RunSettings settings_;
  std::vector<RobotDescription> priors_;
  std::vector<ExcitationFile> excitations_;
  // Both sides have sensor noise, which no model predicts; at 1 kHz it dominates the differences in force.
  CompareOptions compare_options_ = [] {
    CompareOptions options;
    options.low_pass_hz = 10;
    return options;
  }();
};

Eigen::MatrixXd rows(const Eigen::MatrixXd& all, Eigen::Index first, Eigen::Index count) {
  return all.rows() == 0 ? all : Eigen::MatrixXd(all.middleRows(first, count));
}

}  // namespace

MeasuredLog cut(const MeasuredLog& log, double begin, double end) {
  const double* const t0 = log.t.data();
  const double* const t1 = t0 + log.t.size();
  const Eigen::Index first = std::lower_bound(t0, t1, begin) - t0;
  const Eigen::Index count = std::upper_bound(t0, t1, end) - t0 - first;
  MeasuredLog part = log;
  part.t = log.t.segment(first, count);
  for (const auto member : {&MeasuredLog::q, &MeasuredLog::dq, &MeasuredLog::tau, &MeasuredLog::tau_d,
                            &MeasuredLog::tau_cmd, &MeasuredLog::gravity, &MeasuredLog::x_EE,
                            &MeasuredLog::quat_EE, &MeasuredLog::F_EE, &MeasuredLog::F_true}) {
    part.*member = rows(log.*member, first, count);
  }
  if (!log.lines.empty()) {
    part.lines = {log.lines.begin() + first, log.lines.begin() + first + count};
  }
  return part;
}

RefineResult refine(const Experiment& experiment, const RefineOptions& options,
                    const RefineProgress& progress) {
  if (options.rounds < 1 || options.repeats < 1)
    throw std::invalid_argument("refine: expected at least one round and one repeat");
  return RefinementRun(experiment, options, progress).run();
}

}  // namespace multipanda
