#include "core/modes/multimode_controller.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <thread>

namespace multipanda {
namespace {

// Instances of a set, lowest index first: the order in which they are computed is always the same.
template <typename Visit>
void for_each(InstanceSet set, Visit visit) {
  for (; set != 0; set &= set - 1) visit(static_cast<InstanceIndex>(std::countr_zero(set)));
}

template <typename Visit>
void for_each(ArmSet arms, Visit visit) {
  for (std::uint32_t bits = arms.bits(); bits != 0; bits &= bits - 1) {
    visit(static_cast<ArmIndex>(std::countr_zero(bits)));
  }
}

// Zero in the arm's own size, whatever was left there.
void clear(std::span<JointVector> torques, ArmIndex arm, std::size_t joint_count) {
  torques[arm].setZero(static_cast<Eigen::Index>(joint_count));
}

constexpr std::uint32_t kNeverSeen = 0xFFFFFFFF;

}  // namespace

MultimodeController::MultimodeController(std::vector<std::string> arm_names,
                                         const std::vector<InstanceConfig>& configs, const Registry& registry,
                                         const ArmBlocks& blocks, SafetyStage& safety)
    : arm_names_(std::move(arm_names)), blocks_(blocks), safety_(safety) {
  for (ArmIndex arm = 0; arm < arm_names_.size(); ++arm) {
    InstanceConfig hold{.name = arm_names_[arm] + "_hold", .type = "hold", .arms = {arm}};
    for (const auto& config : configs) {
      if (config.name == hold.name) hold = config;  // a scene may set its parameters and features
    }
    if (hold.type != "hold" || hold.arms != std::vector<ArmIndex>{arm}) {
      throw std::invalid_argument("controllet '" + hold.name + "': this name belongs to the hold of arm '" +
                                  arm_names_[arm] + "'");
    }
    instances_.push_back(std::make_unique<Instance>(hold, registry, blocks));
  }
  for (const auto& config : configs) {
    const InstanceIndex taken = find(config.name);
    if (taken < arm_names_.size()) continue;  // a hold, built above
    if (taken != kNoInstance) throw std::invalid_argument("two controllets are named '" + config.name + "'");
    instances_.push_back(std::make_unique<Instance>(config, registry, blocks));
  }
  if (instances_.size() > kMaxInstances) {
    throw std::invalid_argument("too many controllets: " + std::to_string(instances_.size()) + ", at most " +
                                std::to_string(kMaxInstances) + " with the arms' holds");
  }
  std::size_t offset = 0;
  for (const auto& instance : instances_) {
    output_offsets_.push_back(offset);
    offset += instance->outputs().size();
  }
  last_mode_.fill(ArmMode::other);
  last_config_.fill(kNeverSeen);
  // Long before the first cycle, so that the first torque gets a whole period of the rate limit.
  last_torque_.fill(LoopTime::from_seconds(-1));
  for (ArmIndex arm = 0; arm < arm_names_.size(); ++arm) owners_[arm] = hold_of(arm);
  pending_.resize(kPerStep + Mailbox::kMaxBatch);
}

RecordLayout MultimodeController::layout() const {
  RecordLayout layout;
  for (ArmIndex arm = 0; arm < arm_names_.size(); ++arm) {
    layout.arms.push_back({arm_names_[arm], blocks_.terms[arm].joint_count()});
  }
  for (const auto& instance : instances_) {
    RecordLayout::Instance entry;
    entry.name = instance->name();
    entry.type = instance->statement().type;
    entry.arms = instance->arms().bits();
    for (const auto& input : std::as_const(*instance).inputs()) {
      entry.inputs.push_back(
          {input.spec().name, std::string(to_string(input.spec().quantity)), input.spec().frame});
    }
    entry.parameters = instance->parameter_names();
    for (std::size_t i = 0; i < instance->feature_count(); ++i) {
      entry.features.push_back(instance->feature_statement(i).type);
    }
    for (const auto& output : instance->output_specs()) {
      entry.outputs.push_back({output.name, layout.output_count, output.size});
      layout.output_count += output.size;
    }
    layout.max_references += entry.inputs.size();
    layout.instances.push_back(std::move(entry));
  }
  return layout;
}

void MultimodeController::schedule(std::vector<ScheduledRequest> requests) {
  schedule_.insert(schedule_.end(), requests.begin(), requests.end());
  std::stable_sort(schedule_.begin(), schedule_.end(),
                   [](const auto& a, const auto& b) { return a.at < b.at; });
  next_scheduled_ = 0;
  // Even if all are due at once, each is taken to the cycle.
  pending_.resize(schedule_.size() + kPerStep + Mailbox::kMaxBatch);
}

void MultimodeController::activate_at_start(InstanceSet instances) {
  const Request request{.activate = instances, .only = true};
  if (const Verdict verdict = check(request); verdict != Verdict::accepted) {
    throw std::invalid_argument("active at start: " + std::string(to_string(verdict)));
  }
  ScheduledRequest first;
  first.at = {std::numeric_limits<std::int64_t>::min()};
  first.request = request;
  schedule({first});
}

ArmSet MultimodeController::ArmSet_from(std::uint32_t bits) {
  ArmSet set;
  for (ArmIndex arm = 0; arm < kMaxArms; ++arm) {
    if ((bits >> arm & 1u) != 0) set |= ArmSet::of(arm);
  }
  return set;
}

InstanceSet MultimodeController::all_instances() const {
  return instances_.size() == 64 ? ~InstanceSet{0} : (InstanceSet{1} << instances_.size()) - 1;
}

InstanceIndex MultimodeController::find(std::string_view name) const {
  for (std::size_t i = 0; i < instances_.size(); ++i) {
    if (instances_[i]->name() == name) return static_cast<InstanceIndex>(i);
  }
  return kNoInstance;
}

ArmSet MultimodeController::arms_of(InstanceSet set) const {
  ArmSet arms;
  for_each(set, [&](InstanceIndex i) { arms |= instances_[i]->arms(); });
  return arms;
}

// Who runs after `request`, given who runs now: the activated ones, of the others those that share no arm
// with them (and were not told to stop), and the holds of all arms that are then without an owner.
SwitchPlan MultimodeController::plan(InstanceSet active, const Request& request) const {
  const ArmSet wanted = arms_of(request.activate);
  InstanceSet next = request.activate;
  const InstanceSet others = request.only ? 0 : active & ~request.deactivate & ~request.activate;
  for_each(others, [&](InstanceIndex i) {
    if (!instances_[i]->arms().overlaps(wanted)) next |= bit(i);
  });
  for_each(ArmSet::all(arm_count()) - arms_of(next), [&](ArmIndex arm) { next |= bit(hold_of(arm)); });
  return {.start = next & ~active, .stop = active & ~next, .keep = active & next};
}

Verdict MultimodeController::check(const Request& request) const {
  switch (request.kind) {
    case Request::Kind::switch_controllets: {
      if (((request.activate | request.deactivate) & ~all_instances()) != 0) return Verdict::unknown_instance;
      ArmSet taken;
      Verdict verdict = Verdict::accepted;
      for_each(request.activate, [&](InstanceIndex i) {
        if (taken.overlaps(instances_[i]->arms())) verdict = Verdict::two_owners;
        taken |= instances_[i]->arms();
      });
      if (verdict != Verdict::accepted) return verdict;
      const InstanceSet laws =
          request.activate & ~((InstanceSet{1} << arm_count()) - 1);  // holds may always run
      return arms_of(laws).overlaps(stopped()) ? Verdict::arm_stopped : Verdict::accepted;
    }
    case Request::Kind::resume:
      return (request.arms - ArmSet::all(arm_count())).empty() ? Verdict::accepted : Verdict::unknown_arm;
    case Request::Kind::set_parameter:
    case Request::Kind::set_feature:
    case Request::Kind::set_target:
      break;
  }
  if (request.instance >= instances_.size()) return Verdict::unknown_instance;
  const Instance& instance = *instances_[request.instance];
  if (request.kind == Request::Kind::set_parameter) {
    if (request.index >= instance.parameter_count()) return Verdict::unknown_parameter;
    if (request.size > kMaxParameterSize) return Verdict::wrong_size;
    return instance.check_parameter(request.index, std::span(request.values).first(request.size));
  }
  if (request.kind == Request::Kind::set_feature) {
    return request.index < instance.feature_count() ? Verdict::accepted : Verdict::unknown_feature;
  }
  if (request.index >= instance.inputs().size()) return Verdict::unknown_input;
  return instance.inputs()[request.index].check(request.target);
}

Verdict MultimodeController::post(std::span<const Request> requests, std::uint64_t& ticket) {
  for (const Request& request : requests) {
    if (const Verdict verdict = check(request); verdict != Verdict::accepted) return verdict;
  }
  ticket = mailbox_.post(requests);
  return ticket != 0 ? Verdict::accepted : Verdict::queue_full;
}

Answer MultimodeController::ask(std::span<const Request> requests, double timeout_s) {
  Answer answer;
  std::uint64_t ticket = 0;
  answer.received = host_now();
  answer.verdict = post(requests, ticket);
  if (!answer.accepted()) return answer;
  const HostTime asked = answer.received;
  for (std::uint64_t part = ticket - requests.size() + 1; part <= ticket; ++part) {
    while (!mailbox_.poll(part, answer)) {
      if (seconds(host_now() - asked) > timeout_s) {
        answer.verdict = Verdict::timeout;
        return answer;
      }
      std::this_thread::sleep_for(std::chrono::microseconds(100));
    }
    if (!answer.accepted()) break;
  }
  return answer;
}

// -------------------------------------------------------------------------------------- the loop's side

void MultimodeController::take_requests(const Tick& tick) {
  pending_count_ = 0;
  handed_over_ = {};
  step_wanted_.fill(0);
  step_sent_.fill(0);
  for_each(ArmSet::all(arm_count()) - arms_of(active_), [&](ArmIndex arm) {  // only before the first cycle
    commit({.start = bit(hold_of(arm)), .stop = 0, .keep = 0});
    (void)instances_[hold_of(arm)]->start(tick);
  });
  take_stops(tick);
  while (next_scheduled_ < schedule_.size() && schedule_[next_scheduled_].at <= tick.t) {
    const ScheduledRequest& scheduled = schedule_[next_scheduled_++];
    if (scheduled.what == ScheduledRequest::What::stop) {
      stop(scheduled.stop);
      take_stops(tick);
    } else {
      apply(scheduled.request, 0, tick.start, tick);
    }
  }
  for (std::size_t taken = 0; taken < kPerStep || mailbox_.in_batch(); ++taken) {
    const Mailbox::Posted* posted = mailbox_.front();
    if (posted == nullptr) break;
    apply(posted->request, posted->ticket, posted->received, tick);
    mailbox_.pop();
  }
}

void MultimodeController::take_stops(const Tick& tick) {
  const std::uint32_t bits = stop_requests_.exchange(0, std::memory_order_acq_rel);
  if (bits == 0) return;
  const ArmSet arms = ArmSet_from(bits) & ArmSet::all(arm_count());
  stopped_ |= arms;
  stopped_shared_.store(stopped_.bits(), std::memory_order_release);
  Event event{.kind = EventKind::stopped, .arms = arms.bits()};
  emit(event, tick);
  for_each(arms, [&](ArmIndex arm) {
    const InstanceIndex owner = owners_[arm].load(std::memory_order_relaxed);
    safety_.count(arm, Intervention::stop_requested);
    if (owner != hold_of(arm)) evict(owner, arm, {Intervention::stop_requested}, tick, false);
  });
}

void MultimodeController::apply(const Request& request, std::uint64_t ticket, HostTime received,
                                const Tick& tick) {
  const bool active = request.instance < instances_.size() && (active_ & bit(request.instance)) != 0;
  Answer answer;
  answer.kind = request.kind;
  answer.ticket = ticket;
  answer.cycle = tick.cycle;
  answer.t = tick.t;
  answer.received = received;
  answer.taken = ticket != 0 ? host_now() : tick.start;  // it may have been posted after the step began
  answer.verdict = check(request);
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
        } else {
          instances_[request.instance]->inputs()[request.index].set(request.target);
        }
        event.kind = EventKind::target_set;
        event.size = request.target.size;
        std::copy_n(request.target.values.begin(), request.target.size, event.values.begin());
        break;
      case Request::Kind::resume:
        stopped_ = stopped_ - request.arms;
        stopped_shared_.store(stopped_.bits(), std::memory_order_release);
        event.kind = EventKind::resumed;
        event.arms = request.arms.bits();
        break;
    }
  }
  event.verdict = answer.verdict;
  if (request.kind != Request::Kind::switch_controllets) emit(event, tick);  // switches are told by close()
  pending_[pending_count_++] = answer;
}

