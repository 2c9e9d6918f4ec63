#pragma once

#include <multipanda_msgs/msg/object_poses.hpp>
#include <optional>
#include <rosgraph_msgs/msg/clock.hpp>
#include <string>
#include <vector>

#include "core/rt/triple_buffer.hpp"
#include "ros/adapter/state/topic.hpp"

namespace multipanda::ros {

// Publishes /clock if stamps are simulated time.
class ClockTopic : public AdapterPart {
 public:
  explicit ClockTopic(const AdapterContext& run);
  void take(const CycleRecord& record) override;

 private:
  Topic<rosgraph_msgs::msg::Clock> clock_;
};

// Publishes simulation/object_poses, the poses of free objects of a simulated world. The loop's thread reads
// them: no other thread may while the world moves.
class ObjectPosesTopic : public AdapterPart {
 public:
  explicit ObjectPosesTopic(const AdapterContext& run);
  void on_loop(const Tick& tick, const Backend& backend) override;
  bool needs_loop() const override { return true; }
  void take(const CycleRecord& record) override;

 private:
  struct Snapshot {
    Snapshot() = default;
    explicit Snapshot(std::size_t objects) : X_WO(objects) {}
    Tick tick;
    std::vector<Pose> X_WO;
  };
  const AdapterContext& run_;
  std::vector<std::string> names_;
  // Loop's thread.
  RateDivider every_;
  Snapshot snapshot_;
  // From the loop's thread to the publisher's thread.
  TripleBuffer<Snapshot> newest_;
  Publisher<multipanda_msgs::msg::ObjectPoses> publisher_;
  multipanda_msgs::msg::ObjectPoses message_;
};

}  // namespace multipanda::ros
