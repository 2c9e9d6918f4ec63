#include "experiments/kinds.hpp"

#include <algorithm>
#include <cstdlib>
#include <fstream>
#include <iterator>
#include <sstream>

#include "common/machine.hpp"
#include "common/text.hpp"
#include "report/page_script.hpp"

namespace multipanda {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

void run_page_script(const std::vector<std::string>& words) {
  PageScript("experiments/pages/main.py", "the experiment's page").run(words);
}

void write_json(const fs::path& file, const Json& json) {
  std::ofstream out(file, std::ios::trunc);
  out << json.dump(1, ' ', false, Json::error_handler_t::replace) << '\n';
  out.close();
  if (!out)
    throw std::runtime_error("cannot write " + file.string() +
                             "; check that the folder is writable and the disk has space");
}

std::vector<std::string> words(const std::string& text) {
  std::istringstream in(text);
  return {std::istream_iterator<std::string>(in), {}};
}

Json limits_json(const Experiment& experiment) {
  Json list = Json::array();
  for (const auto& limit : experiment.limits)
    list.push_back({{"metric", limit.metric},
                    {"at_most", limit.at_most},
                    {"at_least", limit.at_least},
                    {"variants", limit.variants}});
  return list;
}

}  // namespace

const std::vector<ExperimentKind>& experiment_kinds() {
  static const std::vector<ExperimentKind> kinds{
      {kTaskKind, "A scene, run in variants on several plants, with limits on its figures.",
       words("q_rmse_rad q_max_rad dq_rmse_rad_per_s dq_max_rad_per_s tau_rmse_nm tau_max_nm x_rmse_m "
             "x_max_m f_rmse_n f_max_n c_err_rmse_nm c_err_max_nm force_rmse_n force_max_n "
             "force_est_rmse_n force_low_n force_high_n force_settling_rmse_n impact_peak_n settling_s "
             "contact_s contact_to_window_s contact_lost_s path_rms_m path_max_m torque_rate_nm_per_s "
             "limiter_hits force_tank_min_j impedance_tank_min_j energy_gain_w stored_energy_max_j held "
             "slip_m tilt_rad lift_error_m force_difference_max_n loss_speed_m_per_s loss_travel_m"),
       run_task},
      {"performance", "Two arms under a motion generator: cycle time, command delay, load, switching.",
       words("control_ratio samples_missing delay_error_us delay_by_sequence_error_us torques_unmatched "
             "generator_lost switches_late switches_refused switches_missing bystander_different"),
       run_performance},
  };
  return kinds;
}

const ExperimentKind* find_kind(const std::string& name) {
  for (const auto& kind : experiment_kinds()) {
    if (kind.name == name) return &kind;
  }
  return nullptr;
}

std::vector<std::string> kind_names() { return names_in(experiment_kinds()); }

ExperimentResult run_experiment(const Experiment& experiment, const ExperimentOptions& options,
                                const ExperimentProgress& progress) {
  const ExperimentKind* kind = find_kind(experiment.kind);
  if (kind == nullptr)
    throw std::invalid_argument(experiment.name + ": unknown kind of experiment '" + experiment.kind + "'");
  return kind->run(experiment, options, progress);
}

Json describe(const Experiment& experiment) {
  Json plan{{"name", experiment.name},           {"kind", experiment.kind},
            {"title", experiment.title},         {"description", experiment.description},
            {"seed", experiment.seed},           {"plants", experiment.plants},
            {"measure", experiment.measure},     {"settings", experiment.settings},
            {"limits", limits_json(experiment)}, {"show", experiment.show},
            {"machine", describe_machine()}};
  plan["variants"] = Json::array();
  for (const auto& variant : experiment.variants) {
    Json set = Json::object();
    for (const auto& change : variant.set) set[change.key] = change.value;
    plan["variants"].push_back({{"name", variant.name},
                                {"label", variant.label},
                                {"tags", variant.tags},
                                {"reported", variant.reported},
                                {"set", set}});
  }
  plan["vary"] = Json::array();
  for (const auto& change : experiment.vary) plan["vary"].push_back({{"key", change.key}, {"by", change.by}});
  plan["set"] = Json::object();
  for (const auto& change : experiment.set) plan["set"][change.key] = change.value;
  plan["published"] = Json::array();
  for (const auto& figure : experiment.published)
    plan["published"].push_back({{"metric", figure.metric}, {"value", figure.value}, {"text", figure.text}});
  return plan;
}

ExperimentResult evaluate(const Experiment& experiment, const Json& plan, const ExperimentOptions& options) {
  const fs::path plan_file = options.directory / "plan.json",
                 results_file = options.directory / "results.json";
  write_json(plan_file, plan);
  run_page_script({plan_file.string()});
  std::ifstream in(results_file);
  ExperimentResult result{.name = experiment.name, .results = Json::parse(in, nullptr, false)};
  if (result.results.is_discarded())
    throw std::runtime_error("the page's script did not write a valid " + results_file.string());
  result.page = options.directory / "report.html";
  result.passed = result.results.value("passed", false);
  for (const auto& problem : result.results.value("problems", Json::array()))
    result.problems.push_back(problem.get<std::string>());
  result.results["report"] = result.page.string();
  return result;
}

fs::path make_index(const std::vector<ExperimentResult>& results, const fs::path& directory) {
  Json list = Json::array();
  for (const auto& result : results)
    list.push_back({{"name", result.name},
                    {"passed", result.passed},
                    {"page", fs::relative(result.page, directory).string()}});
  const fs::path file = directory / "index.json";
  write_json(file, list);
  run_page_script({"--index", file.string()});
  return directory / "index.html";
}

}  // namespace multipanda
