#pragma once

#include <array>
#include <atomic>
#include <memory>
#include <multipanda_msgs/srv/list_arms.hpp>
#include <multipanda_msgs/srv/list_controllets.hpp>
#include <multipanda_msgs/srv/list_features.hpp>
#include <multipanda_msgs/srv/resume_arms.hpp>
#include <multipanda_msgs/srv/set_features.hpp>
#include <multipanda_msgs/srv/stop_arms.hpp>
#include <multipanda_msgs/srv/switch_controllets.hpp>
#include <vector>

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

}  // namespace multipanda::ros
