#include "ros/host/arm_view.hpp"

#include <algorithm>

#include "ros/adapter/state/messages.hpp"
#include "runtime/embedded/shared_arm_state.hpp"

namespace multipanda::ros {
namespace {

const SharedArmState& shared(const void* address) { return *static_cast<const SharedArmState*>(address); }
// Computes terms on demand, in the caller's loop thread.
ModelTerms& terms(const void* address) { return *shared(address).model; }

std::span<const double> span_of(const JointVector& v) {
  return {v.data(), static_cast<std::size_t>(v.size())};
}

template <class Matrix>
void put_rows(const Matrix& M, std::span<double> out) {
  std::size_t at = 0;
  for (Eigen::Index i = 0; i < M.rows(); ++i) {
    for (Eigen::Index k = 0; k < M.cols() && at < out.size(); ++k) out[at++] = M(i, k);
  }
}

}  // namespace

ArmView ArmView::from_interface(double interface_value) noexcept {
  ArmView view;
  view.address_ = shared_arm_state(interface_value);
  return view;
}

std::size_t ArmView::joint_count() const noexcept { return shared(address_).model->joint_count(); }
std::span<const double> ArmView::q() const noexcept { return span_of(shared(address_).state.q); }
std::span<const double> ArmView::dq() const noexcept { return span_of(shared(address_).state.dq); }
std::span<const double> ArmView::tau_J() const noexcept { return span_of(shared(address_).state.tau_J); }
std::span<const double> ArmView::tau_J_d() const noexcept { return span_of(shared(address_).state.tau_J_d); }
std::uint64_t ArmView::sequence() const noexcept { return shared(address_).state.sequence; }
std::uint8_t ArmView::mode() const noexcept { return static_cast<std::uint8_t>(shared(address_).state.mode); }
std::uint64_t ArmView::errors() const noexcept { return shared(address_).state.errors; }

void ArmView::state(multipanda_msgs::msg::RobotState& out) const {
  fill_state(shared(address_).state, terms(address_), out);
}

void ArmView::mass(std::span<double> out) const noexcept { put_rows(terms(address_).M(), out); }
void ArmView::coriolis(std::span<double> out) const noexcept { put_rows(terms(address_).c(), out); }
void ArmView::gravity(std::span<double> out) const noexcept { put_rows(terms(address_).g(), out); }
void ArmView::jacobian(std::span<double> out) const noexcept { put_rows(terms(address_).J_V_WE(), out); }

void ArmView::pose(std::span<double, 16> out) const noexcept {
  const Pose& X = terms(address_).X_WE();
  Eigen::Map<Eigen::Matrix4d> T(out.data());
  T.setIdentity();
  T.block<3, 3>(0, 0) = X.rotation;
  T.block<3, 1>(0, 3) = X.position;
}

void ArmView::model(multipanda_msgs::msg::RobotModel& out) const { fill_model(terms(address_), out); }

}  // namespace multipanda::ros
