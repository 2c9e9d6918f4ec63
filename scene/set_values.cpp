#include "scene/set_values.hpp"

#include <yaml-cpp/yaml.h>

#include "common/spelling.hpp"

namespace multipanda {

Scene with_values(const OpenedScene& opened, const std::vector<std::string>& settings) {
  YAML::Node root = YAML::Load(opened.scene.text);
  for (const auto& setting : settings) {
    const SourcePlace place{"--set", 0};
    const std::size_t equals = setting.find('=');
    if (equals == std::string::npos || equals == 0)
      throw ConfigError(place, "expected KEY=VALUE, found " + in_quotes(setting));
    try {
      put(root, {.key = setting.substr(0, equals), .value = setting.substr(equals + 1), .place = place});
    } catch (const YAML::Exception& error) {
      throw ConfigError(place, in_quotes(setting) + " is not YAML: " + error.what());
    }
  }
  return parse_scene(yaml_text(root) + "\n", opened.scene.path, opened.registry);
}

}  // namespace multipanda
