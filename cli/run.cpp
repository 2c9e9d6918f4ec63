#include <algorithm>
#include <unistd.h>

#include <fmt/format.h>

#include "cli/backend_words.hpp"
#include "cli/program.hpp"
#include "cli/report.hpp"
#include "cli/run_session.hpp"
#include "runtime/live_input/socket_path.hpp"
#include "runtime/ros_module.hpp"
#include "scene/load.hpp"

namespace multipanda::cli {
namespace {

constexpr double kUnpacedDefault = 10;  // [s]; an unpaced run without an end would only fill the disk

struct RunOptions {
  std::string scene;
  std::optional<double> seconds;
  bool fast = false, json = false, report = false;
  std::string record;
  std::optional<int> cpu;
  std::string socket;
  bool ros = false;
  RosWords ros_words;
  BackendWords backend;
};

// Where the run listens. By itself only a paced one does: an unpaced one is over before anybody can speak to
// it.
std::filesystem::path socket_of(const RunOptions& options, const std::string& scene, const Console& console) {
  if (!options.socket.empty()) return options.socket;
  if (options.fast) return {};
  try {
    const auto folder = socket_folder();
    make_private_folder(folder);
    auto path = folder / (scene + ".sock");
    const auto running = running_sockets(folder);
    if (std::find(running.begin(), running.end(), path) != running.end()) {
      path = folder / fmt::format("{}-{}.sock", scene, getpid());
    }
    check_socket_path(path);
    return path;
  } catch (const std::exception& error) {
    console.line(fmt::format("no live input: {}", error.what()));
    return {};
  }
}

int run(const RunOptions& options) {
  const Console console(options.json);
  if (options.report && options.record.empty())
    throw UsageError("run: --report needs a log: add --record DIR");
  if (!options.ros && !(options.ros_words == RosWords{}))
    throw UsageError("run: --ros-node, --ros-namespace and --ros-remap go with --ros");
  const BackendOptions backend = backend_options(options.backend);
  OpenedScene opened = open_scene(options.scene);
  opened.scene = with_arms_from(std::move(opened.scene), backend);  // refused before anything is begun
  SessionOptions session_options{
      .paced = !options.fast, .backend = backend, .duration_s = options.seconds, .record = options.record};
  session_options.thread.cpu = options.cpu;
  session_options.socket = socket_of(options, opened.scene.name, console);
  if (!session_options.socket.empty())
    console.line(fmt::format("live input (multipanda ctl): {}", session_options.socket.string()));
  if (options.fast && !options.seconds && opened.scene.duration_s == 0) {
    session_options.duration_s = kUnpacedDefault;
    console.line(fmt::format("the scene names no end: --fast runs for {:g} s (--seconds says otherwise)",
                             kUnpacedDefault));
  }
  StopSignals signals(console);
  // ROS brings threads of its own: not before the signals have theirs.
  if (options.ros) session_options.make_adapter = load_ros_adapter(options.ros_words);
  Session session(std::move(opened.scene), opened.registry, std::move(session_options));
  if (session.backend_description() != "mujoco")
    console.line(fmt::format("arms: {}", session.backend_description()));
  RunSummary summary = run_session(session, signals, console);
  print_summary(summary, console);
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
      "run", "Runs a scene: the arms are controlled until its end, --seconds, or Ctrl-C (which ends in hold)",
      "  multipanda run two_arms                          in real time, until Ctrl-C\n"
      "  multipanda run two_arms --seconds 10 --record runs --report\n"
      "  multipanda run my/scene.yaml --fast --json       as fast as possible, result as one JSON object\n"
      "  multipanda run two_arms --ros                    ... and by ROS 2, on this machine unless the "
      "environment\n"
      "                                                   (ROS_*, FASTDDS_*) says otherwise\n"
      "  multipanda run two_arms --backend fci --address left=172.16.0.2 --address right=172.16.1.2\n"
      "Fails (exit code 1) if a controllet was taken out, a switch refused, or the log is incomplete.");
  command->add_option("scene", options->scene, "Name (multipanda list scenes) or path of a scene file")
      ->required();
  command->add_option("--seconds", options->seconds, "Length of the run; default: the scene's duration_s")
      ->check(CLI::Range(0.001, 1e6));
  command->add_flag("--fast", options->fast, "As fast as possible instead of paced to the wall clock");
  command->add_option("--record", options->record, "Write a log into a new folder inside DIR")
      ->type_name("DIR");
  command->add_flag("--report", options->report, "Make the report afterwards (needs --record)");
  command->add_flag("--json", options->json,
                    "One JSON object on standard output at the end, all else on standard error");
  command->add_option("--cpu", options->cpu, "Pin the loop's thread to this core")
      ->check(CLI::Range(0, 1023));
  add_backend_words(command, options->backend);
  command
      ->add_option("--socket", options->socket,
                   "Where multipanda ctl reaches this run; default, unless --fast: the scene's name in the "
                   "user's runtime folder")
      ->type_name("PATH");
  command->add_flag("--ros", options->ros,
                    "Topics, services, actions and parameters of ROS 2 (docs/ros_interfaces.md)");
  command
      ->add_option("--ros-node", options->ros_words.node,
                   "Name of the node; default: the scene's, multipanda")
      ->type_name("NAME");
  command
      ->add_option("--ros-namespace", options->ros_words.name_space, "Its namespace; default: the scene's, /")
      ->type_name("/NAME");
  command->add_option("--ros-remap", options->ros_words.remaps, "Another name for one of its interfaces")
      ->type_name("FROM:=TO")
      ->expected(1)
      ->take_all();
  program.on(command, [options] { return run(*options); });
}

}  // namespace multipanda::cli
