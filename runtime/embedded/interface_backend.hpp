#pragma once

#include <array>
#include <atomic>
#include <future>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "core/cycle/backend.hpp"
#include "core/model/model_terms.hpp"
#include "core/rt/triple_buffer.hpp"
#include "core/state/load_ramp.hpp"
#include "core/types/capacity.hpp"
#include "runtime/embedded/shared_arm_state.hpp"
#include "scene/build.hpp"
#include "scene/from_parameters.hpp"

namespace multipanda {

// Input and output numbers of one arm, in order of its joints. The host fills the inputs before a step and
// reads the command after it.
struct ArmSignals {
  std::array<double, kMaxJoints> position{};  // [rad]
  std::array<double, kMaxJoints> velocity{};  // [rad/s]
  std::array<double, kMaxJoints> effort{};    // measured, gravity included [N m]; used with has_effort
  bool has_effort = false;
  // The hardware's complete state; nullptr: none. Changes only while the cycle is inactive.
  const SharedArmState* shared = nullptr;
  std::array<double, kMaxJoints> effort_command{};  // [N m]
};

// A Backend for arms accessed as plain numbers, for a cycle hosted by ros2_control.
//
// An arm with a shared state has all data of its hardware: frames, loads, forces, errors, requests. An arm
// without one has position and velocity, and effort if available: it accepts commands while it delivers data,
// its frames and loads are those set here, and without effort the measured torque is assumed to equal the
// commanded one. Its state is due in every step in which all its numbers are finite and not frozen.
//
// Frozen: for longer than max_silence_s all its numbers are the same to the last bit, although the arm moves
// by its own velocity, or the torque that it is given beyond gravity has changed by 5 % of a joint's limit
// since. An arm at rest may repeat its numbers. An arm that was silent or frozen for longer than
// max_silence_s is `disconnected`; when it delivers again, it is held at its present position.
//
// Torques are sent without gravity if the robot compensates it, otherwise with it (HostedArm::Gravity),
// and limited to the joints' largest efforts. An arm that is not due keeps its command for max_silence_s,
// then gets only gravity. No call of the loop allocates, locks or throws.
class InterfaceBackend : public Backend {
 public:
  struct Arm {
    HostedArm host;
    std::shared_ptr<const ArmModel> model;
    ArmConfig config;
    SafetyLimits safety;
  };
  InterfaceBackend(std::vector<Arm> arms, double period_s);
  ~InterfaceBackend() override;

  ArmSignals& signals(ArmIndex arm) { return arms_[arm]->signals; }
  const ArmSignals& signals(ArmIndex arm) const { return arms_[arm]->signals; }

  // Host's loop.
  // Returns the reason why it cannot start, or an empty string. Call when the signals hold shared states and
  // first values.
  std::string check() const;
  // Starts an activation: every arm is `recovering` until its first state, inclusive; earlier data
  // are ignored.
  void begin();
  // Before a step: advances time and returns the arms that are due.
  ArmSet advance(double period_s);
  // Writes commands that keep the arms safe without a controller: gravity if the cycle compensates it,
  // otherwise zero.
  void leave();

  // Tells the hardware which arms are stopped, for their grippers.
  void share_stopped(ArmSet stopped);

  std::size_t arm_count() const override { return arms_.size(); }
  Capabilities capabilities(ArmIndex arm) const override;
  double period() const override { return period_s_; }
  ArmSet wait() override { return {}; }  // the host calls the cycle's step() itself
  bool ended() const override { return false; }
  LoopTime now() const override { return now_; }
  void read(ArmSet due, std::span<ArmState> states) override;
  void write(ArmSet due, std::span<const ArmCommand> commands) override;
  std::uint64_t overruns() const override { return overruns_.load(std::memory_order_relaxed); }
  std::future<RequestAnswer> request(ArmIndex arm, ArmRequest request) override;
  std::future<RequestAnswer> request(ArmIndex arm, GripperRequest request) override;
  std::future<RequestAnswer> request(WorldRequest request) override;

 private:
  struct Configuration {
    ArmConfig config;
    std::uint32_t version = 1;
  };
  struct PlainArm {
    explicit PlainArm(Arm arm);
    Arm arm;
    ArmSignals signals;
    ModelTerms terms;                     // for gravity
    LoadRamp load;                        // used for gravity compensation
    JointVector tau_cmd;                  // of the last step, without gravity
    Configuration requested;              // protected by the backend's mutex_
    TripleBuffer<Configuration> updates;  // from requests to the loop
    Configuration configuration;          // loop's thread
    std::uint64_t sequence = 0;
    std::uint64_t last_sequence = 0;
    RobotTime last_robot_time;
    std::uint32_t activations = 0;  // counts activations; a new one is a new configuration
    bool recovering = false;        // no state yet in this activation
    double silent_s = 0;            // time without a valid state
    // Without a shared state: its last numbers, for how long they were constant, and tau_cmd at that time.
    std::array<double, 3 * kMaxJoints> numbers{};
    JointVector tau_then;
    double still_s = 0;
    bool frozen = false;
    std::atomic<const SharedArmState*> requests_to{nullptr};  // while active, for senders of requests
    std::size_t joints() const { return arm.model->joint_count(); }
    bool adds_gravity() const {
      if (signals.shared != nullptr) return !signals.shared->capabilities.compensates_gravity;
      return arm.host.gravity == HostedArm::Gravity::cycle;
    }
    bool is_finite() const;
    bool is_lost() const { return silent_s > arm.safety.max_silence_s; }
    void watch_numbers(double dt);
    bool contradicts() const;
  };
  void read_plain(PlainArm& arm, ArmState& state) const;
  static void send(PlainArm& arm, bool with_torque);
  static std::string unlike_joints(const PlainArm& arm);  // empty: alike
  RequestAnswer configure(PlainArm& arm, const ArmRequest& request);
  // Returns nullptr if the arm's hardware has no backend.
  const SharedArmState* shared_backend(ArmIndex arm) const;

  std::vector<std::unique_ptr<PlainArm>> arms_;
  double period_s_;
  double dt_ = 0;  // of this step
  LoopTime now_;
  std::atomic<std::uint64_t> overruns_{0};
  std::mutex mutex_;  // used only by threads that send requests
};

}  // namespace multipanda
