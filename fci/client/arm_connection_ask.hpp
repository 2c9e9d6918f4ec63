#pragma once

// Private to arm_connection.cpp and arm_motion.cpp: sends a request and evaluates its answer.
#include "fci/client/arm_connection.hpp"
#include "fci/client/arm_mode.hpp"

namespace multipanda::fci {

template <class Request>
std::uint32_t ArmConnection::post(const Request& request, const char* what) {
  if (dialect_ == nullptr || !is_connected()) {
    refuse(ConnectionError::Kind::lost, "there is no connection: connect first");
  }
  std::array<std::byte, kMaxRequestSize> message;
  const std::uint32_t id = channel_.next_id();
  const std::size_t size = encode_request(*dialect_, id, request, message);
  if (size == 0) {
    refuse(ConnectionError::Kind::refused, std::string(what) + " is not available in version " +
                                               std::to_string(version()) + " of the protocol");
  }
  channel_.send(std::span(message).first(size), options_.reply_timeout_s);
  return id;
}

// Sends, waits, and throws unless the arm accepts. Returns the bytes after the status.
template <class Request>
std::vector<std::byte> ArmConnection::ask(const Request& request, const char* what, double timeout_s) {
  const std::uint32_t id = post(request, what);
  const auto reply = channel_.wait(id, timeout_s, what);
  std::span<const std::byte> rest;
  const Status status = status_of_reply(Request::kCommand, reply, rest);
  if (status == Status::success) return {rest.begin(), rest.end()};
  (void)look_for_state(0);
  std::string why;
  switch (status) {
    case Status::not_possible:
      why = refusal_in_mode(options_.name, seen_);
      break;
    case Status::invalid_argument:
      why = "the arm does not accept the values: see the ranges in docs/real_arms.md";
      break;
    case Status::rejected_by_safety:
      why = "a safety function of the arm forbids it: check the safety settings in the arm's web interface";
      break;
    case Status::manual_recovery_required:
      why =
          "the arm must be moved by hand first (it is beyond a limit): unlock it in the arm's web interface, "
          "move it, then recover again";
      break;
    default:
      why = text(status);
  }
  refuse(ConnectionError::Kind::refused, std::string(what) + ": " + why);
}

}  // namespace multipanda::fci
