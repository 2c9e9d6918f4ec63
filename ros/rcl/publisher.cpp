#include "ros/rcl/publisher.hpp"

#include "ros/rcl/context.hpp"

namespace multipanda::ros {

PublisherBase::PublisherBase(Node& node, const std::string& name, const rosidl_message_type_support_t* type,
                             const std::string& type_name, const Qos& qos, const Doc& doc)
    : node_(node), publisher_(rcl_get_zero_initialized_publisher()) {
  rcl_publisher_options_t options = rcl_publisher_get_default_options();
  options.qos = qos.profile();
  check(rcl_publisher_init(&publisher_, node.handle(), type, name.c_str(), &options),
        "publishing " + type_name + " on \"" + name + "\"");
  if (!doc.text.empty()) node.describe({"publisher", topic(), type_name, qos.text(), doc.rate, doc.text});
}

PublisherBase::~PublisherBase() { disregard(rcl_publisher_fini(&publisher_, node_.handle())); }

std::string PublisherBase::topic() const { return rcl_publisher_get_topic_name(&publisher_); }

std::size_t PublisherBase::subscribers() const {
  std::size_t count = 0;
  if (rcl_publisher_get_subscription_count(&publisher_, &count) != RCL_RET_OK) (void)take_rcl_error();
  return count;
}

void PublisherBase::publish_any(const void* message) {
  const std::lock_guard lock(mutex_);
  const bool taken = rcl_publish(&publisher_, message, nullptr) == RCL_RET_OK;
  node_.count_message(taken);
  if (taken) return;
  (void)take_rcl_error();
  failures_.fetch_add(1, std::memory_order_relaxed);
}

SubscriptionBase::SubscriptionBase(Executor& executor, Node& node, const std::string& name,
                                   const rosidl_message_type_support_t* type, const std::string& type_name,
                                   const Qos& qos, const Doc& doc)
    : Incoming(executor), node_(node), subscription_(rcl_get_zero_initialized_subscription()) {
  rcl_subscription_options_t options = rcl_subscription_get_default_options();
  options.qos = qos.profile();
  const rcl_ret_t made = rcl_subscription_init(&subscription_, node.handle(), type, name.c_str(), &options);
  const std::string why = take_rcl_error();  // error state that a successful call may have left behind
  disregard(rcl_subscription_options_fini(&options));
  if (made != RCL_RET_OK)
    throw RclError("subscribing to " + type_name + " on \"" + name + "\" failed: " + why);
  if (!doc.text.empty()) node.describe({"subscription", topic(), type_name, qos.text(), doc.rate, doc.text});
}

SubscriptionBase::~SubscriptionBase() { disregard(rcl_subscription_fini(&subscription_, node_.handle())); }

void SubscriptionBase::open() {
  begin();
  check(rcl_subscription_set_on_new_message_callback(&subscription_, &Incoming::arrived,
                                                     static_cast<Incoming*>(this)),
        "waiting for messages on " + topic());
}

void SubscriptionBase::close() {
  disregard(rcl_subscription_set_on_new_message_callback(&subscription_, nullptr, nullptr));
  end();
}

std::string SubscriptionBase::topic() const { return rcl_subscription_get_topic_name(&subscription_); }

std::size_t SubscriptionBase::publishers() const {
  std::size_t count = 0;
  if (rcl_subscription_get_publisher_count(&subscription_, &count) != RCL_RET_OK) (void)take_rcl_error();
  return count;
}

bool SubscriptionBase::take_any(void* message) {
  rmw_message_info_t info = rmw_get_zero_initialized_message_info();
  const rcl_ret_t taken = rcl_take(&subscription_, message, &info, nullptr);
  if (taken == RCL_RET_OK) {
    waited_s_ = note_times(info.source_timestamp, info.received_timestamp);
    return true;
  }
  if (taken != RCL_RET_SUBSCRIPTION_TAKE_FAILED) (void)take_rcl_error();
  return false;
}

}  // namespace multipanda::ros
