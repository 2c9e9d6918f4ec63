#include "backends/simulated_arm/joint_friction.hpp"

#include <cmath>

namespace multipanda {
namespace {

double sigmoid(double x) { return 1.0 / (1.0 + std::exp(-x)); }

}  // namespace

double friction_torque(const JointFriction& friction, std::size_t joint, double dq) {
  const auto i = static_cast<Eigen::Index>(joint);
  const double p1 = friction.p1[i], p2 = friction.p2[i], p3 = friction.p3[i];
  return p1 * (sigmoid(p2 * (dq + p3)) - sigmoid(p2 * p3));
}

double friction_slope(const JointFriction& friction, std::size_t joint, double dq) {
  const auto i = static_cast<Eigen::Index>(joint);
  const double s = sigmoid(friction.p2[i] * (dq + friction.p3[i]));
  return friction.p1[i] * friction.p2[i] * s * (1 - s);
}

}  // namespace multipanda
