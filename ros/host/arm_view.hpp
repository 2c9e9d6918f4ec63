#pragma once

#include <cstddef>
#include <cstdint>
#include <multipanda_msgs/msg/robot_model.hpp>
#include <multipanda_msgs/msg/robot_state.hpp>
#include <span>
#include <string>
#include <vector>

namespace multipanda::ros {

// What multipanda's hardware knows of an arm, looked at through the value of its state interface
// `<arm>/robot_state` or `<arm>/robot_model`: the address of a struct, checked for magic, version, sizes and
// build. For controllers in the same process, in update(): what is shown is of the last read().
//
// Looking neither allocates nor locks; message functions reuse the memory of the message they are given.
class __attribute__((visibility("default"))) ArmView {
 public:
  ArmView() = default;
  // Nothing to see (false) where the value is no such address.
  static ArmView behind(double interface_value) noexcept;
  explicit operator bool() const noexcept { return window_ != nullptr; }

  // --- state; spans are valid until the next read() ---
  std::size_t joint_count() const noexcept;
  std::span<const double> q() const noexcept;        // [rad]
  std::span<const double> dq() const noexcept;       // [rad/s]
  std::span<const double> tau_J() const noexcept;    // gravity included [N m]
  std::span<const double> tau_J_d() const noexcept;  // in use, without gravity [N m]
  std::uint64_t sequence() const noexcept;           // of the packet
  std::uint8_t mode() const noexcept;                // multipanda_msgs/RobotState MODE_*
  std::uint64_t errors() const noexcept;
  void state(multipanda_msgs::msg::RobotState& out) const;

  // --- model at that state, tool and load included; matrices row-major ---
  void mass(std::span<double> out) const noexcept;      // (n x n) [kg m^2]
  void coriolis(std::span<double> out) const noexcept;  // C dq (n) [N m]
  void gravity(std::span<double> out) const noexcept;   // (n) [N m]
  void jacobian(std::span<double> out) const noexcept;  // J_V_WE (6 x n), linear first, world axes
  void pose(std::span<double, 16> out) const noexcept;  // X_WE, column-major
  void model(multipanda_msgs::msg::RobotModel& out) const;

 private:
  const void* window_ = nullptr;
};

}  // namespace multipanda::ros
