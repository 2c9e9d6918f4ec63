#pragma once

#include <future>
#include <map>
#include <mutex>
#include <rcl/client.h>
#include <rosidl_runtime_cpp/traits.hpp>
#include <rosidl_typesupport_cpp/service_type_support.hpp>
#include <string>
#include <utility>

#include "ros/rcl/executor.hpp"
#include "ros/rcl/node.hpp"

namespace multipanda::ros {

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
