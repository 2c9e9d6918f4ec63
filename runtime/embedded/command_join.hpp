#pragma once

#include <array>
#include <cstdint>
#include <span>

#include "core/types/capacity.hpp"
#include "core/types/spatial.hpp"

namespace multipanda {

// Fades in the commands of a motion when a controller takes over an arm. An arm rejects a desired motion that
// jumps, and a command written long ago is no longer valid. Therefore:
//
//   positions and poses: the arm holds (`waiting`) while the command is farther than a threshold from the
//   arm's position. Once it is closer, the difference fades over kFade, so there is no jump. velocities: grow
//   from zero over kFade. After a fault they must have been about zero once.
//
// Loop thread; nothing allocates.
class CommandJoin {
 public:
  static constexpr double kJointWindow = 0.05;                        // [rad]
  static constexpr double kPositionWindow = 0.02, kTurnWindow = 0.1;  // [m], [rad]
  static constexpr double kRestVelocity = 0.02;                       // [rad/s], [m/s]
  static constexpr double kFade = 0.5;                                // [s]

  enum class Result : std::uint8_t { waiting, following, not_finite };

  // Commands are used from now on. `after_fault`: commands from before the fault are not resumed.
  void begin(bool after_fault) {
    stage_ = Stage::fresh;
    after_fault_ = after_fault;
  }

  // `desired`: the arm's own desired position (q_d). `out`: the command to send. Same sizes.
  Result positions(std::span<const double> command, std::span<const double> desired, double dt,
                   std::span<double> out);
  Result velocities(std::span<const double> command, double dt, std::span<double> out);
  // Column-major transforms, as in the arm's interface.
  Result pose(const std::array<double, 16>& command, const std::array<double, 16>& desired, double dt,
              std::array<double, 16>& out);

 private:
  enum class Stage : std::uint8_t { fresh, waiting, following };
  double fade(double dt);  // weight of the command, 0 to 1

  Stage stage_ = Stage::fresh;
  bool after_fault_ = false;
  double time_ = 0;
  std::array<double, kMaxJoints> hold_{}, offset_{};
  std::array<double, 16> hold_pose_{};
  Vector3 shift_ = Vector3::Zero(), turn_ = Vector3::Zero();
};

}  // namespace multipanda
