#pragma once

#include <array>
#include <memory>
#include <span>

#include "arm_interface/arm_error.hpp"
#include "arm_interface/arm_interface.hpp"
#include "backends/simulated_arm/async_planner.hpp"
#include "backends/simulated_arm/inverse_kinematics.hpp"
#include "backends/simulated_arm/measured_limits.hpp"
#include "core/types/spatial.hpp"
#include "core/types/time.hpp"

// Small motions between poses, and checks of pose matrices. No allocation.
namespace multipanda {

// [p - p_before; rotation vector of R R_before^T], axes of the frame that both are given in [m, rad]. From
// the skew part: errors of orthonormality in either, like those of single precision, do not reach it.
Vector6 pose_difference(const Pose& X, const Pose& X_before);

// The pose that differs from X by dX in that sense.
Pose displaced(const Pose& X, const Vector6& dX);

// The rotation nearest to R, which must be within about 0.1 of one: two steps of Newton's iteration for the
// polar factor, error 1e-5 -> 1e-20.
Matrix3 nearest_rotation(Matrix3 R);

// Deviation of T from a right-handed rotation and a last row 0 0 0 1, by lengths of rows and columns, with
// the check and tolerance of Franka's client. 1 or more: not a frame.
double error_of_frame(const Eigen::Matrix4d& T);

// The desired motion as published by the arm. Derivatives are backward differences over one period of 1 ms.
struct DesiredState {
  JointVector q, dq, ddq;            // q_d, dq_d, ddq_d (n x 1)
  Pose X_BE_d, X_BE_c;               // O_T_EE_d = kinematics of q_d; O_T_EE_c, with an exact rotation
  Twist V_BE_d, V_BE_c;              // O_dP_EE_d, O_dP_EE_c
  Vector6 A_BE_d = Vector6::Zero();  // not published; for the arm's own controllers [m/s^2, rad/s^2]
  Vector6 A_BE_c = Vector6::Zero();  // O_ddP_EE_c [m/s^2, rad/s^2]
  // elbow_d: that of q_d. elbow_c: as commanded; without a command elbow_d and joint 3's derivatives. Second
  // entries of the derivatives: 0.
  Elbow elbow_d{}, elbow_c{}, delbow_c{}, ddelbow_c{};
};

enum class MotionStep : std::uint8_t {
  moving,
  at_rest,       // finished as commanded
  still_moving,  // commanded to be finished, but not at rest: no stop within the limits takes one period
  violation,     // see violations(); the state stays that of the previous period
  input_error    // a command that is not finite or of the wrong size; the state stays
};

// The motion generators of the arm's interface (enum MotionGenerator, arm_interface.hpp): turn commands into
// the desired motion of every period, and check them as the arm does. Any thread; only the constructor
// allocates; at most 10 us per step.
//
// hold() -> [start() -> step() ... at_rest | still_moving | violation | input_error] -> hold() ...
// Commands are accepted if their backward differences keep the limits relative to the history of desired
// motion or to the published history in single precision: a client only knows the latter, and one ulp of a
// position is 0.1 rad/s^2 at 1 kHz. A rule is violated only if both differ by more than kSlack. Two rules
// allow more, since the limiter of Franka's client needs it:
// - jerk: what one unit in the last place of a published position makes of a third difference (240 rad/s^3,
//   120 m/s^3). That limiter ends the approach to a velocity by a rule that does not check the jerk.
// - velocities tied to positions: those at the last desired position and two periods' deceleration more; a
// client that brakes along such a limit lags by that much. Rules: commanded joint position, velocity,
// acceleration and jerk; commanded Cartesian and elbow velocity, acceleration and jerk (of translation and
// rotation: Euclidean norms); the frame; and position, velocity, acceleration and jerk of the joints that the
// inverse kinematics finds.
//
// The first command of a position or pose generator either continues the start at rest within the limits, or
// lies within the start tolerance: then the motion begins there, at rest (the second command decides). Any
// other first command is an invalid start pose. A missed command is replaced by extrapolation with the last
// acceleration; the rules apply to the result.
//
// Joint generators publish no commanded twist: V_BE_c, A_BE_c, delbow_c are zero, X_BE_c = X_BE_d.
// none: the state stays where the motion began.
class DesiredMotion {
 public:
  static constexpr double kPeriod = kArmPeriod;   // [s]
  static constexpr double kSlack = 1e-5;          // relative, of every limit
  static constexpr double kJointUlp = 0x1p-22;    // of a number of 2 to 4 [rad]
  static constexpr double kPoseUlp = 0x1p-23;     // of a number of 1 to 2 [m, or an entry of R]
  static constexpr double kStartJoint = 5e-3;     // start tolerance [rad]; of the elbow too
  static constexpr double kStartPosition = 2e-3;  // [m]
  static constexpr double kStartRotation = 5e-3;  // [rad]
  static constexpr double kOrthonormal = 1e-5;    // of a commanded rotation matrix

