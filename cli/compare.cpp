#include "sysid/comparison/compare.hpp"

#include <algorithm>
#include <set>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "cli/program.hpp"
#include "logs/recorder.hpp"

namespace multipanda::cli {
namespace {

namespace fs = std::filesystem;

struct CompareArguments {
  std::string real, sim, arm, columns, gate, out;
  std::vector<double> window;
  std::optional<double> lag;
  bool by_correlation = false;
  double max_lag = 1.0, low_pass = 0;
  bool json = false;
};

using ByArm = std::map<std::string, std::vector<MeasuredLog>>;  // all repeats of each arm

// All repeats in a path. The column map applies to CSV files only.
ByArm read_all(const fs::path& path, const CompareArguments& options) {
  ByArm logs;
  for (const fs::path& repeat : find_repeats(path)) {
    MeasuredLogOptions reading;
    reading.needs_dynamics = false;
    reading.arm = options.arm;
    if (repeat.extension() != ".mcap" && !fs::is_directory(repeat))
      reading.columns = read_column_map(options.columns);
    for (MeasuredLog& log : read_measured(repeat, reading)) logs[log.arm].push_back(std::move(log));
  }
  return logs;
}

std::string names_of(const ByArm& logs) {
  std::string names;
  for (const auto& [name, repeats] : logs)
    names += (names.empty() ? "" : ", ") + (name.empty() ? "an arm without a name" : name);
  return names;
}

// Gives the arms of both sides the same names. A log without names has a single arm.
std::vector<std::string> common_arms(ByArm& real, ByArm& sim) {
  const auto adopt = [](ByArm& nameless, const ByArm& named) {
    if (nameless.size() != 1 || !nameless.begin()->first.empty() || named.contains("")) return;
    if (named.size() != 1)
      throw UsageError(
          "compare: one side has several arms and the other has no names; name one with --arm (" +
          names_of(named) + ")");
    auto repeats = std::move(nameless.begin()->second);
    nameless.clear();
    for (MeasuredLog& log : repeats) log.arm = named.begin()->first;
    nameless[named.begin()->first] = std::move(repeats);
  };
  adopt(real, sim);
  adopt(sim, real);
  // One arm on each side: a bag of ROS names it by its joints, a scene as its user likes.
  if (real.size() == 1 && sim.size() == 1 && real.begin()->first != sim.begin()->first) {
    const bool of_scene = !real.begin()->second.front().scene_text.empty();
    ByArm &renamed = of_scene ? sim : real, &named = of_scene ? real : sim;
    auto arm = renamed.extract(renamed.begin());
    arm.key() = named.begin()->first;
    for (MeasuredLog& log : arm.mapped()) log.arm = arm.key();
    renamed.insert(std::move(arm));
  }
  std::vector<std::string> arms;
  for (const auto& [name, repeats] : real) {
    if (sim.contains(name)) arms.push_back(name);
  }
  if (arms.empty())
    throw UsageError(fmt::format("compare: the logs have no arm in common: real {}, simulated {}",
                                 names_of(real), names_of(sim)));
  return arms;
}

// Adds end-effector pose and gravity to logs without them, from joint positions and the scene of the
// other log.
void complete(std::vector<MeasuredLog>& logs, const std::vector<MeasuredLog>& others) {
  for (MeasuredLog& log : logs) {
    if ((log.x_EE.rows() > 0 && log.gravity.rows() > 0) || others[0].scene_text.empty()) continue;
    if (log.base_moves) continue;  // a scene with fixed bases does not give its pose
    try {
      complete_from_scene(log, others[0].scene_text, others[0].scene_path, others[0].arm);
      log.warnings.emplace_back("x_EE and gravity are computed from its q and the scene of " +
                                others[0].source);
    } catch (const std::invalid_argument& error) {
      log.warnings.push_back(fmt::format("no x_EE, no gravity: {}", error.what()));
    }
  }
}

void print(const ComparedArm& arm, const Console& console) {
  const Comparison& c = arm.comparison;
  const Comparison::Pair* late = &c.pairs.front();
  for (const auto& pair : c.pairs) {
    if (std::abs(pair.measured_lag_s.value_or(0)) > std::abs(late->measured_lag_s.value_or(0))) late = &pair;
  }
  console.line(fmt::format("{}: {} repeat{}, lag {:.2f} ms by correlation, shifted by {:.2f} ms ({})",
                           c.arm.empty() ? "arm" : c.arm, c.pairs.size(), c.pairs.size() == 1 ? "" : "s",
                           1e3 * late->measured_lag_s.value_or(0), 1e3 * late->lag_s, late->aligned_by));
  console.line("            RMSE (mean)     spread    largest      noise      paper");
  for (const QuantityFigures& q : c.quantities) {
    if (!q.available()) {
      console.line(fmt::format("  {:<6} {:>12}: {}", q.name, "n/a", q.missing));
      continue;
    }
    const auto number = [](double value) { return fmt::format("{:.4g}", value); };
    console.line(fmt::format("  {:<6} {:>9} {:<5} {:>9}  {:>9}  {:>9}  {:>9}", q.name, number(q.mean()),
                             q.unit, c.pairs.size() > 1 ? number(q.spread()) : "-", number(q.largest()),
                             q.noise_floor() ? number(*q.noise_floor()) : "-",
                             q.paper > 0 ? number(q.paper) : "-"));
  }
  for (const GateResult& result : arm.gate) {
    if (!result.held) console.line("  limit exceeded: " + result.text);
  }
}

int run(const CompareArguments& options) {
  const Console console(options.json);
  CompareOptions compare_options;
  compare_options.low_pass_hz = options.low_pass;
  compare_options.max_lag_s = options.max_lag;
  compare_options.lag_s = options.lag;
  compare_options.trust_timeline = !options.by_correlation;
  if (!options.window.empty()) compare_options.window_s = {options.window[0], options.window[1]};
  const std::optional<Gate> gate =
      options.gate.empty() ? std::nullopt : std::optional(read_gate(options.gate));

  ByArm real = read_all(options.real, options), sim = read_all(options.sim, options);
  std::vector<ComparedArm> arms;
  std::set<std::string> warnings;
  for (const std::string& name : common_arms(real, sim)) {
    complete(real[name], sim[name]);
    complete(sim[name], real[name]);
    ComparedArm arm;
    arm.comparison = compare(real[name], sim[name], compare_options);
    arm.shown = align(real[name][0], sim[name][0], compare_options);
    if (gate) arm.gate = check_gate(*gate, arm.comparison);
    warnings.insert(arm.comparison.warnings.begin(), arm.comparison.warnings.end());
    arms.push_back(std::move(arm));
  }
  for (const auto& warning : warnings) console.line("warning: " + warning);
  for (const ComparedArm& arm : arms) print(arm, console);
  const auto results = comparison_results(options.real, options.sim, arms);
  const fs::path folder = options.out.empty() ? make_run_directory("runs", "compare") : fs::path(options.out);
  console.line("report: " + make_comparison_page(folder, results, arms).string());
  if (options.json)
    fmt::print("{}\n", results.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace));
  return results["passed"].get<bool>() ? kSuccess : kFailed;
}

}  // namespace

