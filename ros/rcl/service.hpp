#pragma once

#include <functional>
#include <future>
#include <map>
#include <memory>
#include <mutex>
#include <rcl/client.h>
#include <rcl/service.h>
#include <rosidl_runtime_cpp/traits.hpp>
#include <rosidl_typesupport_cpp/service_type_support.hpp>
#include <string>
#include <utility>

#include "ros/rcl/executor.hpp"
#include "ros/rcl/node.hpp"

namespace multipanda::ros {

// The part of a service kept alive by replies. A reply after the service's end has no effect.
class ServiceCore {
 public:
  ServiceCore(Node& node, const std::string& name, const rosidl_service_type_support_t* type);
  ~ServiceCore();
  ServiceCore(const ServiceCore&) = delete;
  bool take(rmw_service_info_t& info, void* request);
  void send(rmw_request_id_t id, void* response);
  void close();
  void on_new(rcl_event_callback_t callback, const void* data);
  std::string name() const;

 private:
  Node& node_;
  rcl_service_t service_;
  std::mutex mutex_;
  bool open_ = false;
};

class ServiceBase : public Incoming {
 public:
  std::string name() const { return core_->name(); }

 protected:
  ServiceBase(Executor& executor, Node& node, const std::string& name,
              const rosidl_service_type_support_t* type, const std::string& type_name, const Doc& doc);
  bool take_any(rmw_request_id_t& id, void* request);
  ~ServiceBase() override;
  void open();
  void close();
  std::string source() const override { return name(); }

  std::shared_ptr<ServiceCore> core_;
};

// The callback may reply at once, or keep the Reply and reply later, once, from any thread, even after the
// service's end. If a callback throws, the caller gets no answer, so catch exceptions.
template <class S>
class Service : public ServiceBase {
 public:
  using Request = typename S::Request;
  using Response = typename S::Response;
  class Reply {
   public:
    Reply(std::weak_ptr<ServiceCore> core, rmw_request_id_t id) : core_(std::move(core)), id_(id) {}
    void operator()(Response response) const {
      if (const auto core = core_.lock()) core->send(id_, &response);
    }

   private:
    std::weak_ptr<ServiceCore> core_;
    rmw_request_id_t id_;
  };
  using Callback = std::function<void(const Request&, Reply)>;

  Service(Executor& executor, Node& node, const std::string& name, const Doc& doc, Callback callback)
      : ServiceBase(executor, node, name, rosidl_typesupport_cpp::get_service_type_support_handle<S>(),
                    rosidl_generator_traits::name<S>(), doc),
        callback_(std::move(callback)) {
    open();
  }
  ~Service() override { close(); }

 private:
  bool take() override {
    rmw_request_id_t id;
    Request request;
    if (!take_any(id, &request)) return false;
    callback_(request, Reply(core_, id));
    return true;
  }

  Callback callback_;
};

class ClientBase : public Incoming {
 public:
  bool ready() const;  // whether the service is available
  // Waits until the service is available; returns false on timeout. Not from a callback.
  bool wait_until_ready(double timeout_s) const;

 protected:
  ClientBase(Executor& executor, Node& node, const std::string& name,
             const rosidl_service_type_support_t* type);
  ~ClientBase() override;
  void open();
  void close();
  std::int64_t send(const void* request);
  bool take_any(std::int64_t& sequence, void* response);
  std::string source() const override;

 private:
  Node& node_;
  rcl_client_t client_;
};

// Calls a service. When the client is destroyed, pending futures throw std::future_error.
template <class S>
class Client : public ClientBase {
 public:
  using Request = typename S::Request;
  using Response = typename S::Response;

  Client(Executor& executor, Node& node, const std::string& name)
      : ClientBase(executor, node, name, rosidl_typesupport_cpp::get_service_type_support_handle<S>()) {
    open();
  }
  ~Client() override { close(); }

  // Any thread. Throws RclError. The executor's thread delivers the answer, so do not wait for it there.
  std::future<Response> call(const Request& request) {
    const std::lock_guard lock(mutex_);
    return waiting_[send(&request)].get_future();
  }

 private:
  bool take() override {
    std::int64_t sequence = 0;
    Response response;
    if (!take_any(sequence, &response)) return false;
    const std::lock_guard lock(mutex_);
    if (auto found = waiting_.extract(sequence)) found.mapped().set_value(std::move(response));
    return true;
  }

  std::mutex mutex_;
  std::map<std::int64_t, std::promise<Response>> waiting_;
};

}  // namespace multipanda::ros
