#include <cmath>
#include <filesystem>
#include <fstream>

#include <fmt/format.h>

#include "analysis/identification/identification_json.hpp"
#include "analysis/identification/mounting.hpp"
#include "cli/console.hpp"
#include "cli/program.hpp"
#include "models/to_mjcf.hpp"
#include "models/to_urdf.hpp"
#include "models/write_robot.hpp"

// `multipanda identify`: from logs to the model of an arm (docs/identification.md).
namespace multipanda::cli {
namespace {

namespace fs = std::filesystem;

struct IdentifyWords {
  std::vector<std::string> logs;
  std::string robot = "fer", arm, columns, out, urdf, mjcf, report;
  std::vector<double> tool;
  IdentifyOptions options;
  bool hand = false, no_hand = false, json = false;
};

void write_text(const std::string& file, const std::string& text) {
  if (fs::path(file).has_parent_path()) fs::create_directories(fs::path(file).parent_path());
  std::ofstream out(file);
  out << text;
  out.close();
  if (!out) throw std::runtime_error(file + " cannot be written");
}

// What hangs on the arm: as the words say, else as the log's scene says, else nothing.
void mount(IdentifyWords& words, const std::vector<MeasuredLog>& logs, const Console& console) {
  const Mounting mounting = mounting_of(logs.front());
  if (mounting.told) {
    words.options.hand = mounting.hand;
    words.options.tool = words.options.payload ? mounting.tool_without_load : mounting.tool;
    words.options.gravity_B = mounting.gravity_B;
    console.line(fmt::format("the log's scene: {}, {}", mounting.hand ? "with hand" : "without hand",
                             words.options.tool ? fmt::format("tool of {:.3f} kg", words.options.tool->mass)
                                                : std::string("no tool")));
  }
  if (words.hand) words.options.hand = true;
  if (words.no_hand) words.options.hand = false;
  if (!words.tool.empty()) {
    const double m = words.tool[0];
    words.options.tool =
        RigidBody{m, Vector3(words.tool[1], words.tool[2], words.tool[3]), 1e-4 * m * Matrix3::Identity()};
  }
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
  console.line(
      fmt::format("all data: {:.4f} N m; bodies {}; condition number {:.1f} (columns of one length: {:.1f})",
                  id.rmse_all.mean(), id.consistent ? "possible" : "NOT possible", id.linear.condition.raw,
                  id.linear.condition.scaled));
  for (const ModelBeside& model : id.beside)
    console.line(fmt::format("  {:<44} {:.4f} N m", model.name, model.mean));
  if (id.payload) {
    const Vector3& c = id.payload->com;
    console.line(
        fmt::format("payload: {:.4f} +- {:.4f} kg, com ({:.4f}, {:.4f}, {:.4f}) +- {:.4f} m in the flange",
                    id.payload->mass, id.payload_mass_half95, c.x(), c.y(), c.z(), id.payload_com_half95));
  }
}

int run(IdentifyWords& words) {
  const Console console(words.json);
  const RobotDescription prior = load_robot(words.robot);
  MeasuredLogOptions reading;
  reading.arm = words.arm;
  if (!words.columns.empty()) reading.columns = read_column_map(words.columns);
  std::vector<MeasuredLog> logs;
  for (const std::string& given : words.logs) {
    for (const fs::path& path : find_repeats(given)) {
      std::vector<MeasuredLog> read = read_measured(path, reading);
      if (read.size() != 1) {
        throw UsageError(
            fmt::format("identify: {} holds {} arms, one is identified at a time: name it with --arm",
                        path.string(), read.size()));
      }
      logs.push_back(std::move(read.front()));
    }
  }
  mount(words, logs, console);
  Identification id = identify(logs, prior, words.options);
  for (const MeasuredLog& log : logs) {
    id.warnings.insert(id.warnings.begin(), log.warnings.begin(), log.warnings.end());
  }
  say(id, console);
  if (!words.out.empty()) {
    if (fs::path(words.out).has_parent_path()) fs::create_directories(fs::path(words.out).parent_path());
    RobotDescription& robot = id.robot;
    robot.name = fs::path(words.out).stem().string();
    robot.title = prior.title + ", identified";
    write_robot(robot, prior, words.out);
    console.line("model: " + words.out);
  }
  if (!words.urdf.empty()) write_text(words.urdf, to_urdf(id.robot, {.hand = words.options.hand}));
  if (!words.mjcf.empty()) write_text(words.mjcf, to_mjcf(id.robot, {.hand = words.options.hand}));
  if (!words.report.empty()) {
    write_identification_page(id, words.report);
    console.line("page: " + (fs::path(words.report) / "identification.html").string());
  }
  if (words.json) fmt::print("{}\n", to_json(id).dump());
  return id.consistent ? kSuccess : kFailed;
}

}  // namespace

void add_identify(Program& program) {
  auto words = std::make_shared<IdentifyWords>();
  CLI::App* command = program.add(
      "identify",
      "Finds an arm's inertial and friction parameters from logs of its motion, and writes a model file",
      "  multipanda identify measured.csv --robot fer --out my/panda.yaml\n"
      "  multipanda identify runs/excitation --robot fer --out my/panda.yaml --report my/page\n"
      "  multipanda identify runs/with_tool --robot my/panda.yaml --payload --json\n"
      "  multipanda predict other.csv --model my/panda.yaml --model fer");
  command->add_option("logs", words->logs, "CSV files, logs, or folders of runs; together one set of data")
      ->required()
      ->type_name("LOG");
  command->add_option("--robot", words->robot, "What is known: name or path of a model file")
      ->capture_default_str();
  command->add_flag("--payload", words->options.payload,
                    "The arm is as known: only a body at its flange is sought");
  command->add_option("--arm", words->arm, "Of a log with several arms");
  command->add_option("--columns", words->columns, "Names of CSV columns: q1=joint_1,t=time or a YAML file");
  command->add_flag("--hand", words->hand,
                    "The hand is on the flange; default: as the log's scene says, else not");
  command->add_flag("--no-hand", words->no_hand, "It is not")->excludes("--hand");
  command
      ->add_option("--tool", words->tool,
                   "Known body on the flange [kg, m]; default: as the log's scene says")
      ->expected(4)
      ->type_name("MASS X Y Z");
  command->add_option("--family", words->options.families, "Only these candidates; several times");
  command->add_option("--out", words->out, "Model file to write, for scenes, controllers, virtual arms");
  command->add_option("--urdf", words->urdf, "The same arm as URDF (rigid bodies only)");
  command->add_option("--mjcf", words->mjcf, "The same arm as MJCF (rigid bodies only)");
  command->add_option("--report", words->report, "Folder for a page with plots")->type_name("DIR");
  command->add_flag("--json", words->json, "All figures as one JSON object on standard output");
  program.on(command, [words] { return run(*words); });
}

}  // namespace multipanda::cli