void add_compare(Program& program) {
  auto options = std::make_shared<CompareArguments>();
  CLI::App* command = program.add(
      "compare", "Compare a measured and a simulated task in every quantity",
      "  multipanda compare real.csv runs/20260102_120000_task_1\n"
      "  multipanda compare recorded/ simulated/ --gate limits.yaml     folders of repeats, for CI\n"
      "  multipanda compare real.csv sim.csv --columns 'q=pos_{},dq=vel_{},tau=effort_{},t=stamp_ms * "
      "0.001'\n"
      "Logs: of multipanda, of libfranka, CSV, NPZ, bags of ROS. Fails (exit code 1) if a limit of the gate "
      "is exceeded.");
  option(command, "real", options->real, "Measured data: a log, the folder of a run, or a folder of repeats",
         required, named("REAL"));
  option(command, "sim", options->sim, "Simulated data: a log, the folder of a run, or a folder of repeats",
         required, named("SIM"));
  option(command, "--arm", options->arm,
         "Arm to compare (default: all); also the name of the arm in a CSV file", named("NAME"));
  option(command, "--columns", options->columns, "Columns of a CSV file: FILE.yaml, or OURS=THEIRS,...",
         named("MAP"));
  option(command, "--window", options->window,
         "Time to compare, from the start of the real log [s] (default: all)", by_commas, expecting(2),
         named("FROM,TO"));
  option(command, "--lag", options->lag,
         "Lag of the simulation [s], 0 for the time stamps as they are (default: estimated)");
  command->add_flag("--align,--by-correlation", options->by_correlation,
                    "Shift by the estimated lag even if both logs follow the timeline of one scene");
  option(command, "--max-lag", options->max_lag, "Largest lag to search for [s]", within(0.0, 60.0), shown);
  option(command, "--low-pass", options->low_pass,
         "Cutoff frequency of a low-pass filter on both logs [Hz], 0 for none", within(0.0, 400.0));
  option(command, "--gate", options->gate, "YAML file with limits (docs/identification.md)", named("FILE"));
  option(command, "--out", options->out,
         "Folder for page, pictures and results.json (default: a new folder in runs)", named("DIR"));
  json_flag(command, options->json);
  program.on(command, [options] {
    try {
      return run(*options);
    } catch (const LogRefused& error) {
      throw UsageError(fmt::format("compare: {}", error.what()));
    }
  });
}

}  // namespace multipanda::cli
