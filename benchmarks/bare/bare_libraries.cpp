#include "benchmarks/bare/bare_libraries.hpp"

#include <cmath>
#include <stdexcept>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <pinocchio/algorithm/crba.hpp>
#include <pinocchio/algorithm/frames.hpp>
#include <pinocchio/algorithm/jacobian.hpp>
#include <pinocchio/algorithm/rnea.hpp>
#include <pinocchio/parsers/urdf.hpp>

#include "core/types/triangular.hpp"

namespace multipanda::bench {
namespace {

using Matrix67 = Eigen::Matrix<double, 6, 7>;
using Matrix76 = Eigen::Matrix<double, 7, 6>;
using Matrix7 = Eigen::Matrix<double, 7, 7>;
using VectorRef = Eigen::Ref<const Eigen::VectorXd>;  // type for which Pinocchio's library contains crba()

pinocchio::Model build(const ArmModel& arm) {
  pinocchio::Model model;
  pinocchio::urdf::buildModelFromXML(arm.urdf(), model);
  if (model.nv != 7) throw std::invalid_argument("the bare math is written for seven joints");
  model.jointPlacements[1] =
      pinocchio::SE3(arm.X_WB().rotation, arm.X_WB().position) * model.jointPlacements[1];
  model.gravity.linear() = Vector3(0, 0, -9.81);
  return model;
}

// From the quaternion, along the shorter rotation.
Vector3 rotation_vector(const Matrix3& R) {
  Quaternion q(R);
  if (q.w() < 0) q.coeffs() = -q.coeffs();
  const double sine = q.vec().norm();
  if (sine < 1e-8) return 2.0 * q.vec();
  return 2.0 * std::atan2(sine, q.w()) / sine * q.vec();
}

}  // namespace

struct BarePinocchioTerms::Robot {
  explicit Robot(const ArmModel& arm)
      : model(build(arm)), data(model), flange(model.getFrameId("flange")), J(6, 7), q(7), dq(7) {}
  pinocchio::Model model;
  pinocchio::Data data;
  pinocchio::FrameIndex flange;
  pinocchio::Data::Matrix6x J;
  Eigen::VectorXd q, dq;
};

BarePinocchioTerms::BarePinocchioTerms(const ArmModel& arm) : robot_(std::make_unique<Robot>(arm)) {
  if (!robot_->model.existFrame("flange")) throw std::invalid_argument("the arm has no flange");
}
BarePinocchioTerms::~BarePinocchioTerms() = default;

void BarePinocchioTerms::compute(const Vector7& q, const Vector7& dq) {
  Robot& r = *robot_;
  r.q = q;
  r.dq = dq;
  r.J.setZero();
  pinocchio::computeJointJacobians(r.model, r.data, r.q);
  pinocchio::updateFramePlacement(r.model, r.data, r.flange);
  pinocchio::getFrameJacobian(r.model, r.data, r.flange, pinocchio::LOCAL_WORLD_ALIGNED, r.J);
  pinocchio::crba(r.model, r.data, VectorRef(r.q), pinocchio::Convention::WORLD);
  pinocchio::nonLinearEffects(r.model, r.data, r.q, r.dq);
  pinocchio::computeGeneralizedGravity(r.model, r.data, r.q);
}

struct BareDualImpedance::Robot {
  explicit Robot(const ArmModel& arm) : model(build(arm)), data(model), q(7), dq(7) {
    model.gravity.setZero();  // nonLinearEffects is then C dq; the arm compensates gravity
    const auto flange = model.getFrameId("flange");
    last_joint = model.frames[flange].parentJoint;
    X_JF = model.frames[flange].placement;
  }
  void torque(const Input& in, const Pose& X_FE, const Gains& gains, Vector7& tau);

