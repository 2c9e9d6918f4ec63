#pragma once

#include <string>

#include <nlohmann/json.hpp>
#include <yaml-cpp/yaml.h>

#include "config_file/text.hpp"
#include "experiments/experiment.hpp"

// YAML trees changed by key paths. For the files of this folder only.
namespace multipanda {

std::string yaml_text(const YAML::Node& node);
// Scalars become numbers, booleans or strings, by their syntax.
nlohmann::ordered_json yaml_json(const YAML::Node& node);

// Puts a value into the tree. The path's last key may be new, everything before it must be there; items of
// lists are named by their `name`, by their number, or by a key that they have (the first that has it).
// Throws ConfigError at the override's place.
void put(YAML::Node& root, const Override& change);

// Varies the number at the path, or each number of the list there, by amounts that `draw` returns within +-1,
// times `by`. Throws ConfigError if there is no plain number.
template <typename Draw>
void vary(YAML::Node& root, const Variation& change, Draw&& draw);

YAML::Node find(const YAML::Node& root, const std::string& key, const SourcePlace& place);
double plain_number(const YAML::Node& node, const std::string& key, const SourcePlace& place);

template <typename Draw>
void vary(YAML::Node& root, const Variation& change, Draw&& draw) {
  const YAML::Node node = find(root, change.key, change.place);
  const auto moved = [&](const YAML::Node& number) {
    return number_text(plain_number(number, change.key, change.place) + change.by * draw());
  };
  std::string text;
  if (node.IsSequence()) {
    for (const auto& item : node) text += (text.empty() ? "[" : ", ") + moved(item);
    text += "]";
  } else {
    text = moved(node);
  }
  put(root, {.key = change.key, .value = text, .place = change.place});
}

}  // namespace multipanda
