#pragma once

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

}  // namespace multipanda
