#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>

#include "core/safety/torque_limiter.hpp"
#include "core/state/arm_state.hpp"
#include "fci/client/posture_hold.hpp"
#include "runtime/embedded/command_follower.hpp"

namespace multipanda {

// Torques that answer one arm's packets: those of a program that runs on another clock while they are recent,
// otherwise those of the arm's hold (PostureHold: the law of `hold_controllet` without its loop) in the
// posture in which the program fell silent. All keep the arm's torque-rate limit relative to both the torque
// in use and the torque sent last, so that a lost answer causes no discontinuity.
//
// The arm's thread, once per packet; nothing allocates.
class TorqueAnswer {
 public:
  static constexpr double kKept = 0.02;  // a torque is repeated at most this long [s]
  static constexpr double kFade = 0.1;   // [s] from the hold back to the program's torques

  // low_pass_hz: on all torques, first order; 0: none. `scene`: limits of the arm's scene, of which the
  // tighter ones apply; none: the model's.
  explicit TorqueAnswer(const std::shared_ptr<const ArmModel>& model, double low_pass_hz = 0,
                        const ArmLimits* scene = nullptr);

  // A motion begins; the arm's torque is zero.
  void begin();
  // The program's newest torque (n x 1), finite.
  void take(const JointVector& tau);
  // Holds the present posture from now on, until resume().
  void hold() { stopped_ = true; }
  // Uses the program's later torques again.
  void resume();

  // The answer to a packet.
  const JointVector& step(const ArmState& state) noexcept;

  bool is_holding() const { return holding_; }
  bool fell_silent() const { return silent_; }  // silent and not resumed
  // While holding: whether the arm is at rest.
  bool is_at_rest() const { return still_ >= kStill; }

 private:
  static constexpr int kStill = 20;  // periods

  fci::PostureHold posture_;
  TorqueLimiter limiter_;
  JointVector tau_program_, tau_;
  bool has_torque_ = false;  // from the program, since begin() or resume()
  bool stopped_ = false, silent_ = false, holding_ = false;
  int age_ = 0;       // periods since the program's newest torque
  int still_ = 0;     // periods at rest
  double share_ = 1;  // weight of the program's torque while it fades in
};

// What drives an arm of a hardware component: the claimed kind of command interfaces.
enum class ArmDrive : std::uint8_t {
  none,  // no controller: the arm holds itself
  effort,
  joint_position,
  joint_velocity,
  cartesian_pose,
  cartesian_velocity
};
inline constexpr std::size_t kArmDrives = 6;

// A program's requests to an arm: its drive and the newest command. Written by the program's loop, read by
// the arm's thread.
struct ArmOrder {
  std::uint32_t change = 0;  // counts selections of a drive
  ArmDrive drive = ArmDrive::none;
  std::uint64_t number = 0;   // counts commands since the selection; 0: none yet
  std::uint32_t resumed = 0;  // value of ArmAnswer::holds() known to the program
  std::int64_t stamp_ns = 0;  // the program's clock
  std::array<double, SampleTrack::kValues> values{};
};

// Answers every packet of one arm, whatever the commanding program does: with its newest command while that
// is recent; after a change of drive or when the program is silent, until the arm has left its motion, with
// joint damping about the present posture (effort) or a stop within the limits (motions). The next motion is
// requested once the arm is at rest, at the latest after kLongestStop. A motion begins in hold: only commands
// written since then count, and torques fade in.
//
// The arm's thread, once per packet; nothing allocates.
class ArmAnswer {
 public:
  static constexpr double kLongestStop = 1.0;  // [s]

  // low_pass_hz: of torques; 0: none. `scene`: limits of torques; none: the model's.
  ArmAnswer(std::shared_ptr<const ArmModel> model, const FollowerLimits& limits, double low_pass_hz = 0,
            const ArmLimits* scene = nullptr);

  enum class Kind : std::uint8_t { none, torque, motion };
  // `running`: the motion in which the arm accepts commands, from its newest packet; none: no motion.
  Kind step(const ArmOrder& order, const ArmState& state, const DesiredMotionState& desired,
            ArmDrive running) noexcept;
  const JointVector& torque() const { return tau_; }
  const InterfaceCommand& motion() const { return command_; }
  // A new connection: no motion is requested yet.
  void reset();
  // The motion to request from the arm, once per change.
  std::optional<ArmDrive> take_request();

  bool follows() const { return follows_; }       // follows the program's commands
  std::uint32_t holds() const { return holds_; }  // how often the program became silent in a motion

 private:
  void begin(ArmDrive running);
  void take(const ArmOrder& order);
  void request(ArmDrive drive);

  std::size_t joints_;
  TorqueAnswer torque_;
  CommandFollower follower_;
  JointVector tau_, tau_program_;
  InterfaceCommand command_;
  std::uint32_t change_ = 0, holds_ = 0;
  std::uint64_t number_ = 0;
  ArmDrive requested_ = ArmDrive::none;  // by the program
  ArmDrive asked_ = ArmDrive::none;      // from the arm
  ArmDrive running_ = ArmDrive::none;
  std::optional<ArmDrive> request_;
  bool leaving_ = false, follows_ = false;
  bool silent_ = false;  // the program is silent and was not resumed, or the motion is being left
  int leaving_for_ = 0;  // periods
};

}  // namespace multipanda
