#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>

#include "runtime/embedded/command_follower.hpp"
#include "runtime/embedded/torque_answer.hpp"

namespace multipanda {

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
