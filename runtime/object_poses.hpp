#pragma once

#include <array>
#include <atomic>
#include <deque>
#include <optional>
#include <string>
#include <utility>

#include "core/types/spatial.hpp"
#include "scene/scene.hpp"

namespace multipanda {

// The newest poses of a simulated world's free objects, from the world's thread to any other.
class ObjectPoses {
 public:
  explicit ObjectPoses(const Scene& scene) {
    for (const auto& object : scene.objects) slots_.emplace_back(object.name, object.fixed);
  }

  std::size_t count() const { return slots_.size(); }  // of all objects, in the scene's order
  const std::string& name(std::size_t object) const { return slots_[object].name; }

  // The world's thread, after a step. Never waits. `pose_of(name)`: the pose in the world, or nothing: then
  // the object keeps its last one.
  void take(const auto& pose_of) {
    for (Slot& slot : slots_) {
      if (slot.fixed) continue;
      const std::optional<Pose> X_WO = pose_of(slot.name);
      if (!X_WO) continue;
      const auto values = X_WO->values();
      const std::uint64_t writes = slot.writes.load(std::memory_order_relaxed);
      slot.writes.store(writes + 1, std::memory_order_relaxed);  // odd: being written
      std::atomic_thread_fence(std::memory_order_release);
      for (std::size_t k = 0; k < values.size(); ++k)
        slot.values[k].store(values[k], std::memory_order_relaxed);
      slot.writes.store(writes + 2, std::memory_order_release);
    }
  }

  // Any other thread: nothing for a fixed object, and before the first pose. Reads again while it is written.
  std::optional<Pose> read(std::size_t object) const {
    const Slot& slot = slots_[object];
    std::array<double, 7> v{};
    for (;;) {
      const std::uint64_t before = slot.writes.load(std::memory_order_acquire);
      for (std::size_t k = 0; k < v.size(); ++k) v[k] = slot.values[k].load(std::memory_order_relaxed);
      std::atomic_thread_fence(std::memory_order_acquire);
      if (before % 2 != 0 || slot.writes.load(std::memory_order_relaxed) != before) continue;
      if (before == 0) return {};
      return Pose::from(v.data());
    }
  }

 private:
  struct Slot {
    Slot(std::string name_, bool fixed_) : name(std::move(name_)), fixed(fixed_) {}
    std::string name;
    bool fixed;
    std::atomic<std::uint64_t> writes{0};
    std::array<std::atomic<double>, 7> values{};  // x y z [m], quaternion w x y z
  };
  std::deque<Slot> slots_;
};

}  // namespace multipanda
