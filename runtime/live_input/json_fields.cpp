#include "runtime/live_input/json_fields.hpp"

#include <algorithm>

#include "common/text.hpp"

namespace multipanda {
namespace {

constexpr std::size_t kQuoted = 60;  // characters of a wrong value that are repeated in a message

// Nested values are named by their kind: dumping them would recurse as deep as the sender chooses.
std::string quoted(const nlohmann::json& value) {
  if (value.is_array()) return "a list of " + std::to_string(value.size());
  if (value.is_object()) return "an object";
  std::string text = to_line(value);
  if (text.size() > kQuoted) text = text.substr(0, kQuoted) + "...";
  return text;
}

}  // namespace

JsonFields::JsonFields(const nlohmann::json& object, std::string what)
    : object_(object), what_(std::move(what)) {
  if (!object_.is_object()) refuse("expected an object, found " + quoted(object_));
}

void JsonFields::refuse(const std::string& reason) const {
  throw RequestRefused("malformed", what_ + ": " + reason);
}

void JsonFields::expected(const std::string& key, const std::string& expectation) const {
  if (!has(key)) refuse("'" + key + "' is missing; expected " + expectation);
  refuse("'" + key + "': expected " + expectation + ", found " + quoted(object_.at(key)));
}

void JsonFields::allow(const std::vector<std::string>& keys) const {
  for (const auto& item : object_.items()) {
    if (std::find(keys.begin(), keys.end(), item.key()) != keys.end()) continue;
    const auto same = same_quantity(item.key(), keys);
    refuse("unknown key '" + item.key().substr(0, kQuoted) + "'" +
           (same.empty() ? name_hint(item.key(), keys, "there are none")
                         : "; expected " + joined(same, " or ")));
  }
}

const nlohmann::json& JsonFields::at(const std::string& key) const {
  if (!has(key)) refuse("'" + key + "' is missing");
  return object_.at(key);
}

std::string JsonFields::text(const std::string& key) const {
  if (!has(key) || !object_.at(key).is_string()) expected(key, "a text");
  return object_.at(key).get<std::string>();
}

std::vector<std::string> JsonFields::texts(const std::string& key) const {
  if (!has(key)) return {};
  const auto& value = object_.at(key);
  if (value.is_string()) return {value.get<std::string>()};
  if (!value.is_array()) expected(key, "a list of names");
  std::vector<std::string> names;
  for (const auto& item : value) {
    if (!item.is_string()) expected(key, "a list of names");
    names.push_back(item.get<std::string>());
  }
  return names;
}

double JsonFields::number(const std::string& key) const {
  if (!has(key) || !object_.at(key).is_number()) expected(key, "a number");
  return object_.at(key).get<double>();
}

double JsonFields::number(const std::string& key, double fallback) const {
  return has(key) ? number(key) : fallback;
}

std::vector<double> JsonFields::numbers(const std::string& key, std::size_t count) const {
  const std::string expectation = "a list of " + std::to_string(count) + " numbers";
  if (!has(key) || !object_.at(key).is_array() || object_.at(key).size() != count) expected(key, expectation);
  return numbers(key, expectation);
}

std::vector<double> JsonFields::numbers(const std::string& key) const {
  if (has(key) && object_.at(key).is_number()) return {number(key)};
  const std::string expectation = "a list of numbers";
  if (!has(key) || !object_.at(key).is_array()) expected(key, expectation);
  return numbers(key, expectation);
}

std::vector<double> JsonFields::numbers(const std::string& key, const std::string& expectation) const {
  std::vector<double> numbers;
  for (const auto& item : object_.at(key)) {
    if (!item.is_number())
      refuse("'" + key + "': expected " + expectation + ", found " + quoted(item) + " in the list");
    numbers.push_back(item.get<double>());
  }
  return numbers;
}

bool JsonFields::boolean(const std::string& key, bool fallback) const {
  if (!has(key)) return fallback;
  if (!object_.at(key).is_boolean()) expected(key, "true or false");
  return object_.at(key).get<bool>();
}

JsonFields JsonFields::section(const std::string& key) const { return {at(key), what_ + ", " + key}; }

bool is_stop(const nlohmann::json& request) {
  return request.is_object() && request.contains("do") && request.at("do") == "stop";
}

std::vector<std::string> with_common(std::vector<std::string> keys) {
  keys.insert(keys.end(), {"id", "do", "asked_ns", "patience_s"});
  return keys;
}

std::string to_line(const nlohmann::json& json) {
  return json.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
}

}  // namespace multipanda
