#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "backends/mujoco/plant.hpp"

namespace multipanda::fci {

// Exact values of the simulation, for observers in the same process. The loop of the virtual arms stores
// them for the last kKept periods; any thread can read them by the message_id of the arms' states.
// Neither side waits.
class VirtualWorldView {
 public:
  static constexpr std::size_t kKept = 256;

  struct Snapshot {
    std::uint64_t message_id = 0;
    std::vector<Wrench> F_K_W_true;  // per arm: of hand and tool on other bodies, about K, world axes
    std::vector<Pose> X_WO;          // per object, in the order of objects()
  };

  explicit VirtualWorldView(const MujocoPlant& plant);

  const std::vector<std::string>& objects() const { return objects_; }
  Snapshot make_snapshot() const;  // preallocated, so that read() does not allocate

  // The loop's thread, after each period. No allocation.
  void publish(std::uint64_t message_id, const MujocoPlant& plant);

  // Any thread. False: the period is not stored.
  bool read(std::uint64_t message_id, Snapshot& into) const;
  std::uint64_t newest() const { return newest_.load(std::memory_order_acquire); }

 private:
  // A sequence lock: odd while it is written. The numbers are atomic so that a concurrent read is not
  // undefined behavior; its result is discarded.
  struct Slot {
    std::atomic<std::uint64_t> sequence{0}, message_id{0};
    std::unique_ptr<std::atomic<double>[]> numbers;
  };
  std::size_t arms_ = 0;
  std::vector<std::string> objects_;
  std::array<Slot, kKept> slots_;
  std::atomic<std::uint64_t> newest_{0};
};

}  // namespace multipanda::fci
