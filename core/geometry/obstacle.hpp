#pragma once

#include <string>

#include "core/geometry/shape.hpp"

namespace multipanda {

// A fixed object in the world, such as a table, a wall or the floor.
struct Obstacle {
  std::string name;
  ConvexShape shape;
  Pose X_WO;  // the shape's frame in the world
};

}  // namespace multipanda
