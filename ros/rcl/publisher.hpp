#pragma once

#include <atomic>
#include <mutex>
#include <rcl/publisher.h>
#include <rosidl_runtime_cpp/traits.hpp>
#include <rosidl_typesupport_cpp/message_type_support.hpp>
#include <string>

#include "ros/rcl/node.hpp"
#include "ros/rcl/qos.hpp"

namespace multipanda::ros {

class PublisherBase {
 public:
  // Resolved name, with remappings.
  std::string topic() const;
  std::size_t subscribers() const;
  // Number of messages that the middleware rejected.
  std::uint64_t failures() const { return failures_.load(std::memory_order_relaxed); }

 protected:
  PublisherBase(Node& node, const std::string& name, const rosidl_message_type_support_t* type,
                const std::string& type_name, const Qos& qos, const Doc& doc);
  ~PublisherBase();
  PublisherBase(const PublisherBase&) = delete;
  void publish_any(const void* message);

 private:
  Node& node_;
  rcl_publisher_t publisher_;
  std::mutex mutex_;
  std::atomic<std::uint64_t> failures_{0};
};

// publish(): any thread; does not wait for readers and does not throw; failures are counted. Serializes and
// copies the message (some 10 us for a small one), so never call it from the loop.
template <class M>
class Publisher : public PublisherBase {
 public:
  Publisher(Node& node, const std::string& name, const Qos& qos, const Doc& doc)
      : PublisherBase(node, name, rosidl_typesupport_cpp::get_message_type_support_handle<M>(),
                      rosidl_generator_traits::name<M>(), qos, doc) {}
  void publish(const M& message) { publish_any(&message); }
};

}  // namespace multipanda::ros
