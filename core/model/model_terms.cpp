#include "core/model/model_terms.hpp"

#include <Eigen/LU>

#include "core/model/pinocchio_chain.hpp"

namespace multipanda {

namespace {

pinocchio::SE3 se3(const Pose& X) { return {X.rotation, X.position}; }

}  // namespace

// The links of one arm at one state. Wrenches, twists and inertias are about the world's origin, in its axes.
struct ModelTerms::Scratch {
  struct Link {
    pinocchio::SE3 X_WJ = pinocchio::SE3::Identity();
    pinocchio::Inertia own = pinocchio::Inertia::Zero();     // of the link
    pinocchio::Inertia behind = pinocchio::Inertia::Zero();  // of it and all links behind it
    pinocchio::Motion v = pinocchio::Motion::Zero();
    pinocchio::Force momentum = pinocchio::Force::Zero(), force = momentum;
  };
  explicit Scratch(const ArmModel::Chain& chain)
      : links(chain.joints.size()), X_W1(chain.joints.front().X_PJ), last_link(chain.joints.back().link) {
    J.setZero(6, static_cast<Eigen::Index>(links.size()));
  }
  std::vector<Link> links;
  Jacobian J;                                        // column i: twist of joint i at unit speed
  pinocchio::SE3 X_W1;                               // first joint at zero, with the base where it is now
  pinocchio::SE3 X_B1 = pinocchio::SE3::Identity();  // in the base
  pinocchio::Inertia last_link;                      // with tool and load, in the joint's frame
  pinocchio::Force links_momentum = pinocchio::Force::Zero();  // as the joints move them, base at rest
  // All bodies of the carried arm as one, about the world's origin, and their momentum; and as they were last
  // known, in the frame of the joint that carries them.
  pinocchio::Inertia carried = pinocchio::Inertia::Zero(), carried_in_joint = carried;
  bool carried_is_known = false;
  pinocchio::Force carried_momentum = pinocchio::Force::Zero();
};

ModelTerms::ModelTerms(std::shared_ptr<const ArmModel> model)
    : model_(std::move(model)), scratch_(std::make_unique<Scratch>(model_->chain())) {
  const auto n = model_->joint_count();
  q_ = dq_ = c_ = g_ = momentum_ = momentum_drift_ = joint_constant(n, 0);
  J_V_WE_.setZero(6, q_.size());
  M_.setZero(q_.size(), q_.size());
  X_WB_ = model_->X_WB();
  scratch_->X_B1 = se3(X_WB_).actInv(scratch_->X_W1);
  V_WB_.vector.setZero();
  update(model_->q_home(), dq_);
}
ModelTerms::~ModelTerms() = default;
ModelTerms::ModelTerms(ModelTerms&&) noexcept = default;
ModelTerms& ModelTerms::operator=(ModelTerms&&) noexcept = default;

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
  done_ = 0;
}

void ModelTerms::set_config(const ArmFrames& frames, const Load& tool, const Load& load) {
  frames_ = frames;
  const auto& chain = model_->chain();
  auto& last = scratch_->last_link;
  last = chain.joints.back().link;
  // Adding a massless body to a massless link would divide by zero.
  if (tool.mass > 0) last += inertia_in_joint(chain.X_JF, tool);
  if (load.mass > 0) last += inertia_in_joint(chain.X_JF, load);
  done_ = 0;
}

void ModelTerms::place_base(const Pose& X_WB) {
  X_WB_ = X_WB;
  scratch_->X_W1 = se3(X_WB) * scratch_->X_B1;
  done_ = 0;
}

void ModelTerms::stand_on(ModelTerms& carrier, const BaseMount& mount) {
  // Terms of the carried arm computed by the carrier belong to its last pose.
  carrier.done_ &= kKinematics | kJacobian | kTwist | kManipulability | kManipulabilityTerms;
  V_WB_.vector.setZero();
  done_ = 0;
  if (!carrier.q_.allFinite() || !carrier.dq_.allFinite()) return;
  base_moves_ = true;
  place_base(carrier.X_WJ(mount.joint) * mount.X_JB);
  const auto& J = carrier.scratch_->J;
  for (Eigen::Index i = 0; i <= static_cast<Eigen::Index>(mount.joint); ++i)
    V_WB_.vector += J.col(i) * carrier.dq_[i];
}

