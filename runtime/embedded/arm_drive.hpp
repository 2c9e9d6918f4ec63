#pragma once

#include <cstddef>
#include <cstdint>

namespace multipanda {

// What drives an arm of a hardware component: the kind of command interfaces that a controller claimed.
enum class ArmDrive : std::uint8_t {
  none,  // no controller: the arm holds itself
  effort,
  joint_position,
  joint_velocity,
  cartesian_pose,
  cartesian_velocity
};
inline constexpr std::size_t kArmDrives = 6;

}  // namespace multipanda
