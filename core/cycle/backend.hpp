#pragma once

#include <array>
#include <future>
#include <optional>
#include <span>
#include <string>
#include <variant>

#include "core/state/arm_state.hpp"
#include "core/types/arm_set.hpp"
#include "core/types/time.hpp"

namespace multipanda {

// What a backend can and cannot do for one arm.
struct Capabilities {
  bool simulated = false;
  bool lockstep = false;              // the world stands still while the loop computes
  bool compensates_gravity = true;    // torques exclude gravity (all backends: design of the interface)
  bool compensates_friction = false;  // or has none: compensation on top would push
  bool has_external_torque = false;   // delivers tau_ext_hat and the wrench estimate
  bool has_contact_truth = false;     // delivers the simulator's own contact wrench
  bool has_gripper = false;           // knows the requests to a parallel gripper
  bool has_vacuum = false;            // knows the requests to a vacuum gripper
  double period_s = 0.001;
};

// Requests to one arm, off the loop. Not every backend knows every request; the answer says so.
struct SetLoad {
  Load load;
};  // payload, as declared to the arm
struct SetFrames {
  std::optional<Pose> X_FE, X_EK;
};  // end-effector and stiffness frame
struct SetJointStiffness {
  JointVector stiffness;
};  // of the arm's own controller [N m/rad]
struct SetCartesianStiffness {
  Vector6 stiffness;
};  // of the arm's own controller, in K [N/m, N m/rad]
// Contact is reported above lower, a reflex stops the arm above upper (both on absolute values).
struct ContactThresholds {
  JointVector torque_lower, torque_upper;  // [N m] (n x 1)
  Vector6 wrench_lower, wrench_upper;      // [N, N m]
};
struct SetCollisionThresholds {
  ContactThresholds nominal;                      // at constant velocity and at rest
  std::optional<ContactThresholds> acceleration;  // while the arm accelerates; none: as nominal
};
struct SetGuidingMode {
  std::array<bool, 6> axes{};  // free to be guided by hand: x, y, z, roll, pitch, yaw
  bool elbow = false;
};
struct RecoverFromError {};  // leads to hold, never back into the controllet that ran
struct Reconnect {};         // real arms: after the connection was lost
struct StopMotion {};
struct SetUserStop {
  bool pressed = false;
};  // simulated arms: the stop button
// Gripper; the answer comes when the motion is over. A new motion ends the one that runs.
struct GripperHoming {};
struct GripperMove {
  double width = 0, speed = 0.1;  // [m, m/s]
};
struct GripperGrasp {
  double width = 0, speed = 0.1, force = 40;  // [m, m/s, N]
  double tolerance_inner = 0.005,
         tolerance_outer = 0.005;  // grasped within [width - inner, width + outer] [m]
};
struct GripperStop {};
struct VacuumOn {
  double pressure_mbar = 100;
  double timeout_s = 1;
};
struct VacuumDrop {
  double timeout_s = 1;
};
struct VacuumStop {};
struct PlaceObject {
  std::string object;
  Pose X_WO;
};  // simulation: put a free object somewhere
struct ResetSimulation {};
struct PauseSimulation {
  bool paused = true;
};
struct StepSimulation {
  std::uint32_t periods = 1;
};  // of a paused simulation; answered when they are over
using ArmRequest =
    std::variant<SetLoad, SetFrames, SetJointStiffness, SetCartesianStiffness, SetCollisionThresholds,
                 SetGuidingMode, RecoverFromError, Reconnect, StopMotion, SetUserStop, GripperHoming,
                 GripperMove, GripperGrasp, GripperStop, VacuumOn, VacuumDrop, VacuumStop, PlaceObject,
                 ResetSimulation, PauseSimulation, StepSimulation>;

struct ArmAnswer {
  bool success = false;
  std::string reason;  // why not, and what to do
};

// What the arms are asked to do in one step.
struct ArmCommand {
  JointVector tau_cmd;  // without gravity and friction [N m] (n x 1)
};

// A world of arms: simulated, real or recorded. One contract, tested on all of them
// (backends/contract_test.cpp).
//
// The loop calls wait, read, write in this order, from one thread. `request` may be called from any thread at
// any time; it never delays the loop.
class Backend {
 public:
  virtual ~Backend() = default;

  virtual std::size_t arm_count() const = 0;
  virtual Capabilities capabilities(ArmIndex arm) const = 0;

  // Called once by the loop's thread before the first wait(). Throws std::runtime_error if the arms cannot be
  // had.
  virtual void start() {}
  // Called once by the loop's thread after the last write(): leave the arms safe.
  virtual void finish() {}

  // Blocks until the state of at least one arm is due, on the backend's own clock. In lock-step this is where
  // the world moves on, by the torques of the last write(). Simulation: all arms; real arms: those whose
  // packet arrived. Empty: no arm is due, because the backend has ended(), or because real arms are silent:
  // then the step lets states age, takes requests and sends nothing.
  virtual ArmSet wait() = 0;
  // After an empty wait(): no more cycles will come (end of a recording, a simulation that failed).
  virtual bool ended() const { return true; }
  // The loop's time of the step that wait() announced.
  virtual LoopTime now() const = 0;
  // Fills the states of the arms due; the others keep what they had. No allocation, no lock.
  virtual void read(ArmSet due, std::span<ArmState> states) = 0;
  // Sends torques to the arms due. No allocation, no lock.
  virtual void write(ArmSet due, std::span<const ArmCommand> commands) = 0;
  // Cycles that were missed so far (paced simulation) or packets lost (real arms).
  virtual std::uint64_t overruns() const { return 0; }

  virtual std::future<ArmAnswer> request(ArmIndex arm, ArmRequest request) = 0;
};

}  // namespace multipanda
