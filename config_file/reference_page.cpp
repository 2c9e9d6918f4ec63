#include "config_file/reference_page.hpp"

#include <cctype>

namespace multipanda {
namespace {

std::string link_to(const Section& section) {
  std::string anchor;
  for (const char c : section.name) {
    if (c == ' ') anchor += '-';
    if (std::isalnum(static_cast<unsigned char>(c)) != 0)
      anchor += static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  }
  return "[" + section.name + "](#" + anchor + ")";
}

std::string value_text(const Key& key) {
  std::string links;
  for (const auto& part : key.parts) links += (links.empty() ? "" : ", ") + link_to(*part);
  if (key.kind == Key::Kind::section) return links + (key.text_alone ? ", or a text" : "");
  if (key.kind == Key::Kind::sections) return "list of " + links;
  if (key.kind == Key::Kind::open) return links.empty() ? "see the description" : "by name: " + links;
  return expectation(key);
}

}  // namespace

std::string table_cell(const std::string& text) {
  std::string escaped;
  for (const char c : text) escaped += c == '|' ? "\\|" : std::string(1, c);
  return escaped.empty() ? " " : escaped;
}

std::string code_text(const std::string& text) { return text.empty() ? "" : "`" + text + "`"; }

std::string reference_tables(const Section& section) {
  std::string out;
  for (const Section* part : all_sections(section)) {
    out += "\n## " + part->name + "\n\n";
    if (!part->doc.empty()) out += part->doc + "\n\n";
    out += "| key | value | default | meaning |\n|---|---|---|---|\n";
    for (const auto& key : part->keys) {
      const std::string absent = key.needed ? "**required**" : code_text(key.fallback);
      out += "| " + code_text(key.name) + " | " + table_cell(value_text(key)) + " | " + table_cell(absent) +
             " | " + table_cell(key.doc) + " |\n";
    }
  }
  return out;
}

}  // namespace multipanda
