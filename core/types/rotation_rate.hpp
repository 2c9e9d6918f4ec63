#pragma once

#include <cmath>

#include "core/types/spatial.hpp"

namespace multipanda {

// dJ/dt dr of the left Jacobian J(r) = I + a S(r) + b S(r)^2, a = (1 - cos t)/t^2, b = (t - sin t)/t^3, t =
// |r|: the angular acceleration of exp_rotation(r), in the parent frame, is J(r) ddr plus this term. It
// vanishes if r and dr are parallel, as in a motion from rest to rest.
inline Vector3 left_jacobian_rate(const Vector3& r, const Vector3& dr) {
  const double t2 = r.squaredNorm(), t = std::sqrt(t2), s = r.dot(dr);  // s = t dt/dtime
  double b = 1.0 / 6 - t2 / 120;
  double da = -1.0 / 12 + t2 / 180, db = -1.0 / 60 + t2 / 1260;  // (da/dt)/t, (db/dt)/t
  if (t > 0.05) {
    b = (t - std::sin(t)) / (t2 * t);
    da = (t * std::sin(t) - 2 * (1 - std::cos(t))) / (t2 * t2);
    db = (t * (1 - std::cos(t)) - 3 * (t - std::sin(t))) / (t2 * t2 * t);
  }
  const Vector3 once = r.cross(dr), twice = r.cross(once);
  // d/dt [a S dr + b S S dr] with dr held: a' S dr + a S' dr (= 0) + b' S S dr + b (S' S + S S') dr.
  return s * da * once + s * db * twice + b * dr.cross(once);
}

}  // namespace multipanda
