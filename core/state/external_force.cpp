#include "core/state/external_force.hpp"

#include <numbers>

#include "core/types/triangular.hpp"

namespace multipanda {
namespace {

// Packets farther apart than this are not combined, because tau_J is the mean over one period only.
constexpr double kLongestGap = 0.02;  // [s]

// A regular pose has eigenvalues of J J^T above 0.01, so this costs less than 1e-4 of a force there; in a
// singular pose no wrench exceeds 500 times the joint torque it comes from.
constexpr double kEps = 1e-6;

}  // namespace

ExternalForceObserver::ExternalForceObserver(std::size_t joint_count, double bandwidth_hz)
    : rate_(2 * std::numbers::pi * bandwidth_hz) {
  residual_ = momentum_ = drift_ = JointVector::Zero(static_cast<Eigen::Index>(joint_count));
}

void ExternalForceObserver::reset() {
  residual_.setZero();
  started_ = false;
}

void ExternalForceObserver::update(const Model& model, ArmState& state) {
  const double dt = seconds(state.t_robot - t_);
  const auto& [momentum, drift, J_V_WK] = model;
  const bool finite = momentum.allFinite() && drift.allFinite() && state.tau_J.allFinite();
  if (finite) {
    // A load or frame declared between two packets changes p without any force.
    const bool follows = started_ && dt > 0 && dt <= kLongestGap && state.config_version == config_version_;
    if (follows) {
      const JointVector push = momentum - momentum_ - dt * (state.tau_J + 0.5 * (drift_ + drift));
      residual_ = (residual_ + rate_ * push) / (1 + rate_ * dt);
    }
    if (!started_ || dt != 0) {
      momentum_ = momentum;
      drift_ = drift;
      t_ = state.t_robot;
      config_version_ = state.config_version;
    }
    started_ = true;
  }
  state.tau_ext_hat = -residual_;
  if (!finite) return;
  state.F_K_W_est = wrench_of(J_V_WK, state.tau_ext_hat);
  state.has_wrench_estimate = true;
}

Wrench wrench_of(const Jacobian& J_V_WK, const JointVector& tau) {
  Matrix6 JJt = kEps * Matrix6::Identity();
  Vector6 Jtau = Vector6::Zero();
  for (Eigen::Index i = 0; i < tau.size(); ++i) {
    const Vector6 column = J_V_WK.col(i);
    JJt.noalias() += column * column.transpose();
    Jtau += tau[i] * column;
  }
  Wrench F;
  Matrix6 L;
  cholesky_factor(JJt, L);
  F.vector = cholesky_solve(L, Jtau);
  return F;
}

}  // namespace multipanda
