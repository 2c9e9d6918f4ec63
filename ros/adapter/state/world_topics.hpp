#pragma once

#include <multipanda_msgs/msg/object_poses.hpp>
#include <optional>
#include <rosgraph_msgs/msg/clock.hpp>
#include <string>
#include <vector>

#include "core/rt/triple_buffer.hpp"
#include "ros/adapter/state/topic.hpp"

namespace multipanda::ros {

// /clock, where stamps are simulated time.
class ClockTopic : public Part {
 public:
  explicit ClockTopic(const AdapterWorld& world);
  void take(const CycleRecord& record) override;

 private:
  Topic<rosgraph_msgs::msg::Clock> clock_;
};

// simulation/object_poses: where the free objects of a simulated world are. The loop's thread looks, since
// nobody else may while the world moves.
class ObjectPosesTopic : public Part {
 public:
  explicit ObjectPosesTopic(const AdapterWorld& world);
  void on_loop(const Tick& tick, const Backend& backend) override;
  bool needs_loop() const override { return true; }
  void take(const CycleRecord& record) override;

 private:
  struct Seen {
    Seen() = default;
    explicit Seen(std::size_t objects) : X_WO(objects) {}
    Tick tick;
    std::vector<Pose> X_WO;
  };
  const AdapterWorld& world_;
  std::vector<std::string> names_;
  // Loop's thread
  Every every_;
  Seen seen_;
  // From there to the publisher's thread
  TripleBuffer<Seen> newest_;
  Publisher<multipanda_msgs::msg::ObjectPoses> publisher_;
  multipanda_msgs::msg::ObjectPoses message_;
};

}  // namespace multipanda::ros
