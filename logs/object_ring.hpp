#pragma once

#include <atomic>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "core/cycle/backend.hpp"
#include "core/rt/spsc_ring.hpp"
#include "core/types/tick.hpp"

namespace multipanda {

// Poses of the free objects of a simulated world, from the loop to the recorder.
class ObjectRing {
 public:
  struct Row {
    std::uint64_t cycle = 0;
    LoopTime t;
    std::vector<std::optional<Pose>> X_WO;  // in the order of names(); none: unknown
  };

  // `every`: cycles, above 0.
  ObjectRing(std::vector<std::string> names, std::uint64_t every, std::size_t capacity)
      : names_(std::move(names)),
        every_(every),
        ring_(capacity, Row{.X_WO = std::vector<std::optional<Pose>>(names_.size())}) {}

  const std::vector<std::string>& names() const { return names_; }

  // The loop's thread, between two steps. No allocation, no lock. A full ring counts as a lost row.
  void take(const Tick& tick, const Backend& backend) {
    if ((tick.cycle - 1) % every_ != 0) return;
    Row* row = ring_.back();
    if (row == nullptr) {
      lost_.fetch_add(1, std::memory_order_relaxed);
      return;
    }
    row->cycle = tick.cycle;
    row->t = tick.t;
    for (std::size_t i = 0; i < names_.size(); ++i) row->X_WO[i] = backend.object_pose(names_[i]);
    ring_.push();
  }

  // The recorder's thread: the oldest row of a cycle before `cycle`; nullptr: none.
  const Row* front(std::uint64_t cycle) {
    const Row* row = ring_.front();
    return row != nullptr && row->cycle < cycle ? row : nullptr;
  }
  void pop() { ring_.pop(); }
  std::uint64_t lost() const { return lost_.load(std::memory_order_relaxed); }

 private:
  std::vector<std::string> names_;
  std::uint64_t every_;
  SpscRing<Row> ring_;
  std::atomic<std::uint64_t> lost_{0};
};

}  // namespace multipanda