  DesiredMotion(std::shared_ptr<const ArmModel> model, MotionLimits limits);

  // Holds q (n x 1). Also called after every end of a motion.
  void hold(const JointVector& q, const Pose& X_FE);

  // Starts a motion at the position of the last hold(). Never returns not_possible.
  MotionStart start(const MotionRequest& request);
  // One period; nullptr: no command arrived. Asynchronous motion: a command sets the target, nullptr is
  // normal, and motion_finished makes the arm brake: `moving` until it stops, then `at_rest`.
  MotionStep step(const InterfaceCommand* command);

  const DesiredState& state() const { return state_; }
  // Violations of the last step, at least one after MotionStep::violation. The index of a Cartesian rule is 0
  // for translation and 3 for rotation, of the elbow -1.
  std::span<const Violation> violations() const { return {violations_.of.data(), violations_.count}; }
  const MotionLimits& limits() const { return limits_; }
  MotionGenerator generator() const { return generator_; }

 private:
  // The published part of the desired motion used by clients, in the precision of the wire.
  struct Published {
    Eigen::Matrix<float, Eigen::Dynamic, 1, Eigen::ColMajor, kMaxJoints, 1> q, dq, ddq;
    Eigen::Matrix3f R;
    Eigen::Vector3f p;
    Eigen::Matrix<float, 6, 1> V, A;
    float elbow = 0, delbow = 0, ddelbow = 0;
    Pose pose() const { return {R.cast<double>(), p.cast<double>()}; }
  };
  // One period's commanded pose and elbow, compared with the history and its published form.
  struct CartesianCommand {
    Pose X;
    Vector6 V = Vector6::Zero(), V_published = Vector6::Zero(), A = Vector6::Zero();
    bool has_elbow = false;
    double elbow = 0, delbow = 0, ddelbow = 0, delbow_published = 0, ddelbow_published = 0;
    bool begins_here = false;  // a new start: the history is discarded
  };
  MotionStep step_from_start(const InterfaceCommand* command);
  MotionStep step_joints(const InterfaceCommand* command);
  MotionStep step_cartesian(const InterfaceCommand* command);
  MotionStep step_planned(const InterfaceCommand* command);
  MotionStep end_of_motion() const;
  bool is_at_rest() const;
  void extrapolate(CartesianCommand& requested) const;
  MotionStep read_cartesian(const InterfaceCommand& command, CartesianCommand& requested);
  void begin_cartesian(CartesianCommand& requested, bool other_pose, bool other_elbow);
  struct Worst;
  bool check_joint_positions(const JointVector& q);
  void check_joint_command(const JointVector& q, const JointVector& dq, const JointVector& dq_published);
  void check_twist(const Vector6& V, const Vector6& V_published);
  void check_elbow(double elbow);
  void check_solution(const InverseKinematics::Solution& solution, const JointVector& dq,
                      const JointVector& dq_published, const JointVector& ddq_published);
  double upper_velocity(Eigen::Index joint) const;
  double lower_velocity(Eigen::Index joint) const;
  double late(Eigen::Index joint) const;
  void begin_at(const JointVector& q);
  void set_joints(const JointVector& q, const JointVector& dq);
  void publish();
  void report(ArmError error, int index, double value, double limit);
  void report(ArmError error, const Worst& worst);
  void report(ArmError of_velocity, const Worst& velocity, const Worst& acceleration, const Worst& jerk);

  std::shared_ptr<const ArmModel> model_;
  MotionLimits limits_;
  InverseKinematics inverse_;
  AsyncPlanner planner_;
  Pose X_FE_;

  MotionGenerator generator_ = MotionGenerator::idle;
  bool asynchronous_ = false, first_ = true, second_ = false, stopping_ = false, elbow_commanded_ = false;
  DesiredState state_;
  Published published_;

  struct Violations {
    std::array<Violation, 8> of{};
    std::size_t count = 0;
  } violations_, if_continued_;  // if_continued_: had the first pose continued the rest
};

}  // namespace multipanda
