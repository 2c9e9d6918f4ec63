#include "core/testing/lagging_motors.hpp"

#include <cmath>
#include <numbers>

#include "core/testing/dense_algebra.hpp"

namespace multipanda::test {

double growth_behind_motors(
    const std::function<JointVector(const JointVector& q, const JointVector& dq)>& torque,
    const JointVector& q, const Eigen::MatrixXd& M, Eigen::Index delay) {
  constexpr int kSteps = 10;
  constexpr double kStep = 0.001 / kSteps, kSmall = 1e-5;
  const double fade = std::exp(-2 * std::numbers::pi * 50 * kStep);
  const Eigen::Index n = q.size(), states = n * (3 + delay);
  const Eigen::MatrixXd M_inverse = inverse(M);
  Eigen::MatrixXd damping(n, n), stiffness(n, n);
  for (Eigen::Index i = 0; i < n; ++i) {
    JointVector dq = JointVector::Zero(n), moved = q;
    dq[i] = kSmall;
    moved[i] += kSmall;
    damping.col(i) = -torque(q, dq) / kSmall;
    stiffness.col(i) = -torque(moved, JointVector::Zero(n)) / kSmall;
  }
  Eigen::MatrixXd cycle(states, states);  // of position, velocity, motor torque, torques in the delay line
  for (Eigen::Index i = 0; i < states; ++i) {
    Eigen::VectorXd x = Eigen::VectorXd::Unit(states, i);
    const Eigen::VectorXd command = -stiffness * x.segment(0, n) - damping * x.segment(n, n);
    for (int k = 0; k < kSteps; ++k) {
      x.segment(2 * n, n) = (fade * x.segment(2 * n, n) + (1 - fade) * x.segment(3 * n, n)).eval();
      x.segment(n, n) += kStep * M_inverse * x.segment(2 * n, n);
      x.segment(0, n) += kStep * x.segment(n, n);
    }
    for (Eigen::Index k = 3; k + 1 < 3 + delay; ++k) x.segment(n * k, n) = x.segment(n * (k + 1), n).eval();
    x.tail(n) = command;
    cycle.col(i) = x;
  }
  return eigenvalues(cycle).cwiseAbs().maxCoeff();
}

JointVector pose_within_limits(Draw& draw, const ArmModel& model) {
  const JointVector& low = model.limits().q_min;
  const JointVector& high = model.limits().q_max;
  const JointVector share = draw.joints(model.joint_count(), 1.0);
  return 0.5 * (low + high) + 0.45 * share.cwiseProduct(high - low);
}

}  // namespace multipanda::test
