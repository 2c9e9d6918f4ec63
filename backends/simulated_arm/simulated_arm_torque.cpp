// The torque path of the simulated arm: its motors in a physics step.
#include <cmath>
#include <numbers>

#include "backends/simulated_arm/simulated_arm.hpp"

namespace multipanda {
namespace {

// The arm's own hold: joints as critically damped oscillators of this frequency, made independent of each
// other by the mass matrix, so that light and heavy joints are equally stable at any control period.
constexpr double kHoldFrequency = 60.0;  // [rad/s]
constexpr double kRestVelocity = 0.02;   // a joint slower than this has stopped [rad/s]
// An unknown load keeps a braked joint creeping, so the joint is held after this time. Braking from the
// highest speed takes a fifth of it.
constexpr double kLongestBraking = 0.5;  // [s]

// While the arm is guided by hand: damping of every joint, and the stiffness that holds the locked axes of
// the end effector (critically damped for about 5 kg and 0.1 kg m^2).
constexpr double kGuidingDamping = 0.5;                             // [N m s/rad]
constexpr double kLockedStiffness = 3000, kLockedRotation = 60;     // [N/m, N m/rad]
constexpr double kLockedDamping = 250, kLockedRotationDamping = 5;  // [N s/m, N m s/rad]
constexpr double kLockedElbow = 20;                                 // of motion in the null space [N m s/rad]

}  // namespace

void SimulatedArm::update_model(const JointVector& q, const JointVector& dq) {
  if (model_.q() != q || model_.dq() != dq) model_.update(q, dq);
}

// tau = M (w^2 (q_hold - q) - 2 w dq) + c, M with the rotors; a moving joint is only braked, and held where
// it stops. Uncompensated weight then displaces it by a few thousandths of a radian.
const JointVector& SimulatedArm::hold_torque(const JointVector& q, const JointVector& dq) {
  const auto& limit = config_.model->limits().tau_max;
  JointVector acceleration = -2 * kHoldFrequency * dq;
  for (Eigen::Index i = 0; i < q.size(); ++i) {
    const auto bit = 1u << static_cast<unsigned>(i);
    if ((at_rest_ & bit) == 0) {
      q_hold_[i] = q[i];
      hold_changed_ = true;
      if (std::abs(dq[i]) < kRestVelocity || braking_s_ >= kLongestBraking) at_rest_ |= bit;
    }
    acceleration[i] += kHoldFrequency * kHoldFrequency * (q_hold_[i] - q[i]);
  }
  tau_hold_ = model_.c();
  tau_hold_ += model_.M().lazyProduct(acceleration);
  if (config_.rotor_inertia.size() > 0) tau_hold_ += config_.rotor_inertia.cwiseProduct(acceleration);
  tau_hold_ = tau_hold_.cwiseMax(-limit).cwiseMin(limit);
  return tau_hold_;
}

// A joint that was caught may still be moved by those that brake.
bool SimulatedArm::is_at_rest() const {
  const auto all = (1u << joint_count()) - 1;
  return (at_rest_ & all) == all &&
         (braking_s_ >= kLongestBraking || state_.dq.cwiseAbs().maxCoeff() < kRestVelocity);
}

// Gravity is compensated anyway: the user's hand feels only inertia and a little damping. Locked axes, in the
// base's directions, are held at the pose where the buttons were pressed.
const JointVector& SimulatedArm::guided_torque(const JointVector& q, const JointVector& dq) {
  const auto& limit = config_.model->limits().tau_max;
  q_hold_ = q;
  hold_changed_ = true;
  tau_hold_ = model_.c() - kGuidingDamping * dq;
  const Matrix3& R_WB = config_.model->X_WB().rotation;
  const Vector6 e_W = pose_error(X_WE_guided_, model_.X_WE());
  const Vector6& V_W = model_.V_WE().vector;
  Wrench F_W;
  for (Eigen::Index k = 0; k < 6; ++k) {
    if (settings_.guiding.axes[static_cast<std::size_t>(k)]) continue;
    const bool turns = k >= 3;
    const Vector3 axis = R_WB.col(k % 3);
    const Vector3 e = turns ? Vector3(e_W.tail<3>()) : Vector3(e_W.head<3>());
    const Vector3 v = turns ? Vector3(V_W.tail<3>()) : Vector3(V_W.head<3>());
    const double f = (turns ? kLockedRotation : kLockedStiffness) * axis.dot(e) -
                     (turns ? kLockedRotationDamping : kLockedDamping) * axis.dot(v);
    if (turns) {
      F_W.torque() += f * axis;
    } else {
      F_W.force() += f * axis;
    }
  }
  tau_hold_ += model_.J_V_WE().transpose().lazyProduct(F_W.vector);
  if (!settings_.guiding.elbow) {
    tau_hold_ += model_.task().null_space_torque(model_.J_V_WE(), -kLockedElbow * dq);
  }
  tau_hold_ = tau_hold_.cwiseMax(-limit).cwiseMin(limit);
  return tau_hold_;
}

// Computes the torque of the arm's own controllers, once per period.
const JointVector& SimulatedArm::follow_torque() {
  if (!follow_due_) return tau_follow_;
  follow_due_ = false;
  const auto& limit = config_.model->limits().tau_max;
  const DesiredState& d = desired_.state();
  tau_follow_ = motion_.controller == ArmController::joint_impedance
                    ? controllers_.joint_impedance(model_, d.q, d.dq, d.ddq, settings_.joint_stiffness)
                    : controllers_.cartesian_impedance(model_, settings_.frames.X_EK, d.X_BE_d, d.V_BE_d,
                                                       d.A_BE_d, d.q, d.dq, settings_.cartesian_stiffness);
  tau_follow_ = tau_follow_.cwiseMax(-limit).cwiseMin(limit);
  return tau_follow_;
}

void SimulatedArm::add_ripple(const JointVector& q) {
  const Transmission& t = config_.transmission;
  for (Eigen::Index i = 0; i < t.ripple.size(); ++i) {
    tau_motor_[i] += t.ripple[i] * std::sin(t.ripple_cycles[i] * q[i] + t.ripple_phase[i]);
  }
}

const JointVector& SimulatedArm::motor_torque(const JointVector& q, const JointVector& dq, double dt) {
  update_model(q, dq);
  if (!moving_) braking_s_ += dt;
  if (mode() == ArmMode::guiding) {
    tau_desired_ = guided_torque(q, dq);
  } else if (moving_ && motion_.controller != ArmController::external) {
    tau_desired_ = follow_torque();
  } else {
    tau_desired_ = moving_ && in_use_.valid ? in_use_.tau : hold_torque(q, dq);
    if (moving_ && in_use_.valid && own_share_ > 0) tau_desired_ += own_share_ * hold_torque(q, dq);
  }
  if (config_.plant.torque_bandwidth_hz > 0) {
    // Exact for a constant command during dt.
    const double rate = 2 * std::numbers::pi * config_.plant.torque_bandwidth_hz;
    tau_tracked_ += -std::expm1(-rate * dt) * (tau_desired_ - tau_tracked_);
  } else {
    tau_tracked_ = tau_desired_;
  }
  tau_motor_ = tau_tracked_ + model_.g();
  add_ripple(q);
  return tau_motor_;
}

}  // namespace multipanda
