#pragma once

#include <atomic>
#include <cstdint>
#include <memory>
#include <mutex>
#include <rcl/node.h>
#include <string>
#include <vector>

#include "ros/rcl/context.hpp"

namespace multipanda::ros {

// Documentation of one entity, for the generated list of interfaces. Without a text it is not listed.
struct Doc {
  std::string rate;  // "100 Hz", "on change", "on request", ...
  std::string text;  // purpose, units and frames
};

struct EntityInfo {
  std::string kind;  // publisher, subscription, service, client, action
  std::string name;  // resolved: "/multipanda/left/robot_state"
  std::string type;  // "multipanda_msgs/msg/RobotState"
  std::string qos;   // of topics
  std::string rate, doc;
};

// A node, which resolves the names of its entities and outlives them. Any thread.
class Node {
 public:
  // Throws RclError, also for names that ROS does not accept.
  Node(Context& context, const std::string& name, const std::string& name_space = "");
  // Borrows a node, for example of rclcpp, that outlives this object. Only creates entities in it.
  explicit Node(rcl_node_t* borrowed);
  ~Node();
  Node(const Node&) = delete;

  rcl_node_t* handle() const { return node_; }
  std::string name() const;
  std::string name_space() const;
  std::string full_name() const;  // "/multipanda"
  // Returns the name with namespace, "~" and remappings (--ros-args -r) applied, as other nodes see it.
  // Throws RclError for names that ROS does not accept.
  std::string resolve(const std::string& name, bool service = false) const;

  // Returns the entities made in this node so far, in order (those with a text in their Doc).
  std::vector<EntityInfo> entities() const;
  void describe(EntityInfo info);

  // Messages that this node's publishers passed to the middleware, and those that it rejected.
  std::uint64_t published() const { return published_.load(std::memory_order_relaxed); }
  std::uint64_t publish_failures() const { return publish_failures_.load(std::memory_order_relaxed); }
  void count_message(bool taken) {
    (taken ? published_ : publish_failures_).fetch_add(1, std::memory_order_relaxed);
  }

  // Other nodes, and the number of publishers of a topic: for tests of the graph.
  std::vector<std::string> other_nodes() const;
  std::size_t publishers_of(const std::string& topic) const;

 private:
  rcl_node_t own_;
  rcl_node_t* node_;
  mutable std::mutex mutex_;
  std::vector<EntityInfo> entities_;
  std::atomic<std::uint64_t> published_{0}, publish_failures_{0};
};

}  // namespace multipanda::ros
