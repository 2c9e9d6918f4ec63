#pragma once

#include <string>
#include <vector>

#include "runtime/motion/joint_move.hpp"
#include "scene/scene.hpp"

namespace multipanda {

// Where the arms come closest to each other, to themselves or to what is fixed in the scene, on the way of
// motions that begin together and take equally long. The shapes are those of collision avoidance, so a
// mounted tool counts only with its tool_shapes.
struct PathClearance {
  double at_start = 0, at_end = 0, least = 0;  // [m]
  std::string pair;                            // of the least: "left link5, right hand"

  // Closer than `margin` where neither end of the path is. The ends do not count: an arm may start in
  // contact.
  bool blocked(double margin) const;
};

// `with_objects`: false: only planes, since a person has removed everything else.
PathClearance path_clearance(const Scene& scene, const std::vector<JointMove>& moves, bool with_objects);

}  // namespace multipanda
