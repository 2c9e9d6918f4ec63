#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>

#include "backends/arm/arm_interface.hpp"
#include "core/cycle/backend.hpp"
#include "scene/scene.hpp"

namespace multipanda {

// What drives an arm of a hardware component: the command interfaces of one kind that somebody claimed.
enum class ArmDrive : std::uint8_t {
  none,  // nobody: the arm holds itself
  effort,
  joint_position,
  joint_velocity,
  cartesian_pose,
  cartesian_velocity
};
inline constexpr std::size_t kArmDrives = 6;
const char* name_of(ArmDrive drive);
MotionGenerator generator_of(ArmDrive drive);

// The arms behind a hardware component: a Backend, plus the motions that are not torques. Loop thread unless
// said otherwise; what is noexcept neither allocates, nor locks, nor waits.
class HardwareArms {
 public:
  virtual ~HardwareArms() = default;
  virtual Backend& backend() = 0;
  const Backend& backend() const { return const_cast<HardwareArms*>(this)->backend(); }

  // Off the loop. connect() throws std::runtime_error with the cure.
  virtual void connect() = 0;
  virtual void disconnect() = 0;

  // Takes what has come, without waiting; which arms have a new state.
  virtual ArmSet update() noexcept = 0;
  // From now on the arm is to be driven so. Simulated: at once; real: its own thread sees to it.
  virtual void want(ArmIndex arm, ArmDrive drive) noexcept = 0;
  // Once per write(), for drives other than effort and none: does the arm take commands of this drive?
  virtual bool is_driven(ArmIndex arm, ArmDrive drive) noexcept = 0;
  // Where the arm itself says that it is to be.
  struct Desired {
    std::array<double, kMaxJoints> q_d{};
    std::array<double, 16> O_T_EE_d{};  // X_BE_d, column-major
  };
  virtual Desired desired(ArmIndex arm) const noexcept = 0;
  virtual void command(ArmIndex arm, const InterfaceCommand& command) noexcept = 0;
  // A command that was no number: the arm stops.
  virtual void stop(ArmIndex arm) noexcept = 0;
  // Sends the torques of the arms in `effort`; the period's commands are complete.
  virtual void write(ArmSet effort, std::span<const ArmCommand> commands) noexcept = 0;
  virtual bool failed() const noexcept { return false; }  // nothing goes on
  virtual std::string fault() const { return {}; }        // why
};

// In MuJoCo, a period of 1 ms per update(). Throws std::invalid_argument.
std::unique_ptr<HardwareArms> mujoco_arms(const Scene& scene);
// Real arms, or virtual ones behind the same protocol. `say`: what nobody asked for, from threads of the
// arms.
std::unique_ptr<HardwareArms> real_arms(const Scene& scene, std::function<void(const std::string&)> say);

}  // namespace multipanda
