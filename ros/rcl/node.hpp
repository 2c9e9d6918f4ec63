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

// About one entity, for the generated list of interfaces. Nothing said: not listed.
struct Doc {
  std::string rate;  // "100 Hz", "on change", "on request", ...
  std::string text;  // what it is for, units and frames
};

struct EntityInfo {
  std::string kind;  // publisher, subscription, service, client, action
  std::string name;  // resolved: "/multipanda/left/robot_state"
  std::string type;  // "multipanda_msgs/msg/RobotState"
  std::string qos;   // of topics
  std::string rate, doc;
};

// A node: the names under which entities are found. Outlives them. Any thread.
class Node {
 public:
  // Throws RclError, also for a name that ROS does not take.
  Node(Context& context, const std::string& name, const std::string& name_space = "");
  // A node of somebody else (rclcpp), who keeps it alive: entities are made in it, nothing else is done to
  // it.
  explicit Node(rcl_node_t* borrowed);
  ~Node();
  Node(const Node&) = delete;

  rcl_node_t* handle() const { return node_; }
  std::string name() const;
  std::string name_space() const;
  std::string full_name() const;  // "/multipanda"
  // The name with namespace, "~" and remappings (--ros-args -r) applied, as others see it. Throws RclError
  // for names that ROS does not take.
  std::string resolve(const std::string& name, bool service = false) const;

  // What was made in this node so far, in order (with a text in its Doc).
  std::vector<EntityInfo> entities() const;
  void describe(EntityInfo info);

  // Messages that the publishers of this node handed to the middleware, and that it did not take.
  std::uint64_t published() const { return published_.load(std::memory_order_relaxed); }
  std::uint64_t publish_failures() const { return publish_failures_.load(std::memory_order_relaxed); }
  void count_message(bool taken) {
    (taken ? published_ : publish_failures_).fetch_add(1, std::memory_order_relaxed);
  }

  // Nodes that others run, and how many offer a topic: for tests of the graph.
  std::vector<std::string> other_nodes() const;
  std::size_t publishers_of(const std::string& topic) const;
  std::size_t subscribers_of(const std::string& topic) const;

 private:
  rcl_node_t own_;
  rcl_node_t* node_;
  mutable std::mutex mutex_;
  std::vector<EntityInfo> entities_;
  std::atomic<std::uint64_t> published_{0}, publish_failures_{0};
};

}  // namespace multipanda::ros
