#pragma once

#include <atomic>
#include <memory>
#include <string>
#include <vector>

#include "core/modes/instance.hpp"
#include "core/modes/mailbox.hpp"
#include "core/modes/reach.hpp"
#include "core/modes/request.hpp"
#include "core/record/cycle_record.hpp"
#include "core/safety/safety.hpp"
#include "core/types/gap_watch.hpp"
#include "core/types/tick.hpp"

namespace multipanda {

// A request that the loop itself executes at a given time. The timeline of a scene consists of these.
struct ScheduledRequest {
  LoopTime at;
  enum class What : std::uint8_t { request, stop } what = What::request;
  Request request;
  ArmSet stop;
};

// Holds all controllet instances, assigns each arm to exactly one of them, and switches between two cycles.
// Instances 0 to arm_count - 1 are the arms' holds ("left_hold"), which own every arm without another owner.
class MultimodeController {
 public:
  // `arm_names` and the blocks have one element per arm. Throws std::invalid_argument (see Instance), on
  // names that are not unique and on too many instances. `spent`: one of the same configs and registry, whose
  // instances work on the same blocks; gives its largest parts, which are as new then.
  MultimodeController(std::vector<std::string> arm_names, const std::vector<InstanceConfig>& configs,
                      const Registry& registry, const ArmBlocks& blocks, SafetyStage& safety,
                      MultimodeController* spent = nullptr);

  // --- before the loop ---
  void schedule(std::vector<ScheduledRequest> requests);  // adds to the requests already scheduled
  // The instances that run from the first cycle on. Throws std::invalid_argument if two own the same arm.
  void activate_at_start(InstanceSet instances);
  // For a loop on the wall clock: if it stalled (GapWatch), all arms are stopped at the next boundary, and
  // earlier requests with a patience are refused.
  void stop_after_gaps() { stops_after_gaps_ = true; }
  // The end effector that counts for check() until the arm shows its own.
  void set_end_effector(ArmIndex arm, const Pose& X_FE) { reach_.set_end_effector(arm, X_FE); }
  RecordLayout layout() const;
  void record_to(RecordRing* record) { record_ = record; }

  // --- any thread except the loop's ---
  std::size_t instance_count() const { return instances_.size(); }
  const Instance& instance(InstanceIndex i) const { return *instances_[i]; }
  Instance& instance(InstanceIndex i) { return *instances_[i]; }
  InstanceIndex find(std::string_view name) const;  // kNoInstance: unknown
  std::size_t arm_count() const { return arm_names_.size(); }
  const std::string& arm_name(ArmIndex arm) const { return arm_names_[arm]; }
  InstanceSet active() const { return active_shared_.load(std::memory_order_acquire); }
  InstanceIndex owner(ArmIndex arm) const { return owners_[arm].load(std::memory_order_acquire); }
  // For one without a loop: shows arms that another controller has stopped.
  void show_stopped(ArmSet arms) { stopped_shared_.store(arms.bits(), std::memory_order_release); }
  ArmSet stopped() const { return ArmSet::from_bits(stopped_shared_.load(std::memory_order_acquire)); }
  // The number of stops until now. Read it before stopped(): then stopped() shows every stop that it counts.
  std::uint32_t stops() const { return stops_.load(std::memory_order_acquire); }

