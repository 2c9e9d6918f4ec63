#include <algorithm>
#include <cctype>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "cli/program.hpp"
#include "common/text.hpp"
#include "models/robot_description.hpp"
#include "scene/build.hpp"
#include "scene/load.hpp"

namespace multipanda::cli {

namespace {

struct ListOptions {
  std::vector<std::string> plugins;
  std::string scene;  // whose plug-ins are loaded
  std::string name;   // of `parameters`
};

Registry registry_of(const ListOptions& options) {
  return options.scene.empty() ? build_registry(options.plugins) : open_scene(options.scene).registry;
}

int list_controllets(const ListOptions& options) {
  const Registry registry = registry_of(options);
  for (const auto& type : registry.controllets()) {
    const ControlletDescriptor& s = type.descriptor;
    fmt::print("{:<34} {} arm{}  {}\n", s.type, s.arms, s.arms == 1 ? " " : "s", s.doc);
  }
  return kSuccess;
}

int list_features(const ListOptions& options) {
  const Registry registry = registry_of(options);
  for (const auto& type : registry.features()) {
    fmt::print("{:<34} {}\n", type.descriptor.type, type.descriptor.doc);
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

// A refused scene is listed with the reason.
int list_scenes() {
  for (const auto& name : available_scenes()) {
    try {
      const OpenedScene opened = open_scene(name);
      const std::size_t arms = opened.scene.arms.size();
      fmt::print("{:<20} {} arm{}  {}\n", name, arms, arms == 1 ? " " : "s", opened.scene.description);
    } catch (const std::exception& error) {
      fmt::print("{:<20} refused: {}\n", name, error.what());
    }
  }
  return kSuccess;
}

std::string values_text(const ParameterSpec& spec, std::size_t joint_count) {
  if (!spec.choices.empty()) return spec.choices.at(static_cast<std::size_t>(spec.initial.at(0)));
  std::vector<double> values = spec.initial;
  if (spec.size == ParameterSpec::kPerJoint && values.size() > joint_count) values.resize(joint_count);
  if (!values.empty() && std::all_of(values.begin(), values.end(), [&](double v) { return v == values[0]; }))
    return number_text(values[0]);
  return fmt::format("[{}]", fmt::join(values, ", "));
}

std::string range_text(const ParameterSpec& spec) {
  if (!spec.choices.empty()) return fmt::format("{}", fmt::join(spec.choices, " | "));
  return fmt::format("{} to {}{}", number_text(spec.min), number_text(spec.max),
                     spec.unit.empty() ? "" : " " + spec.unit);
}

void print_descriptor(const ControlletDescriptor& s, std::size_t joint_count) {
  fmt::print("{}: {}\n", s.type, s.doc);
  for (const auto& p : s.parameters) {
    const std::string size = p.size == ParameterSpec::kPerJoint ? "one per joint"
                             : p.size == 1                      ? ""
                                                                : fmt::format("{} numbers", p.size);
    fmt::print("  {}\n      {}; {}{}default {}\n", p.name, p.doc, fmt::format("{}; ", range_text(p)),
               size.empty() ? "" : size + "; ", values_text(p, joint_count));
  }
  if (s.parameters.empty()) fmt::print("  no parameters\n");
  for (const auto& input : s.inputs) {
    fmt::print("  input {}: {} in {}; {}\n", input.name, to_string(input.quantity), input.frame, input.doc);
  }
}

int list_parameters(const ListOptions& options) {
  const Registry registry = registry_of(options);
  std::size_t joint_count = 7;  // used if no scene gives the joint count
  if (!options.scene.empty()) {
    joint_count = 0;
    for (const auto& arm : open_scene(options.scene).scene.arms)
      joint_count = std::max(joint_count, static_cast<std::size_t>(arm.safety.joints.q_max.size()));
  }
  if (const ControlletType* type = registry.controllet(options.name)) {
    print_descriptor(type->descriptor, joint_count);
    return kSuccess;
  }
  if (const FeatureType* type = registry.feature(options.name)) {
    print_descriptor(type->descriptor, joint_count);
    return kSuccess;
  }
  std::vector<std::string> names;
  for (const auto& type : registry.controllets()) names.push_back(type.descriptor.type);
  for (const auto& type : registry.features()) names.push_back(type.descriptor.type);
  throw UsageError(fmt::format("list parameters: there is no controllet or feature '{}'{}", options.name,
                               name_hint(options.name, names, "there are none")));
}

}  // namespace

void add_list(Program& program) {
  auto options = std::make_shared<ListOptions>();
  CLI::App* command =
      program.add("list", "List controllets, features, models, scenes, or the parameters of a type",
                  "  multipanda list controllets\n"
                  "  multipanda list parameters cartesian_impedance\n"
                  "  multipanda list parameters my_law --scene my/scene.yaml   with the scene's plug-ins");
  command->require_subcommand(1);
  const auto add = [&](const std::string& name, const std::string& what) {
    CLI::App* child = command->add_subcommand(name, what);
    if (name != "models" && name != "scenes") {
      CLI::Option* plugin = option(child, "--plugin", options->plugins, "Shared library with more types",
                                   named("FILE"), existing_file);
      option(child, "--scene", options->scene, "Scene whose plug-ins are loaded")->excludes(plugin);
    }
    return child;
  };
  program.on(add("controllets", "List the types of controllets: control laws that a scene can name"),
             [options] { return list_controllets(*options); });
  program.on(add("features", "List the types of features, which can be added to any controllet"),
             [options] { return list_features(*options); });
  program.on(add("models", "List the robot models"), [] { return list_models(); });
  program.on(add("scenes", "List the scenes that can be named without a path"), [] { return list_scenes(); });
  CLI::App* parameters = add("parameters", "Describe parameters and inputs of a controllet or feature");
  option(parameters, "name", options->name, "Type of a controllet or feature", required);
  program.on(parameters, [options] { return list_parameters(*options); });
}

}  // namespace multipanda::cli
