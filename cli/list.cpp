#include <algorithm>
#include <cctype>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "cli/program.hpp"
#include "models/robot_description.hpp"
#include "scene/build.hpp"
#include "scene/fields.hpp"
#include "scene/load.hpp"
#include "scene/names.hpp"

namespace multipanda::cli {
namespace {

struct ListOptions {
  std::vector<std::string> plugins;
  std::string name;  // of `parameters`
};

Registry registry_of(const ListOptions& options) { return build_registry(options.plugins); }

int list_controllets(const ListOptions& options) {
  const Registry registry = registry_of(options);
  for (const auto& type : registry.controllets()) {
    const Statement& s = type.statement;
    fmt::print("{:<34} {} arm{}  {}\n", s.type, s.arms, s.arms == 1 ? " " : "s", s.doc);
  }
  return kSuccess;
}

int list_features(const ListOptions& options) {
  const Registry registry = registry_of(options);
  for (const auto& type : registry.features()) {
    fmt::print("{:<34} {}\n", type.statement.type, type.statement.doc);
  }
  return kSuccess;
}

int list_models() {
  for (const auto& name : available_robots()) {
    const RobotDescription robot = load_robot(name);
    fmt::print("{:<20} {} joints{}\n", name, robot.joint_count(), robot.hand ? ", hand" : "");
  }
  return kSuccess;
}

// What the file says of itself: the scene is read, and a scene that is refused is listed with the reason.
int list_scenes() {
  for (const auto& name : available_scenes()) {
    try {
      const OpenedScene opened = open_scene(name);
      std::vector<std::string> arms;
      for (const auto& arm : opened.scene.arms) arms.push_back(arm.name);
      fmt::print("{:<20} {} arm{}  {}\n", name, arms.size(), arms.size() == 1 ? " " : "s",
                 opened.scene.description);
    } catch (const std::exception& error) {
      fmt::print("{:<20} refused: {}\n", name, error.what());
    }
  }
  return kSuccess;
}

std::string values_text(const ParameterSpec& spec) {
  if (!spec.choices.empty()) return spec.choices.at(static_cast<std::size_t>(spec.initial.at(0)));
  const bool equal =
      std::all_of(spec.initial.begin(), spec.initial.end(), [&](double v) { return v == spec.initial[0]; });
  if (equal && !spec.initial.empty()) return number_text(spec.initial[0]);
  return fmt::format("[{}]", fmt::join(spec.initial, ", "));
}

std::string range_text(const ParameterSpec& spec) {
  if (!spec.choices.empty()) return fmt::format("{}", fmt::join(spec.choices, " | "));
  return fmt::format("{} to {}{}", number_text(spec.min), number_text(spec.max),
                     spec.unit.empty() ? "" : " " + spec.unit);
}

void print_statement(const Statement& s) {
  fmt::print("{}: {}\n", s.type, s.doc);
  for (const auto& p : s.parameters) {
    const std::string size = p.size == ParameterSpec::kPerJoint ? "one per joint"
                             : p.size == 1                      ? ""
                                                                : fmt::format("{} numbers", p.size);
    fmt::print("  {}\n      {}; {}{}default {}\n", p.name, p.doc, fmt::format("{}; ", range_text(p)),
               size.empty() ? "" : size + "; ", values_text(p));
  }
  if (s.parameters.empty()) fmt::print("  no parameters\n");
  for (const auto& input : s.inputs) {
    fmt::print("  input {}: {} in {}; {}\n", input.name, to_string(input.quantity), input.frame, input.doc);
  }
}

int list_parameters(const ListOptions& options) {
  const Registry registry = registry_of(options);
  if (const ControlletType* type = registry.controllet(options.name)) {
    print_statement(type->statement);
    return kSuccess;
  }
  if (const FeatureType* type = registry.feature(options.name)) {
    print_statement(type->statement);
    return kSuccess;
  }
  std::vector<std::string> names;
  for (const auto& type : registry.controllets()) names.push_back(type.statement.type);
  for (const auto& type : registry.features()) names.push_back(type.statement.type);
  throw UsageError(fmt::format("list parameters: there is no controllet or feature '{}'{}", options.name,
                               name_hint(options.name, names, "there are none")));
}

}  // namespace

void add_list(Program& program) {
  auto options = std::make_shared<ListOptions>();
  CLI::App* command =
      program.add("list", "Lists what there is: controllets, features, models, scenes, parameters",
                  "  multipanda list controllets\n"
                  "  multipanda list parameters cartesian_impedance");
  command->require_subcommand(1);
  const auto add = [&](const std::string& word, const std::string& what) {
    CLI::App* child = command->add_subcommand(word, what);
    if (word != "models" && word != "scenes") {
      child->add_option("--plugin", options->plugins, "Library with more controllets")
          ->type_name("FILE")
          ->check(CLI::ExistingFile);
    }
    return child;
  };
  program.on(add("controllets", "Control laws that a scene can name"),
             [options] { return list_controllets(*options); });
  program.on(add("features", "What can be added to any controllet"),
             [options] { return list_features(*options); });
  program.on(add("models", "Robot models"), [] { return list_models(); });
  program.on(add("scenes", "Scenes that can be named without a path"), [] { return list_scenes(); });
  CLI::App* parameters = add("parameters", "Parameters and inputs of a controllet or feature");
  parameters->add_option("name", options->name, "Type, as listed by list controllets or features")
      ->required();
  program.on(parameters, [options] { return list_parameters(*options); });
}

}  // namespace multipanda::cli
