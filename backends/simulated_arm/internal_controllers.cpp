#include "backends/simulated_arm/internal_controllers.hpp"

#include <algorithm>
#include <cmath>

#include "backends/simulated_arm/friction.hpp"
#include "core/model/coupled_modes.hpp"
#include "core/types/time.hpp"
#include "core/types/triangular.hpp"

namespace multipanda {
namespace {

// The law of the header in the coupled modes: K_f e + D de + the slow part, brought forward by one period.
template <typename Matrix, typename Vector = typename CoupledModes<Matrix>::Vector>
Vector modal_effort(const CoupledModes<Matrix>& modes, const Vector& e, const Vector& de, Vector& slow) {
  constexpr double w = InternalControllers::kBandwidth;
  const Matrix Q = modes.L.lazyProduct(modes.U);
  const Vector e_m = Q.transpose().lazyProduct(e), de_m = Q.transpose().lazyProduct(de);
  auto row = slow.transpose().eval();
  divide_by_transposed_lower(modes.L, row);
  Vector z = (row.lazyProduct(modes.U)).transpose();
  Vector fast = e_m;
  for (Eigen::Index i = 0; i < e.size(); ++i) {
    const double k_fast = std::min(modes.k[i], w * w), rest = modes.k[i] - k_fast;
    const double rate = std::min(0.5 * w, InternalControllers::kIntegral * w * w * w / std::max(rest, 1e-3));
    z[i] += kArmPeriod * rate * (rest * e_m[i] - z[i]);
    fast[i] = k_fast * e_m[i] + 2 * std::sqrt(k_fast) * de_m[i];
  }
  slow = Q.lazyProduct(z);
  return Q.lazyProduct(fast) + slow;
}

// Fixed size for seven joints: three times as fast, same results.
template <int N>
JointVector joint_effort(const JointMatrix& M, const JointVector& stiffness, const JointVector& e,
                         const JointVector& de, JointVector& slow) {
  using Matrix = Eigen::Matrix<double, N, N>;
  using Vector = Eigen::Matrix<double, N, 1>;
  const CoupledModes<Matrix> modes(Matrix(M), Matrix(Vector(stiffness).asDiagonal()));
  Vector slow_n = slow;
  const Vector tau = modal_effort(modes, Vector(e), Vector(de), slow_n);
  slow = slow_n;
  return tau;
}

}  // namespace

InternalControllers::InternalControllers(std::size_t joint_count, std::optional<JointFriction> friction,
                                         JointVector rotor_inertia)
    : friction_(std::move(friction)),
      rotor_inertia_(std::move(rotor_inertia)),
      tau_(joint_constant(joint_count, 0)),
      tau_slow_(tau_),
      ddq_filtered_(tau_) {}

void InternalControllers::start() {
  tau_slow_.setZero();
  ddq_filtered_.setZero();
  F_slow_.setZero();
  A_filtered_.setZero();
}

const JointVector& InternalControllers::joint_impedance(ModelTerms& terms, const JointVector& q_d,
                                                        const JointVector& dq_d, const JointVector& ddq_d,
                                                        const JointVector& stiffness) {
  const JointVector e = q_d - terms.q(), de = dq_d - terms.dq();
  const JointMatrix& M = inertia(terms);
  ddq_filtered_ += kArmPeriod * kFeedforward * (ddq_d - ddq_filtered_);
  if (e.size() == 7) {
    tau_ = joint_effort<7>(M, stiffness, e, de, tau_slow_);
  } else {
    tau_ = modal_effort(CoupledModes<JointMatrix>(M, stiffness.asDiagonal()), e, de, tau_slow_);
  }
  tau_ += M.lazyProduct(ddq_filtered_) + terms.c();
  add_friction(dq_d);
  return tau_;
}

const JointMatrix& InternalControllers::inertia(ModelTerms& terms) {
  if (rotor_inertia_.size() == 0) return terms.M();
  M_ = terms.M();
  M_.diagonal() += rotor_inertia_;
  return M_;
}

void InternalControllers::add_friction(const JointVector& dq_d) {
  if (!friction_) return;
  for (Eigen::Index i = 0; i < dq_d.size(); ++i) {
    tau_[i] += friction_torque(*friction_, static_cast<std::size_t>(i), dq_d[i]);
  }
}

const JointVector& InternalControllers::cartesian_impedance(ModelTerms& terms, const Pose& X_EK,
                                                            const Pose& X_BE_d, const Twist& V_BE_d,
                                                            const Vector6& A_BE_d, const JointVector& q_d,
                                                            const JointVector& dq_d,
                                                            const Vector6& stiffness) {
  // The desired motion at K's origin, world axes.
  const Matrix3& R_WB = terms.model().X_WB().rotation;
  const Pose X_WK_d = terms.model().X_WB() * X_BE_d * X_EK;
  const Vector3 p_EK = R_WB * (X_BE_d.rotation * X_EK.position);
  Vector6 V_d, A_d;
  const Vector3 w = R_WB * V_BE_d.angular(), dw = R_WB * A_BE_d.tail<3>();
  V_d << R_WB * V_BE_d.linear() + w.cross(p_EK), w;
  A_d << R_WB * A_BE_d.head<3>() + dw.cross(p_EK) + w.cross(w.cross(p_EK)), dw;
  A_filtered_ += kArmPeriod * kFeedforward * (A_d - A_filtered_);

  const Jacobian J = terms.J_V_WK();
  const JointMatrix& M = inertia(terms);
  TaskSpace task;
  compute_task_space(J, M, task);
  Matrix6 K = Matrix6::Zero();
  const Matrix3& R = X_WK_d.rotation;
  K.topLeftCorner<3, 3>() = R * stiffness.head<3>().asDiagonal() * R.transpose();
  K.bottomRightCorner<3, 3>() = R * stiffness.tail<3>().asDiagonal() * R.transpose();
  const Vector6 e = pose_error(X_WK_d, terms.X_WK());
  const Vector6 de = V_d - J.lazyProduct(terms.dq());
  const Vector6 F =
      modal_effort(CoupledModes<Matrix6>(task.Lambda, K), e, de, F_slow_) + task.Lambda * A_filtered_;

  const JointVector pull =
      M.lazyProduct(kNullSpace * kNullSpace * (q_d - terms.q()) + 2 * kNullSpace * (dq_d - terms.dq()));
  tau_ = J.transpose().lazyProduct(F) + task.null_space_torque(J, pull) + terms.c();
  add_friction(dq_d);
  return tau_;
}

}  // namespace multipanda
