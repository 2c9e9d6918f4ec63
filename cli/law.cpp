#include <algorithm>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "cli/program.hpp"
#include "core/plugin/law_trial.hpp"
#include "scene/build.hpp"
#include "scene/load.hpp"

// Tests a law on random states before it moves an arm (core/plugin/law_trial.hpp).
namespace multipanda::cli {
namespace {

struct LawArguments {
  std::string library, type, model = "fer";
  LawTrialOptions trial;
  std::size_t samples = 0;
  bool json = false;
};

// All types added by the library, or the named one.
std::vector<ControlletType> chosen_types(const LawArguments& arguments) {
  const std::size_t own = Registry::with_builtins().controllets().size();
  const Registry registry =
      build_registry(arguments.library.empty() ? std::vector<std::string>{} : std::vector{arguments.library});
  if (!arguments.type.empty()) {
    const ControlletType* type = registry.controllet(arguments.type);
    if (type == nullptr) throw UsageError("law: there is no controllet type '" + arguments.type + "'");
    return {*type};
  }
  if (arguments.library.empty()) throw UsageError("law: expected a library, or --type NAME");
  const auto& all = registry.controllets();
  std::vector<ControlletType> types(all.begin() + static_cast<std::ptrdiff_t>(own), all.end());
  if (types.empty()) throw UsageError("law: " + arguments.library + " adds no controllet");
  return types;
}

std::shared_ptr<const ArmModel> model_named(const std::string& name) {
  const std::string text = fmt::format("arms: [{{name: arm, model: {}}}]\n", name);
  return build_controller_model(parse_scene(text, "law: --model", Registry()).arms.at(0));
}

template <typename Vector>
nlohmann::ordered_json numbers(const Vector& vector) {
  return std::vector<double>(vector.data(), vector.data() + vector.size());
}

nlohmann::ordered_json rows(const Eigen::Ref<const Eigen::MatrixXd>& matrix) {
  nlohmann::ordered_json rows = nlohmann::ordered_json::array();
  for (Eigen::Index i = 0; i < matrix.rows(); ++i) rows.push_back(numbers(Eigen::VectorXd(matrix.row(i))));
  return rows;
}

nlohmann::ordered_json arm_of(const OwnedArm& arm) {
  ModelTerms& terms = *arm.terms;
  return {{"q", numbers(arm.q())},
          {"dq", numbers(arm.dq())},
          {"tau_J", numbers(arm.state->tau_J)},
          {"tau_ext_hat", numbers(arm.state->tau_ext_hat)},
          {"F_K_W_est", numbers(arm.state->F_K_W_est.vector)},
          {"p_WE", numbers(terms.X_WE().position)},
          {"R_WE", rows(terms.X_WE().rotation)},
          {"V_WE", numbers(terms.V_WE().vector)},
          {"J_V_WE", rows(terms.J_V_WE())},
          {"M", rows(terms.M())},
          {"c", numbers(terms.c())},
          {"g", numbers(terms.g())},
          {"tau", numbers(*arm.tau)}};
}

nlohmann::ordered_json input_of(const Reference& input) {
  switch (input.spec().quantity) {
    case Quantity::pose:
      return {{"p", numbers(input.pose().position)},
              {"R", rows(input.pose().rotation)},
              {"V", numbers(input.twist().vector)},
              {"A", numbers(input.acceleration().vector)}};
    case Quantity::joints:
      return {{"q", numbers(input.joints())},
              {"dq", numbers(input.joint_velocity())},
              {"ddq", numbers(input.joint_acceleration())}};
    case Quantity::scalar:
      return input.scalar();
    default:
      return numbers(input.vector());
  }
}

// Non-finite numbers become null, which JSON supports.
nlohmann::ordered_json sample_of(const LawTrialState& state) {
  nlohmann::ordered_json sample = {
      {"state", state.number}, {"started", state.started}, {"ok", state.result == LawResult::ok}};
  sample["dt"] = state.context.dt;
  sample["time_s"] = state.context.time_s;
  for (const auto& arm : state.context.arms) sample["arms"].push_back(arm_of(arm));
  sample["inputs"] = nlohmann::ordered_json::object();
  for (const auto& input : state.context.inputs) sample["inputs"][input.spec().name] = input_of(input);
  const ParameterSet& parameters = *state.context.parameters;
  sample["parameters"] = nlohmann::ordered_json::object();
  for (std::size_t i = 0; i < parameters.size(); ++i)
    sample["parameters"][parameters.spec(i).name] =
        std::vector<double>(parameters.values(i).begin(), parameters.values(i).end());
  sample["outputs"] = std::vector<double>(state.context.outputs.begin(), state.context.outputs.end());
  return sample;
}

int run(const LawArguments& arguments) {
  const Console console(arguments.json);
  const auto model = model_named(arguments.model);
  nlohmann::ordered_json result = {
      {"success", true}, {"model", arguments.model}, {"most_us", arguments.trial.most_us}};
  result["laws"] = nlohmann::ordered_json::array();
  for (const auto& type : chosen_types(arguments)) {
    const std::vector<std::shared_ptr<const ArmModel>> models(type.descriptor.arms, model);
    nlohmann::ordered_json samples = nlohmann::ordered_json::array(), fault;
    const LawTrial trial = try_law(type, models, arguments.trial, [&](const LawTrialState& state) {
      if (state.number < arguments.samples) samples.push_back(sample_of(state));
      if (state.result != LawResult::ok && fault.is_null()) fault = sample_of(state);
    });
    const bool fits = trial.faults == 0 && trial.p999_us <= arguments.trial.most_us;
    if (!fits) result["success"] = false;
    console.line(
        fmt::format("{}: {} states, {} faults; processor time of a tick: median {:.2f} us, 99.9 % "
                    "{:.2f} us, worst {:.2f} us (at most {:g} us at 99.9 %): {}",
                    type.descriptor.type, trial.states, trial.faults, trial.median_us, trial.p999_us,
                    trial.worst_us, arguments.trial.most_us, fits ? "ok" : "refused"));
    if (trial.faults > 0 && trial.first_fault < trial.states)
      console.line(fmt::format("  the first fault: state {}{}", trial.first_fault,
                               fault.is_null() ? "" : ", " + fault.dump()));
    nlohmann::ordered_json entry = {{"type", type.descriptor.type}, {"states", trial.states},
                                    {"faults", trial.faults},       {"median_us", trial.median_us},
                                    {"p999_us", trial.p999_us},     {"worst_us", trial.worst_us}};
    entry["first_fault"] = fault;
    if (arguments.samples > 0) entry["samples"] = samples;
    result["laws"].push_back(entry);
  }
  if (arguments.json) fmt::print("{}\n", result.dump());
  return result["success"].get<bool>() ? kSuccess : kFailed;
}

}  // namespace

void add_law(Program& program) {
  auto arguments = std::make_shared<LawArguments>();
  CLI::App* command =
      program.add("law", "Try a controllet on random states: finite torques, and processor time of a tick",
                  "  multipanda law my_law.so                          the laws of a library\n"
                  "  multipanda law --type joint_impedance             one of multipanda's own\n"
                  "  multipanda law my_law.so --model fr3 --json --samples 10\n"
                  "Fails (exit code 1) on a fault, or above --most-us.");
  option(command, "library", arguments->library, "Library of a controllet, as a scene names it in plugins");
  option(command, "--type", arguments->type, "One type only, which may be built in");
  option(command, "--model", arguments->model, "Robot model of every arm (default fer)");
  option(command, "--states", arguments->trial.states, "Number of random states (default 10000)",
         within(1, 10000000));
  option(command, "--seed", arguments->trial.seed, "Seed of the states (default 1)");
  option(command, "--repeats", arguments->trial.repeats,
         "Ticks on each state; the shortest counts (default 3)", within(1, 1000));
  option(command, "--most-us", arguments->trial.most_us,
         "Largest processor time of a tick at 99.9 % [us] (default 100)", within(0.001, 1e6));
  option(command, "--samples", arguments->samples,
         "With --json: the first N states with torques (default 0)");
  json_flag(command, arguments->json);
  program.on(command, [arguments] { return run(*arguments); });
}

}  // namespace multipanda::cli
