#pragma once

#include <array>
#include <atomic>
#include <bitset>
#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <span>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "core/cycle/control_cycle.hpp"
#include "core/types/capacity.hpp"
#include "core/types/spatial.hpp"
#include "runtime/embedded/hardware_arms.hpp"
#include "runtime/embedded/shared_arm_state.hpp"
#include "runtime/run_adapter.hpp"
#include "scene/from_parameters.hpp"

namespace multipanda {

// Runs slow clean-up on a separate thread, so that the calling loop, which may serve other hardware, loses no
// period. Off the loops, one thread at a time.
class TearDown {
 public:
  TearDown() = default;
  ~TearDown() { wait(); }
  TearDown(const TearDown&) = delete;

  // Returns at once, unless an earlier clean-up is still running.
  void start(std::function<void()> work) {
    wait();
    thread_ = std::thread(std::move(work));
  }
  // Waits for the last clean-up.
  void wait() {
    if (thread_.joinable()) thread_.join();
  }

 private:
  std::thread thread_;
};

// Fades in the commands of a motion when a controller takes over an arm. An arm rejects a desired motion that
// jumps, and a command written long ago is no longer valid. Therefore:
//
//   positions and poses: the arm holds (`waiting`) while the command is farther than a threshold from the
//   arm's position. Once it is closer, the difference fades over kFade, so there is no jump. velocities: grow
//   from zero over kFade. After a fault they must have been about zero once.
//
// Loop thread; nothing allocates.
class CommandJoin {
 public:
  static constexpr double kJointWindow = 0.05;                        // [rad]
  static constexpr double kPositionWindow = 0.02, kTurnWindow = 0.1;  // [m], [rad]
  static constexpr double kRestVelocity = 0.02;                       // [rad/s], [m/s]
  static constexpr double kFade = 0.5;                                // [s]

  enum class Result : std::uint8_t { waiting, following, not_finite };

  // Commands are used from now on. `after_fault`: commands from before the fault are not resumed.
  void begin(bool after_fault) {
    stage_ = Stage::fresh;
    after_fault_ = after_fault;
  }

  // `desired`: the arm's own desired position (q_d). `out`: the command to send. Same sizes.
  Result positions(std::span<const double> command, std::span<const double> desired, double dt,
                   std::span<double> out);
  Result velocities(std::span<const double> command, double dt, std::span<double> out);
  // Column-major transforms, as in the arm's interface.
  Result pose(const std::array<double, 16>& command, const std::array<double, 16>& desired, double dt,
              std::array<double, 16>& out);

 private:
  enum class Stage : std::uint8_t { fresh, waiting, following };
  double fade(double dt);  // weight of the command, 0 to 1

  Stage stage_ = Stage::fresh;
  bool after_fault_ = false;
  double time_ = 0;
  std::array<double, kMaxJoints> hold_{}, offset_{};
  std::array<double, 16> hold_pose_{};
  Vector3 shift_ = Vector3::Zero(), turn_ = Vector3::Zero();
};

// A number that a hardware component exports, for example "left_joint1" "position". Its address stays the
// same for the system's life.
struct HardwareNumber {
  std::string prefix, name;
  double* value = nullptr;
  std::string full_name() const { return prefix + "/" + name; }
};

// A ros2_control hardware component without ROS: any number of simulated or real arms, their exported
// numbers, and the kind of command that drives each arm. docs/ros2_control.md lists the interfaces.
//
//   off the loop   constructor, connect(), disconnect(), prepare_switch()
//   host's loop    activate(), deactivate(), perform_switch(), read(), write(): no allocation, lock or wait
//
// One complete kind of command drives an arm at a time: all joints' efforts, positions or velocities, or
// all numbers of a Cartesian pose or velocity. An arm without a claim holds itself. One arm's fault does not
// affect the others. After its recovery (a request to the backend), torques are accepted at once, positions
// once they are near, velocities once they were zero (CommandJoin).
class HardwareSystem {
 public:
  // Ignores the scene's controllets. Throws std::invalid_argument.
  HardwareSystem(Scene scene, std::unique_ptr<HardwareArms> arms);
  ~HardwareSystem();
  HardwareSystem(const HardwareSystem&) = delete;

  const std::vector<HardwareNumber>& states() const { return states_; }
  const std::vector<HardwareNumber>& commands() const { return commands_; }
  const Scene& scene() const { return scene_; }
  std::size_t arm_count() const { return arms_.size(); }

  // Throws std::runtime_error with the remedy. States are available afterwards.
  void connect();
  void disconnect();
  // The same, for a loop that must not wait: the arms are released at once, and a thread stops them and
  // closes their connections. connect() and disconnect() wait for it.
  void disconnect_later();
  bool is_connected() const { return connected_; }

