#pragma once

#include <cstdint>
#include <vector>

#include "arm_interface/arm_error.hpp"
#include "core/geometry/shape.hpp"
#include "core/model/model_terms.hpp"

namespace multipanda {

// The arm's self-collision avoidance: the arm stops when two parts that its model lists as a pair come nearer
// than kMargin. Distances of capsules and spheres are in closed form, those of other tool shapes are convex
// distances; bounding spheres are tested first. Other arms are unknown to the arm.
class SelfCollision {
 public:
  static constexpr double kMargin = 0.005;  // [m]

  explicit SelfCollision(const ArmModel& model);

  // Loop thread, no allocation; terms at the measured state. Parts that are too close when the arm accepts
  // commands again may move apart: they are checked against their distance at that time.
  void stand_at(ModelTerms& terms);
  // The distance of the nearest pair, if it is too small.
  ReflexDetail check(ModelTerms& terms);

 private:
  struct Body {
    int joint = -1;
    ConvexShape shape;
    Pose X_JS;
    bool is_segment = false;
    BoundingSphere sphere;   // in the joint's frame
    Vector3 p0, p1, center;  // now, in the world
    Pose X_WS;               // now
  };
  struct Pair {
    std::uint16_t a = 0, b = 0;
  };
  static void place(Body& body, const Pose& X_WJ);
  double nearest(ModelTerms& terms);  // at most kMargin

  std::vector<Body> bodies_;  // shapes that belong to a pair, by joint
  std::vector<Pair> pairs_;
  double margin_ = kMargin;
};

}  // namespace multipanda
