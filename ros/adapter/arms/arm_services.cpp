#include "ros/adapter/arms/arm_services.hpp"

#include <multipanda_msgs/srv/recover_from_error.hpp>
#include <std_srvs/srv/set_bool.hpp>
#include <std_srvs/srv/trigger.hpp>
#include <stdexcept>

#include "ros/adapter/arms/arm_requests.hpp"
#include "ros/adapter/arms/request_arm.hpp"
#include "ros/rcl/rcl.hpp"

namespace multipanda::ros {
namespace {

namespace srv = multipanda_msgs::srv;  // some of its names are also in the core

// Our own services have a field `error`, the standard ones `message`.
template <class Response>
void set_result(Response& response, const RequestAnswer& answer) {
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
  const AdapterContext* run = &run_;
  const auto callback = [run, arm = arm_, read](const typename S::Request& request, auto reply) {
    const auto answered = [run, reply](const RequestAnswer& answer) {
      typename S::Response response;
      set_result(response, answer);
      run->count_request(answer.success);
      reply(std::move(response));
    };
    ArmRequest converted;
    try {
      converted = read(request);
    } catch (const std::invalid_argument& error) {
      return answered({.success = false, .reason = error.what()});
    }
    request_arm(*run, arm, std::move(converted), kArmTimeout, answered);
  };
  const std::string full = run_.modes->arm_name(arm_) + "/" + name;
  services_.push_back(std::make_unique<Service<S>>(*run_.executor, *run_.node, full, Doc{"", doc}, callback));
  if (alias.empty()) return;
  services_.push_back(std::make_unique<Service<S>>(*run_.executor, *run_.node,
                                                   run_.modes->arm_name(arm_) + "_" + alias,
                                                   Doc{"", "As " + full + "."}, callback));
}

ArmServices::ArmServices(const AdapterContext& run, ArmIndex arm) : run_(run), arm_(arm) {
  const std::size_t n = run.models[arm]->joint_count();
  const auto reads = [n](const auto& request) { return read_request(request, n); };
  offer<srv::RecoverFromError>(
      "recover", "error_recovery_service_server/error_recovery",
      "Clears the arm's error. The arm is held afterwards, whichever controllet was active.",
      [](const auto&) { return RecoverFromError{}; });
  offer<srv::SetLoad>("set_load", "param_service_server/set_load",
                      "Payload: mass [kg], center of mass in the flange [m], inertia about it [kg m^2].",
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
  if (run.backend->capabilities(arm).simulated) {
    offer<std_srvs::srv::SetBool>(
        "set_user_stop", "", "Presses (true) or releases (false) the simulated arm's user stop.",
        [](const auto& request) { return SetUserStop{static_cast<bool>(request.data)}; });
  } else {
    offer<std_srvs::srv::Trigger>("reconnect", "", "Reconnects after a lost connection.",
                                  [](const auto&) { return Reconnect{}; });
  }
}

}  // namespace multipanda::ros
