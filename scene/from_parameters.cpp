#include "scene/from_parameters.hpp"

#include <algorithm>
#include <map>
#include <optional>
#include <sstream>
#include <stdexcept>

#include <yaml-cpp/yaml.h>

#include "common/text.hpp"
#include "scene/rewrite.hpp"

namespace multipanda {
namespace {

// Scene keys that apply to a hosted cycle. The host owns the world and time.
const std::vector<std::string>& scene_keys() {
  static const std::vector<std::string> keys{"name",        "description", "arms",    "objects",
                                             "controllets", "active",      "plugins", "ros"};
  return keys;
}

[[noreturn]] void refuse(const std::string& parameter, const std::string& why) {
  throw std::invalid_argument("parameter '" + parameter + "': " + why);
}

std::vector<std::string> split(const std::string& name) {
  std::vector<std::string> parts;
  std::istringstream in(name);
  for (std::string part; std::getline(in, part, '.');) parts.push_back(part);
  if (std::any_of(parts.begin(), parts.end(), [](const auto& part) { return part.empty(); })) {
    refuse(name, "expected names between the dots");
  }
  return parts;
}

YAML::Node scalar(bool value) { return YAML::Node(value ? "true" : "false"); }
YAML::Node scalar(std::int64_t value) { return YAML::Node(std::to_string(value)); }
YAML::Node scalar(double value) { return YAML::Node(number_text(value)); }  // reads back as the same number
YAML::Node scalar(const std::string& value) { return YAML::Node(value); }

template <typename T>
YAML::Node scalar(const std::vector<T>& values) {
  YAML::Node list(YAML::NodeType::Sequence);
  for (const auto& value : values) list.push_back(scalar(static_cast<T>(value)));
  return list;
}

YAML::Node node_of(const ParameterValue& value) {
  return std::visit([](const auto& v) { return scalar(v); }, value);
}

std::string joined_path(const std::vector<std::string>& parts, std::size_t count) {
  return joined({parts.begin(), parts.begin() + static_cast<std::ptrdiff_t>(count)}, ".");
}

// Puts the value into the tree, at the path parts[first], parts[first + 1], ...
void insert(YAML::Node& root, const std::vector<std::string>& parts, std::size_t first,
            const std::string& name, const ParameterValue& value) {
  YAML::Node at;
  at.reset(root);
  for (std::size_t i = first; i + 1 < parts.size(); ++i) {
    YAML::Node next = at[parts[i]];
    if (!next.IsDefined()) next = YAML::Node(YAML::NodeType::Map);
    if (!next.IsMap())
      refuse(name, "'" + joined_path(parts, i + 1) + "' already has a value; it cannot also have keys");
    at.reset(next);
  }
  at[parts.back()] = node_of(value);
}

std::string text(const ParameterValue& value, const std::string& name) {
  if (!std::holds_alternative<std::string>(value)) refuse(name, "expected a string");
  return std::get<std::string>(value);
}

std::vector<std::string> texts(const ParameterValue& value, const std::string& name) {
  if (std::holds_alternative<std::string>(value)) return {std::get<std::string>(value)};
  if (!std::holds_alternative<std::vector<std::string>>(value)) refuse(name, "expected a list of names");
  return std::get<std::vector<std::string>>(value);
}

template <typename T>
T choice(const ParameterValue& value, const std::string& name,
         const std::vector<std::pair<std::string, T>>& choices) {
  const std::string word = text(value, name);
  std::vector<std::string> valid;
  for (const auto& [key, chosen] : choices) {
    if (key == word) return chosen;
    valid.push_back(key);
  }
  refuse(name, "found '" + word + "'" + name_hint(word, valid, ""));
}

void take_states(const std::vector<std::string>& states, const std::string& name, HostedArm& arm) {
  static const std::vector<std::string> valid{"position", "velocity", "effort", "multipanda_state"};
  for (const auto& state : states) {
    if (std::ranges::find(valid, state) == valid.end())
      refuse(name, "found '" + state + "'" + name_hint(state, valid, ""));
  }
  const auto has = [&](const char* state) { return std::ranges::find(states, state) != states.end(); };
  if (!has("position") || !has("velocity")) refuse(name, "position and velocity are required");
  arm.has_effort = has("effort");
  arm.has_robot_state = has("multipanda_state");
}

// An arm's key for the host; false: it belongs to the scene.
bool take_hosted(const std::string& key, const std::string& name, const ParameterValue& value,
                 HostedArm& arm) {
  using enum HostedArm::Gravity;
  if (key == "joints")
    arm.joints = texts(value, name);
  else if (key == "gravity_compensation")
    arm.gravity = choice<HostedArm::Gravity>(value, name, {{"robot", robot}, {"controller", cycle}});
  else if (key == "external_forces")
    arm.forces_by_robot = choice<bool>(value, name, {{"observer", false}, {"robot", true}});
  else if (key == "state_interfaces")
    take_states(texts(value, name), name, arm);
  else if (key == "base_link")
    arm.base_link = text(value, name);
  else if (key == "tip_link")
    arm.tip_link = text(value, name);
  else
    return false;
  return true;
}

// An arm of the parameters: the host's part, and its section of the scene.
struct NamedArm {
  HostedArm hosted;
  YAML::Node section{YAML::NodeType::Map};
  std::string model;
};
using NamedArms = std::map<std::string, NamedArm>;

NamedArm& named_arm(NamedArms& arms, const std::string& name) {
  NamedArm& arm = arms[name];
  arm.hosted.name = name;
  return arm;
}

// Names of the arms in the order of `requested`; some may have no keys.
std::vector<std::string> ordered(NamedArms& arms, const std::vector<std::string>& requested) {
  for (auto name = requested.begin(); name != requested.end(); ++name) {
    if (std::find(requested.begin(), name, *name) != name)
      refuse("arm_names", "'" + *name + "' is named twice");
    named_arm(arms, *name);
  }
  for (const auto& [name, arm] : arms) {
    if (std::ranges::find(requested, name) == requested.end()) {
      refuse("arms." + name,
             "there is no arm of this name in arm_names" + name_hint(name, requested, "it is empty"));
    }
  }
  return requested;
}

}  // namespace

ParameterScene scene_from_parameters(const FlatParameters& parameters,
                                     const std::function<std::string(const HostedArm&)>& model_of) {
  ParameterScene scene;
  YAML::Node document(YAML::NodeType::Map);
  NamedArms arms;
  std::optional<std::vector<std::string>> requested;
  FlatParameters sorted = parameters;
  std::ranges::stable_sort(sorted, {}, &FlatParameters::value_type::first);
  for (std::size_t k = 0; k < sorted.size(); ++k) {
    const auto& [name, value] = sorted[k];
    const std::string head = name.substr(0, name.find('.'));
    if (name == "arm_names") {
      requested = texts(value, name);
    } else if (std::ranges::find(scene_keys(), head) != scene_keys().end()) {
      if (k > 0 && sorted[k - 1].first == name) refuse(name, "duplicate parameter; remove one");
      const std::vector<std::string> parts = split(name);
      if (name == "plugins") scene.plugins = texts(value, name);
      if (head != "arms") {
        insert(document, parts, 0, name, value);
        continue;
      }
      if (parts.size() < 3) refuse(name, "expected arms.<name>.<key>");
      NamedArm& arm = named_arm(arms, parts[1]);
      if (parts.size() == 3 && take_hosted(parts[2], name, value, arm.hosted)) continue;
      if (parts.size() == 3 && parts[2] == "model") arm.model = text(value, name);
      insert(arm.section, parts, 2, name, value);
    } else if (const std::string meant = nearest_name(head, scene_keys());
               !meant.empty() && name.find('.') != std::string::npos) {
      refuse(name, "did you mean '" + meant + name.substr(head.size()) + "'?");
    }
  }
  std::vector<std::string> names;
  for (const auto& [name, arm] : arms) names.push_back(name);
  if (requested) names = ordered(arms, *requested);
  if (names.empty())
    throw std::invalid_argument("no arms; set the parameter 'arm_names' (a list) or 'arms.<name>.model'");
  YAML::Node sections(YAML::NodeType::Map);
  for (const auto& name : names) {
    NamedArm& arm = arms[name];
    if (arm.model == "robot_description") {
      if (!model_of)
        refuse("arms." + name + ".model", "there is no robot description here; expected the name of a model");
      arm.section["model"] = model_of(arm.hosted);
      if (!arm.section["hand"]) arm.section["hand"] = "false";  // the description already contains it
    } else if (!arm.hosted.base_link.empty() || !arm.hosted.tip_link.empty()) {
      refuse("arms." + name,
             "base_link and tip_link belong to a robot description; add 'model: robot_description'");
    }
    scene.arms.push_back(arm.hosted);
    sections.force_insert(name, arm.section);
  }
  document["arms"] = sections;
  scene.yaml = yaml_text(document) + "\n";
  return scene;
}

}  // namespace multipanda
