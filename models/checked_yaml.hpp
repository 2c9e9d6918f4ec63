#pragma once

#include <cstddef>
#include <filesystem>
#include <initializer_list>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include <Eigen/Core>
#include <yaml-cpp/yaml.h>

namespace multipanda {

// A YAML node that remembers its file and its path from the root, so that every refusal reads
// "file:line: path: expected ..., found ...". All members throw std::invalid_argument with such a text.
// For use off the loop only.
class CheckedYaml {
 public:
  // Reads a file. Throws if it is missing or is not YAML.
  static CheckedYaml load(const std::filesystem::path& file);

  // Throws unless this is a map whose keys are all in `allowed`, each there once. Names the nearest valid
  // key.
  void allow_keys(const std::vector<std::string>& allowed) const;

  bool has(std::string_view key) const;
  CheckedYaml at(std::string_view key) const;  // throws if the key is missing
  std::optional<CheckedYaml> find(std::string_view key) const;
  std::vector<std::string> keys() const;   // of a map, in the order of the file
  std::vector<CheckedYaml> items() const;  // of a list

  std::string text() const;
  bool is_word(std::string_view word) const;             // this text and no list or map
  double number() const;                                 // finite
  double positive() const;                               // finite, > 0
  double angle() const;                                  // [rad]
  Eigen::Vector3d vector3() const;                       // three numbers
  Eigen::Vector3d angles3() const;                       // three angles [rad]
  std::vector<double> numbers(std::size_t count) const;  // exactly `count`
  std::string one_of(const std::vector<std::string>& names, const char* what) const;  // a name in the list

  [[noreturn]] void refuse(const std::string& why) const;

  const std::string& file() const { return *file_; }
  int line() const { return line_; }  // counted from 1

 private:
  CheckedYaml(YAML::Node node, std::shared_ptr<const std::string> file, std::string path, int line);
  CheckedYaml child(const YAML::Node& node, const std::string& step, int line) const;
  void expect_map() const;

  YAML::Node node_;
  std::shared_ptr<const std::string> file_;
  std::string path_;  // for example "joints.joint3.position_m"
  int line_ = 0;
};

// " Did you mean 'x'?" if a candidate is near to `name`, else " Valid: a, b, c."
std::string suggestion(const std::string& name, const std::vector<std::string>& candidates);

}  // namespace multipanda
