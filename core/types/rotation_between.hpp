#pragma once

#include "core/types/spatial.hpp"

namespace multipanda {

// The shortest rotation that turns `from` into the direction of `to`, neither of them zero; if they are
// opposite, a half turn about any axis across them. Eigen's FromTwoVectors does it by a singular value
// decomposition, which takes seconds to compile wherever it is used.
inline Quaternion rotation_between(const Vector3& from, const Vector3& to) {
  const Vector3 a = from.normalized(), b = to.normalized();
  const double cosine = a.dot(b);
  Quaternion q;
  if (cosine < -1 + 1e-12) {
    q.w() = 0;
    q.vec() = a.unitOrthogonal();
  } else {
    q.w() = std::sqrt((1 + cosine) / 2);
    q.vec() = a.cross(b) / (2 * q.w());
  }
  return q.normalized();
}

}  // namespace multipanda
