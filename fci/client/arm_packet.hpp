#pragma once

#include <array>
#include <cstdint>

#include "core/state/arm_state.hpp"
#include "fci/wire/robot_state.hpp"

namespace multipanda::fci {

// One arm's packets as the loop's ArmState: the vendor map of CONVENTIONS.md. Forces are turned from the
// base's axes into the world's.
class ArmPacket {
 public:
  // `hand`: what the controllers' model contains behind the flange. ArmState::tool is what the arm declares
  // beyond it, so that model and tool together are what the arm itself compensates; its mass may be negative
  // where the arm declares less.
  ArmPacket(const Pose& X_WB, const Load& hand) : R_WB_(X_WB.rotation), hand_(hand) {}

  // Fills all but mode, gripper and host time. No allocation. `tau_J_d` counts only while torques are ours.
  void fill(const RobotState& packet, bool commanded, ArmState& state) noexcept;

 private:
  Matrix3 R_WB_;
  Load hand_;
  // The configuration last delivered, as it came
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

Pose pose_of(const std::array<double, 16>& column_major);
// The nearest pose whose rotation is one: single precision leaves 1e-7 of something else.
Pose with_proper_rotation(const Pose& X);
// The body that remains when `part` is taken from `whole`, both in the same frame. None where the masses are
// equal.
Load without(const Load& whole, const Load& part);
// `a` and `b` glued together.
Load with(const Load& a, const Load& b);
// End effector and payload as a packet declares them, in the flange.
Load end_effector_of(const RobotState& packet);
Load payload_of(const RobotState& packet);

}  // namespace multipanda::fci
