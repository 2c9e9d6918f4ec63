#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "backends/mujoco/plant.hpp"

namespace multipanda::fci {

// What only a simulator knows, for observers in the same process: the loop of the virtual arms leaves the
// truth of every period, any thread may look it up by the message_id that the arms' states carried. The last
// kKept periods are there. Neither side ever waits.
class VirtualWorldView {
 public:
  static constexpr std::size_t kKept = 256;

  struct Snapshot {
    std::uint64_t message_id = 0;
    std::vector<Wrench> F_K_W_true;  // per arm: its hand and tool on everything else, about K, world axes
    std::vector<Pose> X_WO;          // per object, in the order of objects()
  };

  explicit VirtualWorldView(const MujocoPlant& plant);

  const std::vector<std::string>& objects() const { return objects_; }
  Snapshot make_snapshot() const;  // with room for one: read() then does not allocate

  // The loop's thread, after each period. No allocation.
  void publish(std::uint64_t message_id, const MujocoPlant& plant);

  // Any thread. False: that period is not there (any more).
  bool read(std::uint64_t message_id, Snapshot& into) const;
  std::uint64_t newest() const { return newest_.load(std::memory_order_acquire); }

 private:
  // A sequence lock: odd while it is written. The numbers are atomic so that a reader that loses the race
  // reads nonsense, which it then throws away, and not undefined behaviour.
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
