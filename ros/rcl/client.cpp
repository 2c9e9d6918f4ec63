#include "ros/rcl/client.hpp"

#include <chrono>
#include <rcl/graph.h>
#include <thread>

#include "ros/rcl/context.hpp"

namespace multipanda::ros {

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
