#include <cmath>
#include <numbers>

#include "backends/simulated_arm/simulated_arm.hpp"

namespace multipanda {
namespace {

constexpr Eigen::Index kLarge = 4;  // joints 1 to 4 have larger drives

// Standard deviations at rest; of dq before its filter.
constexpr double kNoise_q = 2e-6, kNoise_dq = 1.8e-3;  // [rad, rad/s]
double torque_noise(Eigen::Index i) { return i < kLarge ? 0.028 : i == kLarge + 2 ? 0.022 : 0.008; }

double on_grid(double x, double step) { return step * std::round(x / step); }

}  // namespace

ArmSensors::ArmSensors(std::size_t joint_count, std::uint64_t seed, bool own) : seed_(seed), own_(own) {
  offset_ = dq_ = theta_ = dtheta_ = JointVector::Zero(static_cast<Eigen::Index>(joint_count));
  reset();
}

void ArmSensors::reset() {
  random_.seed(seed_ ^ 0x51ED270B7A2F3C15u);
  normal_.reset();
  begun_ = false;
  if (own_) return;
  std::uniform_real_distribution<double> share(-1, 1);
  for (Eigen::Index i = 0; i < offset_.size(); ++i) offset_[i] = (i < kLarge ? 0.6 : 0.3) * share(random_);
}

void ArmSensors::show(ArmState& state, double dt) {
  constexpr double kThetaGrid = 3.1e-6, kFineThetaGrid = 2.4e-6;  // [rad]
  const double rate = -std::expm1(-2 * std::numbers::pi * kVelocityFilter * dt);
  for (Eigen::Index i = 0; i < state.q.size(); ++i) {
    const bool large = i < kLarge;
    const double noise = own_ ? 0 : torque_noise(i);
    state.tau_J[i] =
        on_grid(state.tau_J[i] + offset_[i] + noise * normal_(random_), large ? kTorqueGrid : kFineGrid);
    state.q[i] += kNoise_q * normal_(random_);
    const double theta = on_grid(state.q[i] + state.tau_J[i] / (large ? kStiff : kLessStiff),
                                 large ? kThetaGrid : kFineThetaGrid);
    const double dq = state.dq[i] + kNoise_dq * normal_(random_);
    if (!begun_) {
      dq_[i] = dtheta_[i] = state.dq[i];
    } else {
      dq_[i] += rate * (dq - dq_[i]);
      dtheta_[i] += rate * ((theta - theta_[i]) / dt - dtheta_[i]);
    }
    theta_[i] = theta;
  }
  state.dq = dq_;
  begun_ = true;
}

std::optional<FrictionLaw> usual_link_friction(const RobotDescription& robot) {
  if (robot.joint_count() != 7 || !robot.cartesian) return std::nullopt;
  JointVector amplitude(7);
  if (robot.position_based_velocity) {  // a Franka Research 3
    amplitude << 0.50, 0.32, 0.28, 0.26, 0.39, 0.27, 0.15;
  } else {
    amplitude << 0.25, 0.25, 0.24, 0.54, 0.33, 0.16, 0.27;
  }
  FrictionLaw law;
  law.presliding = {{.distance = 0.01, .amplitude = amplitude}};
  return law;
}

}  // namespace multipanda
