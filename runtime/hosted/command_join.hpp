#pragma once

#include <array>
#include <cstdint>
#include <span>

#include "core/types/capacity.hpp"
#include "core/types/spatial.hpp"

namespace multipanda {

// How the commands of a motion come in when somebody begins to give them. An arm refuses a desired motion
// that jumps, and a command that was written long ago is no order any more. So:
//
//   positions and poses: while the command is farther than the window from where the arm stands, the arm
//   holds
//     (`waiting`). Once within, the difference fades over kFade: no jump, whatever the controller starts
//     from.
//   velocities: grow from zero over kFade. After a fault they must have been about zero once.
//
// Loop thread, nothing allocates.
class CommandJoin {
 public:
  static constexpr double kJointWindow = 0.05;                        // [rad]
  static constexpr double kPositionWindow = 0.02, kTurnWindow = 0.1;  // [m], [rad]
  static constexpr double kRestVelocity = 0.02;                       // [rad/s], [m/s]
  static constexpr double kFade = 0.5;                                // [s]

  enum class Result : std::uint8_t { waiting, following, not_finite };

  // From now on commands count; `after_fault`: those of before the fault are not taken up again.
  void begin(bool after_fault) {
    stage_ = Stage::fresh;
    after_fault_ = after_fault;
  }

  // `desired`: where the arm itself says that it is to be (q_d). `out`: what to send. Same sizes.
  Result positions(std::span<const double> command, std::span<const double> desired, double dt,
                   std::span<double> out);
  Result velocities(std::span<const double> command, double dt, std::span<double> out);
  // Column-major transforms, as the arm's interface has them.
  Result pose(const std::array<double, 16>& command, const std::array<double, 16>& desired, double dt,
              std::array<double, 16>& out);

 private:
  enum class Stage : std::uint8_t { fresh, waiting, following };
  double fade(double dt);  // share of the command that counts, 0 to 1

  Stage stage_ = Stage::fresh;
  bool after_fault_ = false;
  double time_ = 0;
  std::array<double, kMaxJoints> hold_{}, offset_{};
  std::array<double, 16> hold_pose_{};
  Vector3 shift_ = Vector3::Zero(), turn_ = Vector3::Zero();
};

}  // namespace multipanda
