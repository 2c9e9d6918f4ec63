#include "core/model/model_terms.hpp"

#include <array>

#include <Eigen/LU>
#include <pinocchio/algorithm/crba.hpp>
#include <pinocchio/algorithm/jacobian.hpp>
#include <pinocchio/algorithm/rnea.hpp>

#include "core/model/pinocchio_model.hpp"

namespace multipanda {

// Pinocchio's model is copied: its last inertia changes with tool and load, and each thread has its own.
struct ModelTerms::Scratch {
  explicit Scratch(const ArmModel::Pinocchio& p)
      : model(p.model), data(model), bare(p.model.inertias[p.last_joint]), q(model.nq), dq(model.nv) {}
  pinocchio::Model model;
  pinocchio::Data data;
  pinocchio::Inertia bare;  // of the last link without tool and load
  Eigen::VectorXd q, dq;    // Pinocchio's own vector type, allocated once
};

ModelTerms::ModelTerms(std::shared_ptr<const ArmModel> model)
    : model_(std::move(model)), scratch_(std::make_unique<Scratch>(model_->pinocchio())) {
  const auto n = model_->joint_count();
  q_ = dq_ = c_ = g_ = momentum_ = momentum_drift_ = joint_constant(n, 0);
  J_V_WE_.setZero(6, q_.size());
  M_.setZero(q_.size(), q_.size());
  update(model_->q_home(), dq_);
}
ModelTerms::~ModelTerms() = default;
ModelTerms::ModelTerms(ModelTerms&&) noexcept = default;

void ModelTerms::update(const ArmState& state) {
  if (state.config_version != config_version_) {
    set_config(state.frames, state.tool, state.load);
    config_version_ = state.config_version;
  }
  update(state.q, state.dq);
}

void ModelTerms::update(const JointVector& q, const JointVector& dq) {
  q_ = q;
  dq_ = dq;
  scratch_->q = q;
  scratch_->dq = dq;
  done_ = 0;
}

void ModelTerms::set_config(const ArmFrames& frames, const Load& tool, const Load& load) {
  frames_ = frames;
  const auto& p = model_->pinocchio();
  auto& last = scratch_->model.inertias[p.last_joint];
  last = scratch_->bare;
  // Adding a massless body would divide by the zero mass where the link itself is massless.
  if (tool.mass > 0) last += inertia_in_joint(p.X_JF, tool);
  if (load.mass > 0) last += inertia_in_joint(p.X_JF, load);
  done_ = 0;
}

// One sweep gives all joint poses and the joint Jacobian (world origin), which the frame Jacobian is taken
// from.
void ModelTerms::need_kinematics() {
  if (!first(kKinematics)) return;
  auto& s = *scratch_;
  const auto& p = model_->pinocchio();
  pinocchio::computeJointJacobians(s.model, s.data, s.q);
  const pinocchio::SE3 X = s.data.oMi[p.last_joint] * p.X_JF;
  X_WF_ = {X.rotation(), X.translation()};
  X_WE_ = X_WF_ * frames_.X_FE;
  X_WK_ = X_WE_ * frames_.X_EK;
}

const Pose& ModelTerms::X_WF() {
  need_kinematics();
  return X_WF_;
}
const Pose& ModelTerms::X_WE() {
  need_kinematics();
  return X_WE_;
}
const Pose& ModelTerms::X_WK() {
  need_kinematics();
  return X_WK_;
}

Pose ModelTerms::X_WJ(std::size_t joint) {
  need_kinematics();
  const auto& X = scratch_->data.oMi[joint + 1];
  return {X.rotation(), X.translation()};
}

const Jacobian& ModelTerms::J_V_WE() {
  if (!first(kJacobian)) return J_V_WE_;
  need_kinematics();
  // Pinocchio's J holds the velocity at the world's origin; moving it to E: v_E = v_O + omega x p_WE.
  const auto& J = scratch_->data.J;
  const Vector3& p = X_WE_.position;
  for (Eigen::Index i = 0; i < J_V_WE_.cols(); ++i) {
    const Vector3 omega = J.col(i).tail<3>();
    J_V_WE_.col(i).head<3>() = J.col(i).head<3>() + omega.cross(p);
    J_V_WE_.col(i).tail<3>() = omega;
  }
  return J_V_WE_;
}

void ModelTerms::point_jacobian(std::size_t joint, const Vector3& p_W,
                                Eigen::Ref<Eigen::Matrix<double, 3, Eigen::Dynamic>> J_point) {
  need_kinematics();
  const auto& J = scratch_->data.J;
  for (Eigen::Index i = 0; i < J_point.cols(); ++i) {
    if (static_cast<std::size_t>(i) > joint) {
      J_point.col(i).setZero();
    } else {
      const Vector3 omega = J.col(i).tail<3>();
      J_point.col(i) = J.col(i).head<3>() + omega.cross(p_W);
    }
  }
}

Jacobian ModelTerms::J_V_WK() {
  Jacobian J_V_WK = J_V_WE();
  const Vector3 p_EK_W = X_WK_.position - X_WE_.position;
  for (Eigen::Index i = 0; i < J_V_WK.cols(); ++i) {
    const Vector3 omega = J_V_WK.col(i).tail<3>();
    J_V_WK.col(i).head<3>() += omega.cross(p_EK_W);
  }
  return J_V_WK;
}

const Twist& ModelTerms::V_WE() {
  if (first(kTwist)) V_WE_.vector = J_V_WE().lazyProduct(dq_);
  return V_WE_;
}

const JointMatrix& ModelTerms::M() {
  if (!first(kMass)) return M_;
  auto& s = *scratch_;
  pinocchio::crba(s.model, s.data, s.q, pinocchio::Convention::WORLD);
  M_ = s.data.M;
  M_.triangularView<Eigen::StrictlyLower>() = M_.transpose();  // Pinocchio fills the upper half
  return M_;
}

const JointVector& ModelTerms::g() {
  if (first(kGravity))
    g_ = pinocchio::computeGeneralizedGravity(scratch_->model, scratch_->data, scratch_->q);
  return g_;
}

const JointVector& ModelTerms::c() {
  if (first(kCoriolis)) {
    // One sweep without gravity gives C dq alone: cheaper than the matrix C, and than (C dq + g) - g.
    auto& s = *scratch_;
    const auto gravity = s.model.gravity;
    s.model.gravity.setZero();
    c_ = pinocchio::nonLinearEffects(s.model, s.data, s.q, s.dq);
    s.model.gravity = gravity;
  }
  return c_;
}

// With S_i the joints' axes as twists, v_i the links' velocities, h_i = I_i v_i their momenta and
// H_i = sum of h_j over the links that joint i carries, all at the world's origin in world axes:
//   p_i = S_i . H_i,   (C^T dq)_i = 1/2 dq^T (dM/dq_i) dq = (v_i x S_i) . H_i,   g_i = S_i . (-m a_g, -m c x
//   a_g)
// The middle one: turning joint i moves the links behind it with S_i, which changes their kinetic energy by
// d/dq_i sum 1/2 v_j . I_j v_j with dv_j/dq_i = S_i x (v_j - v_i) and dI_j/dq_i = S_i x* I_j - I_j S_i x; the
// terms in v_j cancel and -(S_i x v_i) . H_i is left.
void ModelTerms::need_momentum() {
  if (!first(kMomentum)) return;
  need_kinematics();
  auto& s = *scratch_;
  const auto n = q_.size();
  const auto& J = s.data.J;  // columns S_i, linear first
  const Vector3 gravity = s.model.gravity.linear();
  struct Spatial {
    Vector3 linear, angular;  // at the world's origin: of a twist, a momentum or a wrench
  };
  std::array<Spatial, kMaxJoints> v, h, weight;  // velocity, momentum, weight of each link
  Vector3 linear = Vector3::Zero(), angular = Vector3::Zero();
  for (Eigen::Index i = 0; i < n; ++i) {
    const auto k = static_cast<std::size_t>(i);
    linear += dq_[i] * J.col(i).head<3>();
    angular += dq_[i] * J.col(i).tail<3>();
    v[k] = {linear, angular};
    const auto& X = s.data.oMi[k + 1];
    const auto& body = s.model.inertias[k + 1];
    const Vector3 c = X.rotation() * body.lever() + X.translation();
    h[k].linear = body.mass() * (linear + angular.cross(c));
    const Vector3 turning = X.rotation() * (body.inertia().matrix() * (X.rotation().transpose() * angular));
    h[k].angular = c.cross(h[k].linear) + turning;
    weight[k].linear = body.mass() * gravity;
    weight[k].angular = c.cross(weight[k].linear);
  }
  Spatial H{Vector3::Zero(), Vector3::Zero()}, G = H;
  for (Eigen::Index i = n - 1; i >= 0; --i) {
    const auto k = static_cast<std::size_t>(i);
    H.linear += h[k].linear;
    H.angular += h[k].angular;
    G.linear += weight[k].linear;
    G.angular += weight[k].angular;
    const Vector3 S_v = J.col(i).head<3>(), S_w = J.col(i).tail<3>();
    momentum_[i] = S_v.dot(H.linear) + S_w.dot(H.angular);
    // v x S as twists: [w x S_v + v x S_w; w x S_w]
    const Vector3& w = v[k].angular;
    momentum_drift_[i] = (w.cross(S_v) + v[k].linear.cross(S_w)).dot(H.linear) + w.cross(S_w).dot(H.angular) +
                         S_v.dot(G.linear) + S_w.dot(G.angular);
  }
}

const JointVector& ModelTerms::momentum() {
  need_momentum();
  return momentum_;
}
const JointVector& ModelTerms::momentum_drift() {
  need_momentum();
  return momentum_drift_;
}

const TaskSpace& ModelTerms::task() {
  if (first(kTask)) compute_task_space(J_V_WE(), M(), task_);
  return task_;
}

double ModelTerms::manipulability() {
  if (first(kManipulability)) {
    const auto& J = J_V_WE();
    const Matrix6 JJt = J.lazyProduct(J.transpose());
    manipulability_ = std::sqrt(std::max(0.0, JJt.determinant()));
  }
  return manipulability_;
}

const Manipulability& ModelTerms::manipulability_terms() {
  if (first(kManipulabilityTerms)) compute_manipulability(J_V_WE(), manipulability_terms_);
  return manipulability_terms_;
}

}  // namespace multipanda
