#pragma once

#include <cstdint>
#include <string_view>
#include <type_traits>

#include "core/state/arm_sample.hpp"
#include "core/types/joints.hpp"
#include "core/types/spatial.hpp"
#include "core/types/time.hpp"

// Measurement that a backend delivers for one arm, once per cycle. Names and signs follow the arm's control
// interface (CONVENTIONS.md): B is the arm's base, F the flange, E the end effector, K the stiffness frame.
namespace multipanda {

// disconnected: the connection to a real arm is lost; its state is the last one received.
enum class ArmMode : std::uint8_t {
  other,
  idle,
  move,
  guiding,
  reflex,
  user_stopped,
  recovering,
  disconnected
};

// The arm accepts torque commands; the first one starts its motion.
constexpr bool takes_commands(ArmMode mode) { return mode == ArmMode::idle || mode == ArmMode::move; }

// Name of the mode for users and programs, for example "user_stopped". Not for the loop. An invalid value
// gives "unknown".
std::string_view to_string(ArmMode mode);

// Frames that the user sets on the arm. Defaults: E = F, K = E.
struct ArmFrames {
  Pose X_FE;  // end effector in the flange (F_T_EE)
  Pose X_EK;  // stiffness frame in the end effector (EE_T_K)
};

// A rigid body carried by the flange.
struct Load {
  double mass = 0;                      // [kg]
  Vector3 p_FC = Vector3::Zero();       // center of mass in the flange [m]
  Matrix3 inertia_C = Matrix3::Zero();  // about the center of mass, axes of F [kg m^2]
};

// State that a parallel or vacuum gripper on the flange last reported; updated more slowly than the arm.
struct GripperState {
  bool present = false;
  double width = 0, max_width = 0;  // between the fingers; max_width is found by homing [m]
  bool grasped = false;             // holds an object of the requested width, or by vacuum
  bool moving = false;              // a request is in progress
};

// The state's own type for one of the tables.
template <class T>
using InState = std::conditional_t<std::is_same_v<T, JointArray>, JointVector,
                                   std::conditional_t<std::is_same_v<T, PoseArray>, Pose, T>>;

// What the arm's own interface follows and signals besides its measurements. For display and records; no law
// reads it. `present` is false if the backend does not provide it. Members, with units: arm_sample.hpp; joint
// vectors are n x 1.
struct InterfaceReport {
  bool present = false;
#define MULTIPANDA_REPORT(type, member, name, message, known, doc) InState<type> member{};
  MULTIPANDA_REPORTED_FIELDS(MULTIPANDA_REPORT)
#undef MULTIPANDA_REPORT
};

struct ArmState {
  // Packet
  std::uint64_t sequence = 0;  // counts the arm's packets; 0: none yet
  RobotTime t_robot;           // the arm's own clock
  HostTime t_host;             // when this computer received it
  bool fresh = false;          // arrived for this cycle
  double age_s = 0;            // since it was received, at the start of this cycle [s]

  // Joints (n x 1)
  JointVector q;      // measured position [rad]
  JointVector dq;     // measured velocity [rad/s]
  JointVector tau_J;  // measured link-side torque, gravity included [N m]

  // Last command that the arm accepted
  JointVector tau_J_d;  // commanded torque in use, without gravity [N m]

  // Forces that the arm exerts on the environment. Sizes are 0 and flags false if the backend does not
  // provide them.
  JointVector tau_ext_hat;  // estimated external joint torque [N m]
  bool has_wrench_estimate = false;
  Wrench F_K_W_est;  // estimated, about K, world axes
  bool has_contact_truth = false;
  Wrench F_K_W_true;  // from the simulator's contacts on the hand and tool, about K, world axes

  // Current configuration; `config_version` changes with it
  std::uint32_t config_version = 0;
  ArmFrames frames;
  Load tool;  // end effector, as declared to the arm
  Load load;  // payload, as declared to the arm

  // Condition
  ArmMode mode = ArmMode::other;
  std::uint64_t errors = 0;  // bit i: the i-th error flag of the control interface
  double command_success_rate = 1;
  GripperState gripper;
  InterfaceReport report;
};

// Packets of one arm's connection.
struct ConnectionStatistics {
  std::uint64_t received = 0;       // states taken: newer than the one before
  std::uint64_t lost = 0;           // sequence numbers that never arrived, while connected
  std::uint64_t lost_in_a_row = 0;  // at present
  std::uint64_t lost_in_a_row_max = 0;
  std::uint64_t superseded = 0;          // states that arrived after a newer one: this computer was late
  std::uint64_t foreign = 0;             // datagrams that are not a state of this arm
  std::uint64_t sent = 0, not_sent = 0;  // commands; not_sent: the system did not accept the datagram
  // From taking a state to sending its answer: the loop's computing time [s].
  double answer_delay_mean_s = 0, answer_delay_max_s = 0;
  double command_success_rate = 0;  // as the arm reports it, of the last 100 periods
};

}  // namespace multipanda