// Starts the new ones first: if one refuses, everything stays as it was.
Verdict MultimodeController::apply_switch(const Request& request, Answer& answer, const Tick& tick) {
  answer.plan = plan(active_, request);
  const ArmSet moving = arms_of(answer.plan.start);
  // What inspect() would take out in this very step is not started in the first place. A hold always may.
  const InstanceSet holds = (InstanceSet{1} << arm_count()) - 1;
  bool ready = true;
  for_each(arms_of(answer.plan.start & ~holds), [&](ArmIndex arm) {
    ready = ready && !safety_.inspect(arm, blocks_.states[arm], blocks_.terms[arm]);
  });
  if (!ready) return Verdict::arm_not_ready;
  bool started = true;
  for_each(answer.plan.start,
           [&](InstanceIndex i) { started = started && instances_[i]->start(tick) == LawResult::ok; });
  if (!started) return Verdict::start_refused;
  commit(answer.plan);
  handed_over_ |= moving;
  return Verdict::accepted;
}

void MultimodeController::commit(const SwitchPlan& plan) {
  active_ = (active_ & ~plan.stop) | plan.start;
  for_each(plan.start, [&](InstanceIndex i) {
    for_each(instances_[i]->arms(), [&](ArmIndex arm) { owners_[arm].store(i, std::memory_order_release); });
  });
  active_shared_.store(active_, std::memory_order_release);
}

