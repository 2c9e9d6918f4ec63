#pragma once

#include <cstddef>
#include <cstdint>
#include <multipanda_msgs/msg/robot_model.hpp>
#include <multipanda_msgs/msg/robot_state.hpp>
#include <span>
#include <string>
#include <vector>

namespace multipanda::ros {

// A view of multipanda's hardware data for one arm, for controllers in the same process. The value of the
// state interface `<arm>/multipanda_state` or `<arm>/multipanda_model` is the address of a struct; the view
// checks its magic, version, sizes and build. Use it in update(): it shows the data of the last read().
//
// Viewing neither allocates nor locks. Functions that fill messages reuse the message's memory.
class __attribute__((visibility("default"))) ArmView {
 public:
  ArmView() = default;
  // Returns an empty view (false) if the value is not such an address.
  static ArmView from_interface(double interface_value) noexcept;
  explicit operator bool() const noexcept { return address_ != nullptr; }

  // State. Spans are valid until the next read().
  std::size_t joint_count() const noexcept;
  std::span<const double> q() const noexcept;        // [rad]
  std::span<const double> dq() const noexcept;       // [rad/s]
  std::span<const double> tau_J() const noexcept;    // with gravity [N m]
  std::span<const double> tau_J_d() const noexcept;  // command in use, without gravity [N m]
  std::uint64_t sequence() const noexcept;           // of the packet
  std::uint8_t mode() const noexcept;                // multipanda_msgs/RobotState MODE_*
  std::uint64_t errors() const noexcept;
  void state(multipanda_msgs::msg::RobotState& out) const;

  // Model at that state, including tool and load. Matrices are row-major.
  void mass(std::span<double> out) const noexcept;      // (n x n) [kg m^2]
  void coriolis(std::span<double> out) const noexcept;  // C dq (n) [N m]
  void gravity(std::span<double> out) const noexcept;   // (n) [N m]
  void jacobian(std::span<double> out) const noexcept;  // J_V_WE (6 x n), linear first, world axes
  void pose(std::span<double, 16> out) const noexcept;  // X_WE, column-major
  void model(multipanda_msgs::msg::RobotModel& out) const;

 private:
  const void* address_ = nullptr;
};

}  // namespace multipanda::ros
