#pragma once

#include <array>
#include <bitset>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "core/cycle/control_cycle.hpp"
#include "runtime/hosted/arm_window.hpp"
#include "runtime/hosted/command_join.hpp"
#include "runtime/hosted/hardware_arms.hpp"
#include "runtime/run_adapter.hpp"

namespace multipanda {

// A number that a hardware component exports: "left_joint1" "position". Stays where it is for the world's
// life.
struct HardwareNumber {
  std::string prefix, name;
  double* value = nullptr;
  std::string full_name() const { return prefix + "/" + name; }
};

// A ros2_control hardware component without ROS: any number of arms, simulated or real, their numbers, and
// who drives which arm by what. docs/ros2_control.md has the interfaces.
//
//   off the loop   constructor, connect(), disconnect(), prepare_switch()
//   host's loop    activate(), deactivate(), perform_switch(), read(), write(): no allocation, lock or wait
//
// An arm is driven by one kind of commands at a time, whole: all joints' efforts, positions or velocities, or
// all numbers of a Cartesian pose or velocity. Nobody's arm holds itself. One arm's fault leaves the others
// alone; after it has been recovered (a request to the backend), torques are taken again at once, positions
// once they are near, velocities once they were zero (CommandJoin).
class HardwareWorld {
 public:
  // The scene's controllets are not used. Throws std::invalid_argument.
  HardwareWorld(Scene scene, std::unique_ptr<HardwareArms> arms);
  ~HardwareWorld();
  HardwareWorld(const HardwareWorld&) = delete;

  const std::vector<HardwareNumber>& states() const { return states_; }
  const std::vector<HardwareNumber>& commands() const { return commands_; }
  const Scene& scene() const { return scene_; }
  std::size_t arm_count() const { return arms_.size(); }

  // Throws std::runtime_error with the cure. Then the states are there.
  void connect();
  void disconnect();
  bool is_connected() const { return connected_; }

  // May `stop` be given up and `start` be claimed (full names; those of other components are ignored)?
  // Changes nothing. `why`: why not.
  bool prepare_switch(const std::vector<std::string>& start, const std::vector<std::string>& stop,
                      std::string& why) const;
  // A switch that was prepared: flips what drives the arms, seeds the commands with where the arms are.
  void perform_switch(const std::vector<std::string>& start, const std::vector<std::string>& stop) noexcept;
  // Nobody drives any arm any more.
  void deactivate() noexcept;

  enum class Result : std::uint8_t {
    ok,
    lost  // no arm is left: all connections lost, or the simulation failed (fault())
  };
  Result read() noexcept;
  Result write() noexcept;
  std::string fault() const;

  ArmDrive drive(ArmIndex arm) const { return arms_[arm].drive; }
  const ArmState& state(ArmIndex arm) const { return arms_[arm].window.state; }
  Backend& backend() { return hardware_->backend(); }

  // For services on a node of the hardware's own: requests go to the backend; its controller is never run and
  // has the arms' holds only.
  RunWorld run_world();

 private:
  static constexpr std::size_t kPose = 16, kTwist = 6;
  // Command interfaces of one arm, in this order: effort, position, velocity of each joint, pose, twist.
  using Claims = std::bitset<3 * kMaxJoints + kPose + kTwist>;
  struct Arm {
    std::string name;
    std::size_t joints = 0;
    std::shared_ptr<const ArmModel> model;
    std::unique_ptr<ModelTerms> terms;
    ArmWindow window;

    // States
    std::array<double, kMaxJoints> q{}, dq{}, tau{};
    std::array<double, kPose> pose{};
    std::array<double, kTwist> twist{};
    double window_value = 0, mode = 0, error = 0, success_rate = 0, following = 0;

    // Commands
    std::array<double, kMaxJoints> effort_c{}, position_c{}, velocity_c{};
    std::array<double, kPose> pose_c{};
    std::array<double, kTwist> twist_c{};

    Claims claims;
    ArmDrive drive = ArmDrive::none;
    CommandJoin join;
    bool was_driven = false;  // its commands went to the arm in the last write
    bool has_begun = false;   // they did so once, since the drive began
    bool fault_seen = false;  // since the drive began
    InterfaceCommand command;
  };
  struct Place {
    ArmIndex arm = 0;
    std::size_t bit = 0;
  };
  void list_numbers(ArmIndex arm);
  void add_command(ArmIndex arm, std::size_t bit, std::string prefix, std::string name, double* value);
  const Place* find(const std::string& full_name) const;
  void change(const std::vector<std::string>& names, bool claimed, std::vector<Claims>& claims) const;
  // The drive that these claims are; false: none whole.
  bool drive_of(const Arm& arm, const Claims& claims, ArmDrive& drive) const;
  void publish(Arm& arm);
  void seed(ArmIndex index);
  void drive_arm(ArmIndex index);
  bool fault_free() const noexcept { return !hardware_->failed(); }

  Scene scene_;
  std::unique_ptr<HardwareArms> hardware_;
  std::deque<Arm> arms_;
  std::vector<HardwareNumber> states_, commands_;
  std::map<std::string, Place, std::less<>> places_;
  std::vector<ArmState> read_;
  std::vector<ArmCommand> torques_;
  bool connected_ = false;

  // Of run_world(), built when asked for
  std::unique_ptr<Registry> registry_;
  std::unique_ptr<ControlCycle> resting_;
};

}  // namespace multipanda
