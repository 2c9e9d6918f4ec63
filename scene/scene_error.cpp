#include "scene/scene_error.hpp"

#include <utility>

namespace multipanda {
namespace {

std::string with_place(const SourcePlace& place, const std::string& message) {
  std::string text = place.file;
  if (place.line > 0) {
    text += ':';
    text += std::to_string(place.line);
  }
  text += ": ";
  text += message;
  return text;
}

}  // namespace

SceneError::SceneError(SourcePlace place, const std::string& message)
    : std::invalid_argument(with_place(place, message)), place_(std::move(place)) {}

}  // namespace multipanda
