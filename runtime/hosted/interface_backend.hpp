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
#include "core/types/capacity.hpp"
#include "runtime/hosted/arm_window.hpp"
#include "scene/build.hpp"
#include "scene/from_parameters.hpp"

namespace multipanda {

// The numbers that go in and out of one arm, joint by joint, first to last. The host fills the inputs before
// a step and takes the command after it.
struct ArmSignals {
  std::array<double, kMaxJoints> position{};  // [rad]
  std::array<double, kMaxJoints> velocity{};  // [rad/s]
  std::array<double, kMaxJoints> effort{};    // measured, gravity included [N m]; used with has_effort
  bool has_effort = false;
  // What the hardware knows beyond; nullptr: nothing. Changes only while nothing runs.
  const ArmWindow* window = nullptr;
  std::array<double, kMaxJoints> effort_command{};  // [N m]
};

// Arms behind plain numbers, whoever brings them: the Backend of a cycle that is hosted by ros2_control.
//
// An arm with a window has everything that its hardware has: frames, loads, forces, errors, requests. One
// without works from position and velocity, and effort where there is one: it always takes commands, its
// frames and loads are what it was told here, and its measured torque is taken to be the commanded one where
// nothing else is known. Its state is due in every step in which all its numbers are finite.
//
// Torques leave without gravity where the robot holds itself, and with it where the cycle has to
// (HostedArm::Gravity), then within the joints' largest efforts. An arm that is not due keeps its command for
// max_silence_s, then gets none but gravity. No call of the loop allocates, locks or throws.
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

  // --- the host's loop ---
  // Why it cannot begin, or nothing. With the signals as they are: windows and first states are there.
  std::string check() const;
  // A new activation: every arm is `recovering` up to and with its first state, nothing of before counts.
  void begin();
  // Before a step: takes the time that has passed; which arms are due.
  ArmSet advance(double period_s);
  // Commands that leave the arms safe when nobody computes any more: gravity where the cycle adds it, else
  // none.
  void leave();

  std::size_t arm_count() const override { return arms_.size(); }
  Capabilities capabilities(ArmIndex arm) const override;
  ArmSet wait() override { return {}; }  // the host calls the cycle's step() itself
  bool ended() const override { return false; }
  LoopTime now() const override { return now_; }
  void read(ArmSet due, std::span<ArmState> states) override;
  void write(ArmSet due, std::span<const ArmCommand> commands) override;
  std::uint64_t overruns() const override { return overruns_.load(std::memory_order_relaxed); }
  std::future<ArmAnswer> request(ArmIndex arm, ArmRequest request) override;

 private:
  struct Configuration {
    ArmConfig config;
    std::uint32_t version = 1;
  };
  struct PlainArm {
    explicit PlainArm(Arm arm);
    Arm arm;
    ArmSignals signals;
    ModelTerms terms;                 // for gravity
    JointVector tau_cmd;              // of the last step, without gravity
    Configuration wished;             // guarded by the backend's mutex_
    TripleBuffer<Configuration> box;  // askers -> loop
    Configuration configuration;      // loop
    std::uint64_t sequence = 0;
    std::uint64_t last_window_sequence = 0;
    RobotTime last_window_time;
    std::uint32_t begun = 0;  // counts activations: a new one is a new configuration
    bool recovering = false;  // no state of this activation yet
    double silent_s = 0;
    bool takes_commands = false;                   // as its state says
    std::atomic<const ArmWindow*> asked{nullptr};  // for askers, while active
    std::size_t joints() const { return arm.model->joint_count(); }
    bool adds_gravity() const {
      if (signals.window != nullptr) return !signals.window->capabilities.compensates_gravity;
      return arm.host.gravity == HostedArm::Gravity::cycle;
    }
    bool is_finite() const;
  };
  void read_plain(PlainArm& arm, ArmState& state) const;
  static void send(PlainArm& arm, bool with_torque);
  ArmAnswer configure(PlainArm& arm, const ArmRequest& request);

  std::vector<std::unique_ptr<PlainArm>> arms_;
  double period_s_;
  double dt_ = 0;  // of this step
  LoopTime now_;
  std::atomic<std::uint64_t> overruns_{0};
  std::mutex mutex_;  // askers only
};

}  // namespace multipanda