  // Checks whatever does not need the loop: names, sizes, bounds, joint limits, reach, two owners, stopped
  // arms. Goals and samples from every interface pass here.
  Verdict check(const Request& request) const;
  // The same of a sample of a stream, which only a running controllet takes.
  Verdict check_sample(const Request& sample) const;
  // check_sample(), then to the input, without the loop: it uses the newest sample in its next cycle.
  Verdict post_sample(const Request& sample);
  // Description of invalid numbers of a set-point; empty: the verdict is sufficient.
  std::string refusal(const Request& request) const;
  // Checks the requests, then queues all of them for one cycle. accepted: queued; `ticket` is the last one.
  // The loop refuses with Verdict::timeout a request that it takes after `patience_s`, and with
  // Verdict::arm_stopped one that was `asked` before one of its arms was stopped, and a resume that does not
  // count the latest stop.
  static constexpr double kPatience = 1.0;  // [s]
  // Requests taken by the loop are answered within the same cycle; only a stalled loop needs longer.
  static constexpr double kAnswerPatience = 10;  // [s]
  Verdict post(std::span<const Request> requests, std::uint64_t& ticket, double patience_s = kPatience,
               HostTime asked = host_now());
  // Withdraws what post() queued. true: it will never be executed. false: the loop has decided, its answer
  // follows. Call it before giving up on an answer.
  bool withdraw(std::uint64_t ticket) { return mailbox_->withdraw(ticket); }
  bool poll(std::uint64_t ticket, Answer& answer) const { return mailbox_->poll(ticket, answer); }
  // Posts, then polls for the answers of the loop. Returns the first refusal, otherwise the last answer.
  // Verdict::timeout: not executed. Verdict::pending: taken, but its answer was overwritten by later ones.
  Answer ask(std::span<const Request> requests, double timeout_s = kPatience, HostTime asked = host_now());
  Answer ask(const Request& request, double timeout_s = kPatience, HostTime asked = host_now()) {
    return ask(std::span(&request, 1), timeout_s, asked);
  }
  // Holds all given arms, and the arms that carry them, from the next cycle boundary on, until resumed. It
  // cannot fail and needs no space in a queue.
  void stop(ArmSet arms) { stop_requests_.fetch_or(arms.bits(), std::memory_order_acq_rel); }

  // --- loop thread, between two steps ---
  // Refuses requests with a patience that were posted before now: they were not meant for this run of
  // the loop.
  void begin_anew() {
    began_ = host_now();
    gaps_.restart(began_);
  }
  // Sets the instances that start once their arms are ready, replacing those of the last call. A waiting
  // start has the lowest priority: an accepted switch, a stop or a resume of one of its arms cancels it, and
  // it takes an arm only from its hold.
  //
  // These are no ordinary requests, because a request is decided at the boundary that takes it. The host's
  // loop would have to post one before that boundary, when it cannot know what a user's switch or stop of the
  // same boundary decides; posted first, the start would move an arm that has just been stopped, or be the
  // owner from which the user's switch takes it. A switch with all instances of the start would also be
  // refused as a whole for one arm that is not ready.
  void start_when_ready(InstanceSet instances);
  // Sets the arms that are ready at the next boundary. There, each waiting start whose arms are all ready is
  // executed once, after all other requests of that boundary.
  void set_ready(ArmSet arms) { ready_ = arms; }
  void give_up_starts(ArmSet arms);  // cancels the waiting starts that need one of them

  // --- loop thread, in this order, once per step ---
  void take_requests(const Tick& tick);    // at the boundary: schedule, mailbox, stops
  void inspect(const Tick& tick);          // holds arms that left their limits
  void run_controllets(const Tick& tick);  // computes the torques of the owners
  void run_features(const Tick& tick);     // adds the torques of their features
  void limit(const Tick& tick,
             std::span<JointVector> tau_cmd);  // clamps the torques of the arms that are due
  void close(const Tick& tick);                // after the write: answers, with the time of the first torque
  void record_cycle(CycleRecord& record) const;  // records references and outputs of the active instances

 private:
  InstanceIndex hold_of(ArmIndex arm) const { return static_cast<InstanceIndex>(arm); }
  InstanceSet all_instances() const;
  ArmSet arms_of(InstanceSet set) const;
  ArmSet observed_by(InstanceSet set) const;
  SwitchPlan plan(InstanceSet active, const Request& request) const;
  bool observes_itself(InstanceSet instances) const;

  ArmSet with_carriers(ArmSet arms) const;
  void bear_carried_hands(const Tick& tick);
  bool sweeps_carried_arm(InstanceIndex instance, InstanceSet active) const;

