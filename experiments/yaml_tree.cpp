#include "experiments/yaml_tree.hpp"

#include <charconv>

#include "config_file/text.hpp"
#include "support/spelling.hpp"

namespace multipanda {
namespace {

std::vector<std::string> parts_of(const std::string& key) {
  std::vector<std::string> parts(1);
  for (const char c : key) {
    if (c == '.') {
      parts.emplace_back();
    } else {
      parts.back() += c;
    }
  }
  return parts;
}

bool decimal(std::string_view text, double& value) {
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  return error == std::errc() && end == text.data() + text.size() && !text.empty();
}

// Resolves a path element inside a node: a key of a mapping, an item of a list. -1: not found.
std::ptrdiff_t index_of(const YAML::Node& list, const std::string& word) {
  std::size_t index = 0;
  const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), index);
  if (error == std::errc() && end == word.data() + word.size())
    return index < list.size() ? static_cast<std::ptrdiff_t>(index) : -1;
  for (std::size_t i = 0; i < list.size(); ++i) {
    const YAML::Node item = list[i];
    if (item.IsMap() && item["name"] && item["name"].IsScalar() && item["name"].Scalar() == word)
      return static_cast<std::ptrdiff_t>(i);
  }
  for (std::size_t i = 0; i < list.size(); ++i) {  // events have no names
    const YAML::Node item = list[i];
    if (item.IsMap() && item[word]) return static_cast<std::ptrdiff_t>(i);
  }
  return -1;
}

std::vector<std::string> words_of(const YAML::Node& node) {
  std::vector<std::string> words;
  if (node.IsMap()) {
    for (const auto& pair : node) words.push_back(pair.first.Scalar());
  } else if (node.IsSequence()) {
    for (std::size_t i = 0; i < node.size(); ++i) {
      const YAML::Node item = node[i];
      words.push_back(item.IsMap() && item["name"] ? item["name"].Scalar() : std::to_string(i));
    }
  }
  return words;
}

[[noreturn]] void refuse(const std::string& key, const std::string& word, const YAML::Node& at,
                         const SourcePlace& place) {
  std::string message = "the key path ";
  message += in_quotes(key);
  message += " leads nowhere in the scene: there is no ";
  message += in_quotes(word) + name_hint(word, words_of(at), "the list is empty");
  throw ConfigError(place, message);
}

// A scalar in quotes is a string and stays one.
nlohmann::ordered_json scalar_json(const YAML::Node& node) {
  const std::string& text = node.Scalar();
  double value = 0;
  if (node.Tag() == "!") return text;
  if (text == "true" || text == "false") return text == "true";
  std::int64_t whole = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), whole);
  if (error == std::errc() && end == text.data() + text.size()) return whole;
  if (decimal(text, value)) return value;
  return text;
}

}  // namespace

std::string yaml_text(const YAML::Node& node) {
  YAML::Emitter out;
  out << node;
  return out.c_str();
}

nlohmann::ordered_json yaml_json(const YAML::Node& node) {
  if (node.IsScalar()) return scalar_json(node);
  nlohmann::ordered_json out;
  if (node.IsSequence()) {
    out = nlohmann::ordered_json::array();
    for (const auto& item : node) out.push_back(yaml_json(item));
  } else if (node.IsMap()) {
    out = nlohmann::ordered_json::object();
    for (const auto& pair : node) out[pair.first.Scalar()] = yaml_json(pair.second);
  }
  return out;
}

YAML::Node find(const YAML::Node& root, const std::string& key, const SourcePlace& place) {
  // A node is a reference: assigning to it would write into the tree, reset() lets it refer to another one.
  YAML::Node at;
  at.reset(root);
  for (const auto& word : parts_of(key)) {
    if (at.IsSequence()) {
      const std::ptrdiff_t index = index_of(at, word);
      if (index < 0) refuse(key, word, at, place);
      at.reset(at[static_cast<std::size_t>(index)]);
    } else {
      const YAML::Node& map = at;
      if (!map.IsMap() || !map[word]) refuse(key, word, at, place);
      at.reset(map[word]);
    }
  }
  return at;
}

void put(YAML::Node& root, const Override& change) {
  const std::size_t dot = change.key.rfind('.');
  const std::string last = dot == std::string::npos ? change.key : change.key.substr(dot + 1);
  YAML::Node parent;
  parent.reset(dot == std::string::npos ? root : find(root, change.key.substr(0, dot), change.place));
  const YAML::Node value = YAML::Load(change.value);
  if (parent.IsSequence()) {
    const std::ptrdiff_t index = index_of(parent, last);
    if (index < 0) refuse(change.key, last, parent, change.place);
    parent[static_cast<std::size_t>(index)] = value;
  } else if (parent.IsMap()) {
    parent[last] = value;
  } else {
    refuse(change.key, last, parent, change.place);
  }
}

double plain_number(const YAML::Node& node, const std::string& key, const SourcePlace& place) {
  double value = 0;
  if (!node.IsScalar() || !decimal(node.Scalar(), value))
    throw ConfigError(place, "the key path " + in_quotes(key) +
                                 " does not lead to a plain decimal number, or to a list of them");
  return value;
}

}  // namespace multipanda
