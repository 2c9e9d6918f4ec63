#pragma once

#include <atomic>
#include <cstddef>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "ros/adapter/part.hpp"
#include "ros/rcl/rcl.hpp"
#include "runtime/run_adapter.hpp"

namespace multipanda::ros {

class RecordRelay;

// A run on ROS 2: all of its interfaces, made from what the scene and its controllets state. Stand-alone it
// has its own context, node and executor; as part of somebody else's node (ros2_control) it borrows that.
//
// Threads: the relay's (take: copies into a ring, never waits), the publisher's (the parts' take), the
// executor's (callbacks). The loop's thread only comes to on_loop, for parts that must see the world itself.
class RosAdapter : public RunAdapter {
 public:
  // Throws RclError or std::invalid_argument; then nothing of it is left.
  RosAdapter(const RunWorld& world, RosOptions options);
  // On a node that lives already and outlives the adapter. Its services are answered by the adapter's own
  // executor, beside whatever spins the node.
  RosAdapter(const RunWorld& world, RosOptions options, rcl_node_t* borrowed);
  ~RosAdapter() override;

  void take(const CycleRecord& record) override;
  void take(const Event& event) override;
  void on_loop(const Tick& tick, const Backend& backend) override;

  const Node& node() const { return *node_; }  // its entities() are the documentation
  const AdapterWorld& world() const { return *world_; }
  std::vector<Diagnostic> diagnostics() const;

 private:
  void build(const RunWorld& world);
  void make_parts();
  void warn(const std::string& topic, const std::string& text);

  RosOptions options_;
  std::unique_ptr<Context> context_;  // none: borrowed
  std::unique_ptr<Node> node_;
  std::unique_ptr<Executor> executor_;
  AdapterCounters counters_;
  std::unique_ptr<AdapterWorld> world_;  // of all parts
  Parts parts_;
  std::vector<Part*> in_loop_;          // of them: those that need the loop's thread
  std::unique_ptr<RecordRelay> relay_;  // ends before the parts

  mutable std::mutex warn_mutex_;
  std::map<std::string, HostTime> warned_;
  std::string last_failure_;  // of a callback
};

}  // namespace multipanda::ros
