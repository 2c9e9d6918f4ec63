#include "sysid/identification/predict.hpp"

#include <fstream>

#include <fmt/format.h>

#include "cli/measured_arguments.hpp"
#include "cli/program.hpp"
#include "core/types/statistics.hpp"
#include "sysid/identification/identification_json.hpp"

// `multipanda predict` compares the torque that models predict for the motion of a log with the measured one;
// `multipanda observe` shows how much of the measured one is external.
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
    const bool promised = robot.identified_range && robot.identified_range->rmse.size() > 0;
    const double expected = promised ? robot.identified_range->rmse.mean() : 0;
    console.line(fmt::format("{:<24} mean {:.4f} N m{}, joints{}, unfiltered {:.4f}", name,
                             prediction.rmse_mean,
                             promised ? fmt::format(" (expected {:.4f})", expected) : "", joints,
                             prediction.rmse_unfiltered.mean()));
    nlohmann::ordered_json entry = to_json(prediction);
    entry["model"] = name;
    if (promised) entry["rmse_expected"] = expected;
    if (figures.is_null()) {  // figures of the first model, for users of a single one
      figures = entry;
      figures["models"] = nlohmann::ordered_json::array();
    }
    figures["models"].push_back(entry);
  }
  if (arguments.json) fmt::print("{}\n", figures.dump());
  return kSuccess;
}

struct ObserveArguments {
  std::vector<std::string> logs;
  MeasuredArguments measured;
  std::string model = "fer", out;
  TouchOptions options;
  bool json = false;
};

// What was found in all logs together, as one line and as JSON.
nlohmann::ordered_json say(const char* what, std::vector<Touches> found, const TouchOptions& options,
                           const Console& console) {
  JudgedTouches all;
  std::vector<double> starts;
  for (const Touches& one : found) {
    starts.insert(starts.end(), one.starts.begin(), one.starts.end());
    if (!one.judged) continue;
    all.touches += one.judged->touches, all.missed += one.judged->missed;
    all.false_alarms += one.judged->false_alarms;
    all.quiet = std::max(all.quiet, one.judged->quiet);
    all.delays.insert(all.delays.end(), one.judged->delays.begin(), one.judged->delays.end());
  }
  nlohmann::ordered_json out{{"threshold_nm", options.threshold}, {"starts_s", starts}};
  std::string line = fmt::format("{:<24} {} touches above {} N m", what, starts.size(), options.threshold);
  if (all.touches > 0) {
    const double delay = all.delays.empty() ? 0 : median(all.delays);
    line += fmt::format(
        "; of {} labeled {} missed, {} false, median delay {:.0f} ms; no false one above {:.2f} N m",
        all.touches, all.missed, all.false_alarms, 1e3 * delay, all.quiet);
    out["labeled"] = all.touches;
    out["missed"] = all.missed;
    out["false_alarms"] = all.false_alarms;
    out["median_delay_s"] = delay;
    out["quiet_nm"] = all.quiet;
  }
  console.line(line);
  return out;
}

int run(ObserveArguments& arguments) {
  const Console console(arguments.json);
  std::vector<MeasuredLog> logs;
  for (const std::string& given : arguments.logs)
    std::ranges::move(read_one_arm(given, arguments.measured), std::back_inserter(logs));
  const Mounting mounting = mount(logs, arguments.measured, true).front();
  const RobotDescription robot = load_robot(arguments.model);
  const PredictOptions equipment{
      .hand = mounting.hand, .tool = mounting.tool, .gravity_B = mounting.gravity_B};
  TouchOptions plain = arguments.options;  // the arm filters its own estimates
  plain.stage_hz = 0;
  std::vector<Touches> ours, theirs;
  std::ofstream table;
  if (!arguments.out.empty()) {
    if (logs.size() > 1) throw UsageError("observe: --out takes the torques of one log");
    table.open(arguments.out);
  }
  for (const MeasuredLog& log : logs) {
    for (const std::string& warning : log.warnings) console.line("warning: " + warning);
    const Eigen::MatrixXd tau_ext = observed_torque(log, robot, equipment);
    ours.push_back(find_touches(log, tau_ext, arguments.options));
    if (log.tau_ext.rows() > 0) theirs.push_back(find_touches(log, log.tau_ext, plain));
    if (!table.is_open()) continue;
    table << "t";
    for (Eigen::Index j = 1; j <= log.joints(); ++j) table << ",tau_ext" << j;
    for (Eigen::Index k = 0; k < log.samples(); ++k) {
      table << fmt::format("\n{:.9g}", log.t[k]);
      for (const double value : tau_ext.row(k)) table << fmt::format(",{:.6g}", value);
    }
    table << '\n';
  }
  if (!arguments.out.empty() && !table.flush())
    throw std::runtime_error(arguments.out + " cannot be written");
  nlohmann::ordered_json figures{{"observer", say("observer", ours, arguments.options, console)}};
  if (!theirs.empty()) figures["arm"] = say("the arm's own estimate", theirs, plain, console);
  if (arguments.json) fmt::print("{}\n", figures.dump());
  return kSuccess;
}

}  // namespace

void add_observe(Program& program) {
  auto arguments = std::make_shared<ObserveArguments>();
  CLI::App* command = program.add(
      "observe", "Estimate the external torques of a log by the momentum observer, and find touches",
      "  multipanda observe touched.csv --model fer --hand --out external.csv\n"
      "A column `contact` (0 or 1) labels the touches that should be found.");
  option(command, "logs", arguments->logs, "Logs, or folders of runs, of an arm that holds its pose",
         required, named("LOG"));
  option(command, "--model", arguments->model, "Name or path of a model file", shown);
  add_measured_arguments(command, arguments->measured);
  option(command, "--threshold", arguments->options.threshold, "Quick change that counts as a touch [N m]",
         positive, shown);
  option(command, "--stage", arguments->options.stage_hz, "Low-pass behind the observer [Hz], 0 for none")
      ->check(CLI::NonNegativeNumber)
      ->capture_default_str();
  option(command, "--out", arguments->out, "CSV file to write: time and external torques");
  json_flag(command, arguments->json);
  program.on(command, [arguments] { return run(*arguments); });
}

void add_predict(Program& program) {
  auto arguments = std::make_shared<PredictArguments>();
  CLI::App* command = program.add(
      "predict", "Compare the torque that models predict for the motion of a log with the measured one",
      "  multipanda predict other.csv --model my/panda.yaml --json\n"
      "  multipanda predict other.csv --model my/panda.yaml --model fer");
  option(command, "log", arguments->log, "CSV file, log, or folder of a run", required, named("LOG"));
  option(command, "--model", arguments->models,
         "Name or path of a model file; may be repeated to compare models", required);
  add_measured_arguments(command, arguments->measured);
  command->add_flag("--motor-friction", arguments->options.motor_friction,
                    "Add the motors' friction table to the predicted torque");
  json_flag(command, arguments->json);
  program.on(command, [arguments] { return run(*arguments); });
}

}  // namespace multipanda::cli
