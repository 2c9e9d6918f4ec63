#include <unistd.h>

#include <fmt/format.h>

#include "cli/program.hpp"
#include "cli/reduced_run.hpp"
#include "cli/report.hpp"
#include "cli/run_arguments.hpp"
#include "cli/run_session.hpp"
#include "report/page_script.hpp"
#include "runtime/live_input/socket_path.hpp"
#include "runtime/run_adapter.hpp"
#include "scene/build.hpp"
#include "scene/load.hpp"

namespace multipanda::cli {
namespace {

constexpr double kUnpacedDefault = 10;  // an endless unpaced run would fill the disk [s]

struct RunOptions {
  std::string scene;
  SceneAdditions additions;
  std::vector<std::string> settings;
  std::optional<double> seconds;
  bool fast = false, json = false, report = false, no_timeline = false, until_input_ends = false;
  bool reduced = false, full_speed = false, keep_nothing = false;
  std::string record;
  std::vector<std::string> log_every;
  std::optional<int> cpu;
  std::string socket;
  bool ros = false;
  RosArguments ros_arguments;
  BackendArguments backend;
  CockpitArguments cockpit;
};

// Sets the run's socket. Unpaced runs, usually too short for commands, have one only on request. A second run
// of the same scene takes the second path.
void set_socket(const RunOptions& options, const std::string& scene, const Console& console,
                SessionOptions& session) {
  if (!options.socket.empty()) session.socket = options.socket;
  if (options.fast || !options.socket.empty()) return;
  try {
    const auto folder = socket_folder();
    make_private_folder(folder);
    session.socket = folder / (scene + ".sock");
    session.second_socket = folder / fmt::format("{}-{}.sock", scene, getpid());
    check_socket_path(session.second_socket);
  } catch (const std::exception& error) {
    session.socket.clear();
    console.line(fmt::format("no live input: {}", error.what()));
  }
}

LogEvery log_choice(const RunOptions& options) {
  if (!options.log_every.empty() && options.record.empty())
    throw UsageError("run: --log-every needs a log: add --record DIR");
  LogEvery every;
  try {
    for (const auto& choice : options.log_every) every.set(choice);
  } catch (const std::invalid_argument& error) {
    throw UsageError(fmt::format("run: --log-every {}", error.what()));
  }
  return every;
}

int run(const RunOptions& options) {
  const Console console(options.json);
  if (options.report && options.record.empty())
    throw UsageError("run: --report needs a log: add --record DIR");
  if (const std::string missing = options.report ? missing_page_packages() : ""; !missing.empty())
    throw UsageError("run: --report needs Python packages: " + missing);
  if (!options.ros && !(options.ros_arguments == RosArguments{}))
    throw UsageError("run: --ros-node, --ros-namespace and --ros-remap need --ros");
  const LogEvery log_every = log_choice(options);
  const BackendOptions backend = backend_options(options.backend);
  OpenedScene opened = open_scene(options.scene, options.additions);
  if (!options.settings.empty()) {
    opened.scene = with_values(opened, options.settings);
    for (const auto& setting : options.settings) console.line(fmt::format("set: {}", setting));
  }
  opened.scene = with_connections(std::move(opened.scene), backend);  // refused before anything starts
  if (options.ros) refuse_carried_arms(opened.scene, "ROS (--ros)");
  if (options.cockpit.asked) refuse_carried_arms(opened.scene, "the page (--cockpit)");
  const ReducedRun reduced_run(opened.scene,
                               options.reduced      ? Reduction::asked
                               : options.full_speed ? Reduction::refused
                                                    : Reduction::as_usual,
                               ReducedRun::first_runs_file());
  SeenRun seen(opened.scene);
  reduced_run.apply(opened.scene);
  if (!reduced_run.text().empty()) console.line(reduced_run.text());
  if (options.no_timeline) {
    opened.scene.timeline.clear();
    opened.scene.duration_s = 0;
  }
  SessionOptions session_options{
      .paced = !options.fast, .backend = backend, .duration_s = options.seconds, .record = options.record};
  session_options.log_every = log_every;
  session_options.keep_last = !options.keep_nothing;
  session_options.moving_bases = true;
  session_options.observer = [&seen](const CycleRecord& record) { seen.take(record); };
  session_options.thread.cpu = options.cpu;
  set_socket(options, opened.scene.name, console, session_options);
  if (options.fast && !options.seconds && opened.scene.duration_s == 0) {
    session_options.duration_s = kUnpacedDefault;
    console.line(fmt::format("the scene has no duration_s: --fast runs for {:g} s (change it with --seconds)",
                             kUnpacedDefault));
  }
  StopSignals signals(console);
  OpenedCockpit cockpit(options.cockpit, console);
  cockpit.prepare(session_options);
  std::optional<InputEndWatch> input;
  if (options.until_input_ends) input.emplace([&signals] { signals.stop(); });
  // ROS starts threads: the signal handling must be set up first.
  if (options.ros) session_options.make_adapter = load_ros_adapter(options.ros_arguments);
  Session session(std::move(opened.scene), opened.registry, std::move(session_options));
  seen.begin(session.layout());
  if (!session.socket().empty())
    console.line(fmt::format("live input (multipanda ctl): {}", session.socket().string()));
  if (session.backend_description() != "mujoco")
    console.line(fmt::format("arms: {}", session.backend_description()));
  cockpit.show(session);
  RunSummary summary = run_session(session, signals, console);
  cockpit.end();
  input.reset();
  std::string uncounted;
  if (summary.success() && !options.no_timeline) uncounted = reduced_run.remember(seen);
  print_summary(summary, console);
  if (!uncounted.empty()) console.line(uncounted);
  bool reported = true;
  if (options.report) {
    summary.report = report_of(summary.log, console, &summary);
    reported = !summary.report.empty();
    console.line(reported ? "report: " + summary.report.string() : "the report could not be made, see above");
  }
  for (const auto& fault : summary.faults()) console.line("failed: " + fault);
  if (options.json) fmt::print("{}\n", to_json(summary));
  return summary.success() && reported ? kSuccess : kFailed;
}

}  // namespace

void add_run(Program& program) {
  auto options = std::make_shared<RunOptions>();
  CLI::App* command = program.add(
      "run", "Run a scene until its end, --seconds or Ctrl-C; a stopped run ends in hold",
      "  multipanda run two_arms                          in real time, to the end of the scene\n"
      "  multipanda run two_arms --no-timeline            idle until Ctrl-C, commanded by multipanda ctl\n"
      "  multipanda run two_arms --seconds 10 --record runs --report\n"
      "  multipanda run my/scene.yaml --fast --json       as fast as possible, result as one JSON object\n"
      "  multipanda run two_arms --no-timeline --cockpit  shown and commanded in a browser on this computer\n"
      "  multipanda run two_arms --ros                    also commanded by ROS 2, on this computer unless\n"
      "                                                   ROS_* or FASTDDS_* variables are set\n"
      "  multipanda run two_arms --backend fci --address left=172.16.0.2 --address right=172.16.1.2\n"
      "  multipanda run two_arms --backend replay --log runs/NAME --fast\n"
      "Fails (exit code 1) if a controllet was deactivated by the safety stage, a switch was refused or the "
      "log\n"
      "is incomplete.");
  scene_option(command, options->scene);
  option(command, "--seconds", options->seconds, "Duration of the run [s] (default: the scene's duration_s)",
         within(0.001, 1e6));
  option(command, "--plugin", options->additions.plugins,
         "Library with controllets, in addition to those that the scene names; may be repeated",
         named("FILE"));
  option(command, "--controllet", options->additions.controllets,
         "Controllet in addition to those of the scene, as in a scene file: "
         "'{name: soft, type: my_law, arms: arm}'; may be repeated",
         named("YAML"));
  option(command, "--set", options->settings,
         "Another value of the scene: 'controllets.cartesian.inputs.pose.timeout_s=0.5'; may be repeated",
         named("KEY=VALUE"), expecting(1), repeated);
  command->add_flag("--no-timeline", options->no_timeline,
                    "Ignore the scene's timeline and duration_s: run until Ctrl-C, for multipanda ctl");
  CLI::Option* reduced = command->add_flag(
      "--reduced", options->reduced,
      "Hands at most 0.1 m/s, springs at most 30 N: the default of a scene's first run on physical arms");
  command
      ->add_flag("--full-speed", options->full_speed,
                 "Use the scene's own bounds, even in its first run on physical arms")
      ->excludes(reduced);
  command->add_flag("--fast", options->fast, "Run as fast as possible instead of in real time");
  option(command, "--record", options->record, "Record the log into a new folder inside DIR", named("DIR"));
  option(command, "--log-every", options->log_every,
         "How often the log has state, command, wrench, references, outputs, timing, model or all: "
         "every Nth cycle, 0: never (default 1, model 10). Events and switches are always complete",
         named("GROUP=N"), repeated);
  command->add_flag("--keep-nothing", options->keep_nothing,
                    "Do not keep the last 30 s in memory for faults and `multipanda ctl keep`");
  command->add_flag("--report", options->report, "Make the report afterwards (needs --record)");
  json_flag(command, options->json);
  option(command, "--cpu", options->cpu, "Core to which the loop's thread is pinned (default: none)",
         within(0, 1023));
  add_backend_arguments(command, options->backend);
  option(command, "--socket", options->socket,
         "Path of the live-input socket (default: the scene's name in the user's runtime folder; "
         "with --fast none)",
         named("PATH"));
  add_cockpit_arguments(command, options->cockpit);
  command->add_flag(
      "--until-input-ends", options->until_input_ends,
      "End the run in hold when standard input closes, as when the program that started it has ended");
  command->add_flag("--ros", options->ros,
                    "Offer topics, services, actions and parameters of ROS 2 (docs/ros_interfaces.md)");
  option(command, "--ros-node", options->ros_arguments.node,
         "Name of the ROS node (default: the scene's, or multipanda)", named("NAME"));
  option(command, "--ros-namespace", options->ros_arguments.name_space,
         "Namespace of the ROS node (default: the scene's, or /)", named("/NAME"));
  option(command, "--ros-remap", options->ros_arguments.remaps,
         "Rename a ROS interface; may be given several times", named("FROM:=TO"), expecting(1), repeated);
  program.on(command, [options] { return run(*options); });
}

}  // namespace multipanda::cli
