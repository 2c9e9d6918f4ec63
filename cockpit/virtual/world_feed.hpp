#pragma once

#include <array>
#include <vector>

#include "backends/mujoco/plant.hpp"
#include "core/record/cycle_record.hpp"
#include "core/rt/triple_buffer.hpp"
#include "core/types/capacity.hpp"
#include "runtime/object_poses.hpp"
#include "scene/scene.hpp"

namespace multipanda::cockpit {

// Data from the world of virtual arms for the cockpit: a record per period, like those of a run's loop, with
// the single controllet `program`, which stands for the connected programs.
class WorldFeed {
 public:
  using Frames = std::array<ArmFrames, kMaxArms>;

  explicit WorldFeed(const Scene& scene);

  // The world's thread, after a period. No allocation, no lock. A full ring loses records.
  void take(const MujocoPlant& plant);

  // --- the cockpit's thread ---
  const RecordLayout& layout() const { return layout_; }
  RecordRing& ring() { return ring_; }
  const ObjectPoses& objects() const { return objects_; }
  const Frames& frames() {
    frames_.take();
    return frames_.value();
  }

 private:
  struct Arm {
    ArmMode mode = ArmMode::other;
    std::uint32_t config_version = 0;
  };
  void watch(ArmIndex arm, const ArmState& state, const CycleRecord& record);

  RecordLayout layout_;
  RecordRing ring_;
  ObjectPoses objects_;
  TripleBuffer<Frames> frames_;
  Frames next_{};
  std::vector<Arm> arms_;
  HostTime before_;
};

}  // namespace multipanda::cockpit
