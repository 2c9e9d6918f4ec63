#pragma once

#include <atomic>
#include <functional>
#include <memory>
#include <mutex>
#include <rcl/publisher.h>
#include <rcl/subscription.h>
#include <rosidl_runtime_cpp/traits.hpp>
#include <rosidl_typesupport_cpp/message_type_support.hpp>
#include <string>
#include <type_traits>
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

// A subscription to a type known at run time; `message` is of that type, and is filled again and again, so
// that its sequences keep their memory. The callback gets every available message (up to the depth), and the
// time that it waited, on the executor's thread, and none after destruction. It must not throw for an invalid
// message, since there is no caller to answer.
class AnySubscription : public SubscriptionBase {
 public:
  using Callback = std::function<void(const void* message, double waited_s)>;
  AnySubscription(Executor& executor, Node& node, const std::string& name,
                  const rosidl_message_type_support_t* type, const std::string& type_name, const Qos& qos,
                  const Doc& doc, std::shared_ptr<void> message, Callback callback)
      : SubscriptionBase(executor, node, name, type, type_name, qos, doc),
        message_(std::move(message)),
        callback_(std::move(callback)) {
    open();
  }
  ~AnySubscription() override { close(); }

 private:
  bool take() override {
    if (!take_any(message_.get())) return false;
    callback_(message_.get(), waited_s());
    return true;
  }

  std::shared_ptr<void> message_;
  Callback callback_;
};

// The same for a type of this program; the callback takes a message, and the time that it waited if it likes.
template <class M>
class Subscription : public AnySubscription {
 public:
  template <class Callback>
  Subscription(Executor& executor, Node& node, const std::string& name, const Qos& qos, const Doc& doc,
               Callback callback)
      : AnySubscription(executor, node, name, rosidl_typesupport_cpp::get_message_type_support_handle<M>(),
                        rosidl_generator_traits::name<M>(), qos, doc, std::make_shared<M>(),
                        [callback = std::move(callback)](const void* any, [[maybe_unused]] double waited_s) {
                          const M& message = *static_cast<const M*>(any);
                          if constexpr (std::is_invocable_v<const Callback&, const M&, double>)
                            callback(message, waited_s);
                          else
                            callback(message);
                        }) {}
};

}  // namespace multipanda::ros
