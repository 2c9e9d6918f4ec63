#include "yaml_reader/node.hpp"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <numbers>
#include <sstream>
#include <utility>

#include "common/text.hpp"
#include "yaml_reader/config_error.hpp"

namespace multipanda {

namespace {

namespace fs = std::filesystem;

constexpr std::size_t kLargestFile = 1 << 20;  // [bytes] larger than any handwritten file

std::string description(const YAML::Node& node) {
  if (!node.IsDefined() || node.IsNull()) return "nothing";
  if (node.IsSequence()) return "a list of " + std::to_string(node.size());
  if (node.IsMap()) return "a mapping";
  return in_quotes(node.Scalar());
}

bool is_quoted(const YAML::Node& node) { return node.Tag() == "!"; }

// Line where a second YAML document begins, or 0. YAML::LoadAll does not return on some invalid texts.
int second_document(const std::string& text) {
  std::istringstream in(text);
  std::string line;
  bool content = false;
  for (int number = 1; std::getline(in, line); ++number) {
    if (line == "..." || line == "---" || line.starts_with("--- ")) {
      if (content) return number;
    } else {
      content = content || (!line.empty() && line[0] != '#' && line[0] != '%');
    }
  }
  return 0;
}

bool is_identifier(const std::string& text) {
  constexpr std::size_t kLongest = 60;
  if (text.empty() || text.size() > kLongest || std::isalpha(static_cast<unsigned char>(text[0])) == 0)
    return false;
  return std::all_of(text.begin(), text.end(),
                     [](char c) { return std::isalnum(static_cast<unsigned char>(c)) != 0 || c == '_'; });
}

}  // namespace

std::string read_text(const std::string& file_name) {
  std::ifstream in(file_name, std::ios::binary);
  std::ostringstream text;
  text << in.rdbuf();
  if (!in || fs::is_directory(file_name))
    throw ConfigError({file_name, 0}, "cannot be read; check that the file exists and is readable");
  return text.str();
}

Node::Node(std::shared_ptr<const std::string> file, YAML::Node yaml, int line, std::string what)
    : file_(std::move(file)), yaml_(std::move(yaml)), line_(line), what_(std::move(what)) {
  // An alias has the mark of its anchor, which is further up.
  if (!yaml_.Mark().is_null() && yaml_.Mark().line >= 0) line_ = std::max(line, yaml_.Mark().line + 1);
}

Node& Node::operator=(const Node& other) {
  file_ = other.file_;
  yaml_.reset(other.yaml_);
  line_ = other.line_;
  what_ = other.what_;
  return *this;
}

Node Node::parse(const std::string& text, const std::string& file_name) try {
  if (text.size() > kLargestFile) {
    throw ConfigError({file_name, 0}, "the file is larger than 1 MiB; expected a text file with YAML");
  }
  const YAML::Node root = YAML::Load(text);  // the first document
  if (const int line = second_document(text); line > 0)
    throw ConfigError({file_name, line}, "expected one YAML document, found a second one");
  return {std::make_shared<const std::string>(file_name), root, 1, ""};
} catch (const YAML::Exception& error) {
  throw ConfigError({file_name, error.mark.line + 1}, "not readable as YAML: " + error.msg);
}

Node Node::load(const std::string& file_name) { return parse(read_text(file_name), file_name); }

Node Node::called(std::string what) const { return {file_, yaml_, line_, std::move(what)}; }

Node Node::text_here(const std::string& text) const { return {file_, YAML::Node(text), line_, what_}; }

std::string Node::resolved(const std::string& path) const {
  return fs::path(path).is_absolute() ? path
                                      : (fs::path(*file_).parent_path() / path).lexically_normal().string();
}

void Node::refuse(const std::string& message) const {
  throw ConfigError(place(), (what_.empty() ? "" : what_ + ": ") + message);
}

void Node::expected(const std::string& expectation) const {
  refuse("expected " + expectation + ", found " + description(yaml_));
}

bool Node::is_word(const std::vector<std::string>& words) const {
  return is_scalar() && std::find(words.begin(), words.end(), yaml_.Scalar()) != words.end();
}

std::vector<Node> Node::items() const {
  std::vector<Node> list;
  for (const auto& item : yaml_) list.push_back({file_, item, line_, what_});
  return list;
}

std::vector<std::pair<std::string, Node>> Node::pairs() const {
  if (!is_map()) expected("a mapping (key: value)");
  std::vector<std::pair<std::string, Node>> list;
  FirstLines<> lines;
  for (const auto& pair : yaml_) {
    const Node key{file_, pair.first, line_, what_};
    if (!pair.first.IsScalar()) key.refuse("expected a string as key");
    const std::string& name = pair.first.Scalar();
    if (const auto first = lines.add(name, key.line_)) {
      key.refuse("duplicate key " + in_quotes(name) + ", first in line " + std::to_string(*first) +
                 "; remove one");
    }
    list.emplace_back(name, Node{file_, pair.second, key.line_, what_.empty() ? name : what_ + ": " + name});
  }
  return list;
}

Node Node::key_of(const std::string& name) const {
  for (const auto& pair : yaml_) {
    if (pair.first.IsScalar() && pair.first.Scalar() == name) return {file_, pair.first, line_, what_};
  }
  return *this;
}

std::string Node::text(const Key& key) const {
  if (!is_scalar()) expected(expectation(key));
  const std::string& text = yaml_.Scalar();
  if (key.kind == Key::Kind::identifier && !is_identifier(text)) expected(expectation(key));
  if (key.kind == Key::Kind::choice && !is_word(key.words)) {
    const std::string nearest = nearest_name(text, key.words);
    refuse("expected " + expectation(key) + ", found " + in_quotes(text) +
           (nearest.empty() ? "" : "; did you mean " + in_quotes(nearest) + "?"));
  }
  return text;
}

bool Node::boolean(const Key& key) const {
  if (is_quoted(yaml_) || !is_word({"true", "false"})) expected(expectation(key));
  return yaml_.Scalar() == "true";
}

double Node::number(const Key& key) const {
  double value = 0;
  if (!is_scalar()) expected(expectation(key));
  const std::string& text = yaml_.Scalar();
  if (is_quoted(yaml_)) expected(expectation(key) + " (without quotes)");
  if (!read_number(text, value)) {
    const bool digit = !text.empty() && std::isdigit(static_cast<unsigned char>(text[0])) != 0;
    const bool comma = text.find(',') != std::string::npos;
    expected(expectation(key) + (comma   ? " (with a decimal point)"
                                 : digit ? " (give the number only: the key names the unit)"
                                         : ""));
  }
  if (!std::isfinite(value)) expected(expectation(key) + " (finite)");
  if (key.kind == Key::Kind::integer && value != std::floor(value)) expected(expectation(key));
  if (key.unit == "rad" && std::abs(value) > key.largest_angle) {
    refuse("expected an angle in radians, found " + in_quotes(text) + ", which looks like degrees; " +
           number_text(value) + " degrees are " +
           number_text(std::round(value * std::numbers::pi / 180 * 1e6) / 1e6) + " rad");
  }
  if (value < key.min || value > key.max || (key.open_below && value == key.min)) expected(expectation(key));
  return value;
}

std::vector<double> Node::numbers(const Key& key) const {
  Key each = key;
  each.kind = Key::Kind::number;
  each.words.clear();
  if (key.one_for_all && is_scalar()) return std::vector<double>(key.count, number(each));
  if (!is_list() || (key.count > 0 && yaml_.size() != key.count)) {
    Key list = key;
    list.kind = Key::Kind::numbers;
    expected(expectation(list));
  }
  std::vector<double> values;
  for (const auto& item : items()) values.push_back(item.number(each));
  return values;
}

std::vector<Node> Node::names(const Key& key) const {
  if (!is_list() && !is_scalar()) expected(expectation(key));
  std::vector<Node> list = is_list() ? items() : std::vector<Node>{*this};
  for (const auto& item : list) {
    if (!item.is_scalar()) item.expected("a name");
  }
  return list;
}

std::string yaml_quoted(const std::string& text) {
  YAML::Emitter emitter;
  emitter << YAML::DoubleQuoted << text;
  return emitter.c_str();
}

namespace {

std::string with_place(const SourcePlace& place, const std::string& message) {
  std::string text = place.file;
  if (place.line > 0) text.append(":").append(std::to_string(place.line));
  return text.append(": ").append(message);
}

}  // namespace

ConfigError::ConfigError(SourcePlace place, const std::string& message)
    : std::invalid_argument(with_place(place, message)), place_(std::move(place)) {}

}  // namespace multipanda
