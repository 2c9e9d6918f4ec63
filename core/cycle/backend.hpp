#pragma once

#include <limits>
#include <optional>
#include <span>
#include <string>

#include "core/cycle/requests.hpp"
#include "core/state/arm_state.hpp"
#include "core/state/force_sensor.hpp"
#include "core/types/arm_set.hpp"
#include "core/types/time.hpp"

namespace multipanda {

// Capabilities of a backend for one arm.
struct Capabilities {
  bool simulated = false;
  bool lockstep = false;              // the world is paused while the loop computes
  bool compensates_gravity = true;    // torques exclude gravity; true for all backends
  bool compensates_friction = false;  // or has no friction: compensating it would push the arm
  bool has_external_torque = false;   // delivers tau_ext_hat and the wrench estimate
  bool has_contact_truth = false;     // delivers the simulator's own contact wrench
  bool has_gripper = false;           // knows the requests to a parallel gripper
  bool has_vacuum = false;            // knows the requests to a vacuum gripper
  // No command is lost or late. ArmState::tau_J_d then need not be the last one: a simulated motor lags.
  bool every_command_arrives = false;
  bool own_clock = false;         // its packets arrive at its own times, independent of other arms
  double torque_low_pass_hz = 0;  // cutoff of a low-pass on its torque before the last limit; 0: none
  // A higher torque rate makes the arm stop itself, whatever its limits. [N m/s]
  double torque_rate_max = std::numeric_limits<double>::infinity();
};

// The command to one arm in one step.
struct ArmCommand {
  JointVector tau_cmd;  // without gravity and friction [N m] (n x 1)
  bool usable = true;   // whether the arm accepts it, according to its last state
};

// Arms behind one contract: simulated, real or recorded. backends/contract_test.cpp tests the contract.
//
// The loop calls wait, read, write in this order, from one thread. `request` may be called from any thread at
// any time; it never delays the loop.
class Backend {
 public:
  virtual ~Backend() = default;

  virtual std::size_t arm_count() const = 0;
  virtual Capabilities capabilities(ArmIndex arm) const = 0;
  // The nominal time between two steps of an arm [s].
  virtual double period() const { return kArmPeriod; }

  // Called once by the loop's thread before the first wait(). Throws std::runtime_error if an arm
  // cannot be reached.
  virtual void start() {}
  // Called once by the loop's thread after the last write(): leave the arms safe.
  virtual void finish() {}

  // Blocks until the state of at least one arm is due, and returns the arms that are due: all simulated arms,
  // or the real arms whose packet arrived. In lock-step, the world advances here with the torques of the last
  // write(). The set is empty if the backend has ended() or if the real arms are silent. The step then takes
  // requests and sends nothing.
  virtual ArmSet wait() = 0;
  // The same, but returns at `deadline` at the latest, with no arm due. For a loop that drives the arms of
  // two backends. A backend whose wait() does not block need not override it.
  virtual ArmSet wait_until(HostTime /*deadline*/) { return wait(); }
  // After an empty wait(): no more cycles will follow (end of a recording, a failed simulation).
  virtual bool ended() const { return true; }
  // The loop's time of the current step.
  virtual LoopTime now() const = 0;
  // Fills the states of the arms that are due; the other states stay unchanged. No allocation, no lock.
  virtual void read(ArmSet due, std::span<ArmState> states) = 0;
  // Sends torques to the arms that are due. No allocation, no lock.
  virtual void write(ArmSet due, std::span<const ArmCommand> commands) = 0;
  // The pose in the world of an object, of the states that were read. None: no such object, or its place is
  // unknown, as beside real arms. Loop thread, between two wait(). No allocation, no lock.
  virtual std::optional<Pose> object_pose(const std::string& /*name*/) const { return std::nullopt; }
  // What the arm's force sensor measured last, with its present age; the same address from construction on.
  // nullptr: it has none. Loop thread. No allocation, no lock.
  virtual const ForceReading* force_reading(ArmIndex /*arm*/) { return nullptr; }
  // Cycles that were missed so far (paced simulation) or packets lost (real arms).
  virtual std::uint64_t overruns() const { return 0; }
  // Packets of the arm's connection. Any thread. None: the arm has no connection.
  virtual std::optional<ConnectionStatistics> connection(ArmIndex /*arm*/) const { return std::nullopt; }

  // Requests (core/cycle/requests.hpp). A backend refuses the requests that it does not support.
  virtual std::future<RequestAnswer> request(ArmIndex arm, ArmRequest request) = 0;
  virtual std::future<RequestAnswer> request(ArmIndex arm, GripperRequest request);
  virtual std::future<RequestAnswer> request(WorldRequest request);
};

}  // namespace multipanda
