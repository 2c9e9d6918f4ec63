#pragma once

#include <atomic>
#include <memory>
#include <string>
#include <vector>

#include "core/modes/instance.hpp"
#include "core/modes/mailbox.hpp"
#include "core/modes/request.hpp"
#include "core/record/cycle_record.hpp"
#include "core/safety/safety.hpp"
#include "core/types/tick.hpp"

namespace multipanda {

// A request that the loop makes of itself at a given time: how a scene's timeline runs, to the cycle.
struct ScheduledRequest {
  LoopTime at;
  enum class What : std::uint8_t { request, stop } what = What::request;
  Request request;
  ArmSet stop;
};

// Hosts all controllet instances, gives each arm to exactly one of them, and switches between two cycles.
// Instances 0 .. arm_count-1 are the arms' holds ("left_hold"): whatever nobody owns is held.
class MultimodeController {
 public:
  // `arm_names` and the blocks have one element per arm. Throws std::invalid_argument (see Instance), on
  // names that are not unique and on too many instances.
  MultimodeController(std::vector<std::string> arm_names, const std::vector<InstanceConfig>& configs,
                      const Registry& registry, const ArmBlocks& blocks, SafetyStage& safety);

  // --- before the loop ---
  void schedule(std::vector<ScheduledRequest> requests);  // adds to what is scheduled already
  // What runs from the first cycle on. Throws std::invalid_argument if two own the same arm.
  void activate_at_start(InstanceSet instances);
  RecordLayout layout() const;
  void record_to(RecordRing* record) { record_ = record; }

  // --- any thread but the loop's ---
  std::size_t instance_count() const { return instances_.size(); }
  const Instance& instance(InstanceIndex i) const { return *instances_[i]; }
  Instance& instance(InstanceIndex i) { return *instances_[i]; }
  InstanceIndex find(std::string_view name) const;  // kNoInstance: unknown
  std::size_t arm_count() const { return arm_names_.size(); }
  const std::string& arm_name(ArmIndex arm) const { return arm_names_[arm]; }
  InstanceSet active() const { return active_shared_.load(std::memory_order_acquire); }
  InstanceIndex owner(ArmIndex arm) const { return owners_[arm].load(std::memory_order_acquire); }
  ArmSet stopped() const { return ArmSet::from_bits(stopped_shared_.load(std::memory_order_acquire)); }

  // Checks a request as far as that needs no loop: names, sizes, bounds, two owners, stopped arms.
  Verdict check(const Request& request) const;
  // Checks, then queues all of them for one cycle. accepted: queued, `ticket` is that of the last.
  Verdict post(std::span<const Request> requests, std::uint64_t& ticket);
  bool poll(std::uint64_t ticket, Answer& answer) const { return mailbox_.poll(ticket, answer); }
  // post, then wait for the loop's answers (polling; this thread only). The first refusal, else the last
  // answer.
  Answer ask(std::span<const Request> requests, double timeout_s = 1.0);
  Answer ask(const Request& request, double timeout_s = 1.0) {
    return ask(std::span(&request, 1), timeout_s);
  }
  // All named arms to hold at the next cycle boundary, until resumed. Cannot fail and needs no room in a
  // queue.
  void stop(ArmSet arms) { stop_requests_.fetch_or(arms.bits(), std::memory_order_acq_rel); }

  // --- loop thread, between two steps ---
  // Instances that shall start once their arms are ready, in place of those of the last call. Such a start is
  // the weakest of all requests: whatever else is decided about one of its arms ends it (an accepted switch
  // that names the arm, a stop, a resumption), and it never takes an arm from anybody but its hold.
  void start_when_ready(InstanceSet instances);
  // Arms that are ready as of the next boundary. There each start whose arms all are is made, once, after
  // everything that waits at that boundary.
  void set_ready(ArmSet arms) { ready_ = arms; }
  void give_up_starts(ArmSet arms);  // of whatever needs one of them

  // --- loop thread, in this order, once per step ---
  void take_requests(const Tick& tick);                          // the boundary: schedule, mailbox, stops
  void inspect(const Tick& tick);                                // arms that left their limits go to hold
  void run_controllets(const Tick& tick);                        // torques of the owners
  void run_features(const Tick& tick);                           // what their features add
  void limit(const Tick& tick, std::span<JointVector> tau_cmd);  // safety's last word, for the arms due
  void close(const Tick& tick);  // after the write: answers, with the time of the first torque
  void leave_record(CycleRecord& record) const;  // references and outputs of the active instances

 private:
  InstanceIndex hold_of(ArmIndex arm) const { return static_cast<InstanceIndex>(arm); }
  InstanceSet all_instances() const;
  ArmSet arms_of(InstanceSet set) const;
  SwitchPlan plan(InstanceSet active, const Request& request) const;

  void apply(const Request& request, std::uint64_t ticket, HostTime received, const Tick& tick);
  Verdict apply_switch(const Request& request, Answer& answer, const Tick& tick);
  void commit(const SwitchPlan& plan);
  void evict(InstanceIndex instance, ArmIndex arm, const Finding& finding, const Tick& tick,
             bool update_holds);
  void take_stops(const Tick& tick);
  void take_waiting_starts(const Tick& tick);
  void watch_arm(ArmIndex arm, const Tick& tick);
  void emit(Event event, const Tick& tick);
  void emit_finding(EventKind kind, ArmIndex arm, InstanceIndex instance, const Finding& finding,
                    const Tick& tick);

  std::vector<std::string> arm_names_;
  std::vector<std::unique_ptr<Instance>> instances_;
  ArmBlocks blocks_;
  SafetyStage& safety_;
  RecordRing* record_ = nullptr;
  std::vector<std::size_t> output_offsets_;  // of each instance in CycleRecord::outputs
  Mailbox mailbox_;

  std::vector<ScheduledRequest> schedule_;
  std::size_t next_scheduled_ = 0;

  InstanceSet active_ = 0;                     // loop
  ArmSet stopped_;                             // loop
  InstanceSet waiting_ = 0;                    // loop: starts that wait for their arms
  ArmSet ready_;                               // loop: arms that they need not wait for
  std::atomic<InstanceSet> active_shared_{0};  // copies for other threads
  std::atomic<std::uint32_t> stopped_shared_{0};
  std::array<std::atomic<InstanceIndex>, kMaxArms> owners_{};
  std::atomic<std::uint32_t> stop_requests_{0};

  InstanceSet ticking_ = 0;                    // instances that tick in this step
  static constexpr std::size_t kPerStep = 16;  // requests taken in one step; a batch begun is taken whole
  static constexpr std::size_t kAnswersPerStep = kPerStep + Mailbox::kMaxBatch + kMaxInstances;
  std::vector<Answer> pending_;  // answers of this step, completed by close(); never grows
  std::size_t pending_count_ = 0;
  ArmSet handed_over_;  // arms that changed owner in this step
  std::array<double, kMaxArms> step_wanted_{}, step_sent_{};
  std::array<Intervention, kMaxArms> last_cut_{};  // to log the start of an episode, not every cycle of it
  std::array<LoopTime, kMaxArms>
      last_torque_{};  // when each arm last got a torque: its rate limit counts from there
  std::array<ArmMode, kMaxArms> last_mode_{};
  std::array<std::uint32_t, kMaxArms> last_config_{};
};

}  // namespace multipanda
