#include "yaml_reader/reference_page.hpp"

#include <algorithm>
#include <cctype>
#include <string_view>
#include <utility>

namespace multipanda {
namespace {

std::string link_to(const std::string& heading) {
  std::string anchor;
  for (const char c : heading) {
    if (c == ' ') anchor += '-';
    if (c == '_' || std::isalnum(static_cast<unsigned char>(c)) != 0)
      anchor += static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  }
  return "[" + heading + "](#" + anchor + ")";
}

void remove_all(std::string& text, std::string_view part) {
  for (std::size_t at = 0; (at = text.find(part, at)) != std::string::npos;) text.erase(at, part.size());
}

// As in messages, but short: the page explains names, ranges and lists of numbers once.
std::string value_text(const Key& key) {
  std::string links;
  for (const auto& part : key.parts) links += (links.empty() ? "" : ", ") + link_to(part->name);
  if (key.kind == Key::Kind::section) return links + (key.text_alone ? ", or a text" : "");
  if (key.kind == Key::Kind::sections) return "list of " + links;
  if (key.kind == Key::Kind::open) return links.empty() ? "see the description" : "by name: " + links;
  std::string text = expectation(key);
  for (const char* part : {"a list of ", " (a letter, then letters, digits or _)"}) remove_all(text, part);
  if (key.kind == Key::Kind::boolean && !key.fallback.empty()) return "";  // the default shows it
  if (key.kind == Key::Kind::number) {
    for (const char* start : {"a number, ", "a number "})
      if (text.starts_with(start)) return text.substr(std::string_view(start).size());
  }
  return text.starts_with("a ") ? text.substr(2) : text;
}

}  // namespace

std::string in_brackets(const std::string& value, const std::string& absent) {
  return " (" + value + (value.empty() || absent.empty() ? "" : "; ") + absent + ")";
}

std::string code_text(const std::string& text) { return text.empty() ? "" : "`" + text + "`"; }

std::string PageLists::list(const std::string& title,
                            const std::vector<std::pair<std::string, std::string>>& items) {
  std::vector<std::pair<std::string, std::string>> here;       // names, text
  std::vector<std::pair<std::string, std::string>> elsewhere;  // heading, names
  for (const auto& item : items) {
    const auto [place, is_new] = titles_.emplace(item, title);
    if (is_new && !here.empty() && here.back().second == item.second) {
      here.back().first += ", " + item.first;
      continue;
    }
    if (is_new) {
      here.push_back(item);
      continue;
    }
    auto other = std::ranges::find(elsewhere, place->second, &std::pair<std::string, std::string>::first);
    if (other == elsewhere.end()) other = elsewhere.insert(other, {place->second, ""});
    other->second += (other->second.empty() ? "" : ", ") + item.first;
  }
  std::string lines;
  for (const auto& [names, text] : here) lines += "- " + names + text + "\n";
  for (const auto& [heading, names] : elsewhere) lines += "- as in " + link_to(heading) + ": " + names + "\n";
  return lines.empty() ? "" : "\n" + lines;
}

std::string reference_lists(const Section& section) {
  std::string out;
  PageLists lists;
  for (const Section* part : all_sections(section)) {
    out += "\n## " + part->name + "\n";
    if (!part->doc.empty()) out += "\n" + part->doc + "\n";
    std::vector<std::pair<std::string, std::string>> items;
    for (const auto& key : part->keys) {
      const std::string absent = key.needed             ? "**required**"
                                 : key.fallback.empty() ? ""
                                                        : "default " + code_text(key.fallback);
      items.emplace_back(code_text(key.name), in_brackets(value_text(key), absent) + ": " + key.doc);
    }
    out += lists.list(part->name, items);
  }
  return out;
}

}  // namespace multipanda
