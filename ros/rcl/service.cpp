#include "ros/rcl/service.hpp"

#include <chrono>
#include <rcl/graph.h>
#include <thread>

#include "ros/rcl/context.hpp"

namespace multipanda::ros {

ServiceCore::ServiceCore(Node& node, const std::string& name, const rosidl_service_type_support_t* type)
    : node_(node), service_(rcl_get_zero_initialized_service()) {
  rcl_service_options_t options = rcl_service_get_default_options();
  options.qos.depth = kServiceDepth;
  check(rcl_service_init(&service_, node.handle(), type, name.c_str(), &options),
        "creating the service \"" + name + "\"");
  open_ = true;
}

ServiceCore::~ServiceCore() { close(); }

bool ServiceCore::take(rmw_service_info_t& info, void* request) {
  const rcl_ret_t taken = rcl_take_request_with_info(&service_, &info, request);
  if (taken == RCL_RET_OK) return true;
  if (taken != RCL_RET_SERVICE_TAKE_FAILED) (void)take_rcl_error();
  return false;
}

void ServiceCore::send(rmw_request_id_t id, void* response) {
  const std::lock_guard lock(mutex_);
  // A client that has gone is not an error of the service.
  if (open_ && rcl_send_response(&service_, &id, response) != RCL_RET_OK) (void)take_rcl_error();
}

void ServiceCore::close() {
  const std::lock_guard lock(mutex_);
  if (open_) disregard(rcl_service_fini(&service_, node_.handle()));
  open_ = false;
}

void ServiceCore::on_new(rcl_event_callback_t callback, const void* data) {
  check(rcl_service_set_on_new_request_callback(&service_, callback, data), "waiting for requests");
}

std::string ServiceCore::name() const { return rcl_service_get_service_name(&service_); }

ServiceBase::ServiceBase(Executor& executor, Node& node, const std::string& name,
                         const rosidl_service_type_support_t* type, const std::string& type_name,
                         const Doc& doc)
    : Incoming(executor), core_(std::make_shared<ServiceCore>(node, name, type)) {
  if (!doc.text.empty()) node.describe({"service", this->name(), type_name, "", doc.rate, doc.text});
}

ServiceBase::~ServiceBase() = default;

bool ServiceBase::take_any(rmw_request_id_t& id, void* request) {
  rmw_service_info_t info{};
  if (!core_->take(info, request)) return false;
  id = info.request_id;
  note_times(info.source_timestamp, info.received_timestamp);
  return true;
}

void ServiceBase::open() {
  begin();
  core_->on_new(&Incoming::arrived, static_cast<Incoming*>(this));
}

void ServiceBase::close() {
  try {
    core_->on_new(nullptr, nullptr);
  } catch (const RclError&) {  // the context has gone: no further request
  }
  end();
  core_->close();  // replies still held have no effect from now on
}

ClientBase::ClientBase(Executor& executor, Node& node, const std::string& name,
                       const rosidl_service_type_support_t* type)
    : Incoming(executor), node_(node), client_(rcl_get_zero_initialized_client()) {
  rcl_client_options_t options = rcl_client_get_default_options();
  options.qos.depth = kServiceDepth;
  check(rcl_client_init(&client_, node.handle(), type, name.c_str(), &options),
        "creating a client of the service \"" + name + "\"");
}

ClientBase::~ClientBase() { disregard(rcl_client_fini(&client_, node_.handle())); }

void ClientBase::open() {
  begin();
  check(rcl_client_set_on_new_response_callback(&client_, &Incoming::arrived, static_cast<Incoming*>(this)),
        "waiting for responses");
}

void ClientBase::close() {
  disregard(rcl_client_set_on_new_response_callback(&client_, nullptr, nullptr));
  end();
}

bool ClientBase::ready() const {
  bool there = false;
  if (rcl_service_server_is_available(node_.handle(), &client_, &there) != RCL_RET_OK) (void)take_rcl_error();
  return there;
}

bool ClientBase::wait_until_ready(double timeout_s) const {
  const auto until = std::chrono::steady_clock::now() + std::chrono::duration<double>(timeout_s);
  while (!ready()) {
    if (std::chrono::steady_clock::now() > until) return false;
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  return true;
}

std::string ClientBase::source() const { return rcl_client_get_service_name(&client_); }

std::int64_t ClientBase::send(const void* request) {
  std::int64_t sequence = 0;
  check(rcl_send_request(&client_, request, &sequence), "calling a service");
  return sequence;
}

bool ClientBase::take_any(std::int64_t& sequence, void* response) {
  rmw_request_id_t id{};
  const rcl_ret_t taken = rcl_take_response(&client_, &id, response);
  if (taken != RCL_RET_OK) {
    if (taken != RCL_RET_CLIENT_TAKE_FAILED) (void)take_rcl_error();
    return false;
  }
  sequence = id.sequence_number;
  return true;
}

}  // namespace multipanda::ros
