#include "fci/server/world_view.hpp"

namespace multipanda::fci {
namespace {

constexpr std::size_t kPerWrench = 6, kPerPose = 12;
constexpr std::uint64_t kLowHalf = 0xffffffff;

}  // namespace

VirtualWorldView::VirtualWorldView(const MujocoPlant& plant)
    : arms_(plant.arm_count()), sent_(plant.arm_count()) {
  for (const auto& object : plant.world().objects()) objects_.push_back(object.name);
  for (Slot& slot : slots_) {
    slot.numbers = std::make_unique<std::atomic<double>[]>(kPerWrench * arms_ + kPerPose * objects_.size());
  }
}

VirtualWorldView::Snapshot VirtualWorldView::make_snapshot() const {
  Snapshot snapshot;
  snapshot.F_K_W_true.resize(arms_);
  snapshot.X_WO.resize(objects_.size());
  return snapshot;
}

void VirtualWorldView::publish(std::uint64_t period, const MujocoPlant& plant) {
  Slot& slot = slots_[period % kKept];
  const auto sequence = slot.sequence.load(std::memory_order_relaxed);
  slot.sequence.store(sequence + 1, std::memory_order_relaxed);
  std::atomic_thread_fence(std::memory_order_release);
  slot.period.store(period, std::memory_order_relaxed);
  std::size_t at = 0;
  const auto put = [&](double value) { slot.numbers[at++].store(value, std::memory_order_relaxed); };
  for (ArmIndex i = 0; i < arms_; ++i) {
    for (const double value : plant.arm(i).state().F_K_W_true.vector) put(value);
  }
  for (std::size_t i = 0; i < objects_.size(); ++i) {
    const Pose X_WO = plant.world().X_WO(i);
    for (const double value : X_WO.rotation.reshaped()) put(value);
    for (const double value : X_WO.position) put(value);
  }
  slot.sequence.store(sequence + 2, std::memory_order_release);
  newest_.store(period, std::memory_order_release);
}

void VirtualWorldView::note_sent(ArmIndex arm, std::uint64_t message_id) {
  const std::uint64_t period = newest_.load(std::memory_order_relaxed);
  sent_[arm][message_id % kKept].store(message_id << 32 | (period & kLowHalf), std::memory_order_release);
}

std::optional<std::uint64_t> VirtualWorldView::period_of(ArmIndex arm, std::uint64_t message_id) const {
  const std::uint64_t sent = sent_.at(arm)[message_id % kKept].load(std::memory_order_acquire);
  const std::uint64_t newest = newest_.load(std::memory_order_acquire);
  if (sent >> 32 != (message_id & kLowHalf)) return std::nullopt;
  return newest - ((newest - sent) & kLowHalf);  // the period is not newer than the newest
}

bool VirtualWorldView::read(std::uint64_t period, Snapshot& into) const {
  const Slot& slot = slots_[period % kKept];
  into.F_K_W_true.resize(arms_);
  into.X_WO.resize(objects_.size());
  const auto before = slot.sequence.load(std::memory_order_acquire);
  if (before % 2 != 0 || slot.period.load(std::memory_order_relaxed) != period) return false;
  into.period = period;
  std::size_t at = 0;
  const auto get = [&] { return slot.numbers[at++].load(std::memory_order_relaxed); };
  for (Wrench& wrench : into.F_K_W_true) {
    for (double& value : wrench.vector) value = get();
  }
  for (Pose& X_WO : into.X_WO) {
    for (double& value : X_WO.rotation.reshaped()) value = get();
    for (double& value : X_WO.position) value = get();
  }
  std::atomic_thread_fence(std::memory_order_acquire);
  return slot.sequence.load(std::memory_order_relaxed) == before;
}

}  // namespace multipanda::fci
