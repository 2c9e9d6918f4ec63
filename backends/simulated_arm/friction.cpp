#include "backends/simulated_arm/friction.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace multipanda {
namespace {

double sigmoid(double x) { return 1.0 / (1.0 + std::exp(-x)); }

constexpr double kSteep = 0.01, kFade = 0.3;  // of the Stribeck part, as in FrictionLaw [rad/s]

double direction(double dq) { return dq > 0 ? 1.0 : dq < 0 ? -1.0 : 0.0; }

double stribeck(double amplitude, double dq) {
  return amplitude * std::tanh(dq / kSteep) * std::exp(-dq * dq / (kFade * kFade));
}

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

LinkFriction::LinkFriction(FrictionLaw law, std::size_t joint_count) : law_(std::move(law)) {
  const auto n = static_cast<Eigen::Index>(joint_count);
  const auto check = [n](const JointVector& v, bool optional) {
    if (v.size() != n && !(optional && v.size() == 0)) {
      throw std::invalid_argument("friction beyond the torque sensor is given for " +
                                  std::to_string(v.size()) + " joints, the arm has " + std::to_string(n));
    }
  };
  for (const auto* v : {&law_.offset, &law_.viscous, &law_.stribeck}) check(*v, true);
  for (const auto& element : law_.presliding) check(element.amplitude, false);
  if (law_.sigmoid) {
    for (const auto* v : {&law_.sigmoid->p1, &law_.sigmoid->p2, &law_.sigmoid->p3}) check(*v, false);
  }
  constant_ = slope_ = JointVector::Zero(n);
  state_.assign(law_.presliding.size(), JointVector::Zero(n));
}

void LinkFriction::reset() {
  for (auto& state : state_) state.setZero();
  dq_before_.resize(0);
}

void LinkFriction::add(Eigen::Index joint, double torque, double slope, double dq) {
  constant_[joint] += torque - slope * dq;
  slope_[joint] += slope;
}

void LinkFriction::begin(const JointVector& dq, const JointVector& inertia, double dt) {
  constant_.setZero();
  slope_.setZero();
  for (Eigen::Index i = 0; i < dq.size(); ++i) {
    const double v_now = dq[i], v = dq_before_.size() == 0 ? v_now : 2 * v_now - dq_before_[i];
    if (law_.offset.size() > 0) constant_[i] += law_.offset[i];
    if (law_.viscous.size() > 0) slope_[i] += law_.viscous[i];
    if (law_.stribeck.size() > 0 && law_.stribeck[i] > 0) {
      const double now = stribeck(law_.stribeck[i], v_now);
      if (std::abs(now) * dt > 0.5 * inertia[i] * std::abs(v_now)) {
        slope_[i] += v_now == 0 ? law_.stribeck[i] / kSteep : now / v_now;
      } else {
        const double ahead = stribeck(law_.stribeck[i], v);
        add(i, ahead, v == v_now ? 0.0 : std::max(0.0, (ahead - now) / (v - v_now)), v);
      }
    }
    for (std::size_t e = 0; e < state_.size(); ++e) {
      const double s = law_.presliding[e].distance, a = law_.presliding[e].amplitude[i], z = state_[e][i];
      const double sign = direction(v), decay = std::exp(-std::abs(v) * dt / s);
      const double z_end = s * sign + (z - s * sign) * decay;
      add(i, a * (v == 0 ? z : z_end) / s, a / s * dt * (1 - sign * z / s) * decay, v);
    }
    if (law_.sigmoid) {
      const auto joint = static_cast<std::size_t>(i);
      add(i, friction_torque(*law_.sigmoid, joint, v), friction_slope(*law_.sigmoid, joint, v), v);
    }
  }
  dq_before_ = dq;
}

void LinkFriction::end(const JointVector& dq_after, double dt) {
  for (std::size_t e = 0; e < state_.size(); ++e) {
    const double s = law_.presliding[e].distance;
    for (Eigen::Index i = 0; i < dq_after.size(); ++i) {
      const double end = s * direction(dq_after[i]);
      if (dq_after[i] != 0)
        state_[e][i] = end + (state_[e][i] - end) * std::exp(-std::abs(dq_after[i]) * dt / s);
    }
  }
}

}  // namespace multipanda
