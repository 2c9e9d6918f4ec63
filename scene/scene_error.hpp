#pragma once

#include <stdexcept>
#include <string>

#include "scene/scene.hpp"

namespace multipanda {

// The one refusal of everything that reads scenes. what() is complete: "two_arms.yaml:14: arm 'left': ...",
// with what was found, what was expected, and the nearest valid name.
class SceneError : public std::invalid_argument {
 public:
  SceneError(SourcePlace place, const std::string& message);
  const SourcePlace& place() const { return place_; }

 private:
  SourcePlace place_;
};

}  // namespace multipanda
