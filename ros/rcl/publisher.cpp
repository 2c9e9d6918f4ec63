#include "ros/rcl/publisher.hpp"

#include "ros/rcl/error.hpp"

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

}  // namespace multipanda::ros
