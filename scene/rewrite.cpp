#include "scene/rewrite.hpp"

#include <algorithm>
#include <charconv>
#include <filesystem>

#include <fmt/format.h>

#include "common/text.hpp"
#include "yaml_reader/node.hpp"

namespace multipanda {
namespace {

std::vector<std::string> parts_of(const std::string& key) {
  std::vector<std::string> parts(1);
  for (const char c : key) {
    if (c == '.')
      parts.emplace_back();
    else
      parts.back() += c;
  }
  return parts;
}

bool decimal(std::string_view text, double& value) {
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  return error == std::errc() && end == text.data() + text.size() && !text.empty();
}

// Finds a path element inside a node: a key of a mapping, an item of a list. -1: not found.
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
  message += " does not exist in the scene: there is no ";
  message += in_quotes(word) + name_hint(word, words_of(at), "the list is empty");
  throw ConfigError(place, message);
}

// Adds items to the list under a top-level key; keeps the text around it, comments included.
std::string with_items(const std::string& text, const std::string& file_name, const std::string& key,
                       const std::vector<std::string>& items) {
  if (items.empty()) return text;
  const Node root = Node::parse(text, file_name);
  const auto pairs = root.pairs();
  const auto found = std::ranges::find(pairs, key, &std::pair<std::string, Node>::first);
  if (found == pairs.end()) {
    std::string longer = text;
    if (!longer.empty() && longer.back() != '\n') longer += '\n';
    longer += key + ":\n";
    for (const auto& item : items) longer += "  - " + item + '\n';
    return longer;
  }
  const YAML::Mark mark = found->second.yaml().Mark();
  const auto place = static_cast<std::size_t>(std::max(mark.pos, 0));
  if (!found->second.is_list() || place >= text.size() || (text[place] != '-' && text[place] != '['))
    found->second.refuse("expected a list, to which '" + items[0] + "' can be added");
  std::string added;
  if (text[place] == '[') {
    for (const auto& item : items) added += item + (&item == &items.back() ? "" : ", ");
    if (!found->second.items().empty()) added += ", ";
    return text.substr(0, place + 1) + added + text.substr(place + 1);
  }
  const std::string indent(static_cast<std::size_t>(mark.column), ' ');
  for (const auto& item : items) added += "- " + item + '\n' + indent;
  return text.substr(0, place) + added + text.substr(place);
}

YAML::Node find(const YAML::Node& root, const std::string& key, const SourcePlace& place) {
  // A node is a reference: assignment would write into the tree, reset() rebinds it.
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

double plain_number(const YAML::Node& node, const std::string& key, const SourcePlace& place) {
  double value = 0;
  if (!node.IsScalar() || !decimal(node.Scalar(), value))
    throw ConfigError(place, "the key path " + in_quotes(key) +
                                 " does not lead to a plain decimal number, or to a list of them");
  return value;
}

}  // namespace

std::string yaml_text(const YAML::Node& node) {
  YAML::Emitter out;
  out << node;
  return out.c_str();
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

void vary(YAML::Node& root, const Variation& change, SeededDraw& draw) {
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

std::string with_base(const std::string& scene_text, const std::string& arm, const Pose& X_WB,
                      const std::string& note) {
  YAML::Node scene = YAML::Load(scene_text);
  const Vector3 rpy = rpy_of(X_WB.rotation);
  put(scene, {.key = "arms." + arm + ".base",
              .value = fmt::format(
                  "{{position_m: [{:.7g}, {:.7g}, {:.7g}], rpy_rad: [{:.7g}, {:.7g}, {:.7g}]}}",
                  X_WB.position.x(), X_WB.position.y(), X_WB.position.z(), rpy.x(), rpy.y(), rpy.z()),
              .place = {}});
  return "# " + note + "\n" + yaml_text(scene) + "\n";
}

std::string with_additions(const std::string& text, const std::string& file_name,
                           const SceneAdditions& additions) {
  std::vector<std::string> plugins;
  for (const auto& path : additions.plugins)
    plugins.push_back(yaml_quoted(std::filesystem::absolute(path).string()));
  for (const auto& entry : additions.controllets) {
    const bool one_line = entry.find('\n') == std::string::npos;
    if (!one_line || !Node::parse(entry, "--controllet").is_map())
      Node::parse("x", "--controllet")
          .refuse("expected one line like {name: soft, type: soft, arms: left}, found " + entry);
  }
  return with_items(with_items(text, file_name, "plugins", plugins), file_name, "controllets",
                    additions.controllets);
}

}  // namespace multipanda
