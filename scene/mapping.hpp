#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <yaml-cpp/yaml.h>

#include "scene/fields.hpp"
#include "scene/scene_error.hpp"

// Reading of YAML against a table of fields, for readers of scene and experiment files.
namespace multipanda {

// The file being read, for messages.
struct SceneFile {
  std::string name;    // as messages show it
  std::string folder;  // relative paths in the scene start here
};

// A value with the place where it stands and the words that lead to it ("arm 'left': base").
class Entry {
 public:
  Entry(const SceneFile& file, YAML::Node node, int line, std::string what);
  Entry(const Entry&) = default;
  Entry& operator=(const Entry& other);  // YAML::Node's own assignment would write into the document

  const YAML::Node& node() const { return node_; }
  SourcePlace place() const { return {file_->name, line_}; }
  const SceneFile& file() const { return *file_; }
  const std::string& what() const { return what_; }

  // Throws SceneError "file:line: what: message".
  [[noreturn]] void refuse(const std::string& message) const;
  // Throws "expected ..., found ...".
  [[noreturn]] void expected(const std::string& expectation) const;

  bool is_list() const { return node_.IsSequence(); }
  std::vector<Entry> items() const;  // of a list
  bool is_word(const std::vector<std::string>& words) const;

  // All check type, bounds and unit of the field and throw SceneError.
  std::string text(const Field& field) const;
  bool boolean(const Field& field) const;
  double number(const Field& field) const;
  std::vector<double> numbers(const Field& field, std::size_t count) const;
  std::vector<Entry> text_items(const Field& field) const;

  Entry as(std::string what) const;  // the same value, other words

 private:
  const SceneFile* file_;
  YAML::Node node_;
  int line_;
  std::string what_;
};

// A mapping, read by a Section: the constructor refuses unknown, doubled and missing keys; the accessors
// check what they read and take the section's fallback where the key is absent.
class Mapping {
 public:
  Mapping(Entry entry, const Section& section);

  bool has(const std::string& key) const;
  // Keys of `keys` that are present.
  std::vector<std::string> present(const std::vector<std::string>& keys) const;
  Entry entry(const std::string& key) const;  // present, or the fallback

  std::string text(const std::string& key) const { return entry(key).text(field(key)); }
  bool boolean(const std::string& key) const { return entry(key).boolean(field(key)); }
  double number(const std::string& key) const { return entry(key).number(field(key)); }
  std::vector<double> numbers(const std::string& key) const;
  std::vector<double> numbers(const std::string& key, std::size_t count) const {
    return entry(key).numbers(field(key), count);
  }
  Vector3 vector3(const std::string& key) const;
  std::vector<Entry> text_items(const std::string& key) const;  // absent without fallback: empty
  // Of `sections`; absent: empty. Sections that have a name may also stand as a mapping, name: section.
  std::vector<Entry> items(const std::string& key) const;
  Mapping section(const std::string& key) const;  // of a `section`
  // Words of the messages about this mapping and its values: "arm 'left'".
  void rename(std::string what);

  const Entry& self() const { return self_; }
  const Field& field(const std::string& key) const;

 private:
  Entry self_;
  const Section* section_;
  std::vector<std::pair<std::string, Entry>> entries_;
};

// Key and value of each pair of an open mapping, doubled keys refused.
std::vector<std::pair<std::string, Entry>> pairs_of(const Entry& entry);

// Quoted names, for messages.
std::string in_quotes(const std::string& name);

}  // namespace multipanda
