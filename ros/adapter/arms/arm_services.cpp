#include "ros/adapter/arms/arm_services.hpp"

#include <multipanda_msgs/srv/recover_from_error.hpp>
#include <std_srvs/srv/set_bool.hpp>
#include <std_srvs/srv/trigger.hpp>
#include <stdexcept>

#include "ros/adapter/arms/arm_requests.hpp"
#include "ros/adapter/arms/ask_arm.hpp"
#include "ros/rcl/rcl.hpp"

namespace multipanda::ros {
namespace {

namespace srv = multipanda_msgs::srv;  // some of its names are the core's, too

// `error` of our own services, `message` of the standard ones.
template <class Response>
void say(Response& response, const ArmAnswer& answer) {
  response.success = answer.success;
  if constexpr (requires { response.error; }) {
    response.error = answer.reason;
  } else {
    response.message = answer.reason;
  }
}

}  // namespace

template <class S>
void ArmServices::offer(const std::string& name, const std::string& alias, const std::string& doc,
                        std::function<ArmRequest(const typename S::Request&)> read) {
  const AdapterWorld* world = &world_;
  const auto callback = [world, arm = arm_, read](const typename S::Request& request, auto reply) {
    const auto answered = [world, reply](const ArmAnswer& answer) {
      typename S::Response response;
      say(response, answer);
      count_request(*world, answer.success);
      reply(std::move(response));
    };
    ArmRequest asked;
    try {
      asked = read(request);
    } catch (const std::invalid_argument& error) {
      return answered({.success = false, .reason = error.what()});
    }
    ask_arm(*world, arm, std::move(asked), kArmPatience, answered);
  };
  const std::string full = world_.modes->arm_name(arm_) + "/" + name;
  services_.push_back(
      std::make_unique<Service<S>>(*world_.executor, *world_.node, full, Doc{"", doc}, callback));
  if (alias.empty()) return;
  services_.push_back(std::make_unique<Service<S>>(*world_.executor, *world_.node,
                                                   world_.modes->arm_name(arm_) + "_" + alias,
                                                   Doc{"", "As " + full + "."}, callback));
}

ArmServices::ArmServices(const AdapterWorld& world, ArmIndex arm) : world_(world), arm_(arm) {
  const std::size_t n = world.models[arm]->joint_count();
  const auto reads = [n](const auto& request) { return read_request(request, n); };
  offer<srv::RecoverFromError>("recover", "error_recovery_service_server/error_recovery",
                               "Clears the arm's error; it is held afterwards, whatever ran before.",
                               [](const auto&) { return RecoverFromError{}; });
  offer<srv::SetLoad>("set_load", "param_service_server/set_load",
                      "Payload: mass [kg], centre of mass in the flange [m], inertia about it [kg m^2].",
                      reads);
  offer<srv::SetToolFrame>("set_tool_frame", "param_service_server/set_tool_frame",
                           "End-effector frame in the flange, X_FE.", reads);
  offer<srv::SetStiffnessFrame>("set_stiffness_frame", "param_service_server/set_stiffness_frame",
                                "Stiffness frame in the end effector, X_EK.", reads);
  offer<srv::SetCollisionBehavior>(
      "set_collision_behavior", "param_service_server/set_collision_behavior",
      "Thresholds of contact (lower) and of the arm's reflex (upper) [N m; N, N m].", reads);
  offer<srv::SetJointStiffness>("set_joint_stiffness", "param_service_server/set_joint_stiffness",
                                "Stiffness of the arm's own joint controller [N m/rad].", reads);
  offer<srv::SetCartesianStiffness>("set_cartesian_stiffness", "param_service_server/set_cartesian_stiffness",
                                    "Stiffness of the arm's own Cartesian controller, in K [N/m, N m/rad].",
                                    reads);
  if (world.backend->capabilities(arm).simulated) {
    offer<std_srvs::srv::SetBool>(
        "set_user_stop", "", "Presses (true) or releases the simulated arm's stop button.",
        [](const auto& request) { return SetUserStop{static_cast<bool>(request.data)}; });
  } else {
    offer<std_srvs::srv::Trigger>("reconnect", "", "Takes up the connection again after it was lost.",
                                  [](const auto&) { return Reconnect{}; });
  }
}

}  // namespace multipanda::ros
