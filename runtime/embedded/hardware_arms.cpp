#include "runtime/embedded/hardware_arms.hpp"

#include <algorithm>

#include "backends/mujoco/mujoco_backend.hpp"
#include "common/machine.hpp"
#include "fci/client/fci_backend.hpp"
#include "runtime/embedded/answered_arm.hpp"

namespace multipanda {
namespace {

MotionRequest motion_of(ArmDrive drive) {
  const bool joints = drive == ArmDrive::joint_position || drive == ArmDrive::joint_velocity;
  return {.controller = joints ? ArmController::joint_impedance : ArmController::cartesian_impedance,
          .generator = generator_of(drive),
          .asynchronous = false,
          .dq_max = {}};
}

class MujocoArms final : public HardwareArms {
 public:
  explicit MujocoArms(const Scene& scene) : backend_(scene, {.pace = Pace::hosted}) {}

  Backend& backend() override { return backend_; }
  void connect() override { backend_.start(); }
  void disconnect() override { backend_.finish(); }
  ArmSet update() noexcept override { return backend_.wait(); }
  void set_drive(ArmIndex arm, ArmDrive) noexcept override { backend_.arm(arm).stop_motion(); }

  bool is_driven(ArmIndex arm, ArmDrive drive) noexcept override {
    SimulatedArm& behavior = backend_.arm(arm);
    if (behavior.mode() == ArmMode::move) return behavior.interface().generator == generator_of(drive);
    if (behavior.mode() == ArmMode::idle) (void)behavior.start_motion(motion_of(drive));
    return false;  // reported with the next state
  }
  Desired desired(ArmIndex arm) const noexcept override {
    const InterfaceState& state = backend_.arm(arm).interface();
    Desired desired;
    std::copy(state.q_d.begin(), state.q_d.end(), desired.q_d.begin());
    desired.O_T_EE_d = column_major(state.X_BE_d);
    return desired;
  }
  void command(ArmIndex arm, const InterfaceCommand& command) noexcept override {
    backend_.command(arm, command);
  }
  void stop(ArmIndex arm) noexcept override { backend_.arm(arm).stop_motion(); }
  void write(ArmSet effort, std::span<const ArmCommand> commands) noexcept override {
    backend_.write(effort, commands);
  }
  bool failed() const noexcept override { return backend_.failed(); }
  std::string fault() const override { return backend_.fault(); }

 private:
  MujocoBackend backend_;
};

std::vector<fci::FciArmConfig> waiting_arms(const Scene& scene) {
  std::vector<fci::FciArmConfig> arms;
  for (const auto& arm : scene.arms) {
    if (!arm.fci) throw std::invalid_argument("arm '" + arm.name + "' has no address (robot_ip, or fci)");
    if (!is_on_this_computer(arm.fci->address)) {
      throw std::invalid_argument(
          "arm '" + arm.name + "' is at " + arm.fci->address +
          ", and a real arm does not wait for commands: omit 'lockstep'; virtual arms that wait (virtual-arm "
          "--pace lockstep) are expected on this computer, at "
          "127.x.y.z");
    }
    arms.push_back(fci::fci_arm_config(arm, arm.fci->address));
    arms.back().limit_rate = true;  // any controller may command them, without a safety stage
  }
  return arms;
}

class LockstepArms final : public HardwareArms {
 public:
  LockstepArms(const Scene& scene, std::function<void(const std::string&)> report)
      : backend_(waiting_arms(scene), {.begin_torque = false, .report = std::move(report)}) {}

  Backend& backend() override { return backend_; }
  void connect() override { backend_.start(); }
  void disconnect() override { backend_.finish(); }
  // Reads once per write; a caller that reads repeatedly before it writes answers all received packets.
  ArmSet update() noexcept override {
    const ArmSet fresh = backend_.wait_until(HostTime{});
    due_ |= fresh;
    return fresh;
  }
  void set_drive(ArmIndex arm, ArmDrive drive) noexcept override {
    backend_.request_motion(arm, fci_motion(drive));
  }
  bool is_driven(ArmIndex arm, ArmDrive drive) noexcept override {
    return backend_.is_running(arm, fci_motion(drive)) && due_.contains(arm);
  }
  Desired desired(ArmIndex arm) const noexcept override {
    Desired desired;
    const fci::RobotState& state = backend_.packet(arm);
    std::copy(state.q_d.begin(), state.q_d.end(), desired.q_d.begin());
    desired.O_T_EE_d = state.O_T_EE_d;
    return desired;
  }
  void command(ArmIndex arm, const InterfaceCommand& command) noexcept override {
    fci::RobotCommand wire = fci_command(command);
    backend_.command(arm, wire);
  }
  void stop(ArmIndex arm) noexcept override { backend_.request_motion(arm, fci::ArmMotion::none); }
  void write(ArmSet effort, std::span<const ArmCommand> commands) noexcept override {
    backend_.write(effort & due_, commands);
    due_ = {};
  }

 private:
  fci::FciBackend backend_;
  ArmSet due_;
};

}  // namespace

const char* name_of(ArmDrive drive) {
  static constexpr std::array<const char*, kArmDrives> kNames{
      "none", "effort", "position", "velocity", "Cartesian position", "Cartesian velocity"};
  return kNames[static_cast<std::size_t>(drive)];
}

MotionGenerator generator_of(ArmDrive drive) {
  switch (drive) {
    case ArmDrive::joint_position:
      return MotionGenerator::joint_position;
    case ArmDrive::joint_velocity:
      return MotionGenerator::joint_velocity;
    case ArmDrive::cartesian_pose:
      return MotionGenerator::cartesian_pose;
    case ArmDrive::cartesian_velocity:
      return MotionGenerator::cartesian_velocity;
    case ArmDrive::none:
    case ArmDrive::effort:
      break;
  }
  return MotionGenerator::none;
}

std::unique_ptr<HardwareArms> mujoco_arms(const Scene& scene) { return std::make_unique<MujocoArms>(scene); }
std::unique_ptr<HardwareArms> lockstep_arms(const Scene& scene,
                                            std::function<void(const std::string&)> report) {
  return std::make_unique<LockstepArms>(scene, std::move(report));
}

}  // namespace multipanda
