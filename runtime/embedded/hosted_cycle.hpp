#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "core/cycle/control_cycle.hpp"
#include "core/types/time.hpp"
#include "runtime/embedded/hosted_trace.hpp"
#include "runtime/embedded/interface_backend.hpp"
#include "runtime/run_adapter.hpp"
#include "scene/from_parameters.hpp"

namespace multipanda {

struct HostedOptions {
  std::vector<HostedArm> arms;                   // in the scene's order
  double period_s = kArmPeriod;                  // of the host's loop
  bool stop_after_gaps = true;                   // that loop follows the wall clock, not a simulation's
  MakeRunAdapter make_adapter;                   // none: no adapter
  std::size_t ring_cycles = 2048;                // capacity for records that wait for the relay
  std::optional<HostedTraceOptions> trace = {};  // measures the first activation
  HostedTrace::Report report = {};               // gets the messages of the trace
};

// A control cycle in the loop of another program, such as the update() of a ros2_control controller. Arms,
// controllets, switching, safety and records are as in a Session.
//
//   host's loop   activate(), step(), deactivate(): no allocation, no lock, no exception
//   relay         takes the loop's records to the adapter and to the trace, which becomes its file
//
// The constructor builds everything; the cycle may be activated any number of times. In the very first
// step, the scene's `active` controllets start from the measured state. At every later activation, and for
// arms that do not take commands yet, the arms are held at their measured positions; each controllet starts
// after its arms have taken commands for kSettled steps. The loop decides this after all requests of that
// cycle boundary. An arm that was switched, stopped, resumed or lost since the activation, or that needs
// longer than kTimeout, is left unchanged.
class HostedCycle {
 public:
  // Throws std::invalid_argument if arms, models and controllets are inconsistent, and exceptions of the
  // adapter and the trace. `registry` must outlive the cycle.
  HostedCycle(Scene scene, const Registry& registry, HostedOptions options);
  ~HostedCycle();
  HostedCycle(const HostedCycle&) = delete;

  static constexpr std::uint32_t kSettled = 2;  // steps
  static constexpr double kTimeout = 3.0;       // [s] of the loop's time

  std::size_t arm_count() const { return models_.size(); }
  std::size_t joint_count(ArmIndex arm) const { return models_[arm]->joint_count(); }
  // Returns the names of the arm's joints in the interfaces.
  std::vector<std::string> joint_names(ArmIndex arm) const;
  const Scene& scene() const { return scene_; }
  const std::vector<std::shared_ptr<const ArmModel>>& models() const { return models_; }

  // Host's loop.
  ArmSignals& signals(ArmIndex arm) { return backend_->signals(arm); }
  // Returns the reason why it cannot be activated, or an empty string. Call after setting the signals and
  // shared states. Allocates.
  std::string check() const { return backend_->check(); }
  void activate() noexcept;
  // Performs one step, `period_s` after the last; uses the nominal period if that is not positive. Writes the
  // commands to the signals. Returns false if no arm can be commanded (all are in error, silent or lost).
  bool step(double period_s) noexcept;
  // Writes safe commands to the signals.
  void deactivate() noexcept;
  bool is_active() const { return active_.load(std::memory_order_acquire); }
  const CycleData& data() const { return cycle_->data(); }

  // Any thread but the loop's.
  MultimodeController& modes() { return cycle_->modes(); }
  Backend& backend() { return *backend_; }
  const RecordLayout& layout() const { return cycle_->layout(); }
  RunAdapter* adapter() { return adapter_.get(); }
  std::uint64_t records_dropped() const { return cycle_->record()->dropped_records.load(); }

 private:
  void run_relay();
  bool relay();
  bool watch_arms();

  const Scene scene_;
  const HostedOptions options_;
  std::vector<std::shared_ptr<const ArmModel>> models_;
  std::unique_ptr<InterfaceBackend> backend_;
  std::unique_ptr<ControlCycle> cycle_;
  std::unique_ptr<RunAdapter> adapter_;
  std::unique_ptr<HostedTrace> trace_;  // nullptr: not requested

  std::atomic<bool> active_{false};
  InstanceSet start_set_ = 0;

  // Host's loop, for the current activation. ArmCondition cannot replace it: it remembers the cycle before an
  // activation, and others may have used the arm in between.
  LoopTime activated_;
  ArmSet took_;                                   // arms that accepted commands in this activation
  std::array<std::uint32_t, kMaxArms> taking_{};  // consecutive steps in which the arm accepted commands

  // Relay thread.
  HostTime last_record_;
  std::atomic<bool> ending_{false};
  std::thread relay_;
};

}  // namespace multipanda
