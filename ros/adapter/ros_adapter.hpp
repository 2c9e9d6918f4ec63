#pragma once

#include <atomic>
#include <cstddef>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "ros/adapter/adapter_part.hpp"
#include "ros/rcl/rcl.hpp"
#include "runtime/run_adapter.hpp"

namespace multipanda::ros {

class RecordRelay;

// A run on ROS 2: all its interfaces, made from the scene and the controllet descriptors. Stand-alone it has
// a context, node and executor of its own; inside ros2_control it uses the controller's node.
//
// Threads: the relay's (take: copies into a ring, never waits), the publisher's (the parts' take) and the
// executor's (callbacks). The loop's thread only calls on_loop, for parts that need the physics world itself.
class RosAdapter : public RunAdapter {
 public:
  // Throws RclError or std::invalid_argument.
  RosAdapter(const RunContext& run, RosOptions options);
  // Uses an existing node, which must outlive the adapter. The adapter's own executor serves it, in addition
  // to any executor that spins the node.
  RosAdapter(const RunContext& run, RosOptions options, rcl_node_t* borrowed);
  ~RosAdapter() override;

  void take(const CycleRecord& record) override;
  void take(const Event& event) override;
  void on_loop(const Tick& tick, const Backend& backend) override;

  const Node& node() const { return *node_; }  // its entities() make up the reference page
  const AdapterContext& run() const { return *run_; }
  std::vector<Diagnostic> diagnostics() const;

 private:
  void build(const RunContext& run);
  void make_parts();
  void warn(const std::string& topic, const std::string& text);

  RosOptions options_;
  std::unique_ptr<Context> context_;  // null if the node is borrowed
  std::unique_ptr<Node> node_;
  std::unique_ptr<Executor> executor_, stops_;
  AdapterCounters counters_;
  std::unique_ptr<AdapterContext> run_;  // shared by all parts
  AdapterParts parts_;
  std::vector<AdapterPart*> in_loop_;   // the parts that need the loop's thread
  std::unique_ptr<RecordRelay> relay_;  // destroyed before the parts

  mutable std::mutex warn_mutex_;
  std::map<std::string, HostTime> warned_;
  std::string last_failure_;  // of a callback
};

}  // namespace multipanda::ros
