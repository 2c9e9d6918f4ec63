#include <algorithm>

#include <fmt/format.h>

#include "cli/backend_words.hpp"
#include "cli/console.hpp"
#include "cli/program.hpp"
#include "experiments/kinds.hpp"
#include "logs/recorder.hpp"
#include "runtime/signals.hpp"
#include "scene/names.hpp"

namespace multipanda::cli {
namespace {

namespace fs = std::filesystem;

struct Options {
  std::string name;
  std::optional<std::size_t> repeats;
  bool fast = false, json = false, keep_data = false;
  std::string generator = "socket", pace = "realtime";
  std::vector<std::string> only;
  std::string out = "runs";
  BackendWords backend;
};

// Whether any limit is about the variant.
bool is_judged(const Experiment& experiment, const ExperimentVariant& variant) {
  return std::any_of(experiment.limits.begin(), experiment.limits.end(), [&](const auto& limit) {
    return limit.variants.empty()
               ? !variant.reported
               : std::find_first_of(limit.variants.begin(), limit.variants.end(), variant.tags.begin(),
                                    variant.tags.end()) != limit.variants.end();
  });
}

void list_as_json() {
  auto list = nlohmann::ordered_json::array();
  for (const auto& name : available_experiments()) {
    const Experiment experiment = load_experiment(name);
    auto variants = nlohmann::ordered_json::array();
    for (const auto& variant : experiment.variants)
      variants.push_back({{"name", variant.name}, {"judged", is_judged(experiment, variant)}});
    list.push_back({{"name", name},
                    {"title", experiment.title},
                    {"kind", experiment.kind},
                    {"plants", experiment.plants},
                    {"repeats", experiment.repeats},
                    {"variants", variants}});
  }
  fmt::print("{}\n", list.dump());
}

int list_experiments(bool json) {
  if (json) {
    list_as_json();
    return kSuccess;
  }
  for (const auto& name : available_experiments()) {
    try {
      const Experiment experiment = load_experiment(name);
      fmt::print("{:<24} {}\n", name, experiment.title);
    } catch (const std::exception& error) {
      fmt::print("{:<24} refused: {}\n", name, error.what());
    }
  }
  fmt::print("{:<24} {}\n", "all", "every experiment, and one page about them");
  return kSuccess;
}

Experiment open_experiment(const std::string& name) {
  const bool path = name.find('/') != std::string::npos || name.ends_with(".yaml");
  std::vector<std::string> known = available_experiments();
  if (!path && std::find(known.begin(), known.end(), name) == known.end()) {
    known.insert(known.end(), {"all", "list"});
    throw UsageError(fmt::format("experiment: there is no experiment '{}'{}", name,
                                 name_hint(name, known, "there are none")));
  }
  return load_experiment(name);
}

// Worst figure against its limit, one line per limit that failed; one line if none did.
void print_result(const ExperimentResult& result, const Console& console) {
  std::size_t limits = 0;
  if (result.results.contains("limits")) limits = result.results["limits"].size();
  console.line(result.passed ? fmt::format("{}: passed, {} limits held", result.name, limits)
                             : fmt::format("{}: FAILED", result.name));
  for (const auto& problem : result.problems) console.line("  " + problem);
  if (!result.page.empty()) console.line("  report: " + result.page.string());
}

int run(const Options& options) {
  if (options.name == "list") return list_experiments(options.json);
  const Console console(options.json);
  const bool all = options.name == "all";
  std::vector<Experiment> experiments;
  if (all) {
    if (!options.only.empty()) throw UsageError("experiment all: --only needs one experiment");
    for (const auto& name : available_experiments()) experiments.push_back(load_experiment(name));
  } else {
    experiments.push_back(open_experiment(options.name));
  }

  if (options.generator == "ros" && !std::all_of(experiments.begin(), experiments.end(),
                                                 [](const auto& e) { return e.kind == "performance"; })) {
    throw UsageError(
        "experiment: --generator is for experiments with a motion generator, as "
        "controller-performance");
  }

  BackendOptions backend = backend_options(options.backend);
  backend.lockstep = options.pace == "lockstep";
  if (backend.lockstep && backend.arms != ArmsFrom::virtual_arms)
    throw UsageError("experiment: --pace is for --backend virtual: the world of simulated arms always waits");

  std::atomic<bool> stop{false};
  const SignalWatch watch([&](int) {
    stop = true;
    console.line("stopping: arms to hold, then the end (once more: quit at once)");
  });
  const ExperimentProgress progress{.line = [&](const std::string& text) { console.line(text); },
                                    .stop = &stop};
  const fs::path directory =
      make_run_directory(options.out, all ? "experiments" : "experiment_" + experiments.front().name);
  std::vector<ExperimentResult> results;
  auto json = nlohmann::ordered_json::array();
  for (const auto& experiment : experiments) {
    ExperimentOptions run_options{.fast = options.fast,
                                  .repeats = options.repeats,
                                  .directory = all ? directory / experiment.name : directory,
                                  .only = options.only,
                                  .keep_data = options.keep_data,
                                  .backend = backend,
                                  .ros = options.generator == "ros"};
    fs::create_directories(run_options.directory);
    console.line(fmt::format("{}: {}", experiment.name, experiment.title));
    ExperimentResult result = run_experiment(experiment, run_options, progress);
    if (result.stopped) {
      console.line("stopped: no report");
      return kFailed;
    }
    print_result(result, console);
    json.push_back(result.results);
    results.push_back(std::move(result));
  }
  const bool passed = std::all_of(results.begin(), results.end(), [](const auto& r) { return r.passed; });
  fs::path index;
  if (all) {
    index = make_index(results, directory);
    console.line("page of all: " + index.string());
  }
  if (options.json) {
    if (all) json = {{"passed", passed}, {"index", index.string()}, {"experiments", json}};
    fmt::print("{}\n", all ? json.dump() : json.front().dump());
  }
  return passed ? kSuccess : kFailed;
}

}  // namespace

void add_experiment(Program& program) {
  auto options = std::make_shared<Options>();
  CLI::App* command = program.add(
      "experiment", "Runs an experiment on simulated arms and reports it: figures, limits, pictures",
      "  multipanda experiment list\n"
      "  multipanda experiment task-1                      as it is meant: five repeats, in real time\n"
      "  multipanda experiment task-1 --fast --repeats 1   a quick look\n"
      "  multipanda experiment task-3 --fast --backend virtual   the same through client and virtual arms\n"
      "  multipanda experiment controller-performance --backend virtual --generator ros\n"
      "  multipanda experiment all --fast                  every experiment, one page\n"
      "Fails (exit code 1) if a figure is beyond its limit or a run did not go as asked.");
  command
      ->add_option("name", options->name, "Name (multipanda experiment list), path of a file, all, or list")
      ->required();
  command
      ->add_option("--repeats", options->repeats,
                   "Runs of every variant on every plant; default: the experiment's")
      ->check(CLI::Range(1, 1000));
  command->add_flag("--fast", options->fast,
                    "As fast as possible, several runs at once, instead of paced to the wall clock");
  command->add_option("--only", options->only, "Only these variants, by name or choice")->delimiter(',');
  command->add_option("--out", options->out, "Folder that gets a new folder with logs, figures and page")
      ->type_name("DIR")
      ->capture_default_str();
  add_simulation_words(command, options->backend);
  command
      ->add_option(
          "--generator", options->generator,
          "How set-points of controller-performance's motion generator come: socket, or ros (topics)")
      ->check(CLI::IsMember({"socket", "ros"}))
      ->capture_default_str();
  command
      ->add_option(
          "--pace", options->pace,
          "Virtual arms in real time, as real ones are, or lockstep: they wait for every command, so that "
          "no busy computer comes too late for them")
      ->check(CLI::IsMember({"realtime", "lockstep"}))
      ->capture_default_str();
  command->add_flag("--keep-data", options->keep_data, "Leave the arrays that the figures were made from");
  command->add_flag("--json", options->json,
                    "One JSON object on standard output at the end, all else on standard error");
  program.on(command, [options] { return run(*options); });
}

}  // namespace multipanda::cli
