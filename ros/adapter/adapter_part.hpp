#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "core/record/cycle_record.hpp"
#include "core/types/tick.hpp"
#include "core/types/time.hpp"
#include "runtime/run_adapter.hpp"
#include "scene/scene.hpp"

namespace multipanda::ros {

// ROS options of a run: the scene's section `ros:`, overridden by the command line and the host.
struct RosOptions : RosSection {
  std::vector<std::string> arguments;  // for rcl, as after --ros-args: "-r", "joint_states:=arms" ...
  // False on a node with its own parameter services (ros2_control); then only ParameterTable is used.
  bool parameter_services = true;
  // Packages that provide the messages of `compat`.
  std::string compat_arm_messages = "franka_msgs", compat_mode_messages = "multi_mode_control_msgs";
  // Parts to create; a run that shares its node leaves some to others. `arms`: requests to the backend
  // (services, grippers). `motions`: actions executed by the arms' controllets.
  bool controllets = true, arms = true, motions = true, state = true;
};

class Context;
class Node;
class Executor;

// One line of /diagnostics.
struct Diagnostic {
  enum class Level : std::uint8_t { ok = 0, warn = 1, error = 2 };  // as diagnostic_msgs/DiagnosticStatus
  std::string name;                                                 // "pose0/pose"
  Level level = Level::ok;
  std::string message;
  std::vector<std::pair<std::string, std::string>> values;
};

// Time stamps of this run's messages [ns]: simulated time, or the wall clock.
struct Stamps {
  bool simulated = false;
  std::int64_t wall_minus_host_ns = 0;  // measured once, at the start

  std::int64_t of(const CycleRecord& record) const { return at(record.t, record.start); }
  std::int64_t at(LoopTime t, HostTime host) const { return simulated ? t.ns : host.ns + wall_minus_host_ns; }
};

// Counters that all parts share, for loop statistics.
struct AdapterCounters {
  std::atomic<std::uint64_t> samples_accepted{0}, samples_refused{0};  // messages to inputs
  std::atomic<std::uint64_t> requests{0}, requests_refused{0};         // services and actions
  // dropped before they reached the publisher's thread
  std::atomic<std::uint64_t> records_dropped{0};
};

// Context of every part of the adapter. References stay valid for the part's lifetime.
struct AdapterContext : RunContext {
  Context* context = nullptr;
  Node* node = nullptr;
  Executor* executor = nullptr;
  Executor* stops = nullptr;  // of services that only end motions, so that no other callback delays them
  const RosOptions* options = nullptr;
  Stamps stamps;
  AdapterCounters* counters = nullptr;
  // Diagnostics of all parts. Any thread, once all parts exist.
  std::function<std::vector<Diagnostic>()> diagnostics;
  // Warns the user, at most once a second per `topic`. Any thread but the loop's.
  std::function<void(const std::string& topic, const std::string& text)> warn;

  // Counts an answered service call or action goal. Any thread.
  void count_request(bool success) const {
    counters->requests.fetch_add(1, std::memory_order_relaxed);
    if (!success) counters->requests_refused.fetch_add(1, std::memory_order_relaxed);
  }
};

// The response with a backend's answer, which is counted. Our own services have the field `error`, standard
// ones `message`.
template <class Response>
Response response_of(const AdapterContext& run, const RequestAnswer& answer) {
  Response response;
  response.success = answer.success;
  if constexpr (requires { response.error; }) {
    response.error = answer.reason;
  } else {
    response.message = answer.reason;
  }
  run.count_request(answer.success);
  return response;
}

// A part of the adapter. Its constructor creates its ROS entities. Their callbacks run on the executor's
// thread, take() on the publisher's thread; a part protects data used by both. Neither thread ever waits for
// the loop.
class AdapterPart {
 public:
  virtual ~AdapterPart() = default;
  // Publisher's thread, in order. Receives every record that had room in the adapter's ring: few are missing,
  // none is repeated.
  virtual void take(const CycleRecord&) {}
  virtual void take(const Event&) {}
  // Loop's thread, between two steps, for data available only from the physics world. No allocation, no lock.
  // Called only if needs_loop() returns true; the adapter calls that once before the first step.
  virtual void on_loop(const Tick&, const Backend&) {}
  virtual bool needs_loop() const { return false; }
  virtual std::vector<Diagnostic> diagnostics() const { return {}; }  // any thread
};

using AdapterParts = std::vector<std::unique_ptr<AdapterPart>>;

// Makes the parts for each arm: services, gripper, motions.
AdapterParts make_arms(const AdapterContext& run);

// Makes the parts that publish arms and world: joint states, states, models, wrenches, tf, robot_description,
// /clock, statistics, events and diagnostics; and the services of a simulated run.
AdapterParts make_state(const AdapterContext& run);

class Inputs;

// Makes the parts that have names and types of another system (`ros: {compat: ...}`), none without that key.
// `inputs`: the part with the ports of all inputs; nullptr: the run has no controllets here. Throws
// std::invalid_argument if the messages are missing or do not match.
AdapterParts make_compat(const AdapterContext& run, const Inputs* inputs);

// Makes the parts that follow from controllet descriptors: inputs, references, outputs, parameters, and the
// services to list and switch controllets. `inputs`: the part that has the ports of all inputs.
AdapterParts make_controllets(const AdapterContext& run, const Inputs*& inputs);

// Names shared by several parts and their users. Scene names consist of letters, digits and _, so they are
// valid in topics and frames.

// "left_joint1" ...
inline std::vector<std::string> joint_names(const std::string& arm, std::size_t count) {
  std::vector<std::string> names;
  for (std::size_t i = 1; i <= count; ++i) names.push_back(arm + "_joint" + std::to_string(i));
  return names;
}

inline std::string base_frame(const std::string& arm) { return arm + "_link0"; }
inline constexpr const char* kWorldFrame = "world";

// "~/pose0/collision_avoidance/distance_m" of a feature's output "collision_avoidance.distance_m"
inline std::string topic_of(const std::string& instance, std::string quantity) {
  for (char& c : quantity) c = c == '.' ? '/' : c;
  return "~/" + instance + "/" + quantity;
}

}  // namespace multipanda::ros
