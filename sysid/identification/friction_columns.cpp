#include "sysid/identification/friction_columns.hpp"

#include <cmath>
#include <stdexcept>

#include <fmt/format.h>

namespace multipanda {
namespace {

constexpr double kCoulombVelocity = 0.05;  // [rad/s]
constexpr double kStribeckRise = 0.01;     // [rad/s]
constexpr double kStribeckVelocity = 0.3;  // [rad/s]
// The state at a log's start is unknown. A moving joint has probably come some way in the same direction; a
// resting one may have come from either side.
constexpr double kMoving = 0.02;   // [rad/s]
constexpr double kComeFrom = 0.2;  // [rad]

double stribeck(double dq) {
  const double x = dq / kStribeckVelocity;
  return std::tanh(dq / kStribeckRise) * std::exp(-x * x);
}

// z <- s sign(dq) + (z - s sign(dq)) exp(-|dq| dt / s), exact while dq is constant; returned as z / s.
Eigen::MatrixXd presliding(double s, const Eigen::MatrixXd& dq, double dt) {
  Eigen::MatrixXd out(dq.rows(), dq.cols());
  for (Eigen::Index j = 0; j < dq.cols(); ++j) {
    const double first = dq.rows() > 0 ? dq(0, j) : 0.0;
    double z =
        std::abs(first) > kMoving ? std::copysign(1 - std::exp(-kComeFrom / s), first) : 0.0;  // over s
    for (Eigen::Index i = 0; i < dq.rows(); ++i) {
      const double v = dq(i, j), end = v > 0 ? 1.0 : v < 0 ? -1.0 : 0.0;
      z = end + (z - end) * std::exp(-std::abs(v) * dt / s);
      out(i, j) = z;
    }
  }
  return out;
}

double sigmoid(double p2, double p3, double dq) {
  return 1 / (1 + std::exp(-p2 * (dq + p3))) - 1 / (1 + std::exp(-p2 * p3));
}

}  // namespace

std::string to_string(const FrictionPart& part) {
  switch (part.kind) {
    case FrictionKind::offset:
      return "offset";
    case FrictionKind::viscous:
      return "viscous";
    case FrictionKind::stribeck:
      return "stribeck";
    case FrictionKind::coulomb:
      return "coulomb";
    case FrictionKind::sigmoid:
      return "sigmoid";
    case FrictionKind::presliding:
      return fmt::format("presliding {:g} mrad", 1e3 * part.distance);
    case FrictionKind::acceleration:
      return "joint inertia";
  }
  return {};
}

std::string unit_of(const FrictionPart& part) {
  if (part.kind == FrictionKind::viscous) return "N m s/rad";
  return part.kind == FrictionKind::acceleration ? "kg m^2" : "N m";
}

bool has_sign(const FrictionPart& part) { return part.kind != FrictionKind::offset; }

Eigen::MatrixXd friction_column(const FrictionPart& part, const Eigen::MatrixXd& dq,
                                const Eigen::MatrixXd& ddq, const std::optional<JointFriction>& table,
                                double dt) {
  switch (part.kind) {
    case FrictionKind::offset:
      return Eigen::MatrixXd::Ones(dq.rows(), dq.cols());
    case FrictionKind::viscous:
      return dq;
    case FrictionKind::stribeck:
      return dq.unaryExpr(&stribeck);
    case FrictionKind::coulomb:
      return (dq / kCoulombVelocity).array().tanh();
    case FrictionKind::presliding:
      return presliding(part.distance, dq, dt);
    case FrictionKind::acceleration:
      return ddq;
    case FrictionKind::sigmoid:
      break;
  }
  if (!table)
    throw std::invalid_argument("friction with the shape of the table: the robot has no friction table");
  Eigen::MatrixXd out(dq.rows(), dq.cols());
  for (Eigen::Index j = 0; j < dq.cols(); ++j) {
    out.col(j) = dq.col(j).unaryExpr([&](double v) { return sigmoid(table->p2[j], table->p3[j], v); });
  }
  return out;
}

Eigen::MatrixXd friction_torque(const JointFriction& table, const Eigen::MatrixXd& dq) {
  Eigen::MatrixXd out = friction_column({FrictionKind::sigmoid}, dq, dq, table, kCoulombVelocity);
  for (Eigen::Index j = 0; j < dq.cols(); ++j) out.col(j) *= table.p1[j];
  return out;
}

Eigen::MatrixXd friction_torque(const FrictionLaw& law, const Eigen::MatrixXd& dq, double dt) {
  Eigen::MatrixXd out = Eigen::MatrixXd::Zero(dq.rows(), dq.cols());
  const auto add = [&](const FrictionPart& part, const JointVector& amplitude) {
    if (amplitude.size() == 0) return;
    out += friction_column(part, dq, dq, {}, dt) * amplitude.asDiagonal();
  };
  add({FrictionKind::offset}, law.offset);
  add({FrictionKind::viscous}, law.viscous);
  add({FrictionKind::stribeck}, law.stribeck);
  for (const PreslidingElement& e : law.presliding) add({FrictionKind::presliding, e.distance}, e.amplitude);
  if (law.sigmoid) out += friction_torque(*law.sigmoid, dq);
  return out;
}

}  // namespace multipanda
