#include <fmt/format.h>

#include "cli/console.hpp"
#include "cli/measured_arguments.hpp"
#include "cli/program.hpp"
#include "sysid/identification/identification_json.hpp"
#include "sysid/identification/misfit.hpp"

// `multipanda predict` compares the torque that models predict for the motion of a log with the measured one.
namespace multipanda::cli {
namespace {

struct PredictArguments {
  std::string log;
  MeasuredArguments measured;
  std::vector<std::string> models;
  PredictOptions options;
  bool json = false;
};

int run(PredictArguments& arguments) {
  const Console console(arguments.json);
  std::vector<MeasuredLog> logs = read_one_arm(arguments.log, arguments.measured);
  if (logs.size() != 1) {
    throw UsageError(
        fmt::format("predict: {} has {} runs; name the folder of one run", arguments.log, logs.size()));
  }
  const Mounting mounting = mount(logs, arguments.measured, true).front();
  PredictOptions& options = arguments.options;
  options.hand = mounting.hand;
  options.tool = mounting.tool;
  options.gravity_B = mounting.gravity_B;
  for (const std::string& warning : logs.front().warnings) console.line("warning: " + warning);

  nlohmann::ordered_json figures;
  for (const std::string& name : arguments.models) {
    const RobotDescription robot = load_robot(name);
    const Prediction prediction = predict(logs.front(), robot, options);
    if (const auto found = misfit(logs.front(), robot, options); !found.empty())
      console.line("warning: " + found);
    if (const auto left = outside_range(logs.front(), robot); !left.empty()) console.line("warning: " + left);
    std::string joints;
    for (const double value : prediction.rmse) joints += fmt::format(" {:7.4f}", value);
    console.line(fmt::format("{:<24} mean {:.4f} N m, joints{}, unfiltered {:.4f}", name,
                             prediction.rmse_mean, joints, prediction.rmse_unfiltered.mean()));
    nlohmann::ordered_json entry = to_json(prediction);
    entry["model"] = name;
    if (figures.is_null()) {  // figures of the first model, for users of a single one
      figures = entry;
      figures["models"] = nlohmann::ordered_json::array();
    }
    figures["models"].push_back(entry);
  }
  if (arguments.json) fmt::print("{}\n", figures.dump());
  return kSuccess;
}

}  // namespace

void add_predict(Program& program) {
  auto arguments = std::make_shared<PredictArguments>();
  CLI::App* command = program.add(
      "predict", "Compare the torque that models predict for the motion of a log with the measured one",
      "  multipanda predict other.csv --model my/panda.yaml --json\n"
      "  multipanda predict other.csv --model my/panda.yaml --model fer");
  command->add_option("log", arguments->log, "CSV file, log, or folder of a run")
      ->required()
      ->type_name("LOG");
  command
      ->add_option("--model", arguments->models,
                   "Name or path of a model file; may be repeated to compare models")
      ->required();
  add_measured_arguments(command, arguments->measured);
  command->add_flag("--motor-friction", arguments->options.motor_friction,
                    "Add the motors' friction table to the predicted torque");
  command->add_flag("--json", arguments->json, "Print all figures as one JSON object to standard output");
  program.on(command, [arguments] { return run(*arguments); });
}

}  // namespace multipanda::cli
