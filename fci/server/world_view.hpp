#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "backends/mujoco/plant.hpp"

namespace multipanda::fci {

// Exact values of the simulation, for observers in the same process. The loop of the virtual arms stores
// them for the last kKept periods; any thread can read them by the period in which an arm measured the state
// that it sent. Arms with clocks of their own number their states differently from the world and from each
// other. Neither side waits.
class VirtualWorldView {
 public:
  static constexpr std::size_t kKept = 256;

  struct Snapshot {
    std::uint64_t period = 0;        // of the world, counted from 1; 0: nothing was read yet
    std::vector<Wrench> F_K_W_true;  // per arm: of hand and tool on other bodies, about K, world axes
    std::vector<Pose> X_WO;          // per object, in the order of objects()
  };

  explicit VirtualWorldView(const MujocoPlant& plant);

  const std::vector<std::string>& objects() const { return objects_; }
  Snapshot make_snapshot() const;  // preallocated, so that read() does not allocate

  // The loop's thread, after each period. No allocation.
  void publish(std::uint64_t period, const MujocoPlant& plant);
  // The loop's thread, before an arm sends a state: its measurement in the newest period.
  void note_sent(ArmIndex arm, std::uint64_t message_id);

  // Any thread. False: the period is not stored.
  bool read(std::uint64_t period, Snapshot& into) const;
  // Any thread. The period of that state's measurement; none: not among the last kKept ones.
  std::optional<std::uint64_t> period_of(ArmIndex arm, std::uint64_t message_id) const;
  std::uint64_t newest() const { return newest_.load(std::memory_order_acquire); }

 private:
  // A sequence lock: odd while it is written. The numbers are atomic so that a concurrent read is not
  // undefined behavior; its result is discarded.
  struct Slot {
    std::atomic<std::uint64_t> sequence{0}, period{0};
    std::unique_ptr<std::atomic<double>[]> numbers;
  };
  std::size_t arms_ = 0;
  std::vector<std::string> objects_;
  std::array<Slot, kKept> slots_;
  // Per arm and state: the low halves of message_id and period in one word, so that both are read at once.
  std::vector<std::array<std::atomic<std::uint64_t>, kKept>> sent_;
  std::atomic<std::uint64_t> newest_{0};
};

}  // namespace multipanda::fci