  // Returns whether `stop` can be released and `start` be claimed (full names; those of other components are
  // ignored). Otherwise sets `why`. Changes nothing else.
  bool prepare_switch(const std::vector<std::string>& start, const std::vector<std::string>& stop,
                      std::string& why) const;
  // Performs a prepared switch of drives; commands start at the current positions.
  void perform_switch(const std::vector<std::string>& start, const std::vector<std::string>& stop) noexcept;
  // Releases all arms.
  void deactivate() noexcept;

  enum class Result : std::uint8_t {
    ok,
    lost  // no arm left: all connections are lost, or the simulation failed (fault())
  };
  Result read() noexcept;
  // `stamp_ns`: time of the commands' computation; only differences matter. Without it, now.
  Result write(std::int64_t stamp_ns) noexcept;
  Result write() noexcept { return write(host_now().ns); }
  std::string fault() const;

  ArmDrive drive(ArmIndex arm) const { return arms_[arm].drive; }
  const ArmState& state(ArmIndex arm) const { return arms_[arm].shared.state; }
  Backend& backend() { return hardware_->backend(); }

  // For services on the hardware's own node: requests go to the backend. The context's controller never runs
  // and has only the arms' holds; it shows which arms the controllers beside have stopped.
  RunContext run_context();

 private:
  static constexpr std::size_t kPose = 16, kTwist = 6;
  // Command interfaces of one arm, in this order: effort, position, velocity of each joint, pose, twist.
  using Claims = std::bitset<3 * kMaxJoints + kPose + kTwist>;
  struct Arm {
    std::string name;
    std::size_t joints = 0;
    std::shared_ptr<const ArmModel> model;
    std::unique_ptr<ModelTerms> terms;
    SharedArmState shared;
    std::atomic<std::uint8_t> mode_now{0};  // for threads that serve requests
    std::atomic<bool> grasped_now{false};

    // States
    std::array<double, kMaxJoints> q{}, dq{}, tau{};
    std::array<double, kPose> pose{};
    std::array<double, kTwist> twist{};
    double shared_value = 0, mode = 0, error = 0, success_rate = 0, following = 0;

    // Commands
    std::array<double, kMaxJoints> effort_c{}, position_c{}, velocity_c{};
    std::array<double, kPose> pose_c{};
    std::array<double, kTwist> twist_c{};

    Claims claims;
    ArmDrive drive = ArmDrive::none;
    CommandJoin join;
    bool was_driven = false;  // its commands were sent to the arm in the last write()
    bool has_driven = false;  // the same, once since the drive was selected
    bool had_fault = false;   // since the drive was selected
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
  // Finds the drive for these claims; returns false if no kind is complete.
  bool drive_of(const Arm& arm, const Claims& claims, ArmDrive& drive) const;
  void publish(Arm& arm);
  void seed(ArmIndex index);
  void drive_arm(ArmIndex index);
  void release() noexcept;
  void close();
  bool fault_free() const noexcept { return !hardware_->failed(); }

  Scene scene_;
  std::unique_ptr<HardwareArms> hardware_;
  std::deque<Arm> arms_;
  std::vector<HardwareNumber> states_, commands_;
  std::map<std::string, Place, std::less<>> places_;
  std::vector<ArmState> read_;
  std::vector<ArmCommand> torques_;
  bool connected_ = false;
  bool released_ = false;       // disconnect_later() is closing or has closed
  double passed_ = kArmPeriod;  // between the last two writes, for fading in [s]

  // For run_context(), built on demand.
  std::unique_ptr<Registry> registry_;
  std::unique_ptr<ControlCycle> resting_;
  std::atomic<MultimodeController*> shows_stopped_{nullptr};  // of resting_

  TearDown tear_down_;  // destroyed before what it uses
};

// Returns a scene from the parameters of a hardware component, which URDFs carry as strings.
//
//   scene             a scene file or name; then no other parameter of a scene is allowed
//   arm_names         "left right" (or with commas)
//   arms.<name>.*     the scene's keys of an arm, with values in YAML: "[0, 0.26, 0]"
//   objects.<name>.*  those of an object
//   arms.<name>.fci   address; required with `real`
// The names of multipanda_ros2 are accepted too: robot_count, ns_<i>, robot_ip_<i>, hand_<i>.
//
// `real`: every arm needs an address; otherwise addresses are refused. Keys in `others` are ignored, all
// other keys are refused. Throws std::invalid_argument.
Scene hardware_scene(const std::map<std::string, std::string>& parameters, bool real,
                     const std::vector<std::string>& others = {});

}  // namespace multipanda
