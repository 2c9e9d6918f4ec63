#include "core/modes/multimode_controller.hpp"

#include <algorithm>
#include <limits>
#include <stdexcept>
#include <thread>

#include "core/modes/request.hpp"

// Construction and the functions for other threads. The loop's part is in multimode_loop.cpp.
namespace multipanda {
namespace {

constexpr std::uint32_t kNeverSeen = 0xFFFFFFFF;

}  // namespace

MultimodeController::MultimodeController(std::vector<std::string> arm_names,
                                         const std::vector<InstanceConfig>& configs, const Registry& registry,
                                         const ArmBlocks& blocks, SafetyStage& safety,
                                         MultimodeController* spent)
    : arm_names_(std::move(arm_names)),
      blocks_(blocks),
      safety_(safety),
      reach_(blocks),
      mailbox_(spent != nullptr ? std::move(spent->mailbox_) : std::make_unique<Mailbox>()) {
  mailbox_->clear();
  if (spent != nullptr) pending_ = std::move(spent->pending_);
  const auto add = [&](const InstanceConfig& config) {
    if (spent == nullptr) {
      instances_.push_back(std::make_unique<Instance>(config, registry, blocks));
    } else {
      instances_.push_back(std::move(spent->instances_[instances_.size()]));
      instances_.back()->renew(registry, blocks);
    }
  };
  for (ArmIndex arm = 0; arm < arm_names_.size(); ++arm) {
    InstanceConfig hold{.name = arm_names_[arm] + "_hold", .type = "hold", .arms = {arm}};
    for (const auto& config : configs) {
      if (config.name == hold.name) hold = config;  // a scene may set its parameters and features
    }
    if (hold.type != "hold" || hold.arms != std::vector<ArmIndex>{arm}) {
      throw std::invalid_argument("controllet '" + hold.name +
                                  "': this name is reserved for the hold of arm '" + arm_names_[arm] + "'");
    }
    add(hold);
  }
  for (const auto& config : configs) {
    const InstanceIndex taken = find(config.name);
    if (taken < arm_names_.size()) continue;  // a hold, built above
    if (taken != kNoInstance) throw std::invalid_argument("two controllets are named '" + config.name + "'");
    add(config);
  }
  if (instances_.size() > kMaxInstances) {
    throw std::invalid_argument("too many controllets: " + std::to_string(instances_.size()) +
                                " with the arms' holds; at most " + std::to_string(kMaxInstances) +
                                " are supported");
  }
  std::size_t offset = 0;
  for (const auto& instance : instances_) {
    output_offsets_.push_back(offset);
    offset += instance->outputs().size();
  }
  last_mode_.fill(ArmMode::other);
  last_config_.fill(kNeverSeen);
  // Well before the first cycle, so that the rate limit of the first torque covers a whole period.
  last_torque_.fill(LoopTime::from_seconds(-1));
  for (ArmIndex arm = 0; arm < arm_names_.size(); ++arm) owners_[arm] = hold_of(arm);
  pending_.resize(kAnswersPerStep);
}

void MultimodeController::schedule(std::vector<ScheduledRequest> requests) {
  schedule_.insert(schedule_.end(), requests.begin(), requests.end());
  std::stable_sort(schedule_.begin(), schedule_.end(),
                   [](const auto& a, const auto& b) { return a.at < b.at; });
  next_scheduled_ = 0;
  // Room for all of them at once, so that each is taken in its cycle.
  pending_.resize(schedule_.size() + kAnswersPerStep);
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

ArmSet MultimodeController::observed_by(InstanceSet set) const {
  ArmSet arms;
  for_each(set, [&](InstanceIndex i) { arms |= instances_[i]->observed(); });
  return arms;
}

// The instances that run after `request`: the activated ones, the active ones that share no arm with them and
// are not deactivated, and the holds of all arms that then have no owner.
SwitchPlan MultimodeController::plan(InstanceSet active, const Request& request) const {
  const ArmSet requested_arms = arms_of(request.activate);
  InstanceSet next = request.activate;
  const InstanceSet others = request.only ? 0 : active & ~request.deactivate & ~request.activate;
  for_each(others, [&](InstanceIndex i) {
    if (!instances_[i]->arms().overlaps(requested_arms)) next |= bit(i);
  });
  for_each(ArmSet::all(arm_count()) - arms_of(next), [&](ArmIndex arm) { next |= bit(hold_of(arm)); });
  return {.start = next & ~active, .stop = active & ~next, .keep = active & next};
}

// Whether an arm would be observed, directly or through others, by its own owner: arms that follow each other
// in a circle drift or oscillate without bound.
bool MultimodeController::observes_itself(InstanceSet instances) const {
  std::array<ArmSet, kMaxArms> sees{};
  for_each(instances, [&](InstanceIndex i) {
    for_each(instances_[i]->arms(), [&](ArmIndex arm) {
      for (const ArmIndex leader : instances_[i]->observed_list()) sees[arm] |= ArmSet::of(leader);
    });
  });
  for (std::size_t round = 0; round < arm_count(); ++round) {  // the longest path has an arm per round
    for (ArmIndex arm = 0; arm < arm_count(); ++arm) {
      for_each(sees[arm], [&](ArmIndex other) { sees[arm] |= sees[other]; });
      if (sees[arm].contains(arm)) return true;
    }
  }
  return false;
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
      const SwitchPlan next = plan(active(), request);
      if (observes_itself(next.start | next.keep)) return Verdict::observes_itself;
      // Holds may always run.
      const InstanceSet laws = request.activate & ~((InstanceSet{1} << arm_count()) - 1);
      return (arms_of(laws) | observed_by(laws)).overlaps(stopped()) ? Verdict::arm_stopped
                                                                     : Verdict::accepted;
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
  // A stop must leave the arm in place: until it is resumed, nothing may soften its hold or push it.
  if (request.instance < arm_count() && stopped().contains(request.instance)) return Verdict::arm_stopped;
  if (request.kind == Request::Kind::set_parameter) {
    if (request.index >= instance.parameter_count()) return Verdict::unknown_parameter;
    if (request.size > kMaxParameterSize) return Verdict::wrong_size;
    return instance.check_parameter(request.index, std::span(request.values).first(request.size));
  }
  if (request.kind == Request::Kind::set_feature) {
    return request.index < instance.feature_count() ? Verdict::accepted : Verdict::unknown_feature;
  }
  if (request.index >= instance.inputs().size()) return Verdict::unknown_input;
  const Reference& input = instance.inputs()[request.index];
  const Target& target = request.target;
  if (const Verdict verdict = input.check(target); verdict != Verdict::accepted) return verdict;
  if (request.until.set()) {
    const Quantity quantity = input.spec().quantity;
    const bool place = quantity == Quantity::pose || quantity == Quantity::joints;
    if (!place || target.delivery != Delivery::goal) return Verdict::out_of_bounds;
    for (const double limit : request.until.limits) {
      if (!(limit > 0)) return Verdict::out_of_bounds;
    }
  }
  if (target.delivery == Delivery::motion) return Verdict::accepted;
  return reach_.contains(instance, input.spec(), target.values, nullptr) ? Verdict::accepted
                                                                         : Verdict::out_of_bounds;
}

Verdict MultimodeController::check_sample(const Request& sample) const {
  const bool runs = sample.instance < instances_.size() && (active() & bit(sample.instance)) != 0;
  return runs ? check(sample) : Verdict::not_active;
}

Verdict MultimodeController::post_sample(const Request& sample) {
  const Verdict verdict = check_sample(sample);
  if (verdict != Verdict::accepted) return verdict;
  return instances_[sample.instance]->inputs()[sample.index].post(sample.target);
}

std::string MultimodeController::refusal(const Request& request) const {
  if (request.kind != Request::Kind::set_target || request.instance >= instances_.size()) return {};
  const Instance& instance = *instances_[request.instance];
  if (request.index >= instance.inputs().size()) return {};
  const Reference& input = instance.inputs()[request.index];
  std::string why = input.refusal(request.target);
  if (why.empty() && request.target.delivery != Delivery::motion)
    (void)reach_.contains(instance, input.spec(), request.target.values, &why);
  return why;
}

Verdict MultimodeController::post(std::span<const Request> requests, std::uint64_t& ticket, double patience_s,
                                  HostTime asked) {
  for (const Request& request : requests) {
    if (const Verdict verdict = check(request); verdict != Verdict::accepted) return verdict;
  }
  ticket = mailbox_->post(requests, patience_s, asked);
  return ticket != 0 ? Verdict::accepted : Verdict::queue_full;
}

Answer MultimodeController::ask(std::span<const Request> requests, double timeout_s, HostTime asked) {
  Answer answer;
  std::uint64_t ticket = 0;
  answer.received = host_now();
  answer.verdict = post(requests, ticket, timeout_s, asked);
  if (!answer.accepted()) return answer;
  const HostTime posted = answer.received;
  for (std::uint64_t part = ticket - requests.size() + 1; part <= ticket; ++part) {
    while (!mailbox_->poll(part, answer)) {
      const double waited = seconds(host_now() - posted);
      if (waited > timeout_s && mailbox_->withdraw(ticket)) {
        answer.verdict = Verdict::timeout;
        return answer;
      }
      if (waited > timeout_s + kAnswerPatience) {
        answer.verdict = Verdict::pending;
        return answer;
      }
      std::this_thread::sleep_for(std::chrono::microseconds(100));
    }
    if (!answer.accepted()) break;
  }
  return answer;
}

}  // namespace multipanda
