#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "arm_interface/arm_interface.hpp"
#include "core/cycle/backend.hpp"
#include "core/model/arm_model.hpp"
#include "core/state/arm_state.hpp"
#include "fci/client/end_effector.hpp"
#include "fci/client/net_ft.hpp"
#include "fci/wire/robot_state.hpp"

namespace multipanda {
struct SceneArm;
}

namespace multipanda::fci {

// What a connected arm reports about itself.
struct ArmIdentity {
  int version = 0;         // of the protocol
  std::string generation;  // "FR3", "Panda"
  bool model_checked = false;
  std::string model_report;  // the result of the comparison of the models, or why there was none
};

// A higher torque rate stops the arm: its limit, less the margin of Franka's library [N m/s].
constexpr double kTorqueRateMax = 1000 - 1e-3;

enum class ModelCheck : std::uint8_t {
  off,
  report,  // refuse different kinematics, report different masses
  refuse   // also refuse different masses
};

// Address and configuration of one real or virtual arm.
struct FciArmConfig {
  std::string name;     // for messages: "left"
  std::string address;  // IPv4 address or host name
  std::uint16_t port = 1337;
  int version = 0;  // of the protocol, 4 to 10; 0: asks the arm

  // The model of the controllers; its X_WB rotates the arm's forces to world axes.
  std::shared_ptr<const ArmModel> model;
  // The load that `model` contains behind the flange (the hand, fingers closed). The arm must declare it,
  // together with `tool`, as its end effector. In the flange.
  Load hand;
  // The same hand as declared by the arm; none: `hand`.
  std::optional<Load> hand_declared;

  // Sent to the arm at the start and after each reconnection, and checked in its state. Requests of the run
  // replace them; a load that was requested is not sent to an arm that has lost it, which waits for a new
  // request. The end effector's mass can only be set in the arm's settings: a difference is reported.
  ArmFrames frames;
  Load tool, load;
  std::optional<JointVector> joint_stiffness;  // of the arm's own controllers; none: unchanged
  std::optional<Vector6> cartesian_stiffness;  // in K [N/m, N m/rad]
  std::optional<SetCollisionThresholds> thresholds;

  double low_pass_hz = 0;  // first order, on the torque, before the last limit; 0: none
  // True: write() applies the low-pass and limits torque and rate itself. For torques that do not come from a
  // control cycle, whose safety stage is otherwise the last to change them.
  bool limit_rate = false;

  std::optional<ModelCheck> model_check;  // overrides FciOptions

  // True: an arm found in a reflex is recovered without asking. Otherwise it stays stopped, and
  // RecoverFromError sets it up.
  bool recover_at_start = false;

  std::optional<NetFt::Config> force_sensor;

