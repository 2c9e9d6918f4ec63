#pragma once

#include <cstdint>
#include <vector>

#include "backends/arm/arm_error.hpp"
#include "core/geometry/distance.hpp"
#include "core/model/model_terms.hpp"

namespace multipanda {

// The arm's own avoidance of itself: it stops when two of its parts that its model pairs come nearer than
// kMargin. Capsules and spheres by their closed form, other shapes of tools by their convex distance, all
// behind a test of bounding spheres. Other arms are nothing that an arm knows of.
class SelfCollision {
 public:
  static constexpr double kMargin = 0.005;  // [m]

  explicit SelfCollision(const ArmModel& model);

  // Loop thread, no allocation; terms at the measured state.
  // Parts that are too near when the arm takes commands again may part: they are watched from there.
  void stand_at(ModelTerms& terms);
  // The distance of the nearest pair, if it is too near.
  ReflexDetail check(ModelTerms& terms);

 private:
  struct Body {
    int joint = -1;
    ConvexShape shape;
    Pose X_JS;
    bool is_segment = false;
    BoundingSphere sphere;   // in the joint's frame
    Vector3 p0, p1, centre;  // now, in the world
    Pose X_WS;               // now
  };
  struct Pair {
    std::uint16_t a = 0, b = 0;
  };
  static void place(Body& body, const Pose& X_WJ);
  double nearest(ModelTerms& terms);  // at most kMargin

  std::vector<Body> bodies_;  // those of some pair, by joint
  std::vector<Pair> pairs_;
  double margin_ = kMargin;
};

}  // namespace multipanda
