#pragma once

#include <functional>
#include <map>
#include <optional>
#include <string>

namespace multipanda {

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
