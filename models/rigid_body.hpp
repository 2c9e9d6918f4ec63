#pragma once

#include "core/types/spatial.hpp"

namespace multipanda {

// Mass properties of one link.
struct RigidBody {
  double mass = 0;                    // [kg]
  Vector3 com = Vector3::Zero();      // center of mass in the link frame [m]
  Matrix3 inertia = Matrix3::Zero();  // about the center of mass, axes of the link frame [kg m^2]
};

// The same body seen from frame A; X_AB places the frame B, in which `body` is given, in A.
RigidBody moved(const RigidBody& body, const Pose& X_AB);

// Two bodies rigidly joined; both in the same frame.
RigidBody merged(const RigidBody& a, const RigidBody& b);

// Whether the properties are physically consistent: mass above zero and the second moment of
// mass about the center of mass, tr(I)/2 * 1 - I, positive definite. It is the same as a positive definite
// pseudo-inertia, and implies the triangle inequality that physics engines ask for.
bool is_physical(const RigidBody& body);

}  // namespace multipanda
