#include "logs/export.hpp"

#include <fstream>

#include <fmt/format.h>

#include "cli/program.hpp"
#include "cli/report.hpp"
#include "models/to_mjcf.hpp"
#include "models/to_urdf.hpp"

namespace multipanda::cli {
namespace {

struct ExportOptions {
  std::string what, out;
  double rotor_hidden = 0;
  bool csv = false, npz = false, urdf = false, mjcf = false, hand = false;
};

// Writes the model for other programs: MODEL.urdf, MODEL.xml in the folder `out`.
int export_model(const ExportOptions& options) {
  namespace fs = std::filesystem;
  const RobotDescription robot = load_robot(options.what);
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

int run(const ExportOptions& options) {
  namespace fs = std::filesystem;
  if (options.urdf || options.mjcf) return export_model(options);
  if (!options.csv && !options.npz) {
    throw UsageError("export: name a format: --csv or --npz for a log, --urdf or --mjcf for a model");
  }
  const fs::path log = find_log(options.what);
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
  CLI::App* command =
      program.add("export", "Export a log as CSV tables or numpy archive, or a robot model as URDF or MJCF",
                  "  multipanda export runs/20260102_120000_two_arms/log.mcap --csv --out tables\n"
                  "  multipanda export runs --npz                      of the newest run in runs\n"
                  "  multipanda export identified.yaml --urdf --mjcf --hand --out models");
  command
      ->add_option("what", options->what,
                   "Log file or folder of its run; with --urdf or --mjcf name or file of a model")
      ->required()
      ->type_name("LOG|MODEL");
  CLI::Option* csv = command->add_flag(
      "--csv", options->csv, "Write a table per topic into a folder (default: csv next to the log)");
  command->add_flag("--npz", options->npz, "Write one archive for numpy.load() (default: next to the log)")
      ->excludes(csv);
  CLI::Option* urdf =
      command->add_flag("--urdf", options->urdf, "Write the rigid bodies of the model as NAME.urdf");
  CLI::Option* mjcf = command->add_flag(
      "--mjcf", options->mjcf, "Write the model with motor inertia and viscous and dry friction as NAME.xml");
  for (CLI::Option* format : {urdf, mjcf}) format->excludes(csv)->excludes("--npz");
  command
      ->add_option(
          "--rotor-hidden", options->rotor_hidden,
          "With --mjcf: how much of the rotors' inertia is left out, as if a torque loop of the arm hid it, "
          "0 to 1; the rest becomes armature. Other programs have no such loop")
      ->check(CLI::Range(0.0, 1.0))
      ->needs(mjcf)
      ->capture_default_str();
  command->add_flag("--hand", options->hand, "Include the closed hand on the flange");
  command
      ->add_option("--out", options->out,
                   "Folder for --csv, --urdf and --mjcf, file for --npz (default: see the formats; models: "
                   "this folder)")
      ->type_name("PATH");
  program.on(command, [options] { return run(*options); });
}

}  // namespace multipanda::cli
