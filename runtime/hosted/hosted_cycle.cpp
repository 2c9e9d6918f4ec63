#include "runtime/hosted/hosted_cycle.hpp"

#include <algorithm>
#include <chrono>
#include <stdexcept>

#include "scene/build.hpp"

namespace multipanda {

HostedCycle::HostedCycle(Scene scene, const Registry& registry, HostedOptions options)
    : scene_(std::move(scene)), options_(std::move(options)) {
  if (options_.arms.size() != scene_.arms.size()) {
    throw std::invalid_argument("one description of each arm's interfaces is expected");
  }
  CycleConfig config = build_cycle_config(scene_, options_.ring_cycles);
  std::vector<InterfaceBackend::Arm> arms;
  for (ArmIndex i = 0; i < scene_.arms.size(); ++i) {
    models_.push_back(config.arms[i].model);
    config.arms[i].safety.period_s = options_.period_s;
    arms.push_back({.host = options_.arms[i],
                    .model = config.arms[i].model,
                    .config = arm_config(scene_.arms[i]),
                    .safety = config.arms[i].safety});
  }
  backend_ = std::make_unique<InterfaceBackend>(std::move(arms), options_.period_s);
  cycle_ = std::make_unique<ControlCycle>(config, registry, *backend_);
  modes().schedule(build_schedule(scene_, modes()));
  start_set_ = start_set(scene_, modes());
  modes().activate_at_start(start_set_);  // in the first step; arms that are not ready then: as later
  if (options_.make_adapter) {
    adapter_ = options_.make_adapter({.scene = &scene_,
                                      .modes = &modes(),
                                      .backend = backend_.get(),
                                      .layout = &cycle_->layout(),
                                      .models = models_});
  }
  relay_ = std::thread([this] { run_relay(); });
}

HostedCycle::~HostedCycle() {
  ending_.store(true, std::memory_order_release);
  relay_.join();
}

std::vector<std::string> HostedCycle::joint_names(ArmIndex arm) const {
  if (!options_.arms[arm].joints.empty()) return options_.arms[arm].joints;
  std::vector<std::string> names;
  for (std::size_t i = 0; i < joint_count(arm); ++i) {
    names.push_back(scene_.arms[arm].name + "_joint" + std::to_string(i + 1));
  }
  return names;
}

void HostedCycle::activate() noexcept {
  backend_->begin();
  taking_.fill(0);
  settled_.store(0, std::memory_order_relaxed);
  lost_.store(0, std::memory_order_relaxed);
  took_ = 0;
  activations_.fetch_add(1, std::memory_order_release);
  active_.store(true, std::memory_order_release);
}

bool HostedCycle::step(double period_s) noexcept {
  cycle_->step(backend_->advance(period_s));
  const auto& states = cycle_->data().state;
  bool any = false;
  std::uint32_t settled = 0, lost = lost_.load(std::memory_order_relaxed);
  for (ArmIndex i = 0; i < states.size(); ++i) {
    const ArmMode mode = states[i].mode;
    const bool takes = mode == ArmMode::move || mode == ArmMode::idle;
    taking_[i] = takes ? std::min(taking_[i] + 1, kSettled) : 0;
    if (taking_[i] == kSettled) settled |= ArmSet::of(i).bits();
    if (takes) took_ |= ArmSet::of(i).bits();
    if (!takes) lost |= took_ & ArmSet::of(i).bits();
    any = any || takes || mode == ArmMode::recovering;
  }
  lost_.store(lost, std::memory_order_relaxed);
  settled_.store(settled, std::memory_order_release);
  return any;
}

void HostedCycle::deactivate() noexcept {
  backend_->leave();
  active_.store(false, std::memory_order_release);
}

// ------------------------------------------------------------------------------------------------- relay

void HostedCycle::run_relay() {
  while (true) {
    const bool last = ending_.load(std::memory_order_acquire);
    const bool busy = relay();
    start_controllets();
    if (last && !busy) return;
    if (busy) continue;
    if (!active_.load(std::memory_order_acquire)) {
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
      continue;
    }
    // As in a session: asleep up to the time of the next record, then often.
    constexpr auto kLook = std::chrono::microseconds(100);
    const auto expected =
        last_record_ + std::chrono::nanoseconds(static_cast<std::int64_t>(options_.period_s * 0.95e9));
    const auto now = host_now();
    std::this_thread::sleep_for(expected > now ? std::max<std::chrono::nanoseconds>(expected - now, kLook)
                                               : kLook);
  }
}

// After an activation: the controllets that the scene wants, each once its arms are there.
void HostedCycle::start_controllets() {
  const std::uint64_t activations = activations_.load(std::memory_order_acquire);
  if (activations != seen_) {
    seen_ = activations;
    wanted_ = start_set_;
    wanted_since_ = host_now();
  }
  if (wanted_ == 0) return;
  if (!is_active() || seconds(host_now() - wanted_since_) > kPatience) {
    wanted_ = 0;
    return;
  }
  const ArmSet settled = ArmSet::from_bits(settled_.load(std::memory_order_acquire));
  const ArmSet lost = ArmSet::from_bits(lost_.load(std::memory_order_relaxed));
  for (InstanceIndex i = 0; i < modes().instance_count(); ++i) {
    if (modes().instance(i).arms().overlaps(lost)) wanted_ &= ~bit(i);  // after a fault somebody has to ask
    if ((wanted_ & bit(i)) == 0 || !settled.contains(modes().instance(i).arms())) continue;
    if ((modes().active() & bit(i)) != 0) {  // since the first step
      wanted_ &= ~bit(i);
      continue;
    }
    const Request request{.activate = bit(i)};
    std::uint64_t ticket = 0;
    (void)modes().post(std::span(&request, 1), ticket);  // refused: the arms stay held, an event says so
    wanted_ &= ~bit(i);
  }
}

bool HostedCycle::relay() {
  RecordRing& ring = *cycle_->record();
  bool busy = false;
  while (const Event* event = ring.events.front()) {
    busy = true;
    if (adapter_) adapter_->take(*event);
    ring.events.pop();
  }
  for (int n = 0; n < 256; ++n) {
    const CycleRecord* record = ring.ring.front();
    if (record == nullptr) break;
    busy = true;
    if (adapter_) adapter_->take(*record);
    last_record_ = record->start;
    ring.ring.pop();
  }
  return busy;
}

}  // namespace multipanda
