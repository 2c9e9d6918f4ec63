#pragma once

#include <cstdint>
#include <optional>
#include <random>

#include "core/state/arm_state.hpp"
#include "core/types/joints.hpp"
#include "models/robot_description.hpp"

namespace multipanda {

// The joint sensors of a Franka arm, modeled on states that two Pandas and a Franka Research 3 sent
// (docs/like_a_real_arm.md):
//
//   tau_J            + an offset that the seed draws, + noise, on a grid
//   theta            q + tau_J / K, on a grid; q is the link's
//   dq, dtheta       through a first-order low-pass of 50 Hz: 3 ms late
//
// Loop thread; only the constructor allocates.
class ArmSensors {
 public:
  static constexpr double kVelocityFilter = 50;                      // [Hz]
  static constexpr double kStiff = 14250, kLessStiff = 9000;         // K of joints 1 to 4, others [N m/rad]
  static constexpr double kTorqueGrid = 0.0238, kFineGrid = 0.0064;  // of tau_J, the same joints [N m]

  // `own`: the torque sensor of an individual arm, which has its own offset and noise.
  ArmSensors(std::size_t joint_count, std::uint64_t seed, bool own);

  // The same noise again, at rest.
  void reset();
  // Turns true q, dq, tau_J of a period of `dt` into measured ones.
  void show(ArmState& state, double dt);
  const JointVector& theta() const { return theta_; }    // [rad] (n x 1)
  const JointVector& dtheta() const { return dtheta_; }  // [rad/s] (n x 1)

 private:
  std::uint64_t seed_;
  bool own_;
  bool begun_ = false;
  JointVector offset_, dq_, theta_, dtheta_;
  std::mt19937_64 random_;
  std::normal_distribution<double> normal_;
};

// Friction on the link side of the torque sensors, which therefore measure it, as found on the same arms.
// None for other arms, of which nothing is known.
std::optional<FrictionLaw> usual_link_friction(const RobotDescription& robot);

}  // namespace multipanda
