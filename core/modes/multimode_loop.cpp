#include <algorithm>

#include "core/modes/multimode_controller.hpp"
#include "core/modes/request.hpp"
#include "core/record/arm_config.hpp"

// The loop's part: the steps of a cycle, in order. Nothing here allocates, locks, logs or throws.
namespace multipanda {
namespace {

// Sets the torque to zero, with the arm's joint count.
void clear(std::span<JointVector> torques, ArmIndex arm, std::size_t joint_count) {
  torques[arm].setZero(static_cast<Eigen::Index>(joint_count));
}

}  // namespace

void MultimodeController::take_requests(const Tick& tick) {
  pending_count_ = 0;
  handed_over_ = {};
  step_requested_.fill(0);
  step_sent_.fill(0);
  for_each(ArmSet::all(arm_count()) - arms_of(active_), [&](ArmIndex arm) {  // only before the first cycle
    commit({.start = bit(hold_of(arm)), .stop = 0, .keep = 0});
    (void)instances_[hold_of(arm)]->start(tick);
  });
  if (stops_after_gaps_ && gaps_.look(tick.start) == tick.start) {
    began_ = tick.start;
    stop(ArmSet::all(arm_count()));  // taken below
  }
  while (next_scheduled_ < schedule_.size() && schedule_[next_scheduled_].at <= tick.t) {
    const ScheduledRequest& scheduled = schedule_[next_scheduled_++];
    if (scheduled.what == ScheduledRequest::What::stop) {
      stop_now(with_carriers(scheduled.stop & ArmSet::all(arm_count())), tick);
    } else {
      apply(scheduled.request, 0, tick.start, tick);
    }
  }
  take_mail(tick);
  take_stops(tick);  // last, so that a stop overrides all requests of this boundary
  take_waiting_starts(tick);
}

// Requests whose senders still wait. The others are refused, or have been withdrawn. A batch is refused as a
// whole if a stop came between its post and now, and from its first refusal on, since later requests may rely
// on it.
void MultimodeController::take_mail(const Tick& tick) {
  for (std::size_t taken = 0; taken < kPerStep || mailbox_->in_batch(); ++taken) {
    const Mailbox::Posted* posted = mailbox_->front();
    if (posted == nullptr) break;
    if (!mailbox_->in_batch()) {
      batch_verdict_ = Verdict::accepted;
      for (std::size_t i = 0; i < mailbox_->batch_size(); ++i) {
        if (overtaken_by_stop(mailbox_->of_batch(i))) batch_verdict_ = Verdict::arm_stopped;
      }
    }
    const Mailbox::Claim claim = mailbox_->claim(host_now());
    if (claim != Mailbox::Claim::withdrawn) {
      const bool late = claim == Mailbox::Claim::expired || (posted->bounded() && posted->asked < began_);
      apply(posted->request, posted->ticket, posted->received, tick,
            late ? Verdict::timeout : batch_verdict_);
      batch_verdict_ = pending_[pending_count_ - 1].verdict;
    }
    mailbox_->pop();
  }
}

// The sender did not know that the arm would be stopped: the request must resume, start or change nothing,
// also if the arm was resumed meanwhile.
bool MultimodeController::overtaken_by_stop(const Mailbox::Posted& posted) const {
  const Request& request = posted.request;
  ArmSet arms = request.kind == Request::Kind::resume               ? request.arms
                : request.kind == Request::Kind::switch_controllets ? arms_of(request.activate)
                : request.instance < instances_.size()              ? instances_[request.instance]->arms()
                                                                    : ArmSet{};
  // take_stops() comes last: a stop that waits would undo what is accepted here.
  const ArmSet asked = ArmSet::from_bits(stop_requests_.load(std::memory_order_acquire));
  bool overtaken = arms.overlaps(with_carriers(asked & ArmSet::all(arm_count())));
  for_each(arms, [&](ArmIndex arm) {
    overtaken =
        overtaken || posted.asked < stopped_at_[arm] ||
        (request.kind == Request::Kind::resume && stopped_.contains(arm) && request.stops < stop_of_[arm]);
  });
  return overtaken;
}

void MultimodeController::start_when_ready(InstanceSet instances) {
  waiting_ = instances & all_instances();
  waited_s_.fill(0);
  ready_ = {};
}

void MultimodeController::give_up_starts(ArmSet arms) {
  for_each(waiting_, [&](InstanceIndex i) {
    if (instances_[i]->arms().overlaps(arms)) waiting_ &= ~bit(i);
  });
}

void MultimodeController::give_up_starts_that_observe(ArmSet arms) {
  for_each(waiting_, [&](InstanceIndex i) {
    if (instances_[i]->observed().overlaps(arms)) waiting_ &= ~bit(i);
  });
}

// After all other requests of this boundary, which may have canceled waiting starts.
void MultimodeController::take_waiting_starts(const Tick& tick) {
  constexpr double kPatience_s = 5;  // with observed arms: a start minutes later would be unexpected
  give_up_starts(stopped_);
  give_up_starts_that_observe(stopped_);
  for_each(waiting_, [&](InstanceIndex i) {
    const ArmSet arms = instances_[i]->arms();
    if ((waiting_ & bit(i)) == 0 || !ready_.contains(arms)) return;  // an earlier start may cancel it
    if (!sees_observed(i) && (waited_s_[i] += tick.dt) < kPatience_s) return;  // refused afterwards
    waiting_ &= ~bit(i);
    bool free = true;
    for_each(arms, [&](ArmIndex arm) {
      free = free && owners_[arm].load(std::memory_order_relaxed) == hold_of(arm);
    });
    if (free) apply({.activate = bit(i)}, 0, tick.start, tick);
  });
}

void MultimodeController::take_stops(const Tick& tick) {
  const std::uint32_t bits = stop_requests_.exchange(0, std::memory_order_acq_rel);
  if (bits == 0) return;
  const ArmSet arms = with_carriers(ArmSet::from_bits(bits) & ArmSet::all(arm_count()));
  asked_to_stop_ |= arms;
  stop_now(arms, tick);
}

void MultimodeController::stop_now(ArmSet arms, const Tick& tick) {
  stopped_ |= arms;
  const HostTime now = host_now();
  const std::uint32_t number = stops_.load(std::memory_order_relaxed) + 1;
  for_each(arms, [&](ArmIndex arm) {
    stopped_at_[arm] = now;
    stop_of_[arm] = number;
    instances_[hold_of(arm)]->set_stopped(true);
  });
  stopped_shared_.store(stopped_.bits(), std::memory_order_release);
  stops_.store(number, std::memory_order_release);
  give_up_starts(arms);
  Event event{.kind = EventKind::stopped, .arms = arms.bits()};
  emit(event, tick);
  for_each(arms, [&](ArmIndex arm) {
    const InstanceIndex owner = owners_[arm].load(std::memory_order_relaxed);
    safety_.count(arm, Intervention::stop_requested);
    if (owner != hold_of(arm)) evict(owner, arm, {Intervention::stop_requested}, tick, false);
  });
}

void MultimodeController::apply(const Request& request, std::uint64_t ticket, HostTime received,
                                const Tick& tick, Verdict verdict) {
  const bool active = request.instance < instances_.size() && (active_ & bit(request.instance)) != 0;
  Answer answer;
  answer.kind = request.kind;
  answer.ticket = ticket;
  answer.cycle = tick.cycle;
  answer.t = tick.t;
  answer.received = received;
  answer.taken = ticket != 0 ? host_now() : tick.start;  // it may have been posted after the step began
  answer.verdict = verdict == Verdict::accepted ? check(request) : verdict;
  Event event{
      .verdict = answer.verdict, .ticket = ticket, .instance = request.instance, .index = request.index};
  if (answer.accepted()) {
    switch (request.kind) {
      case Request::Kind::switch_controllets:
        answer.verdict = apply_switch(request, answer, tick);
        break;
      case Request::Kind::set_parameter:
        instances_[request.instance]->set_parameter(request.index,
                                                    std::span(request.values).first(request.size), active);
        event.kind = EventKind::parameter_set;
        event.size = request.size;
        std::copy_n(request.values.begin(), request.size, event.values.begin());
        break;
      case Request::Kind::set_feature:
        if (instances_[request.instance]->set_feature(request.index, request.on, active, tick) !=
            LawResult::ok) {
          answer.verdict = Verdict::start_refused;
        }
        event.kind = EventKind::feature_set;
        event.size = 1;
        event.values[0] = request.on ? 1 : 0;
        break;
      case Request::Kind::set_target:
        if (!active) {
          answer.verdict = Verdict::not_active;
        } else if (!instances_[request.instance]->watch_goal(request.index, request.target, request.until)) {
          answer.verdict = Verdict::arm_not_ready;
        } else {
          instances_[request.instance]->inputs()[request.index].set(request.target);
        }
        event.kind = EventKind::target_set;
        event.size = request.target.size;
        std::copy_n(request.target.values.begin(), request.target.size, event.values.begin());
        if (request.target.delivery ==
            Delivery::motion) {  // rise, then sine; the harmonics are visible in the references
          std::copy_n(request.target.sine.begin(), request.target.size, event.values.begin() + event.size);
          event.size = static_cast<std::uint8_t>(2 * event.size);
        }
        break;
      case Request::Kind::resume: {
        // The schedule was fixed before: it must not resume an arm that was stopped since.
        const ArmSet arms = ticket != 0 ? request.arms : request.arms - asked_to_stop_;
        if (ticket != 0) for_each(arms & stopped_, [&](ArmIndex arm) { safety_.release_limits(arm); });
        stopped_ = stopped_ - arms;
        asked_to_stop_ = asked_to_stop_ - arms;
        stopped_shared_.store(stopped_.bits(), std::memory_order_release);
        for_each(arms, [&](ArmIndex arm) { instances_[hold_of(arm)]->set_stopped(false); });
        give_up_starts(arms);  // a resume starts nothing by itself
        give_up_starts_that_observe(arms);
        event.kind = EventKind::resumed;
        event.arms = arms.bits();
        break;
      }
    }
  }
  event.verdict = answer.verdict;
  if (request.kind != Request::Kind::switch_controllets) emit(event, tick);  // close() reports switches
  pending_[pending_count_++] = answer;
}

// Starts the new instances first: if one refuses, nothing changes.
Verdict MultimodeController::apply_switch(const Request& request, Answer& answer, const Tick& tick) {
  answer.plan = plan(active_, request);
  const ArmSet moving = arms_of(answer.plan.start);
  // Do not start an instance that inspect() would remove in the same step. A hold may always start.
  const InstanceSet holds = (InstanceSet{1} << arm_count()) - 1;
  for_each(arms_of(answer.plan.start & ~holds), [&](ArmIndex arm) {
    if (answer.rule != Intervention::none) return;
    answer.rule = safety_.inspect(arm, blocks_.conditions[arm], blocks_.states[arm], blocks_.terms[arm]).rule;
  });
  bool ready = answer.rule == Intervention::none;
  for_each(answer.plan.start, [&](InstanceIndex i) { ready = ready && sees_observed(i); });
  if (!ready) return Verdict::arm_not_ready;
  bool started = true;
  for_each(answer.plan.start, [&](InstanceIndex i) {
    started = started && !sweeps_carried_arm(i, (active_ & ~answer.plan.stop) | answer.plan.start);
  });
  if (!started) return Verdict::start_refused;
  for_each(answer.plan.start,
           [&](InstanceIndex i) { started = started && instances_[i]->start(tick) == LawResult::ok; });
  if (!started) {
    ArmIndex arm = 0;
    answer.rule = lost_sensor(moving, arm).rule;
    return Verdict::start_refused;
  }
  commit(answer.plan);
  handed_over_ |= moving;
  give_up_starts(request.only ? ArmSet::all(arm_count()) : arms_of(request.activate | request.deactivate));
  return Verdict::accepted;
}

void MultimodeController::commit(const SwitchPlan& plan) {
  active_ = (active_ & ~plan.stop) | plan.start;
  for_each(plan.start, [&](InstanceIndex i) {
    for_each(instances_[i]->arms(), [&](ArmIndex arm) {
      owners_[arm].store(i, std::memory_order_release);
      hold_fault_[arm] = Intervention::none;
    });
  });
  active_shared_.store(active_, std::memory_order_release);
}

// Deactivates an instance; its arms are held from this cycle on.
void MultimodeController::evict(InstanceIndex instance, ArmIndex arm, const Finding& finding,
                                const Tick& tick, bool update_holds) {
  if ((active_ & bit(instance)) == 0) return;
  const Request request{.deactivate = bit(instance)};
  const SwitchPlan leave = plan(active_, request);
  commit(leave);
  ticking_ &= ~leave.stop;
  handed_over_ |= arms_of(leave.start);
  for_each(leave.start, [&](InstanceIndex i) {
    (void)instances_[i]->start(tick);
    if (!update_holds) return;
    (void)instances_[i]->begins_tick(instances_[i]->arms(), tick);
    const ArmIndex held = instances_[i]->arms().first();
    if (instances_[i]->update(tick) != Intervention::none ||
        safety_.judge(held, blocks_.tau_controllet[held])) {
      clear(blocks_.tau_controllet, held,
            blocks_.terms[held]
                .joint_count());  // a hold cannot be computed either; the arm compensates its own gravity
    }
    if (instances_[i]->update_features(tick) != Intervention::none ||
        safety_.judge(held, blocks_.tau_controllet[held], blocks_.tau_feature[held])) {
      clear(blocks_.tau_feature, held, blocks_.terms[held].joint_count());
    }
  });
  if (finding.rule != Intervention::stop_requested) {
    safety_.count(arm, finding.rule);
    emit_finding(EventKind::intervention, arm, instance, finding, tick);
  }
  Event event{.kind = EventKind::switched, .started = leave.start, .stopped = leave.stop, .kept = leave.keep};
  event.intervention = finding.rule;
  event.instance = instance;
  event.arm = static_cast<std::uint16_t>(arm);
  emit(event, tick);
}

// Emits an event if the arm changed its mode or configuration. An arm that returns, for example from a
// reflex, from hand guiding or from silence, is held at its current position, not at its previous one.
void MultimodeController::watch_arm(ArmIndex arm, const Tick& tick) {
  const ArmState& state = blocks_.states[arm];
  if (blocks_.conditions[arm].returned && owners_[arm].load(std::memory_order_relaxed) == hold_of(arm)) {
    (void)instances_[hold_of(arm)]->start(tick);
  }
  if (state.mode != last_mode_[arm]) {
    last_mode_[arm] = state.mode;
    Event event{.kind = EventKind::arm_mode, .arm = static_cast<std::uint16_t>(arm)};
    event.index = static_cast<std::uint16_t>(state.mode);
    emit(event, tick);
  }
  if (state.fresh && state.config_version != last_config_[arm]) {
    last_config_[arm] = state.config_version;
    reach_.set_end_effector(arm, state.frames.X_FE);
    Event event{.arm = static_cast<std::uint16_t>(arm)};
    event.index = static_cast<std::uint16_t>(state.config_version);
    put_arm_config(event, state.frames, state.tool, state.load);
    emit(event, tick);
  }
}

void MultimodeController::inspect(const Tick& tick) {
  for_each(ArmSet::all(arm_count()), [&](ArmIndex arm) {
    watch_arm(arm, tick);
    const InstanceIndex owner = owners_[arm].load(std::memory_order_relaxed);
    safety_.track_limits(arm, blocks_.states[arm], blocks_.terms[arm], owner == hold_of(arm),
                         blocks_.conditions[arm].began);
    if (owner == hold_of(arm)) return;
    const bool alone = instances_[owner]->arms().size() == 1;
    const ArmCondition& condition = blocks_.conditions[arm];
    if (const Finding finding =
            safety_.inspect(arm, condition, blocks_.states[arm], blocks_.terms[arm], alone)) {
      evict(owner, arm, finding, tick, false);
    }
  });
  inspect_observed(tick);
}

// The last motion of a lost arm is not a set-point, and a stop of an arm also stops its followers. Their arms
// are held until they are switched again, which aligns them again.
Finding MultimodeController::inspect_observed(ArmIndex arm) const {
  if (stopped_.contains(arm)) return {Intervention::observed_arm_lost};
  return safety_.inspect_observed(arm, blocks_.conditions[arm], blocks_.states[arm]);
}

void MultimodeController::inspect_observed(const Tick& tick) {
  for_each(active_, [&](InstanceIndex i) {
    for_each(instances_[i]->observed(), [&](ArmIndex arm) {
      if (const Finding finding = inspect_observed(arm))
        evict(i, instances_[i]->arms().first(), finding, tick, false);
    });
    if (sweeps_carried_arm(i, active_))
      evict(i, instances_[i]->arms().first(), {Intervention::observed_arm_lost}, tick, false);
  });
}

bool MultimodeController::sees_observed(InstanceIndex instance) const {
  bool sees = true;
  for_each(instances_[instance]->observed(), [&](ArmIndex arm) { sees = sees && !inspect_observed(arm); });
  return sees;
}

// The hold itself failed: only the arm's own gravity compensation remains. This is not reported for an arm
// that takes no commands, for example in a reflex.
void MultimodeController::report_hold(ArmIndex arm, const Finding& finding, const Tick& tick) {
  if (!blocks_.conditions[arm].usable) return;
  safety_.count(arm, finding.rule);
  if (hold_fault_[arm] == finding.rule) return;
  hold_fault_[arm] = finding.rule;
  emit_finding(EventKind::intervention, arm, hold_of(arm), finding, tick);
}

void MultimodeController::end_goal(InstanceIndex i, const Tick& tick) {
  Instance::EndedGoal ended;
  if (!instances_[i]->end_goal(ended)) return;
  Event event{.kind = EventKind::goal_ended, .instance = i};
  event.index = static_cast<std::uint16_t>(ended.input);
  event.arm = static_cast<std::uint16_t>(instances_[i]->arm_list()[ended.arm]);
  event.size = 3;
  event.values[0] = ended.cause;
  event.values[1] = ended.measured;
  event.values[2] = ended.limit;
  emit(event, tick);
}

// A law without the force that it needs reports a fault: the sensor is the reason. `arm`: the sensor's.
Finding MultimodeController::lost_sensor(ArmSet arms, ArmIndex& arm) const {
  Finding finding;
  for_each(arms, [&](ArmIndex a) {
    const SensorFault& sensor = blocks_.conditions[a].sensor;
    if (finding || sensor.rule == Intervention::none) return;
    finding = {sensor.rule, 0xFFFF, sensor.value, sensor.limit};
    arm = a;
  });
  return finding;
}

void MultimodeController::run_controllets(const Tick& tick) {
  ticking_ = 0;
  for_each(active_, [&](InstanceIndex i) {
    Instance& instance = *instances_[i];
    if ((active_ & bit(i)) == 0 || !instance.begins_tick(tick.due, tick)) return;
    ticking_ |= bit(i);
    end_goal(i, tick);
    Finding finding{instance.update(tick)};
    ArmIndex arm = instance.arms().first();
    if (finding.rule == Intervention::controllet_fault) {
      if (const Finding sensor = lost_sensor(instance.arms(), arm)) finding = sensor;
    }
    if (!finding) {
      for_each(instance.arms(), [&](ArmIndex a) {
        if (finding) return;
        finding = safety_.judge(a, blocks_.tau_controllet[a]);
        if (finding) arm = a;
      });
    }
    if (finding) {
      if (i < arm_count()) {
        clear(blocks_.tau_controllet, arm, blocks_.terms[arm].joint_count());
        report_hold(arm, finding, tick);
      } else {
        evict(i, arm, finding, tick, true);
      }
    }
  });
}

void MultimodeController::run_features(const Tick& tick) {
  for_each(ticking_, [&](InstanceIndex i) {
    if ((ticking_ & bit(i)) == 0) return;
    Instance& instance = *instances_[i];
    Finding finding{instance.update_features(tick)};
    ArmIndex arm = instance.arms().first();
    for_each(instance.arms(), [&](ArmIndex a) {
      if (finding) return;
      finding = safety_.judge(a, blocks_.tau_controllet[a], blocks_.tau_feature[a]);
      if (finding) arm = a;
    });
    if (!finding) return;
    if (i < arm_count()) {
      clear(blocks_.tau_feature, arm, blocks_.terms[arm].joint_count());
      report_hold(arm, finding, tick);
    } else {
      evict(i, arm, finding, tick, true);
    }
  });
  bear_carried_hands(tick);
}

void MultimodeController::limit(const Tick& tick, std::span<JointVector> tau_cmd) {
  for_each(tick.due, [&](ArmIndex arm) {
    const JointVector tau_requested = blocks_.tau_controllet[arm] + blocks_.tau_feature[arm];
    const JointVector before = safety_.last_command(arm);
    Finding cut;
    tau_cmd[arm] = safety_.limit(arm, tau_requested, seconds(tick.t - last_torque_[arm]), cut);
    last_torque_[arm] = tick.t;
    if (handed_over_.contains(arm)) {
      step_requested_[arm] = (tau_requested - before).lpNorm<Eigen::Infinity>();
      step_sent_[arm] = (tau_cmd[arm] - before).lpNorm<Eigen::Infinity>();
    }
    if (cut && cut.rule != last_cut_[arm]) {
      emit_finding(EventKind::intervention, arm, owners_[arm].load(std::memory_order_relaxed), cut, tick);
    }
    last_cut_[arm] = cut.rule;
  });
}

void MultimodeController::close(const Tick& tick) {
  if (pending_count_ == 0) return;
  const HostTime now = host_now();
  for (std::size_t k = 0; k < pending_count_; ++k) {
    Answer& answer = pending_[k];
    answer.first_torque = now;
    if (answer.kind == Request::Kind::switch_controllets) {
      answer.step_requested = step_requested_;
      answer.step_sent = step_sent_;
      Event event{.kind = answer.accepted() ? EventKind::switched : EventKind::switch_refused};
      event.verdict = answer.verdict;
      event.ticket = answer.ticket;
      event.started = answer.plan.start;
      event.stopped = answer.plan.stop;
      event.kept = answer.plan.keep;
      event.arms = arms_of(answer.plan.start).bits();
      event.received = answer.received;
      event.taken = answer.taken;
      event.first_torque = now;
      event.size = static_cast<std::uint8_t>(2 * arm_count());
      for (ArmIndex arm = 0; arm < arm_count(); ++arm) {
        event.values[2 * arm] = step_requested_[arm];
        event.values[2 * arm + 1] = step_sent_[arm];
      }
      emit(event, tick);
    }
    if (answer.ticket != 0) mailbox_->answer(answer);
  }
}

}  // namespace multipanda
