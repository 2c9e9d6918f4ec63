#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "core/cycle/control_cycle.hpp"
#include "runtime/hosted/interface_backend.hpp"
#include "runtime/run_adapter.hpp"
#include "scene/from_parameters.hpp"

namespace multipanda {

struct HostedOptions {
  std::vector<HostedArm> arms;     // in the scene's order
  double period_s = 0.001;         // of the host's loop
  MakeRunAdapter make_adapter;     // none: nobody speaks for the cycle
  std::size_t ring_cycles = 2048;  // records that may wait for the relay
};

// A control cycle whose loop is somebody else's: the update() of a ros2_control controller. Same arms,
// controllets, switching, safety and records as in a Session; what differs is who calls.
//
//   host's loop   activate(), step(), deactivate(): no allocation, no lock, no exception
//   relay         takes the loop's records to the adapter
//
// Everything is built in the constructor and may be activated any number of times. In the first step of all,
// the scene's `active` controllets start from the measured state. At every later activation, and for arms
// that do not take commands yet, the arms are held where they stand measured; each controllet starts in the
// step after its arms have taken commands for kSettled steps. The loop decides that itself, after all that
// was asked for at that boundary: an arm that somebody switched, stopped or resumed since the activation, one
// that was lost since and one that needs longer than kPatience stay as they are.
class HostedCycle {
 public:
  // Throws std::invalid_argument: arms, models and controllets that do not fit together, and what the adapter
  // throws. `registry` must live longer.
  HostedCycle(Scene scene, const Registry& registry, HostedOptions options);
  ~HostedCycle();
  HostedCycle(const HostedCycle&) = delete;

  static constexpr std::uint32_t kSettled = 2;  // steps
  static constexpr double kPatience = 3.0;      // [s] of the loop's time

  std::size_t arm_count() const { return models_.size(); }
  std::size_t joint_count(ArmIndex arm) const { return models_[arm]->joint_count(); }
  // Names of the arm's joints in the interfaces.
  std::vector<std::string> joint_names(ArmIndex arm) const;
  const Scene& scene() const { return scene_; }
  const std::vector<std::shared_ptr<const ArmModel>>& models() const { return models_; }

  // --- host's loop ---
  ArmSignals& signals(ArmIndex arm) { return backend_->signals(arm); }
  // Why it may not be activated, or nothing: after the signals and windows were set. Allocates.
  std::string check() const { return backend_->check(); }
  void activate() noexcept;
  // One step, `period_s` after the last. Not a positive number: the nominal period. The commands are in the
  // signals afterwards. False: no arm can be commanded (all are in error, silent or lost).
  bool step(double period_s) noexcept;
  // Commands that leave the arms safe are in the signals afterwards.
  void deactivate() noexcept;
  bool is_active() const { return active_.load(std::memory_order_acquire); }
  const CycleData& data() const { return cycle_->data(); }

  // --- any thread but the loop's ---
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

  std::atomic<bool> active_{false};
  InstanceSet start_set_ = 0;

  // Host's loop, of the present activation
  LoopTime activated_;
  ArmSet took_;                                   // arms that took commands in it
  std::array<std::uint32_t, kMaxArms> taking_{};  // steps in a row with commands taken

  // Relay thread
  HostTime last_record_;
  std::atomic<bool> ending_{false};
  std::thread relay_;
};

}  // namespace multipanda
