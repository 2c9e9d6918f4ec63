#pragma once

#include <atomic>
#include <optional>
#include <string>
#include <vector>
#include <visualization_msgs/msg/marker_array.hpp>

#include "core/rt/triple_buffer.hpp"
#include "ros/adapter/state/arm_models.hpp"
#include "ros/adapter/topic.hpp"
#include "ros/rcl/publisher.hpp"

namespace multipanda::ros {

// Publishes ~/markers while a viewer subscribes: everything drawn besides the arms. Namespaces: `objects` of
// the scene, `targets` (set-points of active controllets), `contact_forces` (the simulator's),
// `estimated_forces`, `tanks`.
//
// Every message contains every marker, with the same namespace, id and frame: ADD, or DELETE if it does not
// apply now (a force below kLeastForce, a target of an inactive controllet, an object at an unknown pose). So
// a viewer that missed a message is correct after the next one.
class Markers : public AdapterPart {
 public:
  static constexpr double kMetersPerNewton = 0.005;  // of arrows
  static constexpr double kLeastForce = 1;           // smallest force that is drawn [N]
  static constexpr double kTankHeight = 0.2;         // height of the bar of a full tank [m]
  // Foot of the bar of a controllet's k-th tank, in the base of its first arm [m].
  static Vector3 tank_place(std::size_t k) { return {-0.25, 0.1 * static_cast<double>(k), 0}; }

  explicit Markers(const AdapterContext& run);
  void on_loop(const Tick& tick, const Backend& backend) override;
  bool needs_loop() const override { return !X_WO_.empty(); }
  void take(const Event& event) override { models_.take(event); }
  void take(const CycleRecord& record) override;

 private:
  using Marker = visualization_msgs::msg::Marker;
  using Poses = std::vector<std::optional<Pose>>;
  struct Part {  // a shape of an object
    std::size_t marker, object;
    Pose X_OM;
  };
  struct Target {
    std::size_t marker;
    Quantity quantity;
    ArmIndex arm;
  };
  struct Tank {
    std::size_t bar, text, output;  // two markers; an index of CycleRecord::outputs
    std::string name;
    const Instance* instance;
    std::size_t greatest;  // the instance's parameter with the largest energy
    Pose X_WT;             // foot of the bar
  };

  std::size_t add(const std::string& ns, std::int32_t type, const Vector3& scale,
                  const std::array<double, 4>& rgba, const std::string& frame);
  void add_object(const SceneObject& object, std::size_t index);
  void add_targets(const Instance& instance);
  void add_tanks(const Instance& instance, const RecordLayout::Instance& layout);
  Marker& show(std::size_t marker, const Pose& X);
  void show_arrow(std::size_t marker, const Vector3& from, const double* force);
  void show_target(const Target& target, const ReferenceSample& sample);
  void show_forces(const CycleRecord& record);
  void show_tank(const Tank& tank, double energy);

  const AdapterContext& run_;
  ArmModels models_;
  std::vector<ModelTerms> at_targets_;  // models at joint set-points, one per arm
  visualization_msgs::msg::MarkerArray message_;
  RateDivider turn_;
  Publisher<visualization_msgs::msg::MarkerArray> publisher_;
  std::vector<Part> parts_;
  std::vector<std::vector<std::optional<Target>>> targets_;  // by instance and input
  std::vector<std::size_t> contact_, estimated_;             // markers, one per arm
  std::vector<Tank> tanks_;
  std::atomic<bool> watched_{false};  // there is a subscriber
  // Loop's thread.
  RateDivider every_;
  Poses X_WO_;  // of all objects
  // From the loop's thread to the publisher's thread.
  TripleBuffer<Poses> newest_;
};

}  // namespace multipanda::ros
