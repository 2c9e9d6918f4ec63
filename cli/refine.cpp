#include "sysid/refine/refine.hpp"

#include <algorithm>
#include <filesystem>

#include <fmt/format.h>

#include "cli/program.hpp"
#include "cli/run_arguments.hpp"
#include "common/machine.hpp"
#include "common/process.hpp"
#include "logs/recorder.hpp"

// `multipanda refine` adapts the simulation of a task to its arms (docs/identification.md).
namespace multipanda::cli {
namespace {

namespace fs = std::filesystem;

struct RefineArguments {
  std::string experiment, target = "virtual", out = "runs";
  std::uint64_t hidden = 1;
  std::string drives = "ideal";
  std::vector<std::string> addresses;
  bool cleared = false, json = false, no_page = false;
  RefineOptions options;
};

RefineTarget target_of(const RefineArguments& arguments) {
  RefineTarget target;
  if (arguments.target == "virtual") {
    if (!arguments.addresses.empty()) throw UsageError("refine: --address needs --target fci");
    target.hidden = arguments.hidden;
    target.motors = arguments.drives == "motors";
    return target;
  }
  if (arguments.drives != "ideal") throw UsageError("refine: --drives is for virtual arms only");
  if (arguments.addresses.empty())
    throw UsageError("refine: --target fci needs --address ARM=ADDRESS for every arm");
  BackendArguments backend{.backend = "fci", .addresses = arguments.addresses};
  target.addresses = backend_options(backend).addresses;
  const bool real = std::any_of(target.addresses.begin(), target.addresses.end(),
                                [](const auto& one) { return !is_on_this_computer(one.second); });
  if (real && !arguments.cleared) {
    throw UsageError(
        "refine: real arms will perform the task and the excitation, which needs free space (0.9 m around "
        "their bases); remove everything that is not part of the task, keep the user stop at hand, and "
        "confirm with --cleared");
  }
  return target;
}

int run(RefineArguments& arguments) {
  const Console console(arguments.json);
  const Experiment experiment = load_experiment(arguments.experiment);
  arguments.options.target = target_of(arguments);
  std::atomic<bool> stop{false};
  const SignalWatch watch([&](int) {
    stop = true;
    console.line("stopping: the arms hold, then the run ends (interrupt again after 2 s to quit at once)");
  });
  arguments.options.directory = make_run_directory(arguments.out, "refine_" + experiment.name);
  arguments.options.page = !arguments.no_page;
  const RefineResult result =
      refine(experiment, arguments.options,
             {.line = [&](const std::string& line) { console.line(line); }, .stop = &stop});
  if (result.stopped) {
    console.line("stopped: no report");
    return kFailed;
  }
  bool worse = false;
  for (const auto& changes : result.rounds.back().changes) {
    for (const auto& change : changes) worse = worse || change.worse;
  }
  console.line(worse ? "some distances grew by more than twice their spread over repeats"
                     : "no distance grew");
  for (const auto& arm : result.rounds.back().arms)
    console.line("model of " + arm.arm + ": " + arm.model.string());
  if (!result.page.empty()) console.line("report: " + result.page.string());
  if (arguments.json) fmt::print("{}\n", result.json.dump());
  return result.faults.empty() ? kSuccess : kFailed;
}

}  // namespace

void add_refine(Program& program) {
  auto arguments = std::make_shared<RefineArguments>();
  RefineOptions& options = arguments->options;
  CLI::App* command = program.add(
      "refine",
      "Adapt the simulation of a task to its arms: run, compare, identify, run again, compare again",
      "  multipanda refine task-4                              virtual arms with hidden plants of seed 1\n"
      "  multipanda refine task-5 --hidden 7 --rounds 2 --repeats 5\n"
      "  multipanda refine task-4 --variant mu01_k10 --target fci --address arm=172.16.0.2 --cleared");
  option(command, "experiment", arguments->experiment, "Name or path of an experiment of the kind 'task'",
         required);
  option(command, "--target", arguments->target,
         "virtual (virtual arms of another process) or fci (real arms)", one_of({"virtual", "fci"}), shown);
  option(command, "--hidden", arguments->hidden, "Seed of the hidden parameters of the virtual arms", shown);
  option(command, "--drives", arguments->drives,
         "Drives of these arms: ideal, or motors (rotors, elastic joints and gear ripple, which "
         "identified models cannot express)",
         one_of({"ideal", "motors"}), shown);
  option(command, "--address", arguments->addresses, "Address of a real arm, once per arm",
         named("ARM=ADDRESS"));
  command->add_flag("--cleared", arguments->cleared, "Confirm that the space around the real arms is free");
  option(command, "--rounds", options.rounds, "Number of refinement rounds", within(1, 20), shown);
  option(command, "--repeats", options.repeats, "Number of repeats of the task", within(1, 100), shown);
  option(command, "--variant", options.variant, "Variant of the experiment (default: the first with limits)");
  option(command, "--plant", options.plant, "Fidelity of the simulation", one_of({"ideal", "realistic"}),
         shown);
  option(command, "--excitation", options.excitations,
         "Scene files of excitations, one for all arms or one per arm (default: those in the project)");
  option(command, "--family", options.family,
         "Friction family, see identify (default: the best in cross-validation)");
  option(command, "--out", arguments->out, "Folder in which a new folder is created", shown);
  command->add_flag("--no-page", arguments->no_page, "Make no page, only refine.json and the logs");
  command->add_flag("--json", arguments->json, "Print refine.json to standard output");
  program.on(command, [arguments] { return run(*arguments); });
}

}  // namespace multipanda::cli
