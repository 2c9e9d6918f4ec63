#pragma once

#include <array>
#include <vector>

#include "backends/mujoco/plant.hpp"
#include "cockpit/run/object_poses.hpp"
#include "core/record/cycle_record.hpp"
#include "core/rt/triple_buffer.hpp"
#include "core/types/capacity.hpp"
#include "scene/scene.hpp"

namespace multipanda::cockpit {

// What the world of virtual arms hands to the cockpit: a record per period as a run's loop makes them, whose
// only controllet is `program`, the programs that are connected.
class WorldFeed {
 public:
  using Frames = std::array<ArmFrames, kMaxArms>;

  explicit WorldFeed(const Scene& scene);

  // The world's thread, after a period. No allocation, no lock. A full ring loses records.
  void take(const MujocoPlant& plant);

  // --- the cockpit's thread ---
  const RecordLayout& layout() const { return layout_; }
  RecordRing& ring() { return ring_; }
  ObjectPoses& objects() { return objects_; }
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