// Takes an instance out; its arms are held from this very step on.
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
    (void)instances_[i]->begins_tick(instances_[i]->arms());
    const ArmIndex held = instances_[i]->arms().first();
    if (instances_[i]->update(tick) != Intervention::none ||
        safety_.judge(held, blocks_.tau_controllet[held])) {
      clear(blocks_.tau_controllet, held,
            blocks_.terms[held].joint_count());  // not even a hold can be computed: the arm carries itself
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

// Leaves an event when the arm itself changed its mode or configuration.
void MultimodeController::watch_arm(ArmIndex arm, const Tick& tick) {
  const ArmState& state = blocks_.states[arm];
  if (state.mode != last_mode_[arm]) {
    last_mode_[arm] = state.mode;
    Event event{.kind = EventKind::arm_mode, .arm = static_cast<std::uint16_t>(arm)};
    event.index = static_cast<std::uint16_t>(state.mode);
    emit(event, tick);
  }
  if (state.fresh && state.config_version != last_config_[arm]) {
    last_config_[arm] = state.config_version;
    Event event{.kind = EventKind::arm_config, .arm = static_cast<std::uint16_t>(arm)};
    event.index = static_cast<std::uint16_t>(state.config_version);
    const auto add = [&](double value) { event.values[event.size++] = value; };
    for (const Pose& X : {state.frames.X_FE, state.frames.X_EK}) {
      const Quaternion q = X.quaternion();
      for (const double v : {X.position.x(), X.position.y(), X.position.z(), q.w(), q.x(), q.y(), q.z()})
        add(v);
    }
    for (const Load& load : {state.tool, state.load}) {
      for (const double v : {load.mass, load.p_FC.x(), load.p_FC.y(), load.p_FC.z()}) add(v);
    }
    emit(event, tick);
  }
}

void MultimodeController::inspect(const Tick& tick) {
  for_each(ArmSet::all(arm_count()), [&](ArmIndex arm) {
    watch_arm(arm, tick);
    const InstanceIndex owner = owners_[arm].load(std::memory_order_relaxed);
    if (owner == hold_of(arm)) return;
    if (const Finding finding = safety_.inspect(arm, blocks_.states[arm], blocks_.terms[arm])) {
      evict(owner, arm, finding, tick, false);
    }
  });
}

void MultimodeController::run_controllets(const Tick& tick) {
  ticking_ = 0;
  for_each(active_, [&](InstanceIndex i) {
    Instance& instance = *instances_[i];
    if ((active_ & bit(i)) == 0 || !instance.begins_tick(tick.due)) return;
    ticking_ |= bit(i);
    Finding finding{instance.update(tick)};
    ArmIndex arm = instance.arms().first();
    if (!finding) {
      for_each(instance.arms(), [&](ArmIndex a) {
        if (finding) return;
        finding = safety_.judge(a, blocks_.tau_controllet[a]);
        if (finding) arm = a;
      });
    }
    if (finding) {
      if (i < arm_count()) {
        // The hold itself: nothing below it but the arm's own gravity compensation.
        clear(blocks_.tau_controllet, arm, blocks_.terms[arm].joint_count());
        safety_.count(arm, finding.rule);
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
      safety_.count(arm, finding.rule);
    } else {
      evict(i, arm, finding, tick, true);
    }
  });
}

void MultimodeController::limit(const Tick& tick, std::span<JointVector> tau_cmd) {
  for_each(tick.due, [&](ArmIndex arm) {
    const JointVector wanted = blocks_.tau_controllet[arm] + blocks_.tau_feature[arm];
    const JointVector before = safety_.last_command(arm);
    Finding cut;
    tau_cmd[arm] = safety_.limit(arm, wanted, seconds(tick.t - last_torque_[arm]), cut);
    last_torque_[arm] = tick.t;
    if (handed_over_.contains(arm)) {
      step_wanted_[arm] = (wanted - before).lpNorm<Eigen::Infinity>();
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
      answer.step_wanted = step_wanted_;
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
        event.values[2 * arm] = step_wanted_[arm];
        event.values[2 * arm + 1] = step_sent_[arm];
      }
      emit(event, tick);
    }
    if (answer.ticket != 0) mailbox_.answer(answer);
  }
}

void MultimodeController::leave_record(CycleRecord& record) const {
  record.reference_count = 0;
  std::fill(record.outputs.begin(), record.outputs.end(), std::numeric_limits<double>::quiet_NaN());
  for_each(active_, [&](InstanceIndex i) {
    const Instance& instance = *instances_[i];
    for (std::size_t k = 0; k < instance.inputs().size(); ++k) {
      const Reference& reference = instance.inputs()[k];
      ReferenceSample& sample = record.references[record.reference_count++];
      sample.instance = i;
      sample.input = static_cast<std::uint8_t>(k);
      sample.size = static_cast<std::uint8_t>(reference.size());
      sample.streaming = reference.streaming();
      reference.record(sample.values.data(), sample.rates.data());
    }
    std::copy(instance.outputs().begin(), instance.outputs().end(),
              record.outputs.begin() + static_cast<std::ptrdiff_t>(output_offsets_[i]));
  });
}

void MultimodeController::emit(Event event, const Tick& tick) {
  if (record_ == nullptr) return;
  event.t = tick.t;
  event.cycle = tick.cycle;
  if (!record_->events.push(event)) record_->dropped_events.fetch_add(1, std::memory_order_relaxed);
}

void MultimodeController::emit_finding(EventKind kind, ArmIndex arm, InstanceIndex instance,
                                       const Finding& finding, const Tick& tick) {
  Event event{.kind = kind, .intervention = finding.rule};
  event.arm = static_cast<std::uint16_t>(arm);
  event.instance = instance;
  event.joint = finding.joint;
  event.size = 2;
  event.values[0] = finding.value;
  event.values[1] = finding.limit;
  emit(event, tick);
}

}  // namespace multipanda
