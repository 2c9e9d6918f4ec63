#include "scene/fields.hpp"

#include <charconv>
#include <cmath>

#include "scene/names.hpp"

namespace multipanda {
namespace {

std::string in_quotes(const std::vector<std::string>& words) {
  std::string text;
  for (std::size_t i = 0; i < words.size(); ++i) {
    text += (i == 0 ? "'" : i + 1 == words.size() ? " or '" : ", '") + words[i] + "'";
  }
  return text;
}

std::string kind_text(const Field& field) {
  switch (field.kind) {
    case FieldKind::text:
      return "a text";
    case FieldKind::identifier:
      return "a name (a letter, then letters, digits or _)";
    case FieldKind::choice:
      return field.choices.size() > 1 ? in_quotes(field.choices) : "a name";
    case FieldKind::boolean:
      return "true or false";
    case FieldKind::integer:
      return "a whole number";
    case FieldKind::number:
      return "a number";
    case FieldKind::numbers:
      if (field.count == Field::kPerJoint) return "a list of numbers, one per joint";
      if (field.count == Field::kByQuantity) return "a list of numbers, as many as the input carries";
      return "a list of " + std::to_string(field.count) + " numbers";
    case FieldKind::texts:
      return "a list of names";
    case FieldKind::section:
    case FieldKind::open:
      return "a mapping (key: value)";
    case FieldKind::sections:
      return "a list, each item a mapping (key: value)";
  }
  return "";
}

}  // namespace

std::vector<std::string> Section::keys() const {
  std::vector<std::string> list;
  for (const auto& field : fields) list.push_back(field.key);
  return list;
}

std::string number_text(double value) {
  char buffer[40];
  const auto [end, error] = std::to_chars(buffer, buffer + sizeof(buffer), value);
  return error == std::errc() ? std::string(buffer, end) : "?";
}

std::string bounds_text(double min, double max) {
  if (std::isfinite(min) && std::isfinite(max)) return number_text(min) + " to " + number_text(max);
  if (std::isfinite(min)) return "at least " + number_text(min);
  if (std::isfinite(max)) return "at most " + number_text(max);
  return "";
}

std::string expectation(const Field& field) {
  std::string text = kind_text(field);
  if (!field.unit.empty()) text += " [" + field.unit + "]";
  if (const std::string bounds = bounds_text(field.min, field.max); !bounds.empty()) text += ", " + bounds;
  if (!field.choices.empty() && field.kind != FieldKind::choice) text += ", or " + in_quotes(field.choices);
  return text;
}

}  // namespace multipanda
