#pragma once

#include <vector>

#include <pinocchio/spatial.hpp>

#include "core/model/arm_model.hpp"

namespace multipanda {

// A joint and the link behind it. Private to core/model: Pinocchio's headers are slow to compile.
struct ChainJoint {
  ChainJoint(bool prismatic, const Vector3& axis, const pinocchio::SE3& X_PJ);

  // The frame of the joint at position q [rad or m], in the frame in which it is `at_zero` at zero.
  pinocchio::SE3 moved(double q, const pinocchio::SE3& at_zero) const {
    pinocchio::SE3 X = at_zero;
    auto& R = X.rotation();
    if (prismatic) {
      X.translation() += R * (q * axis);
    } else if (coordinate < 0) {
      R = R * Eigen::AngleAxisd(q, axis).toRotationMatrix();
    } else {
      const int a = (coordinate + 1) % 3, b = (coordinate + 2) % 3;
      R.col(a) = std::cos(q) * R.col(a) + std::sin(q) * R.col(b);
      R.col(b) = R.col(coordinate).cross(R.col(a));
    }
    return X;
  }
  // Linear and angular velocity at the world's origin that unit speed of the joint gives, world axes.
  Vector6 twist(const pinocchio::SE3& X_WJ) const {
    const Vector3 a =
        coordinate < 0 ? Vector3(X_WJ.rotation() * axis) : Vector3(X_WJ.rotation().col(coordinate));
    Vector6 S;
    if (prismatic) {
      S << a, Vector3::Zero();
    } else {
      S << X_WJ.translation().cross(a), a;
    }
    return S;
  }

  bool prismatic;
  Vector3 axis;         // of length one, in the joint's frame
  int coordinate = -1;  // of the axis, if it is one of the frame's (x is 0)
  pinocchio::SE3 X_PJ;  // at zero, in the frame of the joint before; the first one's in the world
  pinocchio::Inertia link = pinocchio::Inertia::Zero();
};

struct ArmModel::Chain {
  std::vector<ChainJoint> joints;
  pinocchio::Inertia base = pinocchio::Inertia::Zero();
  pinocchio::SE3 X_JF = pinocchio::SE3::Identity();  // flange in the last joint's frame
  ArmLimits limits;                                  // those of the URDF
};

// The inertia in joint frame J of a body whose center of mass and inertia are given in the flange's frame.
pinocchio::Inertia inertia_in_joint(const pinocchio::SE3& X_JF, const Load& load);

}  // namespace multipanda
