#pragma once

#include <functional>
#include <memory>
#include <string>
#include <utility>

#include "ros/adapter/compat/message_type.hpp"
#include "ros/rcl/rcl.hpp"

// Publishers, subscriptions and services of types known by name only. Threads as in ros/rcl.
namespace multipanda::ros {

class UntypedPublisher : public PublisherBase {
 public:
  UntypedPublisher(Node& node, const std::string& name, const MessageType& type, const Qos& qos,
                   const Doc& doc)
      : PublisherBase(node, name, type.type_support(), type.name(), qos, doc) {}
  void publish(const void* message) { publish_any(message); }
};

class UntypedSubscription : public AnySubscription {
 public:
  UntypedSubscription(Executor& executor, Node& node, const std::string& name, const MessageType& type,
                      const Qos& qos, const Doc& doc, Callback callback)
      : AnySubscription(executor, node, name, type.type_support(), type.name(), qos, doc, type.make(),
                        std::move(callback)) {}
};

class UntypedService : public ServiceBase {
 public:
  // Replies once, from any thread; `fill` writes the response.
  class Reply {
   public:
    Reply(std::weak_ptr<ServiceCore> core, rmw_request_id_t id, MessageType response)
        : core_(std::move(core)), id_(id), response_(std::move(response)) {}
    void operator()(const std::function<void(void* response)>& fill = nullptr) const {
      const auto response = response_.make();
      if (fill) fill(response.get());
      if (const auto core = core_.lock()) core->send(id_, response.get());
    }

   private:
    std::weak_ptr<ServiceCore> core_;
    rmw_request_id_t id_;
    MessageType response_;
  };
  using Callback = std::function<void(const void* request, Reply)>;

  UntypedService(Executor& executor, Node& node, const std::string& name, const ServiceType& type,
                 const Doc& doc, Callback callback)
      : ServiceBase(executor, node, name, type.type_support, type.name, doc),
        type_(type),
        callback_(std::move(callback)) {
    open();
  }
  ~UntypedService() override { close(); }

 private:
  bool take() override {
    rmw_request_id_t id;
    const auto request = type_.request.make();
    if (!take_any(id, request.get())) return false;
    callback_(request.get(), Reply(core_, id, type_.response));
    return true;
  }

  ServiceType type_;
  Callback callback_;
};

}  // namespace multipanda::ros
