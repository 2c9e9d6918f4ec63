#pragma once

#include <functional>
#include <map>
#include <optional>
#include <stdexcept>
#include <string>

namespace multipanda {

// Where a value is written, for messages: "two_arms.yaml:14".
struct SourcePlace {
  std::string file;
  int line = 0;  // from 1; 0: not from a file
};

// The common error of all configuration readers. what() is complete: "two_arms.yaml:14: arm 'left': ...",
// with what was found, what was expected, and the nearest valid name.
class ConfigError : public std::invalid_argument {
 public:
  ConfigError(SourcePlace place, const std::string& message);
  const SourcePlace& place() const { return place_; }

 private:
  SourcePlace place_;
};

// The line where each name was first written. Files may have thousands of names, so lookup is not linear.
// Less: for the test that counts comparisons.
template <typename Less = std::less<>>
class FirstLines {
 public:
  explicit FirstLines(Less less = {}) : lines_(less) {}
  // The line of an earlier `name`, or none; then it is in line `line`.
  std::optional<int> add(const std::string& name, int line) {
    const auto [first, added] = lines_.emplace(name, line);
    return added ? std::nullopt : std::optional<int>(first->second);
  }

 private:
  std::map<std::string, int, Less> lines_;
};

}  // namespace multipanda
