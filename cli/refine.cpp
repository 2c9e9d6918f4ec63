#include "experiments/refine/refine.hpp"

#include <algorithm>
#include <filesystem>

#include <fmt/format.h>

#include "cli/backend_words.hpp"
#include "cli/console.hpp"
#include "cli/program.hpp"
#include "logs/recorder.hpp"
#include "runtime/signals.hpp"

// `multipanda refine`: a task's simulation brought nearer to the arms that it is about (docs/refine.md).
namespace multipanda::cli {
namespace {

namespace fs = std::filesystem;

struct RefineWords {
  std::string experiment, target = "virtual", out = "runs";
  std::uint64_t hidden = 1;
  std::vector<std::string> addresses;
  bool cleared = false, json = false, no_page = false;
  RefineOptions options;
};

bool is_loopback_address(const std::string& address) {
  return address.starts_with("127.") || address == "localhost";
}

RefineTarget target_of(const RefineWords& words) {
  RefineTarget target;
  if (words.target == "virtual") {
    if (!words.addresses.empty()) throw UsageError("refine: --address needs --target fci");
    target.hidden = words.hidden;
    return target;
  }
  if (words.addresses.empty())
    throw UsageError("refine: --target fci needs --address ARM=ADDRESS for every arm");
  BackendWords backend{.backend = "fci", .addresses = words.addresses};
  target.addresses = backend_options(backend).addresses;
  const bool real = std::any_of(target.addresses.begin(), target.addresses.end(),
                                [](const auto& one) { return !is_loopback_address(one.second); });
  if (real && !words.cleared) {
    throw UsageError(
        "refine: real arms will do the task, and swing through the room of the excitation (0.9 m around "
        "their bases): "
        "take everything out of it that is not the task's, stay by the stop button, and say so with "
        "--cleared");
  }
  return target;
}

int run(RefineWords& words) {
  const Console console(words.json);
  const Experiment experiment = load_experiment(words.experiment);
  words.options.target = target_of(words);
  std::atomic<bool> stop{false};
  const SignalWatch watch([&](int) {
    stop = true;
    console.line("stopping: arms to hold, then the end (once more: quit at once)");
  });
  words.options.directory = make_run_directory(words.out, "refine_" + experiment.name);
  words.options.page = !words.no_page;
  const RefineResult result =
      refine(experiment, words.options,
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
  if (words.json) fmt::print("{}\n", result.json.dump());
  return result.faults.empty() ? kSuccess : kFailed;
}

}  // namespace

void add_refine(Program& program) {
  auto words = std::make_shared<RefineWords>();
  RefineOptions& options = words->options;
  CLI::App* command = program.add(
      "refine",
      "Brings a task's simulation nearer to its arms: run, compare, identify, run again, compare again",
      "  multipanda refine task-4                              virtual arms with hidden plants of seed 1\n"
      "  multipanda refine task-5 --hidden 7 --rounds 2 --repeats 5\n"
      "  multipanda refine task-4 --variant mu01_k10 --target fci --address arm=172.16.0.2 --cleared");
  command->add_option("experiment", words->experiment, "Name or path, of the kind 'task'")->required();
  command->add_option("--target", words->target, "Virtual arms of another process, or real ones")
      ->check(CLI::IsMember({"virtual", "fci"}))
      ->capture_default_str();
  command->add_option("--hidden", words->hidden, "Seed of the virtual arms' true parameters")
      ->capture_default_str();
  command->add_option("--address", words->addresses, "Of a real arm")->type_name("ARM=ADDRESS");
  command->add_flag("--cleared", words->cleared, "The room around the real arms is free");
  command->add_option("--rounds", options.rounds, "Of exciting, identifying and simulating")
      ->check(CLI::Range(1, 20))
      ->capture_default_str();
  command->add_option("--repeats", options.repeats, "Of the task")
      ->check(CLI::Range(1, 100))
      ->capture_default_str();
  command->add_option("--variant", options.variant, "Of the experiment; default: its first that counts");
  command->add_option("--plant", options.plant, "Fidelity of the simulation")
      ->check(CLI::IsMember({"ideal", "realistic"}))
      ->capture_default_str();
  command->add_option("--excitation", options.excitations,
                      "Scene files of excitations, one for all arms or one each; default: the shipped ones");
  command->add_option("--family", options.family,
                      "Of friction (see identify); default: the best in cross-validation");
  command->add_option("--out", words->out, "Folder that gets a new folder")->capture_default_str();
  command->add_flag("--no-page", words->no_page, "Only refine.json and the logs");
  command->add_flag("--json", words->json, "Standard output has refine.json");
  program.on(command, [words] { return run(*words); });
}

}  // namespace multipanda::cli
