#include <algorithm>
#include <cctype>
#include <charconv>
#include <cmath>

#include <nlohmann/json.hpp>

#include "yaml_reader/reference_page.hpp"

namespace multipanda {
namespace {

using Json = nlohmann::ordered_json;

// A reference is a URI: no spaces or brackets.
std::string definition_name(const Section& section) {
  std::string name;
  for (const char c : section.name) name += std::isalnum(static_cast<unsigned char>(c)) != 0 ? c : '_';
  return name;
}

Json reference(const Section& section) { return {{"$ref", "#/definitions/" + definition_name(section)}}; }

Json any_of(std::vector<Json> choices) {
  return choices.size() == 1 ? choices[0] : Json{{"anyOf", std::move(choices)}};
}

// YAML reads the string 5 as a number.
Json words_schema(const std::vector<std::string>& words) {
  Json list = Json::array();
  for (const auto& word : words) {
    list.push_back(word);
    int number = 0;
    const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), number);
    if (error == std::errc() && end == word.data() + word.size()) list.push_back(number);
  }
  return {{"enum", list}};
}

Json number_schema(const Key& key) {
  Json number = {{"type", key.kind == Key::Kind::integer ? "integer" : "number"}};
  if (std::isfinite(key.min)) number[key.open_below ? "exclusiveMinimum" : "minimum"] = key.min;
  if (std::isfinite(key.max)) number["maximum"] = key.max;
  if (!key.unit.starts_with("rad")) return number;
  return any_of({number, {{"type", "string"}, {"pattern", "^[-+]?([0-9.]+\\*)?pi(/[0-9.]+)?$"}}});
}

Json numbers_schema(const Key& key) {
  Json list = {{"type", "array"}, {"items", number_schema(key)}};
  if (key.count > 0) list["minItems"] = list["maxItems"] = key.count;
  std::vector<Json> choices{list};
  if (key.one_for_all) choices.push_back(number_schema(key));
  if (!key.words.empty()) choices.push_back(words_schema(key.words));
  return any_of(std::move(choices));
}

// A list of sections; sections with a name also as a mapping of names.
Json sections_schema(const Section& section) {
  Json item = reference(section);
  if (!section.has("name")) return {{"type", "array"}, {"items", item}};
  const Json named = {{"allOf", {item, {{"required", {"name"}}}}}};
  const Json by_name = {{"anyOf", {item, {{"type", "null"}}}}};
  return any_of(
      {{{"type", "array"}, {"items", named}}, {{"type", "object"}, {"additionalProperties", by_name}}});
}

Json value_schema(const Key& key) {
  const Json text = {{"type", "string"}};
  switch (key.kind) {
    case Key::Kind::text:
      return key.proposals.empty() ? text : any_of({words_schema(key.proposals), text});
    case Key::Kind::identifier:
      return {{"type", "string"}, {"pattern", "^[A-Za-z][A-Za-z0-9_]*$"}};
    case Key::Kind::choice:
      return words_schema(key.words);
    case Key::Kind::boolean:
      return {{"type", "boolean"}};
    case Key::Kind::integer:
    case Key::Kind::number:
      return number_schema(key);
    case Key::Kind::numbers:
      return numbers_schema(key);
    case Key::Kind::names: {
      const Json name = key.proposals.empty() ? text : any_of({words_schema(key.proposals), text});
      return any_of({name, {{"type", "array"}, {"items", name}}});
    }
    case Key::Kind::section:
      return key.text_alone ? any_of({reference(*key.parts[0]), text}) : reference(*key.parts[0]);
    case Key::Kind::sections:
      return sections_schema(*key.parts[0]);
    case Key::Kind::open:
      break;
  }
  if (key.parts.empty()) return Json::object();
  std::vector<Json> choices;
  for (const auto& part : key.parts) choices.push_back(reference(*part));
  return {{"type", "object"}, {"additionalProperties", any_of(std::move(choices))}};
}

Json key_schema(const Key& key) {
  Json schema = value_schema(key);
  if (schema.contains("$ref")) schema = {{"allOf", {schema}}};  // draft 7 ignores the keys next to $ref
  schema["description"] = key.doc + (key.unit.empty() ? "" : " [" + key.unit + "]");
  if (!key.fallback.empty()) {
    const Json value = Json::parse(key.fallback, nullptr, false);
    const bool text = value.is_discarded() || key.kind == Key::Kind::text || key.kind == Key::Kind::choice;
    schema["default"] = text ? Json(key.fallback) : value;
  }
  return schema;
}

Json section_schema(const Section& section) {
  Json keys = Json::object(), needed = Json::array();
  for (const auto& key : section.keys) {
    keys[key.name] = key_schema(key);
    if (key.needed && key.name != "name") needed.push_back(key.name);
  }
  Json schema = {{"type", "object"}};
  if (!section.doc.empty()) schema["description"] = section.doc;
  schema["properties"] = std::move(keys);
  schema["additionalProperties"] = false;
  if (!needed.empty()) schema["required"] = std::move(needed);
  return schema;
}

}  // namespace

nlohmann::ordered_json json_schema(const Section& section, const std::string& title) {
  Json schema = {{"$schema", "http://json-schema.org/draft-07/schema#"},
                 {"title", title},
                 {"allOf", {reference(section)}},
                 {"definitions", Json::object()}};
  for (const Section* part : all_sections(section))
    schema["definitions"][definition_name(*part)] = section_schema(*part);
  return schema;
}

}  // namespace multipanda