  pinocchio::Model model;
  pinocchio::Data data;
  pinocchio::JointIndex last_joint = 0;
  pinocchio::SE3 X_JF;
  Eigen::VectorXd q, dq;  // Pinocchio's own vector type
};

void BareDualImpedance::Robot::torque(const Input& in, const Pose& X_FE, const Gains& gains, Vector7& tau) {
  // Pinocchio: M, and with it the joints' poses and Jacobian; C dq.
  q = in.q;
  dq = in.dq;
  pinocchio::crba(model, data, VectorRef(q), pinocchio::Convention::WORLD);
  Matrix7 M = data.M;
  M.triangularView<Eigen::StrictlyLower>() = M.transpose();
  const pinocchio::SE3 X_WF = data.oMi[last_joint] * X_JF;
  const Matrix3 R = X_WF.rotation() * X_FE.rotation;
  const Vector3 p = X_WF.rotation() * X_FE.position + X_WF.translation();
  Matrix67 J;
  for (Eigen::Index i = 0; i < 7; ++i) {
    const Vector3 omega = data.J.col(i).tail<3>();
    J.col(i).head<3>() = data.J.col(i).head<3>() + omega.cross(p);
    J.col(i).tail<3>() = omega;
  }
  const Vector7 c = pinocchio::nonLinearEffects(model, data, q, dq);

  // Inertia at the hand.
  const Eigen::LLT<Matrix7> M_cholesky(M);
  Matrix67 half = J;
  divide_by_transposed_lower(M_cholesky.matrixLLT(), half);
  Matrix6 A;
  A.noalias() = half.lazyProduct(half.transpose());
  const Eigen::LLT<Matrix6> A_cholesky(A);
  Matrix6 A_half = Matrix6::Identity();
  divide_by_transposed_lower(A_cholesky.matrixLLT(), A_half);
  const Matrix6 Lambda = A_half * A_half.transpose();
  divide_by_lower(M_cholesky.matrixLLT(), half);
  Matrix76 J_bar;
  J_bar.noalias() = half.transpose().lazyProduct(Lambda);

  // Damping of Lambda and K by their common modes.
  Matrix6 K = Matrix6::Zero();
  K.diagonal().head<3>() = gains.translational_stiffness;
  K.diagonal().tail<3>().setConstant(gains.rotational_stiffness);
  const Eigen::LLT<Matrix6> Lambda_cholesky(Lambda);
  Matrix6 S = K;
  divide_by_transposed_lower(Lambda_cholesky.matrixLLT(), S);
  S.transposeInPlace();
  divide_by_transposed_lower(Lambda_cholesky.matrixLLT(), S);
  const Eigen::SelfAdjointEigenSolver<Matrix6> modes(S);
  const Vector6 d = 2.0 * gains.damping_ratio * modes.eigenvalues().cwiseMax(0.0).cwiseSqrt();
  const Matrix6 L = Lambda_cholesky.matrixL();
  const Matrix6 Q = L * modes.eigenvectors();

  // The law.
  Vector6 error;
  error.head<3>() = in.X_W_d.position - p;
  error.tail<3>() = rotation_vector(in.X_W_d.rotation * R.transpose());
  const Vector6 V = J * in.dq;
  const Vector6 damping = Q * d.cwiseProduct(Q.transpose() * (in.V_d - V));
  const Vector6 F = K.diagonal().cwiseProduct(error) + damping + Lambda * in.A_d;
  const Vector7 D_N = 2.0 * gains.damping_ratio * (gains.null_space_stiffness * M.diagonal()).cwiseSqrt();
  const Vector7 dq_null = in.dq - J_bar * V;
  const Vector7 tau_null = gains.null_space_stiffness * (in.q_N - in.q) - D_N.cwiseProduct(dq_null);
  const Vector6 F_null = J_bar.transpose() * tau_null;
  tau = J.transpose() * (F - F_null) + tau_null + c;
}

BareDualImpedance::BareDualImpedance(const ArmModel& first, const ArmModel& second, const Pose& X_FE,
                                     const Gains& gains)
    : robots_{std::make_unique<Robot>(first), std::make_unique<Robot>(second)}, X_FE_(X_FE), gains_(gains) {}
BareDualImpedance::~BareDualImpedance() = default;

const std::array<Vector7, 2>& BareDualImpedance::torques(const std::array<Input, 2>& inputs) {
  for (std::size_t i = 0; i < 2; ++i) robots_[i]->torque(inputs[i], X_FE_, gains_, tau_[i]);
  return tau_;
}

}  // namespace multipanda::bench
