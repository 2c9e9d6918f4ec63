#pragma once

#include <atomic>
#include <functional>
#include <mutex>
#include <rcl/publisher.h>
#include <rcl/subscription.h>
#include <rosidl_runtime_cpp/traits.hpp>
#include <rosidl_typesupport_cpp/message_type_support.hpp>
#include <string>
#include <utility>

#include "ros/rcl/context.hpp"
#include "ros/rcl/executor.hpp"
#include "ros/rcl/node.hpp"

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

class SubscriptionBase : public Incoming {
 public:
  std::string topic() const;
  std::size_t publishers() const;

 protected:
  SubscriptionBase(Executor& executor, Node& node, const std::string& name,
                   const rosidl_message_type_support_t* type, const std::string& type_name, const Qos& qos,
                   const Doc& doc);
  ~SubscriptionBase() override;
  void open();   // call at the end of the most derived constructor
  void close();  // call at the start of the most derived destructor
  // Returns false if there was no message, or it could not be read (which is counted).
  bool take_any(void* message);
  // Waiting time of the last message taken [s]; 0 if the middleware does not report its arrival.
  double waited_s() const { return waited_s_; }
  std::string source() const override { return topic(); }

 private:
  Node& node_;
  rcl_subscription_t subscription_;
  double waited_s_ = 0;
};

// The callback gets every available message (up to the depth) on the executor's thread, and none after
// destruction. It must not throw for an invalid message, since there is no caller to answer.
template <class M>
class Subscription : public SubscriptionBase {
 public:
  Subscription(Executor& executor, Node& node, const std::string& name, const Qos& qos, const Doc& doc,
               std::function<void(const M&)> callback)
      : SubscriptionBase(executor, node, name, rosidl_typesupport_cpp::get_message_type_support_handle<M>(),
                         rosidl_generator_traits::name<M>(), qos, doc),
        callback_(std::move(callback)) {
    open();
  }
  ~Subscription() override { close(); }

 private:
  bool take() override {
    if (!take_any(&message_)) return false;
    callback_(message_);
    return true;
  }

  std::function<void(const M&)> callback_;
  M message_;  // reused, so that its sequences keep their memory
};

}  // namespace multipanda::ros
