#pragma once

#include <string>

#include "core/geometry/shape.hpp"

namespace multipanda {

// Something that stands in the world and does not move: a table, a wall, a floor.
struct Obstacle {
  std::string name;
  ConvexShape shape;
  Pose X_WO;  // the shape's frame in the world
};

}  // namespace multipanda
