#pragma once

#include <span>
#include <vector>

#include "core/trajectory/quintic.hpp"
#include "core/types/spatial.hpp"

// Motions of a pose that are planned as a whole before they begin, as joint_motion.hpp does for joints. All
// functions throw std::invalid_argument, with the expected input, if a motion cannot be planned. They do not
// check whether an arm can reach the poses.
namespace multipanda {

// Limits of a motion as Euclidean norms, above 0.
struct PoseMotionLimits {
  double speed = 0.5;               // [m/s]
  double acceleration = 3;          // [m/s^2]
  double jerk = 60;                 // [m/s^3]
  double angular_speed = 1.0;       // [rad/s]
  double angular_acceleration = 6;  // [rad/s^2]
  double angular_jerk = 120;        // [rad/s^3]
};

// A pose in W, its velocity and acceleration at its own origin in the axes of W: twist and its rate.
struct PoseSample {
  Pose X;
  Twist V, A;
};

// A motion of a pose from t = 0 to duration(). A value.
class PoseMotion {
 public:
  // A polynomial in the position and in a rotation vector r relative to R_0: R(t) = exp(r(t)) R_0.
  struct Piece {
    Matrix3 R_0 = Matrix3::Identity();
    QuinticPiece path;  // six coordinates
    PoseSample evaluate(double t) const;
  };

  explicit PoseMotion(const Pose& rest);
  PoseMotion(const Pose& start, std::vector<Piece> pieces, std::vector<double> knots);

  double duration() const { return starts_.back(); }  // [s]
  // Sample at t [s] since the start. Before the start and after the end the motion rests. Does not allocate.
  PoseSample sample(double t) const;
  // One time per via point, in their order [s].
  const std::vector<double>& knots() const { return knots_; }
  const std::vector<Piece>& pieces() const { return pieces_; }

 private:
  Pose start_, end_;
  std::vector<Piece> pieces_;
  std::vector<double> starts_, knots_;
};

// A motion through every via point without a stop, to rest at the last one, within `scale` (0 < scale <= 1)
// times the limits. Position and orientation are continuous up to their accelerations. Rotations take the
// shorter way from one via point to the next, which must be less than pi - 0.01 rad. The path is straight
// between two rests, otherwise curved, and slower at sharper bends. Where the path reverses, the motion
// stops. The motion does not depend on the frame that the poses are given in. A moving start is braked to
// rest first. A via point equal to the one before takes no time.
PoseMotion pose_via_motion(const PoseSample& start, std::span<const Pose> via, const PoseMotionLimits& limits,
                           double scale = 1);

// A smooth stop within `scale` times the limits of acceleration and jerk.
PoseMotion pose_brake(const PoseSample& from, const PoseMotionLimits& limits, double scale = 1);

}  // namespace multipanda
