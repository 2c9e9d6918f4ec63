#include "yaml_reader/config_error.hpp"

#include <utility>

namespace multipanda {
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
