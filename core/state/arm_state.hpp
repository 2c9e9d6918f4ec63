#pragma once

#include <cstdint>

#include "core/types/joints.hpp"
#include "core/types/spatial.hpp"
#include "core/types/time.hpp"

// What a backend delivers for one arm, once per cycle. Names and signs follow the arm's control interface
// (CONVENTIONS.md): B is the arm's base, F the flange, E the end effector, K the stiffness frame.
namespace multipanda {

// disconnected: a real arm whose connection is lost; its state is the last one that came.
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

// Frames that the user sets on the arm. Defaults: E = F, K = E.
struct ArmFrames {
  Pose X_FE;  // end effector in the flange (F_T_EE)
  Pose X_EK;  // stiffness frame in the end effector (EE_T_K)
};

// A rigid body carried by the flange.
struct Load {
  double mass = 0;                      // [kg]
  Vector3 p_FC = Vector3::Zero();       // centre of mass in the flange [m]
  Matrix3 inertia_C = Matrix3::Zero();  // about the centre of mass, axes of F [kg m^2]
};

// A parallel gripper or a vacuum gripper on the flange, as it last reported; slower than the arm.
struct GripperState {
  bool present = false;
  double width = 0, max_width = 0;  // between the fingers; max_width is found by homing [m]
  bool grasped = false;             // holds something of the width that the last grasp named, or by vacuum
  bool moving = false;              // a request is being carried out
};

struct ArmState {
  // Packet
  std::uint64_t sequence = 0;  // counts the arm's packets; 0: none yet
  RobotTime t_robot;           // the arm's own clock
  HostTime t_host;             // when this computer took it
  bool fresh = false;          // arrived for this cycle
  double age_s = 0;            // since it was taken, at this cycle's start [s]

  // Joints (n x 1)
  JointVector q;      // measured position [rad]
  JointVector dq;     // measured velocity [rad/s]
  JointVector tau_J;  // measured link-side torque, gravity included [N m]

  // What the arm understood last
  JointVector tau_J_d;  // commanded torque in use, without gravity [N m]

  // Forces: what the arm exerts on the environment. Sizes 0 / flags false where the backend cannot tell.
  JointVector tau_ext_hat;  // estimated external joint torque [N m]
  bool has_wrench_estimate = false;
  Wrench F_K_W_est;  // estimated, about K, world axes
  bool has_contact_truth = false;
  Wrench F_K_W_true;  // from the simulator's contacts on the hand and tool, about K, world axes

  // Configuration in force; `config_version` changes with it
  std::uint32_t config_version = 0;
  ArmFrames frames;
  Load tool;  // end effector, as declared to the arm
  Load load;  // payload, as declared to the arm

  // Condition
  ArmMode mode = ArmMode::other;
  std::uint64_t errors = 0;  // bit i: the i-th error flag of the control interface
  double command_success_rate = 1;
  GripperState gripper;
};

}  // namespace multipanda
