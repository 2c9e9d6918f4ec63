#include "scene/from_parameters.hpp"

#include <algorithm>
#include <map>
#include <sstream>
#include <stdexcept>

#include <yaml-cpp/yaml.h>

#include "config_file/text.hpp"
#include "support/spelling.hpp"

namespace multipanda {
namespace {

// The keys of a scene that apply to a hosted cycle. The host owns the world and its time.
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

// A tree that keeps the order of its branches.
struct Tree {
  std::vector<std::pair<std::string, Tree>> branches;
  const ParameterValue* value = nullptr;
  std::string name;  // of the parameter

  Tree& branch(const std::string& key) {
    const auto it = std::find_if(branches.begin(), branches.end(), [&](auto& b) { return b.first == key; });
    if (it != branches.end()) return it->second;
    return branches.emplace_back(key, Tree{}).second;
  }
  const Tree* find(const std::string& key) const {
    const auto it = std::find_if(branches.begin(), branches.end(), [&](auto& b) { return b.first == key; });
    return it == branches.end() ? nullptr : &it->second;
  }
};

YAML::Node node_of(const Tree& tree) {
  if (tree.value != nullptr) return node_of(*tree.value);
  YAML::Node map(YAML::NodeType::Map);
  for (const auto& [key, branch] : tree.branches) map.force_insert(key, node_of(branch));
  return map;
}

void insert(Tree& root, const std::string& name, const ParameterValue& value) {
  Tree* at = &root;
  for (const auto& part : split(name)) {
    if (at->value != nullptr)
      refuse(name, "'" + at->name + "' already has a value; it cannot also have keys");
    at = &at->branch(part);
  }
  if (!at->branches.empty()) refuse(name, "it has keys; it cannot also have a value");
  if (at->value != nullptr) refuse(name, "duplicate parameter; remove one");
  at->value = &value;
  at->name = name;
}

std::string text(const Tree& tree, const std::string& name) {
  if (tree.value == nullptr || !std::holds_alternative<std::string>(*tree.value))
    refuse(name, "expected a string");
  return std::get<std::string>(*tree.value);
}

std::vector<std::string> texts(const Tree& tree, const std::string& name) {
  if (tree.value != nullptr && std::holds_alternative<std::string>(*tree.value)) {
    return {std::get<std::string>(*tree.value)};
  }
  if (tree.value == nullptr || !std::holds_alternative<std::vector<std::string>>(*tree.value)) {
    refuse(name, "expected a list of names");
  }
  return std::get<std::vector<std::string>>(*tree.value);
}

template <typename T>
T choice(const Tree& tree, const std::string& name, const std::vector<std::pair<std::string, T>>& choices) {
  const std::string word = text(tree, name);
  std::vector<std::string> valid;
  for (const auto& [key, value] : choices) {
    if (key == word) return value;
    valid.push_back(key);
  }
  refuse(name, "found '" + word + "'" + name_hint(word, valid, ""));
}

void take_states(const std::vector<std::string>& states, const std::string& name, HostedArm& arm) {
  static const std::vector<std::string> valid{"position", "velocity", "effort", "multipanda_state"};
  for (const auto& state : states) {
    if (std::find(valid.begin(), valid.end(), state) == valid.end()) {
      refuse(name, "found '" + state + "'" + name_hint(state, valid, ""));
    }
  }
  const auto has = [&](const char* state) {
    return std::find(states.begin(), states.end(), state) != states.end();
  };
  if (!has("position") || !has("velocity")) refuse(name, "position and velocity are required");
  arm.has_effort = has("effort");
  arm.has_robot_state = has("multipanda_state");
}

// Removes the keys of the host from those of an arm.
HostedArm take_hosted(const std::string& name, Tree& tree) {
  HostedArm arm;
  arm.name = name;
  const std::string path = "arms." + name + ".";
  std::erase_if(tree.branches, [&](const auto& pair) {
    const auto& [key, branch] = pair;
    if (key == "joints") {
      arm.joints = texts(branch, path + key);
    } else if (key == "gravity_compensation") {
      using enum HostedArm::Gravity;
      arm.gravity = choice<HostedArm::Gravity>(branch, path + key, {{"robot", robot}, {"controller", cycle}});
    } else if (key == "external_forces") {
      arm.forces_by_robot = choice<bool>(branch, path + key, {{"observer", false}, {"robot", true}});
    } else if (key == "state_interfaces") {
      take_states(texts(branch, path + key), path + key, arm);
    } else if (key == "base_link") {
      arm.base_link = text(branch, path + key);
    } else if (key == "tip_link") {
      arm.tip_link = text(branch, path + key);
    } else {
      return false;
    }
    return true;
  });
  return arm;
}

// Sorts the arms in the order of `names`; some may have no keys.
void order_arms(Tree& arms, const std::vector<std::string>& names) {
  std::vector<std::pair<std::string, Tree>> ordered;
  for (const auto& name : names) {
    const bool twice = std::any_of(ordered.begin(), ordered.end(), [&](auto& b) { return b.first == name; });
    if (twice) refuse("arm_names", "'" + name + "' is named twice");
    ordered.emplace_back(name, std::move(arms.branch(name)));
  }
  for (const auto& [name, branch] : arms.branches) {
    if (std::find(names.begin(), names.end(), name) == names.end()) {
      refuse("arms." + name,
             "there is no arm of this name in arm_names" + name_hint(name, names, "it is empty"));
    }
  }
  arms.branches = std::move(ordered);
}

}  // namespace

ParameterScene scene_from_parameters(const FlatParameters& parameters,
                                     const std::function<std::string(const HostedArm&)>& model_of) {
  Tree root;
  ParameterScene scene;
  std::vector<std::string> names;
  bool named = false;
  FlatParameters sorted = parameters;
  std::stable_sort(sorted.begin(), sorted.end(),
                   [](const auto& a, const auto& b) { return a.first < b.first; });
  for (const auto& [name, value] : sorted) {
    const std::string head = name.substr(0, name.find('.'));
    if (name == "arm_names") {
      names = texts(Tree{{}, &value, name}, name);
      named = true;
    } else if (std::find(scene_keys().begin(), scene_keys().end(), head) != scene_keys().end()) {
      insert(root, name, value);
    } else if (const std::string meant = nearest_name(head, scene_keys());
               !meant.empty() && name.find('.') != std::string::npos) {
      refuse(name, "did you mean '" + meant + name.substr(head.size()) + "'?");
    }
  }
  Tree& arms = root.branch("arms");
  if (named) order_arms(arms, names);
  if (arms.branches.empty()) {
    throw std::invalid_argument("no arms; set the parameter 'arm_names' (a list) or 'arms.<name>.model'");
  }
  std::vector<std::string> models(arms.branches.size());
  for (auto& [name, branch] : arms.branches) {
    const HostedArm& arm = scene.arms.emplace_back(take_hosted(name, branch));
    const Tree* model = branch.find("model");
    const std::string path = "arms." + name + ".model";
    if (model != nullptr && text(*model, path) == "robot_description") {
      if (!model_of) refuse(path, "there is no robot description here; expected the name of a model");
      models[scene.arms.size() - 1] = model_of(arm);
    } else if (!arm.base_link.empty() || !arm.tip_link.empty()) {
      refuse("arms." + name,
             "base_link and tip_link belong to a robot description; add 'model: robot_description'");
    }
  }
  if (const Tree* plugins = root.find("plugins")) scene.plugins = texts(*plugins, "plugins");

  YAML::Node document = node_of(root);
  for (std::size_t i = 0; i < models.size(); ++i) {
    if (models[i].empty()) continue;
    YAML::Node arm = document["arms"][scene.arms[i].name];
    arm["model"] = models[i];
    if (!arm["hand"]) arm["hand"] = "false";  // the description already contains it
  }
  YAML::Emitter out;
  out << document;
  scene.yaml = std::string(out.c_str()) + "\n";
  return scene;
}

}  // namespace multipanda
