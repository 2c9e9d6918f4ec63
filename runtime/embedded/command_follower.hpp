#pragma once

#include <array>
#include <cstdint>
#include <limits>
#include <span>

#include "arm_interface/arm_interface.hpp"
#include "core/model/arm_model.hpp"
#include "runtime/embedded/sample_track.hpp"

// One coordinate of a desired motion that follows a reference within limits. Stateless, any thread, no
// allocation. Separate from FollowingMotion (core/controllets), which limits lengths of vectors: an arm's
// interface checks the backward differences of each coordinate, and its ranges.
namespace multipanda {

// Of one coordinate, in its unit u (rad, m) per s, s^2, s^3.
struct AxisLimits {
  double velocity = 0, acceleration = 0, jerk = 0;  // > 0
  // Largest velocity, in addition to the reference's, for reducing the distance to the reference: jumps are
  // approached slowly.
  double catch_up = 0;  // [u/s]
  // The range of positions. Towards an end, at the distance d from it, the velocity is at most
  // sqrt(2 deceleration d + offset^2) - offset. Beyond an end only a return is possible, on request.
  double lower = -std::numeric_limits<double>::infinity(), upper = std::numeric_limits<double>::infinity();
  double deceleration = 1, offset = 0.1;  // > 0 [u/s^2, u/s]
};

// Differences used by the arm: backward over one period, so v = (x - x_before) / T, a = (v - v_before) / T.
struct AxisState {
  double x = 0, v = 0, a = 0;
};

// Bandwidth of the followers: three (velocity: two) equal poles at this place, without oscillation. A
// reference of constant velocity is followed without lag, an acceleration a with the distance 3 a / w^2.
// Noise of the size n on a position makes a jerk of about w^3 n.
inline constexpr double kFollowerBandwidth = 150;  // [rad/s]

// One period towards the reference, which is at `x_d` at the end of the period and moves at `v_d`. Velocity,
// acceleration and jerk stay within the limits whatever the reference does.
void follow_position(const AxisLimits& limits, double x_d, double v_d, AxisState& state) noexcept;
// One period towards a velocity; 0 stops within the limits.
void follow_velocity(const AxisLimits& limits, double v_d, AxisState& state) noexcept;

// The velocities that the limits allow at x.
double upper_velocity(const AxisLimits& limits, double x) noexcept;
double lower_velocity(const AxisLimits& limits, double x) noexcept;

struct RobotDescription;

// Limits of a desired motion: below those checked by the arm, and within those tightened by its scene.
struct FollowerLimits {
  // Fractions of the arm's limits. The rest allows for rounding of published values.
  static constexpr double kVelocity = 0.95, kAcceleration = 0.9, kJerk = 0.8;
  static constexpr double kCatchUp = 0.25;                              // [rad/s]
  static constexpr double kCatchUpLinear = 0.1, kCatchUpAngular = 0.4;  // [m/s, rad/s]
  // The Cartesian interface also checks joint velocities and accelerations, which depend on the pose. These
  // fractions respect them away from singular poses.
  static constexpr double kCartesianVelocity = 0.5, kCartesianAcceleration = 0.2, kCartesianJerk = 0.2;

  std::array<AxisLimits, kMaxJoints> joints{};
  AxisLimits linear, angular;  // of each axis; their norms also keep the limits

  // `scene`: the limits of the arm's scene, of which the tighter ones apply; none: those of the robot.
  static FollowerLimits of(const RobotDescription& robot, const ArmLimits* scene = nullptr);
};

// The desired motion published in the arm's newest packet: the base of the next command.
struct DesiredMotionState {
  std::array<double, kMaxJoints> q_d{}, dq_d{}, ddq_d{};
  std::array<double, 16> O_T_EE_c{};  // column-major
  std::array<double, 6> O_dP_EE_c{}, O_ddP_EE_c{};
};

enum class FollowedMotion : std::uint8_t {
  joint_position,
  joint_velocity,
  cartesian_pose,
  cartesian_velocity
};

// Converts commands of a program with another clock to commands of one arm's motion: resampled on the arm's
// clock (SampleTrack), low-pass filtered, and limited in velocity, acceleration and jerk against the motion
// that the arm publishes, so that no jump, late command or lost packet is a discontinuity for the arm. A jump
// is approached slowly. Without new commands the motion continues for kKeptMotion, then slows down, and after
// kSilence the follower stops it until resume().
//
// The arm's thread, once per packet; nothing allocates.
class CommandFollower {
 public:
  static constexpr double kSilence = 0.15;  // [s]

  CommandFollower(const FollowerLimits& limits, std::size_t joints) : limits_(limits), joints_(joints) {}

  // A motion of this kind begins at the pose in the next packet.
  void begin(FollowedMotion motion);
  // The program's newest command, stamped with its clock: joint positions or velocities, a column-major
  // transform or a twist.
  void push(std::int64_t stamp_ns, std::span<const double> values);
  // Stops within the limits, until resume().
  void stop() { stopped_ = true; }
  // Follows later commands again, from the arm's present position.
  void resume();

  // The answer to a packet that shows `desired`.
  void step(const DesiredMotionState& desired, InterfaceCommand& command) noexcept;

  // Whether commands are followed: there are some, and neither stop() nor silence ended the motion.
  bool follows() const { return !stopped_ && !track_.empty(); }
  bool is_stopped() const { return stopped_; }
  bool is_at_rest() const;
  double delay() const { return track_.delay(); }

 private:
  void take_base(const DesiredMotionState& desired);
  bool shows_sent(const DesiredMotionState& desired);
  void follow_joints(const SampleTrack::Place& place);
  void follow_pose(const SampleTrack::Place& place);
  void halt();
  void turn();
  void send(InterfaceCommand& command);
  std::size_t axes() const { return is_cartesian() ? 6 : joints_; }
  bool is_cartesian() const { return motion_ >= FollowedMotion::cartesian_pose; }
  const AxisLimits& limits(std::size_t axis) const {
    return !is_cartesian() ? limits_.joints[axis] : axis < 3 ? limits_.linear : limits_.angular;
  }

  FollowerLimits limits_;
  std::size_t joints_;
  FollowedMotion motion_ = FollowedMotion::joint_position;
  SampleTrack track_;
  bool begun_ = false;                        // a command was sent in this motion
  bool stopped_ = false;                      // on request, or by silence
  int silent_ = 0;                            // periods since the newest command
  std::array<AxisState, kMaxJoints> axes_{};  // joints, or the axes of the base: position, rotation
  Matrix3 rotation_ = Matrix3::Identity();
  // The last commands, newest first, and the number of packets until the arm shows one.
  std::array<std::array<double, 16>, 3> sent_{};
  int lag_ = 0;
  bool lag_known_ = false;  // measured in motion; a property of the arm, not of the motion
  int unknown_ = 0;         // consecutive packets that match none of them
};

}  // namespace multipanda
