#pragma once

// Private to arm_link.cpp and arm_motion.cpp: how a request is sent and its answer judged.
#include "fci/client/arm_link.hpp"
#include "fci/client/arm_words.hpp"

namespace multipanda::fci {

template <class Request>
std::uint32_t ArmLink::post(const Request& request, const char* what) {
  if (dialect_ == nullptr || !is_connected()) {
    refuse(LinkError::Kind::lost, "there is no connection: connect first");
  }
  std::array<std::byte, kMaxRequestSize> message;
  const std::uint32_t id = channel_.next_id();
  const std::size_t size = encode_request(*dialect_, id, request, message);
  if (size == 0) {
    refuse(LinkError::Kind::refused, std::string(what) + " does not exist in version " +
                                         std::to_string(version()) + " of the protocol");
  }
  channel_.send(std::span(message).first(size), options_.reply_timeout_s);
  return id;
}

// Sends, waits, and throws unless the answer is yes. What follows the status is returned.
template <class Request>
std::vector<std::byte> ArmLink::ask(const Request& request, const char* what, double timeout_s) {
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
      why = "a safety function of the arm forbids it: look at the safety settings in the arm's web interface";
      break;
    case Status::manual_recovery_required:
      why =
          "the arm must be moved by hand first (it stands beyond a limit, or was pushed there): unlock it in "
          "the "
          "arm's web interface, move it, then recover again";
      break;
    default:
      why = text(status);
  }
  refuse(LinkError::Kind::refused, std::string(what) + ": " + why);
}

}  // namespace multipanda::fci
