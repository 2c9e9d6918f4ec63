#include "ros/host/arm_view.hpp"

#include <algorithm>

#include "backends/arm/arm_error.hpp"
#include "runtime/hosted/arm_window.hpp"

namespace multipanda::ros {
namespace {

const ArmWindow& seen(const void* window) { return *static_cast<const ArmWindow*>(window); }
// Computes on demand, for whoever asks, in the loop's thread.
ModelTerms& terms(const void* window) { return *seen(window).model; }

std::span<const double> span_of(const JointVector& v) {
  return {v.data(), static_cast<std::size_t>(v.size())};
}

void put(const Pose& X, geometry_msgs::msg::Pose& out) {
  out.position.x = X.position.x();
  out.position.y = X.position.y();
  out.position.z = X.position.z();
  const Quaternion q = X.quaternion();
  out.orientation.w = q.w();
  out.orientation.x = q.x();
  out.orientation.y = q.y();
  out.orientation.z = q.z();
}

template <class V, class Message>
void put3(const V& v, Message& out) {
  out.x = v[0];
  out.y = v[1];
  out.z = v[2];
}

void put(const Load& load, multipanda_msgs::msg::ArmLoad& out) {
  out.mass = load.mass;
  put3(load.p_FC, out.centre);
  const Matrix3& I = load.inertia_C;
  out.inertia = {I(0, 0), I(0, 1), I(0, 2), I(1, 1), I(1, 2), I(2, 2)};
}

void put(const Wrench& F, geometry_msgs::msg::Wrench& out) {
  put3(F.force(), out.force);
  put3(F.torque(), out.torque);
}

void put(const JointVector& v, std::vector<double>& out) { out.assign(v.begin(), v.end()); }

template <class Matrix>
void put_rows(const Matrix& M, std::span<double> out) {
  std::size_t at = 0;
  for (Eigen::Index i = 0; i < M.rows(); ++i) {
    for (Eigen::Index k = 0; k < M.cols() && at < out.size(); ++k) out[at++] = M(i, k);
  }
}

}  // namespace

ArmView ArmView::behind(double interface_value) noexcept {
  ArmView view;
  view.window_ = window_behind(interface_value);
  return view;
}

std::size_t ArmView::joint_count() const noexcept { return seen(window_).model->joint_count(); }
std::span<const double> ArmView::q() const noexcept { return span_of(seen(window_).state.q); }
std::span<const double> ArmView::dq() const noexcept { return span_of(seen(window_).state.dq); }
std::span<const double> ArmView::tau_J() const noexcept { return span_of(seen(window_).state.tau_J); }
std::span<const double> ArmView::tau_J_d() const noexcept { return span_of(seen(window_).state.tau_J_d); }
std::uint64_t ArmView::sequence() const noexcept { return seen(window_).state.sequence; }
std::uint8_t ArmView::mode() const noexcept { return static_cast<std::uint8_t>(seen(window_).state.mode); }
std::uint64_t ArmView::errors() const noexcept { return seen(window_).state.errors; }

void ArmView::state(multipanda_msgs::msg::RobotState& out) const {
  const ArmState& state = seen(window_).state;
  ModelTerms& model = terms(window_);
  out.mode = mode();
  if (out.errors != state.errors) {
    out.error_names.clear();
    for (std::size_t i = 0; i < kArmErrorCount; ++i) {
      if ((state.errors >> i & 1u) != 0) out.error_names.emplace_back(to_string(static_cast<ArmError>(i)));
    }
  }
  out.errors = state.errors;
  out.sequence = state.sequence;
  out.robot_time_ns = state.t_robot.ns;
  out.age = state.age_s;
  out.command_success_rate = state.command_success_rate;
  put(state.q, out.q);
  put(state.dq, out.dq);
  put(state.tau_J, out.tau_j);
  put(state.tau_J_d, out.tau_j_d);
  put(state.tau_ext_hat, out.tau_ext);
  put(model.X_WE(), out.pose);
  put3(model.V_WE().linear(), out.twist.linear);
  put3(model.V_WE().angular(), out.twist.angular);
  out.has_wrench = state.has_wrench_estimate;
  put(state.F_K_W_est, out.wrench);
  out.has_contact = state.has_contact_truth;
  put(state.F_K_W_true, out.contact);
  out.config_version = state.config_version;
  put(state.frames.X_FE, out.end_effector);
  put(state.frames.X_EK, out.stiffness);
  put(state.tool, out.tool);
  put(state.load, out.load);
  out.has_gripper = state.gripper.present;
  out.gripper_width = state.gripper.width;
  out.gripper_max_width = state.gripper.max_width;
  out.gripper_grasped = state.gripper.grasped;
  out.gripper_moving = state.gripper.moving;
}

void ArmView::mass(std::span<double> out) const noexcept { put_rows(terms(window_).M(), out); }
void ArmView::coriolis(std::span<double> out) const noexcept { put_rows(terms(window_).c(), out); }
void ArmView::gravity(std::span<double> out) const noexcept { put_rows(terms(window_).g(), out); }
void ArmView::jacobian(std::span<double> out) const noexcept { put_rows(terms(window_).J_V_WE(), out); }

void ArmView::pose(std::span<double, 16> out) const noexcept {
  const Pose& X = terms(window_).X_WE();
  Eigen::Map<Eigen::Matrix4d> T(out.data());
  T.setIdentity();
  T.block<3, 3>(0, 0) = X.rotation;
  T.block<3, 1>(0, 3) = X.position;
}

void ArmView::model(multipanda_msgs::msg::RobotModel& out) const {
  ModelTerms& model = terms(window_);
  const std::size_t n = joint_count();
  out.mass.resize(n * n);
  out.coriolis.resize(n);
  out.gravity.resize(n);
  out.jacobian.resize(6 * n);
  mass(out.mass);
  coriolis(out.coriolis);
  gravity(out.gravity);
  jacobian(out.jacobian);
  put(model.X_WF(), out.flange);
  put(model.X_WE(), out.pose);
  put(model.X_WK(), out.stiffness);
  out.manipulability = model.manipulability();
}

}  // namespace multipanda::ros
