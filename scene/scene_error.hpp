#pragma once

#include <stdexcept>
#include <string>

#include "scene/scene.hpp"

namespace multipanda {

// The one refusal of everything that reads scenes. what() is complete: "two_arms.yaml:14: arm 'left': ...",
// with what was found, what was expected, and the nearest valid name.
class SceneError : public std::invalid_argument {
 public:
  SceneError(SourcePlace place, const std::string& message)
      : std::invalid_argument(text(place) + message), place_(std::move(place)) {}
  const SourcePlace& place() const { return place_; }

 private:
  static std::string text(const SourcePlace& place) {
    return place.file + (place.line > 0 ? ":" + std::to_string(place.line) : "") + ": ";
  }
  SourcePlace place_;
};

}  // namespace multipanda
