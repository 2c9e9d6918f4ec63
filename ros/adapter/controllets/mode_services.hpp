#pragma once

#include <array>
#include <atomic>
#include <memory>
#include <multipanda_msgs/msg/controllet_info.hpp>
#include <multipanda_msgs/msg/feature_info.hpp>
#include <multipanda_msgs/srv/list_arms.hpp>
#include <multipanda_msgs/srv/list_controllets.hpp>
#include <multipanda_msgs/srv/list_features.hpp>
#include <multipanda_msgs/srv/resume_arms.hpp>
#include <multipanda_msgs/srv/set_features.hpp>
#include <multipanda_msgs/srv/stop_arms.hpp>
#include <multipanda_msgs/srv/switch_controllets.hpp>
#include <optional>
#include <string>
#include <vector>

#include "core/modes/multimode_controller.hpp"
#include "ros/adapter/adapter_part.hpp"
#include "ros/adapter/controllets/input_codec.hpp"
#include "ros/rcl/rcl.hpp"

namespace multipanda::ros {

// Services to list and switch controllets: ~/switch_controllets, ~/list_controllets, ~/list_features,
// ~/list_arms, ~/set_features, ~/stop, ~/resume. ~/set_controllers (switches to exactly these) and
// ~/get_controllers are the names in multipanda_ros2. A response is sent when the loop has answered.
class ModeServices : public AdapterPart {
 public:
  ModeServices(const AdapterContext& run, const std::vector<InputCodec>& codecs);
  void take(const CycleRecord& record) override;  // tracks the modes for the list of arms

 private:
  using Switch = multipanda_msgs::srv::SwitchControllets;
  using List = multipanda_msgs::srv::ListControllets;
  void switch_controllets(Switch::Request request, const Service<Switch>::Reply& reply);
  void set_features(const multipanda_msgs::srv::SetFeatures::Request& request,
                    const Service<multipanda_msgs::srv::SetFeatures>::Reply& reply);
  void stop(const multipanda_msgs::srv::StopArms::Request& request,
            const Service<multipanda_msgs::srv::StopArms>::Reply& reply);
  void resume(const multipanda_msgs::srv::ResumeArms::Request& request,
              const Service<multipanda_msgs::srv::ResumeArms>::Reply& reply);
  List::Response list_controllets() const;
  multipanda_msgs::srv::ListFeatures::Response list_features(const std::string& instance) const;
  multipanda_msgs::srv::ListArms::Response list_arms() const;

  const AdapterContext& run_;
  const std::vector<InputCodec> codecs_;
  std::array<std::atomic<std::uint8_t>, kMaxArms> modes_of_arms_{};
  std::vector<std::unique_ptr<Incoming>> services_;
};

// Converts service messages about controllets to requests, and answers to responses. Needs no ROS graph.
// Verdicts have the names of the socket's answers.

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
