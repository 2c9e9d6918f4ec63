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
// The wire fields of a motion's command.
fci::RobotCommand fci_command(const InterfaceCommand& command);

// One real arm whose packets are answered at once by a separate thread, independent of the commanding
// program's clock. Both sides exchange the newest order and the newest report without waiting.
class AnsweredArm {
 public:
  // Published by the arm's thread after each packet.
  struct Report {
    ArmState state;
    HardwareArms::Desired desired;
    ArmDrive running = ArmDrive::none;  // accepts commands of this kind
    bool follows = false;               // follows the program's commands
    std::uint32_t holds = 0;            // ArmAnswer::holds()
  };

  // `arm`: of the scene from which `config` was made. The tighter limits of scene and robot apply.
  AnsweredArm(fci::FciArmConfig config, const SceneArm& arm, std::function<void(const std::string&)> report);
  ~AnsweredArm() { leave(); }
  AnsweredArm(const AnsweredArm&) = delete;

  // --- off the loop ---
  // Connects in the arm's thread, which then answers. The result is empty, or why it failed.
  std::future<std::string> enter();
  // Ends the thread and the connection. Select no drive before: a moving arm is stopped first.
  void begin_leaving() { leaving_.store(true, std::memory_order_release); }
  void leave();  // waits for it
  // One step of the thread: waits for a packet, at most as long as the backend allows, and answers it.
  void cycle();

  // --- the program's loop ---
  void set_drive(ArmDrive drive) noexcept;
  // The newest command of the drive.
  void command(std::int64_t stamp_ns, std::span<const double> values) noexcept;
  bool take_report() noexcept { return reports_.take(); }  // whether there is a newer report()
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

  ArmOrder order_;  // used by the program's loop
  Report now_;      // used by the arm's thread
  DesiredMotionState desired_;
  std::vector<ArmState> states_;
  std::vector<ArmCommand> torques_;

  std::thread thread_;
};

}  // namespace multipanda