void ModelTerms::carry(ModelTerms& carried, std::size_t joint) {
  carried_ = &carried;
  carried_joint_ = joint;
  done_ = 0;
}

// One sweep gives all joint poses and the joint Jacobian at the world's origin.
void ModelTerms::need_kinematics() {
  if (!first(kKinematics)) return;
  auto& s = *scratch_;
  const auto& chain = model_->chain();
  for (std::size_t i = 0; i < s.links.size(); ++i) {
    const auto column = static_cast<Eigen::Index>(i);
    const pinocchio::SE3 X_PJ = chain.joints[i].moved(q_[column], i == 0 ? s.X_W1 : chain.joints[i].X_PJ);
    s.links[i].X_WJ = i == 0 ? X_PJ : s.links[i - 1].X_WJ * X_PJ;
    s.J.col(column) = chain.joints[i].twist(s.links[i].X_WJ);
  }
  const pinocchio::SE3 X = s.links.back().X_WJ * chain.X_JF;
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

std::array<Vector3, 2> ModelTerms::points_from_hand() {
  need_kinematics();
  return {X_WF_.position - X_WE_.position, X_WF_ * model_->tool_end() - X_WE_.position};
}

Pose ModelTerms::X_WJ(std::size_t joint) {
  need_kinematics();
  const auto& X = scratch_->links[joint].X_WJ;
  return {X.rotation(), X.translation()};
}

const Jacobian& ModelTerms::J_V_WE() {
  if (!first(kJacobian)) return J_V_WE_;
  need_kinematics();
  // Column i of the scratch's J is the velocity at the world's origin. At E: v_E = v_O + omega x p_WE.
  const auto& J = scratch_->J;
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
  const auto& J = scratch_->J;
  for (Eigen::Index i = 0; i < J_point.cols(); ++i) {
    if (static_cast<std::size_t>(i) > joint) {
      J_point.col(i).setZero();
    } else {
      const Vector3 omega = J.col(i).tail<3>();
      J_point.col(i) = J.col(i).head<3>() + omega.cross(p_W);
    }
  }
}

JointVector ModelTerms::torque_of(std::size_t joint, const Vector3& p_W, const Vector6& F) {
  need_kinematics();
  JointVector tau = JointVector::Zero(q_.size());
  const Vector3 moment_O = F.tail<3>() + p_W.cross(F.head<3>());
  for (Eigen::Index i = 0; i <= static_cast<Eigen::Index>(joint); ++i) {
    const auto S = scratch_->J.col(i);
    tau[i] = S.head<3>().dot(F.head<3>()) + S.tail<3>().dot(moment_O);
  }
  return tau;
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
  if (!first(kTwist)) return V_WE_;
  V_WE_.vector = J_V_WE().lazyProduct(dq_);
  if (base_moves_) {
    const Vector3 omega = V_WB_.angular();
    V_WE_.vector.head<3>() += V_WB_.linear() + omega.cross(X_WE_.position);
    V_WE_.vector.tail<3>() += omega;
  }
  return V_WE_;
}

// The carried arm as one body about the world's origin, its base's link included, and its momentum.
void ModelTerms::need_carried() {
  if (carried_ == nullptr) return;
  auto& s = *scratch_;
  const pinocchio::SE3& X_WJ = s.links[carried_joint_].X_WJ;
  s.carried_is_known = carried_->q_.allFinite() && carried_->dq_.allFinite();
  if (!s.carried_is_known) {
    s.carried = X_WJ.act(s.carried_in_joint);
    return;
  }
  carried_->need_motion();
  const auto& from = *carried_->scratch_;
  s.carried = from.links.front().behind + se3(carried_->X_WB_).act(carried_->model_->chain().base);
  s.carried_in_joint = X_WJ.actInv(s.carried);
  s.carried_momentum = from.links_momentum + s.carried * pinocchio::Motion(carried_->V_WB_.vector);
}

// The inertia of each link, and of each link with all links behind it, in world axes.
void ModelTerms::need_inertias() {
  if (!first(kInertias)) return;
  need_kinematics();
  need_carried();
  auto& links = scratch_->links;
  const auto& joints = model_->chain().joints;
  for (std::size_t i = joint_count(); i-- > 0;) {
    const bool is_last = i + 1 == joint_count();
    links[i].own = links[i].X_WJ.act(is_last ? scratch_->last_link : joints[i].link);
    if (carried_ != nullptr && i == carried_joint_) links[i].own += scratch_->carried;
    links[i].behind = links[i].own;
    if (!is_last) links[i].behind += links[i + 1].behind;
  }
}

// With S_i the twist of joint i at unit speed and Y_i the inertia of link i and all links behind it, about
// the world's origin: M_ij = S_i . Y_j S_j for i <= j, and g_i = -S_i . Y_i a_g.
const JointMatrix& ModelTerms::M() {
  if (!first(kMass)) return M_;
  need_inertias();
  const auto& s = *scratch_;
  for (Eigen::Index j = 0; j < q_.size(); ++j) {
    const pinocchio::Motion S(s.J.col(j));
    const Vector6 F = (s.links[static_cast<std::size_t>(j)].behind * S).toVector();
    for (Eigen::Index i = 0; i <= j; ++i) M_(i, j) = M_(j, i) = s.J.col(i).dot(F);
  }
  if (model_->known_motor_inertia().size() > 0) M_.diagonal() += model_->known_motor_inertia();
  return M_;
}

const JointVector& ModelTerms::g() {
  if (!first(kGravity)) return g_;
  need_inertias();
  const auto& s = *scratch_;
  const Vector3 gravity(0, 0, -9.81);
  for (Eigen::Index i = 0; i < q_.size(); ++i) {
    const auto& Y = s.links[static_cast<std::size_t>(i)].behind;
    const Vector3 weight = Y.mass() * gravity, S_v = s.J.col(i).head<3>(), S_w = s.J.col(i).tail<3>();
    g_[i] = -S_v.dot(weight) - S_w.dot(Y.lever().cross(weight));
  }
  return g_;
}

// With v_i the velocity of link i, a_i the part of its acceleration that the joint speeds alone cause,
// h_i = I_i v_i its momentum, f_i = I_i a_i + v_i x* h_i the force that this motion needs, and H_i, F_i the
// sums of h_j, f_j over link i and all links behind it:
//   p_i = S_i . H_i,   (C dq)_i = S_i . F_i,   (C^T dq)_i = 1/2 dq^T (dM/dq_i) dq = (v_i x S_i) . H_i.
// The last one: turning joint i moves the links behind it with S_i, which changes their kinetic energy by
// d/dq_i sum 1/2 v_j . I_j v_j with dv_j/dq_i = S_i x (v_j - v_i) and dI_j/dq_i = S_i x* I_j - I_j S_i x; the
// terms in v_j cancel and -(S_i x v_i) . H_i is left.
// A base that moves with V_0 adds V_0 to every v_j of p and (C^T dq), which then are those of Newton's law
// whatever moves the base: dH_i/dt is the wrench on link i and all links behind it, and S_i turns with v_i. A
// carried arm adds its momentum beyond that of the rigid body that its carrier's inertias contain.
void ModelTerms::need_motion() {
  if (!first(kMotion)) return;
  g();
  auto& s = *scratch_;
  pinocchio::Motion v = pinocchio::Motion::Zero(), a = v;
  for (Eigen::Index i = 0; i < q_.size(); ++i) {
    auto& link = s.links[static_cast<std::size_t>(i)];
    const pinocchio::Motion joint(dq_[i] * s.J.col(i));
    a += v.cross(joint);
    v += joint;
    link.v = v;
    link.momentum = link.own * v;
    link.force = link.own * a + v.cross(link.momentum);
  }
  pinocchio::Force H = pinocchio::Force::Zero(), F = H;
  for (Eigen::Index i = q_.size() - 1; i >= 0; --i) {
    const auto k = static_cast<std::size_t>(i);
    const auto& link = s.links[k];
    const pinocchio::Motion S(s.J.col(i));
    H += link.momentum;
    F += link.force;
    c_[i] = S.dot(F);
    pinocchio::Motion whole_v = link.v;
    pinocchio::Force whole_H = H;
    if (carried_ != nullptr && s.carried_is_known && k <= carried_joint_)
      whole_H += s.carried_momentum - s.carried * s.links[carried_joint_].v;
    if (base_moves_) {
      const pinocchio::Motion base(V_WB_.vector);
      whole_v += base;
      whole_H += link.behind * base;
    }
    momentum_[i] = S.dot(whole_H);
    momentum_drift_[i] = whole_v.cross(S).dot(whole_H) - g_[i];
  }
  s.links_momentum = H;
}

const JointVector& ModelTerms::c() {
  need_motion();
  return c_;
}
const JointVector& ModelTerms::momentum() {
  need_motion();
  return momentum_;
}
const JointVector& ModelTerms::momentum_drift() {
  need_motion();
  return momentum_drift_;
}

// C dq is quadratic in dq, so C(dq) v is its polar form: the sweeps of need_motion() with one factor dq and
// one factor v, averaged over which is which.
JointVector ModelTerms::coriolis_times(const JointVector& v) {
  need_inertias();
  auto& s = *scratch_;
  pinocchio::Motion own = pinocchio::Motion::Zero(), other = own, a = own;
  for (Eigen::Index i = 0; i < q_.size(); ++i) {
    auto& link = s.links[static_cast<std::size_t>(i)];
    const pinocchio::Motion joint(dq_[i] * s.J.col(i)), other_joint(v[i] * s.J.col(i));
    a += 0.5 * (own.cross(other_joint) + other.cross(joint));
    own += joint;
    other += other_joint;
    const pinocchio::Force h = link.own * own, other_h = link.own * other;
    link.force = link.own * a + 0.5 * (own.cross(other_h) + other.cross(h));
  }
  JointVector torque(q_.size());
  pinocchio::Force F = pinocchio::Force::Zero();
  for (Eigen::Index i = q_.size() - 1; i >= 0; --i) {
    F += s.links[static_cast<std::size_t>(i)].force;
    torque[i] = pinocchio::Motion(s.J.col(i)).dot(F);
  }
  return torque;
}

// With column j of J = [l_j; z_j] and omega_j the angular velocity of link j:
//   dz_j/dt = omega_j x z_j,   dl_j/dt = omega_j x l_j + z_j x sum over k > j of l_k dq_k.
Vector6 ModelTerms::jacobian_rate_times(const JointVector& v) {
  const Jacobian& J = J_V_WE();
  Vector3 omega = V_WE().angular(), beyond = Vector3::Zero();  // beyond: sum over k > j
  Vector6 rate = Vector6::Zero();
  for (Eigen::Index j = q_.size() - 1; j >= 0; --j) {
    const Vector3 l = J.col(j).head<3>(), z = J.col(j).tail<3>();
    rate.head<3>() += v[j] * (omega.cross(l) + z.cross(beyond));
    rate.tail<3>() += v[j] * omega.cross(z);
    omega -= dq_[j] * z;
    beyond += dq_[j] * l;
  }
  return rate;
}

Vector6 ModelTerms::task_coriolis(const Vector6& V) {
  const TaskSpace& space = task();
  const JointVector v = space.J_bar.lazyProduct(V);
  return Vector6(space.J_bar.transpose().lazyProduct(coriolis_times(v))) -
         space.Lambda * jacobian_rate_times(v);
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
