#pragma once

#include <multipanda_msgs/msg/object_poses.hpp>
#include <multipanda_msgs/srv/place_objects.hpp>
#include <multipanda_msgs/srv/step_simulation.hpp>
#include <optional>
#include <rosgraph_msgs/msg/clock.hpp>
#include <std_srvs/srv/set_bool.hpp>
#include <std_srvs/srv/trigger.hpp>
#include <string>
#include <vector>

#include "core/rt/triple_buffer.hpp"
#include "ros/adapter/adapter_part.hpp"
#include "ros/adapter/topic.hpp"
#include "ros/rcl/rcl.hpp"

namespace multipanda::ros {

// simulation/{reset, pause, step, place_objects}, for the world of the simulated arms.
class SimulationServices : public AdapterPart {
 public:
  explicit SimulationServices(const AdapterContext& run);

 private:
  using Step = multipanda_msgs::srv::StepSimulation;
  using Answered = std::function<void(const std::vector<RequestAnswer>&)>;
  // Sends all requests in one cycle and calls `answered` on the executor's thread when all are answered, at
  // the latest after `timeout_s`.
  void send(std::vector<WorldRequest> requests, double timeout_s, Answered answered);
  // Sends one request, and replies with its answer.
  template <class S>
  void forward(WorldRequest request, double timeout_s, const typename Service<S>::Reply& reply);
  void place(const multipanda_msgs::srv::PlaceObjects::Request& request,
             const Service<multipanda_msgs::srv::PlaceObjects>::Reply& reply);

  const AdapterContext& run_;
  Service<std_srvs::srv::Trigger> reset_;
  Service<std_srvs::srv::SetBool> pause_;
  Service<Step> step_;
  Service<multipanda_msgs::srv::PlaceObjects> place_;
};

// Returns the requested poses of objects. Throws std::invalid_argument for wrong sizes, frames or numbers.
std::vector<PlaceObject> placements(const multipanda_msgs::srv::PlaceObjects::Request& request,
                                    const std::vector<std::pair<std::string, Pose>>& bases);

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
