#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "core/cycle/backend.hpp"
#include "core/model/arm_model.hpp"
#include "fci/client/arm_statistics.hpp"
#include "fci/client/end_effector.hpp"
#include "fci/wire/robot_state.hpp"

namespace multipanda::fci {

enum class ModelCheck : std::uint8_t {
  off,
  report,  // another kinematics is refused, other masses are reported with figures
  refuse   // other masses are refused, too
};

// One real arm, or a virtual one: where it is and what it is told before it moves.
struct FciArmConfig {
  std::string name;     // for messages: "left"
  std::string address;  // IPv4 address or host name
  std::uint16_t port = 1337;
  int version = 0;  // of the protocol, 4 to 10; 0: asks the arm

  // What the controllers know of the arm; its X_WB turns the arm's forces into world axes.
  std::shared_ptr<const ArmModel> model;
  // What `model` contains behind the flange (the hand, fingers closed) and the arm therefore must declare as
  // its end effector, together with `tool`. In the flange.
  Load hand;

  // Told to the arm at the start, and again after each reconnection; each is checked in the state that comes
  // back. The end effector's mass can be set in the arm's own settings only: a difference is reported.
  ArmFrames frames;
  Load tool, load;
  std::optional<JointVector> joint_stiffness;  // of the arm's own controllers; none: as the arm has it
  std::optional<Vector6> cartesian_stiffness;  // in K [N/m, N m/rad]
  std::optional<SetCollisionThresholds> thresholds;

  // On the torque, last before the wire. The safety stage has limited torque and torque rate already. Here
  // the rate stays just below the arm's own limit of 1000 N m/s, counted from the torque last sent; with
  // `limit_rate` counted from the torque that the arm shows to be in use, so that a command lost on the way
  // costs no reflex.
  bool limit_rate = false;
  double low_pass_hz = 0;  // first order, on the torque; 0: none

  std::optional<ModelCheck> model_check;  // other than FciOptions says

  // A gripper beside the arm; empty: none. Called off the loop, once.
  std::function<std::unique_ptr<EndEffector>()> end_effector;
};

// What a connected arm is driven by. Other than torque: the arm's own controllers follow what is sent.
enum class ArmMotion : std::uint8_t {
  none,  // nothing: the arm holds itself
  torque,
  joint_position,
  joint_velocity,
  cartesian_pose,
  cartesian_velocity
};

struct FciOptions {
  // False: start() connects and sets up only, and every arm holds itself until want() says otherwise.
  bool begin_torque = true;
  // For virtual arms of one server in lock-step: wait() gathers the states of the same step of all connected
  // arms, now() is the arms' own time. Else: an arm is due when its packet arrives, now() is this computer's
  // time.
  bool lockstep = false;
  double silence_s = 0.02;       // wait() returns with nobody due after so long without any packet
  double lost_after_s = 1.0;     // an arm silent for so long counts as disconnected
  double lockstep_wait_s = 2.0;  // in lock-step: how long the slowest arm is waited for
  ModelCheck model_check = ModelCheck::report;
  // What a user should know and nobody asked for: warnings at the start, a connection lost, a motion ended.
  // Called off the loop, from the arms' threads, one at a time.
  std::function<void(const std::string&)> say;
};

// Real arms through the control interface, any generation, all in one loop. docs/real_arms.md is for people.
//
// The loop touches UDP only: wait() takes what has arrived on all arms' sockets, write() answers an arm's
// packet with its torque at once: the command's delay is the computing time. One thread per arm, the
// commander, does everything that talks TCP: connecting, settings, starting the torque motion, recovery.
//
// start() connects all arms at the same time, checks versions and models, tells each arm its configuration
// and starts torque control on all of them; if one arm cannot be had, all are left as they were and it throws
// std::runtime_error with the arm's name and a cure. finish() ends the motions; the arms hold themselves.
//
// Every arm fails alone. ArmState::mode says how it is:
//   move          torques are taken
//   reflex, user_stopped, guiding, other   as the arm says; `other` also when its motion has ended or was
//                 stopped on request
//   recovering    the commander is bringing it back
//   disconnected  the connection is lost, or no packet came for lost_after_s
// In all but `move` nothing is sent. RecoverFromError leads back to `move`: clears the error and starts the
// torque motion; refused when there is nothing to recover from. Reconnect does the same after a loss. The
// modes layer holds such an arm until somebody switches.
//
// Requests known: SetLoad, SetFrames, SetJointStiffness, SetCartesianStiffness, SetCollisionThresholds and
// SetGuidingMode (by most arms not while in move: the answer says so; then the motion is stopped for them and
// started again if the arm stands still), RecoverFromError, Reconnect, StopMotion, and the gripper's.
class FciBackend : public Backend {
 public:
  // Throws std::invalid_argument: no arms, an arm without model, not seven joints, values out of range.
  explicit FciBackend(std::vector<FciArmConfig> arms, FciOptions options = {});
  ~FciBackend() override;  // closes; call finish() first, else the arms stop with an error

  std::size_t arm_count() const override;
  Capabilities capabilities(ArmIndex arm) const override;
  void start() override;
  void finish() override;

  ArmSet wait() override;
  // The same, but returns at `deadline` at the latest (with nobody due): for loops that also drive simulated
  // arms. Not in lock-step.
  ArmSet wait_until(HostTime deadline);
  bool ended() const override;  // false between start() and finish(): an arm can always be reconnected
  LoopTime now() const override;
  // An arm that is disconnected is never due; of its state only the mode changes.
  void read(ArmSet due, std::span<ArmState> states) override;
  void write(ArmSet due, std::span<const ArmCommand> commands) override;
  std::uint64_t overruns() const override;  // packets lost, all arms
  std::future<ArmAnswer> request(ArmIndex arm, ArmRequest request) override;

  // --- loop: motions other than torque, beside it per arm ---
  // From now on the arm is to be driven so; its commander stops what runs and begins the new motion, the
  // states show it: `recovering`, then `move`. Never waits. RecoverFromError and Reconnect lead to it as
  // well.
  void want(ArmIndex arm, ArmMotion motion) noexcept;
  // Does it run, as the newest state shows it?
  bool runs(ArmIndex arm, ArmMotion motion) const noexcept;
  // The newest packet as it came.
  const RobotState& packet(ArmIndex arm) const noexcept;
  // Answers the newest packet of an arm whose motion is not torque; write() is for torque.
  void command(ArmIndex arm, RobotCommand& command) noexcept;

  // --- any thread ---
  ArmStatistics statistics(ArmIndex arm) const;
  ArmIdentity identity(ArmIndex arm) const;  // after start()

 private:
  struct Implementation;
  std::unique_ptr<Implementation> self_;
};

}  // namespace multipanda::fci
