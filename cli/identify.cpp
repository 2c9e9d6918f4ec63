#include <algorithm>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <unistd.h>

#include <fmt/format.h>

#include "cli/measured_arguments.hpp"
#include "cli/program.hpp"
#include "models/write_robot.hpp"
#include "sysid/identification/identification_json.hpp"

// `multipanda identify` makes an arm's model from logs (docs/identification.md).
namespace multipanda::cli {
namespace {

namespace fs = std::filesystem;

struct IdentifyArguments {
  std::vector<std::string> logs;
  std::string robot = "fer", out, urdf, mjcf, report;
  MeasuredArguments measured;
  IdentifyOptions options;
  bool json = false;
};

void write_text(const std::string& file, const std::string& text) {
  if (fs::path(file).has_parent_path()) fs::create_directories(fs::path(file).parent_path());
  std::ofstream out(file);
  out << text;
  out.close();
  if (!out) throw std::runtime_error(file + " cannot be written");
}

void mount_all(IdentifyArguments& arguments, std::vector<MeasuredLog>& logs, const Console& console) {
  IdentifyOptions& options = arguments.options;
  const std::vector<Mounting> mountings = mount(logs, arguments.measured, !options.payload);
  const Mounting& mounting = mountings.front();
  options.hand = mounting.hand;
  options.tool = options.payload ? mounting.tool_without_load : mounting.tool;
  options.gravity_B = mounting.gravity_B;
  for (std::size_t i = 0; i < logs.size(); ++i) {
    if (mountings[i].base_told) console.line(fmt::format("{}: {}", logs[i].source, in_words(mountings[i])));
  }
  if (!mounting.told) return;
  console.line(fmt::format(
      "the log's scene: {}, {}", mounting.hand ? "with hand" : "without hand",
      options.tool ? fmt::format("tool of {:.3f} kg", options.tool->mass) : std::string("no tool")));
}

void say(const Identification& id, const Console& console) {
  for (const std::string& warning : id.warnings) console.line("warning: " + warning);
  console.line(fmt::format("chosen: {}", id.family));
  for (const FamilyScore& score : id.scores) {
    console.line(fmt::format("  {} {:<44} {:3} coefficients, cross-validation {:.4f} N m",
                             score.chosen ? '*' : ' ', score.name, score.coefficients, score.mean));
  }
  if (id.rmse_train.size() > 0) {
    console.line(fmt::format("first two thirds fitted: train {:.4f}, held out {:.4f} N m",
                             id.rmse_train.mean(), id.rmse_heldout.mean()));
  }
  if (id.rmse_expected.size() > 0) {
    console.line(
        fmt::format("expected on other motion within the same ranges: {:.4f} N m (RMSE at 10 Hz, mean "
                    "over joints)",
                    id.rmse_expected.mean()));
  }
  console.line(fmt::format(
      "all data: {:.4f} N m; bodies {}; condition number {:.1f} (scaled columns: {:.1f})", id.rmse_all.mean(),
      id.consistent ? "possible" : "NOT possible", id.linear.condition.raw, id.linear.condition.scaled));
  for (const ModelBeside& model : id.beside)
    console.line(fmt::format("  {:<44} {:.4f} N m", model.name, model.mean));
  if (id.payload) {
    const Vector3& c = id.payload->com;
    console.line(
        fmt::format("payload: {:.4f} +- {:.4f} kg, com ({:.4f}, {:.4f}, {:.4f}) +- {:.4f} m in the flange",
                    id.payload->mass, id.payload_mass_half95, c.x(), c.y(), c.z(), id.payload_com_half95));
  }
}

// Throws before the fit, which takes seconds, if a result could not be written. Creates the folders.
void check_outputs(const IdentifyArguments& arguments) {
  for (const std::string& file : {arguments.out, arguments.urdf, arguments.mjcf}) {
    if (file.empty()) continue;
    const fs::path folder = fs::absolute(file).parent_path();
    std::error_code error;
    fs::create_directories(folder, error);
    if (error || fs::is_directory(file, error) || access(folder.c_str(), W_OK) != 0 ||
        (fs::exists(file, error) && access(file.c_str(), W_OK) != 0)) {
      throw UsageError(
          fmt::format("identify: {} cannot be written; choose another file or make it writable", file));
    }
  }
  if (arguments.report.empty()) return;
  std::error_code error;
  fs::create_directories(arguments.report, error);
  if (error || access(arguments.report.c_str(), W_OK) != 0)
    throw UsageError(
        fmt::format("identify: the folder {} is not writable; choose another one", arguments.report));
}

int run(IdentifyArguments& arguments) {
  const Console console(arguments.json);
  check_outputs(arguments);
  const RobotDescription prior = load_robot(arguments.robot);
  std::vector<MeasuredLog> logs;
  for (const std::string& given : arguments.logs)
    std::ranges::move(read_one_arm(given, arguments.measured), std::back_inserter(logs));
  mount_all(arguments, logs, console);
  Identification id = identify(logs, prior, arguments.options);
  for (const MeasuredLog& log : logs) {
    id.warnings.insert(id.warnings.begin(), log.warnings.begin(), log.warnings.end());
  }
  say(id, console);
  if (!arguments.out.empty()) {
    if (fs::path(arguments.out).has_parent_path())
      fs::create_directories(fs::path(arguments.out).parent_path());
    RobotDescription& robot = id.robot;
    robot.name = fs::path(arguments.out).stem().string();
    robot.title = prior.title + ", identified";
    write_robot(robot, prior, arguments.out);
    console.line("model: " + arguments.out);
  }
  if (!arguments.urdf.empty())
    write_text(arguments.urdf, to_urdf(id.robot, {.hand = arguments.options.hand}));
  if (!arguments.mjcf.empty())
    write_text(arguments.mjcf, to_mjcf(id.robot, {.hand = arguments.options.hand}));
  if (!arguments.report.empty()) {
    write_identification_page(id, arguments.report);
    console.line("page: " + (fs::path(arguments.report) / "identification.html").string());
  }
  if (arguments.json) fmt::print("{}\n", to_json(id).dump());
  return id.consistent ? kSuccess : kFailed;
}

}  // namespace

void add_identify(Program& program) {
  auto arguments = std::make_shared<IdentifyArguments>();
  CLI::App* command =
      program.add("identify",
                  "Identify the inertial and friction parameters of an arm from logs of its motion, and "
                  "write a model file",
                  "  multipanda identify measured.csv --robot fer --out my/panda.yaml\n"
                  "  multipanda identify runs/excitation --robot fer --out my/panda.yaml --report my/page\n"
                  "  multipanda identify runs/with_tool --robot my/panda.yaml --payload --json\n"
                  "  multipanda identify floor.csv wall.csv --base wall.csv=0,1.5708,0 --out my/panda.yaml\n"
                  "  multipanda predict other.csv --model my/panda.yaml --model fer");
  option(command, "logs", arguments->logs, "CSV files, logs, or folders of runs, used as one set of data",
         required, named("LOG"));
  option(command, "--robot", arguments->robot, "Known model of the arm: name or path of a model file", shown);
  command->add_flag("--payload", arguments->options.payload,
                    "Identify only a body on the flange; the arm itself is taken from the known model");
  add_measured_arguments(command, arguments->measured);
  option(command, "--family", arguments->options.families,
         "Candidate family to try; may be repeated (default: all)");
  option(command, "--out", arguments->out, "Model file to write, for scenes, controllers and virtual arms");
  option(command, "--urdf", arguments->urdf, "URDF file to write (rigid bodies only)");
  option(command, "--mjcf", arguments->mjcf, "MJCF file to write (rigid bodies only)");
  option(command, "--report", arguments->report, "Folder for a page with plots", named("DIR"));
  json_flag(command, arguments->json);
  program.on(command, [arguments] { return run(*arguments); });
}

}  // namespace multipanda::cli
