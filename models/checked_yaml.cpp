#include "models/checked_yaml.hpp"

#include <algorithm>
#include <cmath>
#include <set>
#include <stdexcept>

namespace multipanda {
namespace {

// Number of single-letter insertions, deletions and replacements between two words (Levenshtein).
std::size_t edit_distance(const std::string& a, const std::string& b) {
  std::vector<std::size_t> row(b.size() + 1);
  for (std::size_t j = 0; j <= b.size(); ++j) row[j] = j;
  for (std::size_t i = 1; i <= a.size(); ++i) {
    std::size_t diagonal = row[0];
    row[0] = i;
    for (std::size_t j = 1; j <= b.size(); ++j) {
      const std::size_t replaced = diagonal + (a[i - 1] == b[j - 1] ? 0 : 1);
      diagonal = row[j];
      row[j] = std::min({row[j] + 1, row[j - 1] + 1, replaced});
    }
  }
  return row[b.size()];
}

std::string listed(const std::vector<std::string>& names) {
  std::string text;
  for (const auto& name : names) text += (text.empty() ? "" : ", ") + name;
  return text;
}

}  // namespace

std::string suggestion(const std::string& name, const std::vector<std::string>& candidates) {
  if (candidates.empty()) return "";
  const auto nearest = std::min_element(
      candidates.begin(), candidates.end(),
      [&](const auto& a, const auto& b) { return edit_distance(name, a) < edit_distance(name, b); });
  if (edit_distance(name, *nearest) <= std::max<std::size_t>(2, name.size() / 3)) {
    return " Did you mean '" + *nearest + "'?";
  }
  return " Valid: " + listed(candidates) + ".";
}

CheckedYaml::CheckedYaml(YAML::Node node, std::shared_ptr<const std::string> file, std::string path, int line)
    : node_(std::move(node)), file_(std::move(file)), path_(std::move(path)), line_(line) {}

CheckedYaml CheckedYaml::load(const std::filesystem::path& file) {
  const auto name = std::make_shared<const std::string>(file.string());
  try {
    const YAML::Node root = YAML::LoadFile(file.string());
    return {root, name, "", 1};
  } catch (const YAML::BadFile&) {
    throw std::invalid_argument(*name + ": cannot be read; check that it exists and may be read");
  } catch (const YAML::ParserException& error) {
    throw std::invalid_argument(*name + ":" + std::to_string(error.mark.line + 1) +
                                ": this is not YAML: " + error.msg);
  }
}

void CheckedYaml::refuse(const std::string& why) const {
  throw std::invalid_argument(*file_ + ":" + std::to_string(line_) + ": " +
                              (path_.empty() ? "" : path_ + ": ") + why);
}

CheckedYaml CheckedYaml::child(const YAML::Node& node, const std::string& step, int line) const {
  return {node, file_, path_.empty() || step.front() == '[' ? path_ + step : path_ + "." + step, line};
}

void CheckedYaml::expect_map() const {
  if (!node_.IsMap()) refuse("expected a map (key: value)");
}

void CheckedYaml::allow_keys(const std::vector<std::string>& allowed) const {
  expect_map();
  std::set<std::string> seen;
  for (const auto& entry : node_) {
    const auto key = entry.first.as<std::string>();
    const CheckedYaml at_key = child(entry.first, key, entry.first.Mark().line + 1);
    if (std::find(allowed.begin(), allowed.end(), key) == allowed.end()) {
      at_key.refuse("unknown key." + suggestion(key, allowed));
    }
    if (!seen.insert(key).second) at_key.refuse("this key stands twice; remove one");
  }
}

std::optional<CheckedYaml> CheckedYaml::find(std::string_view key) const {
  expect_map();
  for (const auto& entry : node_) {
    const auto name = entry.first.as<std::string>();
    if (name == key) return child(entry.second, name, entry.first.Mark().line + 1);
  }
  return std::nullopt;
}

bool CheckedYaml::has(std::string_view key) const { return find(key).has_value(); }

CheckedYaml CheckedYaml::at(std::string_view key) const {
  if (auto found = find(key)) return *found;
  refuse("the key '" + std::string(key) + "' is missing");
}

std::vector<std::string> CheckedYaml::keys() const {
  expect_map();
  std::vector<std::string> names;
  for (const auto& entry : node_) names.push_back(entry.first.as<std::string>());
  return names;
}

std::vector<CheckedYaml> CheckedYaml::items() const {
  if (!node_.IsSequence()) refuse("expected a list");
  std::vector<CheckedYaml> list;
  for (std::size_t i = 0; i < node_.size(); ++i) {
    std::string step = "[";
    step.append(std::to_string(i)).append("]");
    list.push_back(child(node_[i], step, node_[i].Mark().line + 1));
  }
  return list;
}

std::string CheckedYaml::text() const {
  if (!node_.IsScalar()) refuse("expected a text");
  return node_.Scalar();
}

bool CheckedYaml::is_word(std::string_view word) const { return node_.IsScalar() && node_.Scalar() == word; }

double CheckedYaml::number() const {
  double value = 0;
  if (!node_.IsScalar() || !YAML::convert<double>::decode(node_, value)) {
    refuse("expected a number" + (node_.IsScalar() ? ", found '" + node_.Scalar() + "'" : std::string()));
  }
  if (!std::isfinite(value)) refuse("expected a finite number, found '" + node_.Scalar() + "'");
  return value;
}

double CheckedYaml::positive() const {
  const double value = number();
  if (value <= 0) refuse("expected a number above 0, found '" + node_.Scalar() + "'");
  return value;
}

double CheckedYaml::angle() const {
  const double value = number();
  constexpr double kFarBeyondAnyJoint = 20.0;  // more than three turns: somebody wrote degrees
  if (std::abs(value) > kFarBeyondAnyJoint) {
    refuse("expected an angle in radians, found '" + node_.Scalar() + "', which looks like degrees");
  }
  return value;
}

std::vector<double> CheckedYaml::numbers(std::size_t count) const {
  const auto list = items();
  if (list.size() != count) {
    refuse("expected " + std::to_string(count) + " numbers, found " + std::to_string(list.size()));
  }
  std::vector<double> values;
  for (const auto& item : list) values.push_back(item.number());
  return values;
}

Eigen::Vector3d CheckedYaml::vector3() const {
  const auto values = numbers(3);
  return {values[0], values[1], values[2]};
}

Eigen::Vector3d CheckedYaml::angles3() const {
  const Eigen::Vector3d values = vector3();
  for (const auto& item : items()) (void)item.angle();
  return values;
}

std::string CheckedYaml::one_of(const std::vector<std::string>& names, const char* what) const {
  const std::string name = text();
  if (std::find(names.begin(), names.end(), name) == names.end()) {
    refuse(std::string("expected ") + what + ", found '" + name + "'." + suggestion(name, names));
  }
  return name;
}

}  // namespace multipanda
