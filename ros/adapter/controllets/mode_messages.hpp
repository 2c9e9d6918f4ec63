#pragma once

#include <multipanda_msgs/msg/controllet_info.hpp>
#include <multipanda_msgs/msg/feature_info.hpp>
#include <multipanda_msgs/srv/resume_arms.hpp>
#include <multipanda_msgs/srv/set_features.hpp>
#include <multipanda_msgs/srv/stop_arms.hpp>
#include <multipanda_msgs/srv/switch_controllets.hpp>
#include <optional>
#include <string>
#include <vector>

#include "core/modes/multimode_controller.hpp"

// Converts service messages about controllets to requests, and answers to responses. Needs no ROS graph.
// Verdicts have the names of the socket's answers.
namespace multipanda::ros {

// The reason for refusing a request before it reaches the loop.
struct Refused {
  std::string verdict, reason;  // "unknown_instance", "there is no controllet ..."
};

// Convert names to requests. If a name is wrong, they fill `refused` and return nothing.
std::optional<Request> switch_request(const MultimodeController& modes,
                                      const multipanda_msgs::srv::SwitchControllets::Request& message,
                                      Refused& refused);
std::optional<std::vector<Request>> feature_requests(
    const MultimodeController& modes, const multipanda_msgs::srv::SetFeatures::Request& message,
    Refused& refused);
// No names: all arms.
std::optional<ArmSet> arms_named(const MultimodeController& modes, const std::vector<std::string>& names,
                                 Refused& refused);

// `received`: arrival time of the request in this process.
multipanda_msgs::srv::SwitchControllets::Response switch_response(const MultimodeController& modes,
                                                                  const Request& request,
                                                                  const Answer& answer, HostTime received);

// For responses with the fields accepted, verdict and reason.
template <class Response>
Response refusal(const Refused& refused) {
  Response response;
  response.accepted = false;
  response.verdict = refused.verdict;
  response.reason = refused.reason;
  return response;
}

multipanda_msgs::msg::FeatureInfo feature_info(const Instance& instance, std::size_t feature);
// Omits the topics: names only.
multipanda_msgs::msg::ControlletInfo controllet_info(const MultimodeController& modes, InstanceIndex i);

}  // namespace multipanda::ros
