#include <algorithm>
#include <cctype>
#include <charconv>
#include <cmath>
#include <numbers>

#include "scene/mapping.hpp"
#include "scene/names.hpp"

namespace multipanda {
namespace {

// Beyond one turn nobody means an angle of an arm or of a pose.
constexpr double kLargestAngle = 2 * std::numbers::pi + 1e-9;
constexpr std::size_t kLongestQuote = 60;

std::string cut(const std::string& text) {
  std::string clean;
  for (const char c : text.substr(0, kLongestQuote)) {
    clean += static_cast<unsigned char>(c) < 0x20 ? ' ' : c;
  }
  return text.size() > kLongestQuote ? clean + "..." : clean;
}

std::string description(const YAML::Node& node) {
  if (!node.IsDefined() || node.IsNull()) return "nothing";
  if (node.IsSequence()) return "a list of " + std::to_string(node.size());
  if (node.IsMap()) return "a mapping";
  return in_quotes(node.Scalar());
}

bool is_quoted(const YAML::Node& node) { return node.Tag() == "!"; }

bool read_decimal(std::string_view text, double& value) {
  if (text.starts_with('+')) text.remove_prefix(1);
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error == std::errc::result_out_of_range) value = std::numeric_limits<double>::infinity();
  return (error == std::errc() || error == std::errc::result_out_of_range) &&
         end == text.data() + text.size();
}

// A decimal number, or a multiple of pi as "pi", "-pi/2", "3*pi/4"; .inf and .nan are YAML's own words.
bool read_number(std::string text, double& value) {
  if (text == ".inf" || text == "+.inf" || text == "-.inf" || text == ".nan" || text == ".NaN" ||
      text == ".Inf") {
    value = std::numeric_limits<double>::quiet_NaN();
    return true;
  }
  const std::size_t at = text.find("pi");
  if (at == std::string::npos) return read_decimal(text, value);
  std::string before = text.substr(0, at), after = text.substr(at + 2);
  double factor = 1, divisor = 1;
  if (before == "-" || before == "+" || before.empty()) {
    factor = before == "-" ? -1 : 1;
  } else if (before.back() != '*' || !read_decimal(before.substr(0, before.size() - 1), factor)) {
    return false;
  }
  if (!after.empty() && (after[0] != '/' || !read_decimal(after.substr(1), divisor))) return false;
  value = factor * std::numbers::pi / divisor;
  return true;
}

}  // namespace

std::string in_quotes(const std::string& name) {
  std::string text = "'";
  text += cut(name);
  text += '\'';
  return text;
}

Entry::Entry(const SceneFile& file, YAML::Node node, int line, std::string what)
    : file_(&file), node_(std::move(node)), line_(line), what_(std::move(what)) {
  if (!node_.Mark().is_null() && node_.Mark().line >= 0) line_ = std::max(line, node_.Mark().line + 1);
}

Entry& Entry::operator=(const Entry& other) {
  file_ = other.file_;
  node_.reset(other.node_);
  line_ = other.line_;
  what_ = other.what_;
  return *this;
}

void Entry::refuse(const std::string& message) const {
  throw SceneError(place(), (what_.empty() ? "" : what_ + ": ") + message);
}

void Entry::expected(const std::string& expectation) const {
  refuse("expected " + expectation + ", found " + description(node_));
}

Entry Entry::as(std::string what) const { return {*file_, node_, line_, std::move(what)}; }

std::vector<Entry> Entry::items() const {
  std::vector<Entry> list;
  for (const auto& item : node_) list.emplace_back(*file_, item, line_, what_);
  return list;
}

bool Entry::is_word(const std::vector<std::string>& words) const {
  return node_.IsScalar() && std::find(words.begin(), words.end(), node_.Scalar()) != words.end();
}

std::string Entry::text(const Field& field) const {
  if (!node_.IsScalar()) expected(expectation(field));
  const std::string& text = node_.Scalar();
  if (field.kind == FieldKind::choice && !is_word(field.choices)) {
    const std::string nearest = nearest_name(text, field.choices);
    refuse("expected " + expectation(field) + ", found " + description(node_) +
           (nearest.empty() ? "" : "; did you mean " + in_quotes(nearest) + "?"));
  }
  if (field.kind == FieldKind::identifier) {
    constexpr std::size_t kLongestName = 60;
    bool valid = !text.empty() && text.size() <= kLongestName &&
                 std::isalpha(static_cast<unsigned char>(text[0])) != 0;
    for (const char c : text) valid = valid && (std::isalnum(static_cast<unsigned char>(c)) != 0 || c == '_');
    if (!valid) expected(expectation(field));
  }
  return text;
}

bool Entry::boolean(const Field& field) const {
  if (!node_.IsScalar() || is_quoted(node_) || !is_word({"true", "false"})) expected(expectation(field));
  return node_.Scalar() == "true";
}

double Entry::number(const Field& field) const {
  double value = 0;
  if (!node_.IsScalar()) expected(expectation(field));
  const std::string& text = node_.Scalar();
  if (is_quoted(node_)) expected(expectation(field) + " (without quotes)");
  if (!read_number(text, value)) {
    std::string hint;
    if (text.find(',') != std::string::npos) hint = " (the decimal sign is a point)";
    if (!text.empty() && std::isdigit(static_cast<unsigned char>(text[0])) != 0 && hint.empty()) {
      hint = " (the number alone: the key carries the unit)";
    }
    expected(expectation(field) + hint);
  }
  if (!std::isfinite(value)) expected(expectation(field) + " (finite)");
  if (field.kind == FieldKind::integer && value != std::floor(value)) expected(expectation(field));
  if (field.unit == "rad" && std::abs(value) > kLargestAngle) {
    refuse("expected an angle in radians, found " + in_quotes(text) + ", which looks like degrees; " +
           number_text(value) + " degrees are " +
           number_text(std::round(value * std::numbers::pi / 180 * 1e6) / 1e6) + " rad");
  }
  if (value < field.min || value > field.max) expected(expectation(field));
  return value;
}

std::vector<double> Entry::numbers(const Field& field, std::size_t count) const {
  Field exact = field;  // tells the number of joints, now that it is known
  exact.kind = FieldKind::numbers;
  exact.count = count;
  if (!node_.IsSequence()) expected(expectation(exact));
  if (node_.size() != count) expected(expectation(exact));
  std::vector<double> values;
  Field each = field;
  each.kind = FieldKind::number;
  each.choices.clear();
  for (const auto& item : items()) values.push_back(item.number(each));
  return values;
}

std::vector<Entry> Entry::text_items(const Field& field) const {
  if (!node_.IsSequence() && !node_.IsScalar()) expected(expectation(field));
  std::vector<Entry> list = node_.IsSequence() ? items() : std::vector<Entry>{*this};
  for (const auto& item : list) {
    if (!item.node().IsScalar()) item.expected("a name");
  }
  return list;
}

}  // namespace multipanda
