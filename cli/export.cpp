#include "logs/export.hpp"

#include <fstream>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "cli/program.hpp"
#include "cli/report.hpp"
#include "models/write_robot.hpp"
#include "report/report.hpp"

namespace multipanda::cli {

namespace {

struct ExportOptions {
  std::vector<std::string> all;  // logs, or one model
  std::string what, out, lerobot;
  std::vector<std::string> leaders;
  LerobotOptions dataset;
  double rotor_hidden = 0;
  bool csv = false, npz = false, urdf = false, mjcf = false, hand = false;
};

// Writes the model for other programs: MODEL.urdf, MODEL.xml in the folder `out`.
int export_model(const ExportOptions& options) {
  namespace fs = std::filesystem;
  const RobotDescription robot = load_robot(options.what);
  if (!robot.left_out_friction.empty())
    fmt::print(stderr, "note: the URDF's friction is left out; give link_friction in the model's file: {}\n",
               fmt::join(robot.left_out_friction, ", "));
  const fs::path folder = options.out.empty() ? "." : options.out;
  fs::create_directories(folder);
  const auto write = [&](const std::string& ending, const std::string& text) {
    const fs::path file = folder / (robot.name + (options.hand ? "_hand" : "") + ending);
    std::ofstream stream(file, std::ios::binary);
    stream << text;
    if (!stream.flush()) throw std::runtime_error("cannot write " + file.string());
    fmt::print("{}\n", file.string());
  };
  if (options.urdf) write(".urdf", to_urdf(robot, {.hand = options.hand}));
  if (options.mjcf)
    write(".xml",
          to_mjcf(robot, {.hand = options.hand, .friction = true, .rotor_hidden = options.rotor_hidden}));
  return kSuccess;
}

// Makes a LeRobot data set from the marked episodes of all logs.
int export_dataset(LerobotOptions dataset, const ExportOptions& options) {
  for (const std::string& pair : options.leaders) {
    const auto both = key_and_value(pair);
    if (!both) throw UsageError("export: --leader: expected ARM=LEADER, found " + pair);
    dataset.leaders.insert_or_assign(both->first, both->second);
  }
  std::vector<std::filesystem::path> logs;
  for (const std::string& log : options.all) logs.push_back(own_log(find_log(log)));
  const LerobotResult result = export_lerobot(logs, options.lerobot, dataset);
  for (const auto& note : result.notes) fmt::print(stderr, "note: {}\n", note);
  fmt::print(stderr, "{}\n", result.said);
  fmt::print("{}\n", options.lerobot);
  return kSuccess;
}

int run(ExportOptions options) {
  namespace fs = std::filesystem;
  if (!options.lerobot.empty()) return export_dataset(options.dataset, options);
  if (options.all.size() != 1)
    throw UsageError("export: expected one log or model; only --lerobot takes several");
  options.what = options.all.front();
  if (options.urdf || options.mjcf) return export_model(options);
  if (!options.csv && !options.npz) {
    throw UsageError(
        "export: name a format: --csv, --npz or --lerobot for a log, --urdf or --mjcf for a model");
  }
  const fs::path log = own_log(find_log(options.what));
  fs::path out = options.out;
  if (out.empty()) out = options.csv ? log.parent_path() / "csv" : fs::path(log).replace_extension(".npz");
  const ExportResult result = options.csv ? export_csv(log, out) : export_npz(log, out);
  for (const auto& note : result.notes) fmt::print(stderr, "note: {}\n", note);
  for (const auto& file : result.files) fmt::print("{}\n", file.string());
  return kSuccess;
}

}  // namespace

void add_export(Program& program) {
  auto options = std::make_shared<ExportOptions>();
  CLI::App* command = program.add(
      "export",
      "Export a log as CSV tables, numpy archive or LeRobot data set, or a robot model as URDF or MJCF",
      "  multipanda export runs/20260102_120000_two_arms/log.mcap --csv --out tables\n"
      "  multipanda export runs --npz                      of the newest run in runs\n"
      "  multipanda export runs/one runs/two --lerobot data/stack --fps 30 --task 'Stack the boxes'\n"
      "  multipanda export identified.yaml --urdf --mjcf --hand --out models");
  option(command, "what", options->all,
         "Log file or folder of its run, several with --lerobot; with --urdf or --mjcf name or file of "
         "a model",
         required, named("LOG|MODEL"));
  CLI::Option* csv = command->add_flag(
      "--csv", options->csv, "Write a table per topic into a folder (default: csv next to the log)");
  command->add_flag("--npz", options->npz, "Write one archive for numpy.load() (default: next to the log)")
      ->excludes(csv);
  CLI::Option* urdf =
      command->add_flag("--urdf", options->urdf, "Write the rigid bodies of the model as NAME.urdf");
  CLI::Option* mjcf = command->add_flag(
      "--mjcf", options->mjcf, "Write the model with motor inertia and viscous and dry friction as NAME.xml");
  for (CLI::Option* format : {urdf, mjcf}) format->excludes(csv)->excludes("--npz");
  option(command, "--rotor-hidden", options->rotor_hidden,
         "With --mjcf: fraction of the rotors' inertia that the arm's torque loop compensates, 0 "
         "to 1; the rest becomes armature. Other programs have no such loop",
         within(0.0, 1.0))
      ->needs(mjcf)
      ->capture_default_str();
  command->add_flag("--hand", options->hand, "Include the closed hand on the flange");
  option(command, "--out", options->out,
         "Folder for --csv, --urdf and --mjcf, file for --npz (default: see the formats; models: "
         "this folder)",
         named("PATH"));
  LerobotOptions& dataset = options->dataset;
  CLI::Option* lerobot =
      option(command, "--lerobot", options->lerobot,
             "Write a LeRobot data set (v3.0) of the logs' marked episodes into this new folder; needs "
             "the Python package pyarrow (docs/lerobot.md)",
             named("DIR"))
          ->excludes(csv)
          ->excludes("--npz")
          ->excludes(urdf)
          ->excludes(mjcf)
          ->excludes("--out");
  const auto of_dataset = [&](const char* name, auto& value, const char* text, const char* type) {
    return option(command, name, value, text, named(type))->needs(lerobot);
  };
  of_dataset("--fps", dataset.fps, "Frames per second of the data set (default 30)", "N")
      ->check([](const std::string& text) {
        const bool whole = text.find_first_not_of("0123456789") == std::string::npos;
        return whole && CLI::Range(1, 1000)(text).empty()
                   ? std::string()
                   : "expected a whole number of frames per second, 1 to 1000, found " + text;
      });
  of_dataset("--task", dataset.task, "Task description (default: the scene's name)", "TEXT");
  of_dataset("--arms", dataset.arms, "Arms, in the order of the features (default: all)", "NAMES")
      ->delimiter(',')
      ->allow_extra_args(false);
  of_dataset("--action", dataset.action,
             "Set-points to use as the action (default: the first that all arms have)", "KIND")
      ->check(CLI::IsMember({"joints", "pose"}));
  of_dataset("--observe", dataset.observe,
             "Measured quantities: joints, velocities, torques, pose, wrench (default: joints)", "NAMES")
      ->delimiter(',')
      ->allow_extra_args(false);
  of_dataset("--grippers", dataset.grippers, "Arms whose fingers are included", "NAMES")
      ->delimiter(',')
      ->allow_extra_args(false);
  of_dataset("--leader", options->leaders,
             "Use the measured motion of LEADER as the action of ARM, for arms that followed in the run",
             "ARM=LEADER")
      ->delimiter(',')
      ->allow_extra_args(false);
  of_dataset("--outcomes", dataset.outcomes, "Episodes to use: success, failure, discard (default: success)",
             "NAMES")
      ->delimiter(',')
      ->allow_extra_args(false)
      ->check(CLI::IsMember({"success", "failure", "discard"}));
  program.on(command, [options] { return run(*options); });
}

void add_repair(Program& program) {
  auto path = std::make_shared<std::string>();
  CLI::App* command = program.add(
      "repair", "Add the missing index and footer to the log of a killed run; leave out what cannot be read",
      "  multipanda repair runs/20260102_120000_two_arms/log.mcap");
  option(command, "log", *path, "Log file or folder of its run", required, named("LOG"));
  program.on(command, [path] {
    const std::filesystem::path log = find_log(*path);
    const RepairResult result = repair_log(log);
    if (result.was_complete) {
      fmt::print("{}: complete, {} messages; nothing changed\n", log.string(), result.messages);
    } else {
      fmt::print("{}: repaired, {} messages; {} unreadable chunks and {} bytes at the end were dropped\n",
                 log.string(), result.messages, result.chunks_dropped, result.bytes_dropped);
    }
    return kSuccess;
  });
}

}  // namespace multipanda::cli
