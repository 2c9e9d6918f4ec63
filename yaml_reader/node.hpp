#pragma once

#include <memory>
#include <string>
#include <utility>
#include <vector>

#include <yaml-cpp/yaml.h>

#include "yaml_reader/config_error.hpp"
#include "yaml_reader/key.hpp"

namespace multipanda {

// A YAML value with its place in the file and the names that lead to it ("arm 'left': base"). All members
// throw ConfigError: file, line, what was found, what was expected. For use off the loop only.
class Node {
 public:
  Node(const Node&) = default;
  Node& operator=(const Node& other);  // YAML::Node's own assignment would write into the document

  // The one document in `text`; at most 1 MiB.
  static Node parse(const std::string& text, const std::string& file_name);
  static Node load(const std::string& file_name);

  const YAML::Node& yaml() const { return yaml_; }
  SourcePlace place() const { return {*file_, line_}; }
  const std::string& file() const { return *file_; }
  const std::string& what() const { return what_; }
  Node called(std::string what) const;            // the same value under another name
  Node text_here(const std::string& text) const;  // a text in the place of this value
  // Makes a path relative to the file's folder relative to the working directory.
  std::string resolved(const std::string& path) const;

  [[noreturn]] void refuse(const std::string& message) const;
  // Throws "expected ..., found ...".
  [[noreturn]] void expected(const std::string& expectation) const;

  bool is_null() const { return !yaml_.IsDefined() || yaml_.IsNull(); }
  bool is_list() const { return yaml_.IsSequence(); }
  bool is_map() const { return yaml_.IsMap(); }
  bool is_scalar() const { return yaml_.IsScalar(); }
  bool is_word(const std::vector<std::string>& words) const;

  std::vector<Node> items() const;                          // of a list
  std::vector<std::pair<std::string, Node>> pairs() const;  // of a mapping, in order; refuses duplicate keys
  Node key_of(const std::string& name) const;               // the key itself, for its place

  // Each checks what the key declares: type, bounds, unit, choices.
  std::string text(const Key& key) const;
  bool boolean(const Key& key) const;
  double number(const Key& key) const;
  std::vector<double> numbers(const Key& key) const;  // key.count of them
  std::vector<Node> names(const Key& key) const;      // a list, or one alone

 private:
  Node(std::shared_ptr<const std::string> file, YAML::Node yaml, int line, std::string what);

  std::shared_ptr<const std::string> file_;
  YAML::Node yaml_;  // a reference into the document
  int line_ = 0;
  std::string what_;
};

// The text as YAML in double quotes, whatever it contains.
std::string yaml_quoted(const std::string& text);

// Throws ConfigError if the file cannot be read.
std::string read_text(const std::string& file_name);

}  // namespace multipanda
