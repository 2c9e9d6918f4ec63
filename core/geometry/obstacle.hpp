#pragma once

#include <string>

#include "core/geometry/shape.hpp"

namespace multipanda {

// A fixed object in the world, such as a table, a wall or the floor. Nothing pushes it, but the timeline of a
// simulation may place it elsewhere.
struct Obstacle {
  std::string name;
  ConvexShape shape;
  Pose X_WO;               // the shape's frame in the world
  bool is_placed = false;  // a simulation may put it elsewhere during the run
};

}  // namespace multipanda
