#pragma once

#include <string>
#include <vector>

#include "runtime/motion/joint_move.hpp"
#include "scene/scene.hpp"

namespace multipanda {

// Where the arms come too close to each other, to themselves or to what stands in the scene, on the way of
// motions that begin together and take equally long: the pair of bodies that comes nearest, compared with its
// own distances at both ends. The shapes are those of collision avoidance, so a
// mounted tool counts only with its tool_shapes.
struct PathClearance {
  double at_start = 0, at_end = 0, least = 0;  // of this pair; infinite: all stay far apart [m]
  std::string pair;                            // "left link5, right hand"

  // Closer than `margin` where neither end of the path is. The ends do not count: an arm may start in
  // contact, but only what it touches there may be near on the way.
  bool blocked(double margin) const;
};

// `with_objects`: false: only planes, since a person has removed everything else.
PathClearance path_clearance(const Scene& scene, const std::vector<JointMove>& moves, bool with_objects);

}  // namespace multipanda
