#include <fmt/format.h>

#include "analysis/identification/identification_json.hpp"
#include "analysis/identification/mounting.hpp"
#include "cli/console.hpp"
#include "cli/program.hpp"

// `multipanda predict`: torque that models expect of a log's motion, beside what was measured.
namespace multipanda::cli {
namespace {

struct PredictWords {
  std::string log, arm, columns;
  std::vector<std::string> models;
  std::vector<double> tool;
  PredictOptions options;
  bool hand = false, no_hand = false, json = false;
};

int run(PredictWords& words) {
  const Console console(words.json);
  MeasuredLogOptions reading;
  reading.arm = words.arm;
  if (!words.columns.empty()) reading.columns = read_column_map(words.columns);
  const std::vector<MeasuredLog> logs = read_measured(words.log, reading);
  if (logs.size() != 1) {
    throw UsageError(fmt::format("predict: {} holds {} arms: name one with --arm", words.log, logs.size()));
  }
  const Mounting mounting = mounting_of(logs.front());
  PredictOptions& options = words.options;
  if (mounting.told) {
    options.hand = mounting.hand;
    options.tool = mounting.tool;
    options.gravity_B = mounting.gravity_B;
  }
  if (words.hand) options.hand = true;
  if (words.no_hand) options.hand = false;
  if (!words.tool.empty()) {
    const double m = words.tool[0];
    options.tool =
        RigidBody{m, Vector3(words.tool[1], words.tool[2], words.tool[3]), 1e-4 * m * Matrix3::Identity()};
  }
  for (const std::string& warning : logs.front().warnings) console.line("warning: " + warning);

  nlohmann::ordered_json json;
  for (const std::string& name : words.models) {
    const Prediction prediction = predict(logs.front(), load_robot(name), options);
    std::string joints;
    for (const double value : prediction.rmse) joints += fmt::format(" {:7.4f}", value);
    console.line(fmt::format("{:<24} mean {:.4f} N m, joints{}, unfiltered {:.4f}", name,
                             prediction.rmse_mean, joints, prediction.rmse_unfiltered.mean()));
    nlohmann::ordered_json entry = to_json(prediction);
    entry["model"] = name;
    if (json.is_null()) {  // of the first model, where somebody wants one number
      json = entry;
      json["models"] = nlohmann::ordered_json::array();
    }
    json["models"].push_back(entry);
  }
  if (words.json) fmt::print("{}\n", json.dump());
  return kSuccess;
}

}  // namespace

void add_predict(Program& program) {
  auto words = std::make_shared<PredictWords>();
  CLI::App* command =
      program.add("predict", "Compares the torque that models expect of a log's motion with the measured one",
                  "  multipanda predict other.csv --model my/panda.yaml --json\n"
                  "  multipanda predict other.csv --model my/panda.yaml --model fer --model fer_maker");
  command->add_option("log", words->log, "CSV file, log, or folder of a run")->required()->type_name("LOG");
  command->add_option("--model", words->models, "Name or path of a model file; several times: side by side")
      ->required();
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
  command->add_flag("--motor-friction", words->options.motor_friction,
                    "The motors' friction table counts as if the torque sensor showed it");
  command->add_flag("--json", words->json, "All figures as one JSON object on standard output");
  program.on(command, [words] { return run(*words); });
}

}  // namespace multipanda::cli