  // Creates the gripper; empty: none. Called off the loop, once.
  std::function<std::unique_ptr<EndEffector>()> end_effector;
};

// The motion of a connected arm. Except for torque, the arm's own controllers follow the commands.
enum class ArmMotion : std::uint8_t {
  none,  // nothing: the arm holds itself
  torque,
  joint_position,
  joint_velocity,
  cartesian_pose,
  cartesian_velocity
};

struct FciOptions {
  // False: start() only connects and configures; every arm holds itself until request_motion().
  bool begin_torque = true;
  // For virtual arms of one server in lock-step: wait() gathers the states of the same step of all connected
  // arms, now() is the arms' own time. Otherwise an arm is due when its packet arrives, and now() is this
  // computer's time.
  bool lockstep = false;
  double silence_s = 0.02;      // wait() returns an empty set after this time without a packet
  double first_states_s = 1.0;  // for a state of every arm in the first wait(); arms that have one are held
  // While start() waits for other arms, a started arm is held for this many packets; then start() fails. Not
  // in lock-step, where the world waits.
  int longest_wait_packets = 100;
  double lost_after_s = 1.0;                     // an arm silent for this long counts as disconnected
  double state_timeout_s = 1.0;                  // longest wait for a state that shows a request's effect
  double lockstep_wait_s = 2.0;                  // lock-step: longest wait for the slowest arm
  double request_patience_s = kRequestPatience;  // requests older than this are not executed
  ModelCheck model_check = ModelCheck::report;
  // Messages for the user: warnings at the start, lost connections, ends of motions. Called off the loop,
  // from the arms' threads, never concurrently.
  std::function<void(const std::string&)> report;
};

// Real arms through the control interface, any generation, all in one loop. See docs/real_arms.md.
//
// The loop touches UDP only: wait() takes what has arrived on all arms' sockets, write() answers an arm's
// packet with its torque at once: the command's delay is the computing time. One thread per arm, the
// commander, does everything over TCP: connecting, settings, starting the torque motion, recovery.
//
// start() connects all arms at the same time, checks versions and models, sends each arm its configuration
// and starts torque control on all of them; those that have begun are held meanwhile. If one arm cannot be
// reached or does not begin, it leaves all arms as they were and throws std::runtime_error with the arm's
// name and a remedy; force sensors come first. finish() ends the motions and holds the arms until they have
// left them; then they hold themselves. A failure of one arm does not affect the others. ArmState::mode:
//   move          torques are taken
//   reflex, user_stopped, guiding, other   as the arm says; `other` also when its motion has ended or was
//                 stopped on request
//   recovering    the commander is recovering it
//   disconnected  the connection is lost, or no packet came for lost_after_s
// Commands are sent in `move` only. RecoverFromError returns to `move`: clears the error and starts the
// torque motion; refused when there is nothing to recover from. Reconnect does the same after a loss. The arm
// is then held until a controllet is activated. Supported requests: SetLoad, SetFrames, SetJointStiffness,
// SetCartesianStiffness, SetCollisionThresholds and SetGuidingMode (most arms refuse them in `move`; then the
// motion is stopped for them and started again if the arm is at rest), RecoverFromError, Reconnect,
// StopMotion, and the gripper's.
class FciBackend : public Backend {
 public:
  // Throws std::invalid_argument: no arms, an arm without model, not seven joints, values out of range.
  explicit FciBackend(std::vector<FciArmConfig> arms, FciOptions options = {});
  ~FciBackend() override;  // closes; call finish() first, otherwise the arms stop with an error

  std::size_t arm_count() const override;
  Capabilities capabilities(ArmIndex arm) const override;
  void start() override;
  void finish() override;

  ArmSet wait() override;
  ArmSet wait_until(HostTime deadline) override;  // not in lock-step
  bool ended() const override;  // false between start() and finish(), because arms can always be reconnected
  LoopTime now() const override;
  // A disconnected arm is never due; only the mode of its state changes.
  void read(ArmSet due, std::span<ArmState> states) override;
  void write(ArmSet due, std::span<const ArmCommand> commands) override;
  std::uint64_t overruns() const override;  // packets lost, all arms
  const ForceReading* force_reading(ArmIndex arm) override;
  using Backend::request;
  std::future<RequestAnswer> request(ArmIndex arm, ArmRequest request) override;
  std::future<RequestAnswer> request(ArmIndex arm, GripperRequest request) override;

  // --- loop: motions other than torque, per arm ---
  // Requests a motion of the arm. The commander stops the running motion and starts the new one; the mode is
  // `recovering`, then `move`. Never waits. RecoverFromError and Reconnect also start it.
  void request_motion(ArmIndex arm, ArmMotion motion) noexcept;
  // Whether the motion runs, according to the newest state.
  bool is_running(ArmIndex arm, ArmMotion motion) const noexcept;
  // The newest packet, as received.
  const RobotState& packet(ArmIndex arm) const noexcept;
  // Answers the newest packet of an arm in a motion other than torque; write() is for torque.
  void command(ArmIndex arm, RobotCommand& command) noexcept;

  // --- any thread ---
  std::optional<ConnectionStatistics> connection(ArmIndex arm) const override;
  ArmIdentity identity(ArmIndex arm) const;  // after start()

 private:
  struct Implementation;
  std::unique_ptr<Implementation> self_;
};

// Configuration from the scene for the arm at `address`: model, frames, tool, load.
// Throws std::invalid_argument.
FciArmConfig fci_arm_config(const SceneArm& arm, const std::string& address);

}  // namespace multipanda::fci
