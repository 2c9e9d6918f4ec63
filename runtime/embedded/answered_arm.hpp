#pragma once

#include <atomic>
#include <functional>
#include <future>
#include <memory>
#include <string>
#include <thread>

#include "core/rt/triple_buffer.hpp"
#include "fci/client/fci_backend.hpp"
#include "runtime/embedded/arm_answer.hpp"
#include "runtime/embedded/hardware_arms.hpp"

namespace multipanda {

fci::ArmMotion fci_motion(ArmDrive drive);
// The fields of the wire for a command of a motion.
fci::RobotCommand fci_command(const InterfaceCommand& command);

// One real arm whose packets a thread of its own answers at once, independent of the clock of the program
// that commands it. Both sides exchange the newest order and the newest report without waiting.
class AnsweredArm {
 public:
  // What the arm's thread publishes after each packet.
  struct Report {
    ArmState state;
    HardwareArms::Desired desired;
    ArmDrive running = ArmDrive::none;  // takes commands of this kind
    bool follows = false;               // the program's commands
    std::uint32_t holds = 0;            // ArmAnswer::holds()
  };

  // `arm`: of the scene from which `config` was made. Of its limits and the robot's the tighter ones count.
  AnsweredArm(fci::FciArmConfig config, const SceneArm& arm, std::function<void(const std::string&)> report);
  ~AnsweredArm() { leave(); }
  AnsweredArm(const AnsweredArm&) = delete;

  // --- off the loop ---
  // Connects in the arm's thread, which then answers. The result is empty, or why it failed.
  std::future<std::string> enter();
  // Ends the thread and the connection. Before, select no drive: an arm in a motion is stopped first.
  void begin_leaving() { leaving_.store(true, std::memory_order_release); }
  void leave();  // waits for it
  // The work of the thread, once: waits for a packet, at most the backend's silence, and answers it.
  void cycle();

  // --- the program's loop ---
  void set_drive(ArmDrive drive) noexcept;
  // The newest command of the drive.
  void command(std::int64_t stamp_ns, std::span<const double> values) noexcept;
  bool take_report() noexcept { return reports_.take(); }  // whether report() is a newer one
  const Report& report() const noexcept { return reports_.value(); }
  // Whether the arm has ended a motion in hold since the last call, because the program was silent.
  bool take_restart() noexcept;

  fci::FciBackend& backend() { return backend_; }
  const fci::FciBackend& backend() const { return backend_; }

 private:
  void run(std::promise<std::string> connected);

  fci::FciBackend backend_;
  ArmAnswer answer_;
  std::function<void(const std::string&)> say_;
  TripleBuffer<ArmOrder> orders_;
  TripleBuffer<Report> reports_;
  std::atomic<bool> leaving_{false};

  ArmOrder order_;  // the program's loop
  Report now_;      // the arm's thread
  DesiredMotionState desired_;
  std::vector<ArmState> states_;
  std::vector<ArmCommand> torques_;

  std::thread thread_;
};

}  // namespace multipanda