  void take_mail(const Tick& tick);
  // Executes a request, unless `verdict` refuses it already.
  void apply(const Request& request, std::uint64_t ticket, HostTime received, const Tick& tick,
             Verdict verdict = Verdict::accepted);
  Verdict apply_switch(const Request& request, Answer& answer, const Tick& tick);
  void commit(const SwitchPlan& plan);
  void end_goal(InstanceIndex i, const Tick& tick);
  void evict(InstanceIndex instance, ArmIndex arm, const Finding& finding, const Tick& tick,
             bool update_holds);
  void take_stops(const Tick& tick);
  void stop_now(ArmSet arms, const Tick& tick);
  bool overtaken_by_stop(const Mailbox::Posted& posted) const;
  void take_waiting_starts(const Tick& tick);
  void give_up_starts_that_observe(ArmSet arms);
  void watch_arm(ArmIndex arm, const Tick& tick);
  Finding inspect_observed(ArmIndex arm) const;
  void inspect_observed(const Tick& tick);
  Finding lost_sensor(ArmSet arms, ArmIndex& arm) const;
  bool sees_observed(InstanceIndex instance) const;  // none of its observed arms is lost
  void report_hold(ArmIndex arm, const Finding& finding, const Tick& tick);
  void emit(Event event, const Tick& tick);
  void emit_finding(EventKind kind, ArmIndex arm, InstanceIndex instance, const Finding& finding,
                    const Tick& tick);

  std::vector<std::string> arm_names_;
  std::vector<std::unique_ptr<Instance>> instances_;
  ArmBlocks blocks_;
  SafetyStage& safety_;
  RecordRing* record_ = nullptr;
  std::vector<std::size_t> output_offsets_;  // of each instance in CycleRecord::outputs
  Reach reach_;
  std::unique_ptr<Mailbox> mailbox_;
  HostTime began_;  // loop: requests received before are refused
  GapWatch gaps_;   // loop
  bool stops_after_gaps_ = false;

  std::vector<ScheduledRequest> schedule_;
  std::size_t next_scheduled_ = 0;

  InstanceSet active_ = 0;                         // loop
  ArmSet stopped_;                                 // loop
  ArmSet asked_to_stop_;                           // loop: the stopped arms that the schedule must not resume
  std::array<HostTime, kMaxArms> stopped_at_{};    // loop: when the arm was last stopped
  std::array<std::uint32_t, kMaxArms> stop_of_{};  // loop: the number of that stop
  Verdict batch_verdict_ = Verdict::accepted;      // loop: of the batch that is being taken
  InstanceSet waiting_ = 0;                        // loop: starts waiting for their arms
  std::array<double, kMaxInstances> waited_s_{};   // loop: for observed arms only, since their own were ready
  ArmSet ready_;                                   // loop: arms that are ready for them
  std::atomic<InstanceSet> active_shared_{0};      // copies for other threads
  std::atomic<std::uint32_t> stopped_shared_{0}, stops_{0};
  std::array<std::atomic<InstanceIndex>, kMaxArms> owners_{};
  std::atomic<std::uint32_t> stop_requests_{0};

  InstanceSet ticking_ = 0;                    // instances that tick in this step
  static constexpr std::size_t kPerStep = 16;  // requests taken in one step; batches are not split
  static constexpr std::size_t kAnswersPerStep = kPerStep + Mailbox::kMaxBatch + kMaxInstances;
  std::vector<Answer> pending_;  // answers of this step, completed by close(); never grows
  std::size_t pending_count_ = 0;
  ArmSet handed_over_;  // arms that changed owner in this step
  std::array<double, kMaxArms> step_requested_{}, step_sent_{};
  std::array<Intervention, kMaxArms> hold_fault_{};  // that was reported of the arm's hold
  std::array<Intervention, kMaxArms> last_cut_{};    // to log the start of an episode only
  // Time of the last torque of each arm, to which its rate limit is relative.
  std::array<LoopTime, kMaxArms> last_torque_{};
  std::array<ArmMode, kMaxArms> last_mode_{};
  std::array<std::uint32_t, kMaxArms> last_config_{};
};

}  // namespace multipanda
