#pragma once

#include <array>
#include <cstdint>

#include "core/state/arm_state.hpp"
#include "fci/wire/robot_state.hpp"

namespace multipanda::fci {

// One arm's packets as the loop's ArmState: the vendor map of CONVENTIONS.md. The wrench stays about K and is
// rotated from K's axes to world axes.
class ArmPacket {
 public:
  // `hand`: the load behind the flange in the controllers' model, with the figures declared by arms.
  // ArmState::tool is the difference from the end effector that the arm declares, so that model and tool
  // match what the arm compensates. Its mass is negative if the arm declares less.
  ArmPacket(const Pose& X_WB, const Load& hand) : R_WB_(X_WB.rotation), hand_(hand) {}

  // Fills everything except mode, gripper and host time. Does not allocate. `tau_J_d` is filled only during
  // our torque motion.
  void fill(const RobotState& packet, bool commanded, ArmState& state) noexcept;

 private:
  Matrix3 R_WB_;
  Load hand_;
  // The last configuration, as received
  struct Configuration {
    std::array<double, 16> F_T_EE{}, EE_T_K{};
    double m_ee = 0, m_load = 0;
    std::array<double, 9> I_ee{}, I_load{};
    std::array<double, 3> F_x_Cee{}, F_x_Cload{};
    bool operator==(const Configuration&) const = default;
  };
  Configuration last_;
  std::uint32_t version_ = 0;
  ArmFrames frames_;
  Load tool_, load_;
};

// The body that remains when `part` is taken from `whole`, both in the same frame. Massless if the
// masses are equal.
Load without(const Load& whole, const Load& part);
// The rigid union of `a` and `b`.
Load with(const Load& a, const Load& b);
// End effector and payload declared in a packet, in the flange.
Load end_effector_of(const RobotState& packet);
Load payload_of(const RobotState& packet);

}  // namespace multipanda::fci
