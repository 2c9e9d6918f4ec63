#include <algorithm>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "cli/program.hpp"
#include "cli/reduced_run.hpp"
#include "cli/run_arguments.hpp"
#include "common/machine.hpp"
#include "common/person.hpp"
#include "common/process.hpp"
#include "common/text.hpp"
#include "experiments/kinds.hpp"
#include "logs/recorder.hpp"
#include "scene/load.hpp"

namespace multipanda::cli {
namespace {

namespace fs = std::filesystem;

struct ExperimentArguments {
  std::string name;
  std::optional<std::size_t> repeats;
  std::optional<std::uint64_t> seed;
  std::vector<std::string> set;
  bool fast = false, json = false, keep_data = false;
  std::string generator = "socket", pace = "realtime";
  std::vector<std::string> only, beside;
  std::string out = "runs", resume, answers;
  BackendArguments backend;
  CockpitArguments cockpit;
};

// Whether any limit applies to the variant.
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

int list_experiments(bool as_json) {
  if (as_json) {
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
  fmt::print("{:<24} {}\n", "all", "all experiments, and one page about them");
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

// The experiment with the seed and the values of the command line.
void change(Experiment& experiment, const ExperimentArguments& options) {
  if (options.seed) experiment.seed = *options.seed;
  for (const auto& text : options.set) {
    const std::size_t equals = text.find('=');
    if (equals == std::string::npos || equals == 0)
      throw UsageError(fmt::format("experiment: --set expects KEY=VALUE, found '{}'", text));
    if (experiment.kind != kTaskKind)
      throw UsageError("experiment: --set needs an experiment that runs a scene; " + experiment.name +
                       " is of kind " + experiment.kind);
    // The command line overrides values of variants.
    for (auto& variant : experiment.variants)
      variant.set.push_back(
          {.key = text.substr(0, equals), .value = text.substr(equals + 1), .place = {"--set", 0}});
  }
}

// The person at the terminal who confirms the steps of an experiment on arms. Files of answers are for
// virtual arms.
std::unique_ptr<Person> person_for(const ExperimentArguments& options, const BackendOptions& backend,
                                   const Console& console) {
  if (backend.kind != BackendKind::fci) {
    if (!options.answers.empty())
      throw UsageError("experiment: --answers is for steps on arms; it needs --backend fci");
    return nullptr;
  }
  if (backend.addresses.empty()) {
    throw UsageError(
        "experiment: --backend fci needs the address of every arm, such as --address arm=172.16.0.2; see "
        "multipanda experiment list and the scene for their names");
  }
  for (const auto& [arm, address] : backend.addresses) {
    if (options.answers.empty() || is_on_this_computer(address)) continue;
    throw UsageError(
        fmt::format("experiment: --answers is for virtual arms on this computer only, and arm '{}' is at {}; "
                    "for real arms a person at a terminal must confirm each step",
                    arm, address));
  }
  Person::Options asking = Person::source(options.answers);
  asking.early = true;
  asking.show = [&console](const std::string&, const std::string& text) { console.line(text); };
  asking.prompt = [&console](const std::string& text) { console.raw(text); };
  return std::make_unique<Person>(std::move(asking));
}

// A person may confirm from habit that the scene has run with lower bounds; the memory of such runs is a
// check. Only a warning, because a scene whose motion lasts longer than the run never counts.
void warn_of_first_run(const Experiment& experiment, const BackendOptions& backend, const Console& console) {
  if (experiment.scene.empty()) {
    console.line(
        "WARNING: this experiment uses the full bounds of its scenes; run them first with "
        "multipanda run SCENE --backend fci --reduced --address ARM=ADDRESS");
    return;
  }
  const Scene scene = with_connections(open_scene(experiment.scene).scene, backend);
  if (!ReducedRun(scene, Reduction::as_usual, ReducedRun::first_runs_file()).reduced()) return;
  console.line(fmt::format(
      "WARNING: there is no record of a first run of this scene on physical arms, and an experiment uses the "
      "scene's full bounds; run first: multipanda run {} --backend fci --reduced --address ARM=ADDRESS",
      experiment.scene));
}

std::string resume_command(const ExperimentArguments& options, const fs::path& directory) {
  std::string text = "multipanda experiment " + options.name + " --resume " + directory.string();
  if (options.backend.backend != "mujoco") text += " --backend " + options.backend.backend;
  for (const auto& address : options.backend.addresses) text += " --address " + address;
  if (options.repeats) text += fmt::format(" --repeats {}", *options.repeats);
  if (options.seed) text += fmt::format(" --seed {}", *options.seed);
  for (const auto& set : options.set) text += " --set '" + set + "'";
  if (!options.only.empty()) text += fmt::format(" --only {}", fmt::join(options.only, ","));
  if (options.fast) text += " --fast";
  if (options.keep_data) text += " --keep-data";
  for (const auto& beside : options.beside) text += " --beside '" + beside + "'";
  if (options.generator != "socket") text += " --generator " + options.generator;
  if (options.pace == "lockstep") text += " --pace lockstep";
  if (!options.answers.empty()) text += " --answers " + options.answers;
  return text;
}

// Prints one line per exceeded limit, with the worst figure.
void print_result(const ExperimentResult& result, const Console& console) {
  std::size_t limits = 0;
  if (result.results.contains("limits")) limits = result.results["limits"].size();
  console.line(result.passed ? fmt::format("{}: passed, {} limits held", result.name, limits)
                             : fmt::format("{}: FAILED", result.name));
  for (const auto& problem : result.problems) console.line("  " + problem);
  if (!result.page.empty()) console.line("  report: " + result.page.string());
}

int run(const ExperimentArguments& options) {
  if (options.name == "list") return list_experiments(options.json);
  const Console console(options.json);
  const bool all = options.name == "all";
  std::vector<Experiment> experiments;
  if (all) {
    if (!options.only.empty()) throw UsageError("experiment all: --only needs a single experiment");
    for (const auto& name : available_experiments()) experiments.push_back(load_experiment(name));
  } else {
    experiments.push_back(open_experiment(options.name));
  }
  for (auto& experiment : experiments) change(experiment, options);

  if (options.generator == "ros" && !std::all_of(experiments.begin(), experiments.end(),
                                                 [](const auto& e) { return e.kind == "performance"; })) {
    throw UsageError(
        "experiment: --generator needs an experiment with a motion generator, such as "
        "controller-performance");
  }

  BackendOptions backend = backend_options(options.backend);
  backend.lockstep = options.pace == "lockstep";
  if (backend.lockstep && backend.kind != BackendKind::virtual_arms)
    throw UsageError("experiment: --pace needs --backend virtual; simulated arms always wait for commands");

  if (backend.kind == BackendKind::fci && all)
    throw UsageError("experiment all: --backend fci runs one experiment at a time; name it");
  if (!options.resume.empty() && all)
    throw UsageError("experiment all: --resume continues a single experiment; name it");
  if (!options.beside.empty() && all) throw UsageError("experiment all: --beside needs a single experiment");
  const std::unique_ptr<Person> person = person_for(options, backend, console);

  if (person != nullptr) warn_of_first_run(experiments.front(), backend, console);

  std::atomic<bool> stop{false};
  const SignalWatch watch([&](int) {
    stop = true;
    console.line("stopping: the arms hold, then the run ends (interrupt again after 2 s to quit at once)");
  });
  OpenedCockpit cockpit(options.cockpit, console);
  cockpit.on_stop_between_runs([&] {
    if (!stop.exchange(true)) console.line("stopped in the cockpit: no further run is started");
  });
  const ExperimentProgress progress{.line = [&](const std::string& text) { console.line(text); },
                                    .stop = &stop};
  const fs::path directory =
      !options.resume.empty()
          ? fs::path(options.resume)
          : make_run_directory(options.out, all ? "experiments" : "experiment_" + experiments.front().name);
  std::vector<ExperimentResult> results;
  auto list = nlohmann::ordered_json::array();
  for (const auto& experiment : experiments) {
    ExperimentOptions run_options{.fast = options.fast,
                                  .repeats = options.repeats,
                                  .directory = all ? directory / experiment.name : directory,
                                  .only = options.only,
                                  .keep_data = options.keep_data,
                                  .backend = backend,
                                  .person = person.get(),
                                  .beside = options.beside,
                                  .resume = !options.resume.empty(),
                                  .viewer = cockpit ? &cockpit : nullptr,
                                  .ros = options.generator == "ros"};
    fs::create_directories(run_options.directory);
    console.line(fmt::format("{}: {}", experiment.name, experiment.title));
    ExperimentResult result;
    try {
      result = run_experiment(experiment, run_options, progress);
    } catch (...) {  // a refused experiment leaves no empty folders
      std::error_code not_empty;
      fs::remove(run_options.directory, not_empty);
      fs::remove(directory, not_empty);
      throw;
    }
    if (result.stopped) {
      if (!result.why_stopped.empty()) console.line("stopped: " + result.why_stopped);
      console.line("no report; finished runs are kept");
      if (!all) console.line("continue with: " + resume_command(options, run_options.directory));
      return kFailed;
    }
    print_result(result, console);
    list.push_back(result.results);
    results.push_back(std::move(result));
  }
  const bool passed = std::all_of(results.begin(), results.end(), [](const auto& r) { return r.passed; });
  fs::path index;
  if (all) {
    index = make_index(results, directory);
    console.line("page of all: " + index.string());
  }
  if (options.json) {
    if (all) list = {{"passed", passed}, {"index", index.string()}, {"experiments", list}};
    fmt::print("{}\n", all ? list.dump() : list.front().dump());
  }
  return passed ? kSuccess : kFailed;
}

}  // namespace

void add_experiment(Program& program) {
  auto options = std::make_shared<ExperimentArguments>();
  CLI::App* command = program.add(
      "experiment", "Run an experiment on simulated or real arms and report figures, limits and pictures",
      "  multipanda experiment list\n"
      "  multipanda experiment task-1                      with its five repeats, in real time\n"
      "  multipanda experiment task-1 --fast --repeats 1   a quick look\n"
      "  multipanda experiment task-3 --fast --backend virtual   with virtual arms and the network client\n"
      "  multipanda experiment task-3 --only k10 --backend fci --address arm=172.16.0.2   on an arm, step by "
      "step\n"
      "  multipanda experiment controller-performance --backend virtual --generator ros\n"
      "  multipanda experiment all --fast                  all experiments and one page\n"
      "Fails (exit code 1) if a figure exceeds its limit or a run failed.");
  option(command, "name", options->name,
         "Name (see multipanda experiment list) or path of an experiment; all; or list", required);
  option(command, "--repeats", options->repeats,
         "Runs of every variant on every plant (default: as in the experiment)", within(1, 1000));
  option(command, "--seed", options->seed, "Seed of variation and noise (default: as in the experiment)",
         within(0, 1000000000));
  option(command, "--set", options->set, "Value for the scene of every run, by key path; may be repeated",
         named("KEY=VALUE"), repeated);
  command->add_flag("--fast", options->fast,
                    "Run as fast as possible and several runs at once, instead of in real time");
  option(command, "--only", options->only, "Variants to run, by name or choice (default: all)", by_commas);
  option(command, "--out", options->out,
         "Folder in which a new folder with logs, figures and page is created", named("DIR"), shown);
  option(command, "--beside", options->beside,
         "Log of arms to be shown beside the simulated runs, with the paper's bounds; VARIANT=LOG if several "
         "variants run, or the folder of an experiment on arms; may be repeated. controller-performance: "
         "measurements inside a controller_manager, by file, folder or CONDITION=FILE",
         named("LOG"), repeated);
  option(command, "--resume", options->resume,
         "Resume an interrupted experiment in its folder DIR; finished runs are kept. Give the "
         "same arguments as at its start",
         named("DIR"));
  add_experiment_arguments(command, options->backend);
  option(command, "--answers", options->answers,
         "File or pipe of lines 'QUESTION: answer' in place of a terminal, for virtual arms on this computer "
         "only; '-': standard input",
         named("FILE"));
  add_cockpit_arguments(command, options->cockpit,
                        "Show the runs in a browser on this computer, one at a time, at a port of 127.0.0.1");
  option(command, "--generator", options->generator,
         "Channel of the motion generator of controller-performance: socket, or ros (topics)",
         one_of({"socket", "ros"}), shown);
  option(command, "--pace", options->pace,
         "Pace of virtual arms: realtime, or lockstep: they wait for every command, so that "
         "a busy computer loses none",
         one_of({"realtime", "lockstep"}), shown);
  command->add_flag("--keep-data", options->keep_data,
                    "Keep the arrays from which the figures were computed");
  json_flag(command, options->json);
  program.on(command, [options] { return run(*options); });
}

}  // namespace multipanda::cli
