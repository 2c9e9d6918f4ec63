#include <algorithm>
#include <stdexcept>

#include <yaml-cpp/yaml.h>

#include "common/text.hpp"
#include "runtime/embedded/hardware_system.hpp"
#include "scene/build.hpp"
#include "scene/load.hpp"

namespace multipanda {
namespace {

[[noreturn]] void refuse(const std::string& parameter, const std::string& why) {
  throw std::invalid_argument("hardware parameter '" + parameter + "': " + why);
}

std::vector<std::string> split(std::string text) {
  for (char& c : text) {
    if (c == ',' || c == '[' || c == ']' || c == '\t' || c == '\n') c = ' ';
  }
  std::vector<std::string> parts;
  for (std::size_t at = 0; at < text.size();) {
    const std::size_t end = std::min(text.find(' ', at), text.size());
    if (end > at) parts.push_back(text.substr(at, end - at));
    at = end + 1;
  }
  return parts;
}

// Parses a string that holds a list; keeps other strings unchanged.
ParameterValue value_of(const std::string& name, const std::string& text) {
  if (text.find('[') == std::string::npos) return text;
  try {
    const YAML::Node node = YAML::Load(text);
    if (!node.IsSequence()) return text;
    std::vector<std::string> items;
    for (const auto& item : node) items.push_back(item.as<std::string>());
    return items;
  } catch (const YAML::Exception& error) {
    refuse(name, "not readable as YAML: " + error.msg);
  }
}

std::string lower(std::string text) {
  std::transform(text.begin(), text.end(), text.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return text;
}

// Translates multipanda_ros2's parameters robot_count, ns_i, robot_ip_i, hand_i.
std::map<std::string, std::string> from_multipanda_ros2(std::map<std::string, std::string> parameters) {
  const auto count = parameters.find("robot_count");
  if (count == parameters.end()) return parameters;
  int robots = 0;
  try {
    robots = std::stoi(count->second);
  } catch (const std::exception&) {
    refuse("robot_count", "expected a whole number, found '" + count->second + "'");
  }
  if (robots < 1 || robots > static_cast<int>(kMaxArms)) {
    refuse("robot_count", "expected 1 to " + std::to_string(kMaxArms));
  }
  parameters.erase(count);
  std::string names;
  const auto move = [&](const std::string& from, const std::string& to) {
    const auto it = parameters.find(from);
    if (it == parameters.end()) return;
    parameters[to] = to.ends_with("hand") ? lower(it->second) : it->second;
    parameters.erase(from);
  };
  for (int i = 1; i <= robots; ++i) {
    const std::string number = std::to_string(i);
    const auto name = parameters.find("ns_" + number);
    if (name == parameters.end()) refuse("ns_" + number, "is missing: the name of robot " + number);
    const std::string arm = name->second;
    parameters.erase(name);
    names += arm + " ";
    move("robot_ip_" + number, "arms." + arm + ".fci");
    move("hand_" + number, "arms." + arm + ".hand");
  }
  parameters["arm_names"] = names;
  return parameters;
}

void check_addresses(const Scene& scene, bool real) {
  for (const auto& arm : scene.arms) {
    if (real && !arm.fci) {
      throw std::invalid_argument(
          "arm '" + arm.name + "' has no address: give the hardware parameter 'arms." + arm.name + ".fci'");
    }
    if (!real && arm.fci) {
      throw std::invalid_argument("arm '" + arm.name +
                                  "' has an address, but this hardware simulates: use "
                                  "multipanda_hardware/FciSystem, or omit the address");
    }
  }
}

}  // namespace

Scene hardware_scene(const std::map<std::string, std::string>& parameters, bool real,
                     const std::vector<std::string>& others) {
  const auto own = from_multipanda_ros2(parameters);
  std::vector<std::string> known{"scene", "arm_names", "arms", "objects"};
  const bool whole = own.contains("scene");
  FlatParameters flat;
  for (const auto& [name, text] : own) {
    const std::string head = name.substr(0, name.find('.'));
    if (std::find(others.begin(), others.end(), name) != others.end()) continue;
    if (std::find(known.begin(), known.end(), head) == known.end()) {
      known.insert(known.end(), others.begin(), others.end());
      refuse(name, "unknown" + name_hint(head, known, ""));
    }
    if (whole && name != "scene") refuse(name, "the parameter 'scene' is set: define it in that scene");
    if (name == "arm_names") {
      flat.emplace_back(name, split(text));
    } else if (name != "scene") {
      flat.emplace_back(name, value_of(name, text));
    }
  }
  Scene scene;
  if (whole) {
    scene = open_scene(own.at("scene")).scene;
  } else {
    const Registry registry = Registry::with_builtins();
    scene = parse_scene(scene_from_parameters(flat).yaml, "hardware parameters", registry);
  }
  refuse_carried_arms(scene, "hardware of ros2_control");
  scene.controllets.clear();
  scene.active.clear();
  std::erase_if(scene.timeline, [](const auto& e) { return e.what != TimelineEvent::What::place; });
  check_addresses(scene, real);
  return scene;
}

}  // namespace multipanda
