#include "scene/additions.hpp"

#include <algorithm>
#include <filesystem>

#include "config_file/node.hpp"

namespace multipanda {
namespace {

// Adds items to the list under a top-level key: the text around it, comments included, stays as it is.
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

// In double quotes; paths of laws are made by programs and may contain anything.
std::string quoted(const std::string& path) {
  std::string text = "\"";
  for (const char c : path) {
    if (c == '"' || c == '\\') text += '\\';
    text += c;
  }
  return text + '"';
}

}  // namespace

std::string with_additions(const std::string& text, const std::string& file_name,
                           const SceneAdditions& additions) {
  std::vector<std::string> plugins;
  for (const auto& path : additions.plugins)
    plugins.push_back(quoted(std::filesystem::absolute(path).string()));
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
