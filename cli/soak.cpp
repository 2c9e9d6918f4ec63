#include "benchmarks/soak/soak.hpp"

#include <filesystem>

#include <fmt/format.h>

#include "cli/program.hpp"
#include "logs/recorder.hpp"
#include "report/page_script.hpp"
#include "runtime/session.hpp"
#include "scene/build.hpp"
#include "scene/load.hpp"

namespace multipanda::cli {
namespace {

struct SoakArguments {
  std::string scene;
  double hours = 0.1;
  SoakOptions options;
  std::string out = "runs";
  bool no_page = false;
};

int run(SoakArguments& arguments) {
  const OpenedScene opened = open_scene(arguments.scene);
  refuse_carried_arms(opened.scene, "multipanda soak");
  SoakOptions& options = arguments.options;
  options.duration_s = 3600 * arguments.hours;
  options.folder = make_run_directory(arguments.out, "soak_" + opened.scene.name);
  const Console console(false);
  options.progress = [&](double time_s) {
    if (std::fmod(time_s, 600) < 60)
      console.line(fmt::format("{:.0f} min of {:.0f}", time_s / 60, options.duration_s / 60));
  };
  const SoakResult result = soak(opened.scene, options);
  write_result(result, options.folder);
  const double arm_hours = result.simulated_s / 3600 * static_cast<double>(result.arms.size());
  fmt::print("{}: {:.2f} h of arm time ({} arms) in {:.0f} s, seed {}\n", result.scene, arm_hours,
             result.arms.size(), result.real_s, options.seed);
  fmt::print("{} faults, {} requests, {} switches, {} recoveries\n", result.faults.size(), result.requests,
             result.switches, result.recoveries);
  for (const BrokenInvariant& violation : result.violations)
    fmt::print("  {:.3f} s: {}\n", violation.at_s, violation.what);
  fmt::print("{}\n", result.passed()
                         ? "no invariant was violated"
                         : fmt::format("{} violations of the invariants", result.violation_count));
  if (!arguments.no_page)
    PageScript("benchmarks/soak/soak_page.py", "the page").run({options.folder.string()});
  fmt::print("results: {}\n", options.folder.string());
  return result.passed() ? kSuccess : kFailed;
}

}  // namespace

void add_soak(Program& program) {
  auto arguments = std::make_shared<SoakArguments>();
  CLI::App* command = program.add(
      "soak", "Run a scene for hours of simulated time under faults, checking invariants in every cycle",
      "  multipanda soak four_arms --hours 2\n"
      "  multipanda soak two_arms --hours 0.1 --seed 7 --fault-every 0.5");
  scene_option(command, arguments->scene);
  option(command, "--hours", arguments->hours, "Simulated time [h]; each arm counts it once", positive,
         shown);
  option(command, "--seed", arguments->options.seed, "Seed of all faults, clocks and delays", shown);
  option(command, "--fault-every", arguments->options.mean_interval_s, "Mean time between two faults [s]",
         positive, shown);
  command->add_flag("--bare-joints", arguments->options.bare_joints,
                    "Assume no motor inertia (0.1 kg m^2 per joint) where an arm's model states none");
  option(command, "--out", arguments->out, "Folder in which the run's folder is created", shown);
  command->add_flag("--no-page", arguments->no_page, "Write soak.json only");
  program.on(command, [arguments] { return run(*arguments); });
}

}  // namespace multipanda::cli

// The program `multipanda-soak`.
int main(int argc, char** argv) {
  return multipanda::cli::run_program(argc, argv,
                                      {.name = "multipanda lab",
                                       .description = "Endurance runs.",
                                       .footer = "Exit codes: 0 success; 1 run failed; 2 invalid arguments."},
                                      {multipanda::cli::add_soak});
}
