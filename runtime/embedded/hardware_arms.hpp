#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>

#include "arm_interface/arm_interface.hpp"
#include "core/cycle/backend.hpp"
#include "runtime/embedded/arm_answer.hpp"
#include "scene/scene.hpp"

namespace multipanda {

const char* name_of(ArmDrive drive);
MotionGenerator generator_of(ArmDrive drive);

// The arms behind a hardware component: a Backend, plus motions other than torques. Loop thread unless said
// otherwise; noexcept functions neither allocate, lock nor wait.
class HardwareArms {
 public:
  virtual ~HardwareArms() = default;
  virtual Backend& backend() = 0;

  // Off the loop. connect() throws std::runtime_error with the remedy.
  virtual void connect() = 0;
  virtual void disconnect() = 0;

  // Takes received packets without waiting. Returns the arms with a new state.
  virtual ArmSet update() noexcept = 0;
  // Sets the clock of the following commands; returns the time since the last ones [s]. Simulated arms use
  // this clock.
  virtual double set_time(std::int64_t /*stamp_ns*/) noexcept { return kArmPeriod; }
  // Selects the arm's drive from now on. Simulated arms: at once; real arms: by their own thread.
  virtual void set_drive(ArmIndex arm, ArmDrive drive) noexcept = 0;
  // Once per write(), for drives other than effort and none: returns whether the arm accepts commands of
  // this drive.
  virtual bool is_driven(ArmIndex arm, ArmDrive drive) noexcept = 0;
  // Whether the arm's motion ended in hold since the last call because commands were missing; they may
  // start again.
  virtual bool take_restart(ArmIndex /*arm*/) noexcept { return false; }
  // Whether a driven arm follows the commands.
  virtual bool follows(ArmIndex /*arm*/) const noexcept { return true; }
  // The arm's own desired motion.
  struct Desired {
    std::array<double, kMaxJoints> q_d{};
    std::array<double, 16> O_T_EE_d{};  // X_BE_d, column-major
  };
  virtual Desired desired(ArmIndex arm) const noexcept = 0;
  virtual void command(ArmIndex arm, const InterfaceCommand& command) noexcept = 0;
  // Stops the arm after a command that is not finite.
  virtual void stop(ArmIndex arm) noexcept = 0;
  // Sends the torques of the arms in `effort`; this completes the period's commands.
  virtual void write(ArmSet effort, std::span<const ArmCommand> commands) noexcept = 0;
  virtual bool failed() const noexcept { return false; }  // no further cycle is possible
  virtual std::string fault() const { return {}; }        // its reason
};

// Arms in MuJoCo, which advance by 1 ms per update(). Throws std::invalid_argument.
std::unique_ptr<HardwareArms> mujoco_arms(const Scene& scene);
// Real arms, or virtual ones behind the same protocol, each answered by its own thread (AnsweredArm).
// `report` receives unsolicited messages, from threads of the arms.
std::unique_ptr<HardwareArms> answered_arms(const Scene& scene,
                                            std::function<void(const std::string&)> report);
// Virtual arms that wait for each command, in lock-step: each write() answers the packets of the last read().
// Refuses arms on other computers, whose independent clocks would make them miss commands.
std::unique_ptr<HardwareArms> lockstep_arms(const Scene& scene,
                                            std::function<void(const std::string&)> report);

}  // namespace multipanda
