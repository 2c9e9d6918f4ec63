#pragma once

#include "core/reference/reference.hpp"

namespace multipanda {

// A parameter that displaces set-points, as a reference: a new value is approached with continuous velocity
// and acceleration, within a speed limit, as a goal of an input is. The ramp of other parameters takes 0.2 s
// however far the value is. Loop thread.
class OffsetReference {
 public:
  OffsetReference();
  void start(const Vector3& offset);  // starts at this offset, at rest
  // Advances by dt towards `goal`. `max_speed`: of the input that the offset displaces [m/s].
  void advance(const Vector3& goal, double max_speed, double dt);

  const Vector3& position() const { return reference_.pose().position; }  // [m]
  Vector3 velocity() const { return reference_.twist().linear(); }
  Vector3 acceleration() const { return reference_.acceleration().linear(); }
  // Largest contribution to the speed of the displaced set-point until the goal is reached [m/s]; `max_speed`
  // as above.
  double top_speed(double max_speed) const;

  // Share of the input's speed limit. Two hands that a common offset moves towards each other meet at no more
  // than that limit.
  static constexpr double kShare = 0.5;

 private:
  Reference reference_;
  Vector3 goal_ = Vector3::Zero();
};

}  // namespace multipanda
