#include "ros/adapter/arms/arm_services.hpp"

#include <chrono>
#include <future>
#include <memory>
#include <multipanda_msgs/srv/recover_from_error.hpp>
#include <optional>
#include <std_srvs/srv/set_bool.hpp>
#include <std_srvs/srv/trigger.hpp>
#include <stdexcept>

#include "arm_interface/arm_settings.hpp"
#include "ros/adapter/adapter_part.hpp"
#include "ros/adapter/arms/arm_requests.hpp"
#include "ros/adapter/arms/gripper.hpp"
#include "ros/adapter/arms/motion_actions.hpp"
#include "ros/rcl/executor.hpp"
#include "ros/rcl/rcl.hpp"
#include "runtime/request_text.hpp"

namespace multipanda::ros {

namespace {

namespace srv = multipanda_msgs::srv;  // some of its names are also in the core

}  // namespace

SetCollisionThresholds most_thresholds(const AdapterContext& run, ArmIndex arm) {
  if (run.scene != nullptr && run.scene->arms.at(arm).collision) return *run.scene->arms[arm].collision;
  const ArmModel& model = *run.models[arm];
  return run.backend->capabilities(arm).simulated ? default_settings(model).thresholds
                                                  : careful_thresholds(model);
}

template <class S, class Request>
void ArmServices::offer(const std::string& name, const std::string& alias, const std::string& doc,
                        std::type_identity_t<std::function<Request(const typename S::Request&)>> read,
                        double timeout_s, Executor* executor) {
  const AdapterContext* run = &run_;
  Executor& served_by = executor != nullptr ? *executor : *run_.executor;
  const auto callback = [run, arm = arm_, read, timeout_s](const typename S::Request& request, auto reply) {
    const auto answered = [run, reply](const RequestAnswer& answer) {
      reply(response_of<typename S::Response>(*run, answer));
    };
    Request converted;
    try {
      converted = read(request);
    } catch (const std::invalid_argument& error) {
      return answered({.success = false, .reason = error.what()});
    }
    request_arm(*run, arm, std::move(converted), timeout_s, answered);
  };
  const std::string full = run_.modes->arm_name(arm_) + "/" + name;
  services_.push_back(std::make_unique<Service<S>>(served_by, *run_.node, full, Doc{"", doc}, callback));
  // With `compat: multipanda_ros2` its own types use these names.
  if (alias.empty() || run_.options->compat == RosSection::Compat::multipanda_ros2) return;
  services_.push_back(std::make_unique<Service<S>>(served_by, *run_.node,
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
      "Thresholds of contact (lower) and of the arm's reflex (upper) [N m; N, N m]. Not above those of the "
      "scene.",
      [n, most = most_thresholds(run, arm)](const auto& request) {
        return read_thresholds(request, n, most);
      });
  offer<srv::SetJointStiffness>("set_joint_stiffness", "param_service_server/set_joint_stiffness",
                                "Stiffness of the arm's own joint controller [N m/rad].", reads);
  offer<srv::SetCartesianStiffness>("set_cartesian_stiffness", "param_service_server/set_cartesian_stiffness",
                                    "Stiffness of the arm's own Cartesian controller, in K [N/m, N m/rad].",
                                    reads);
  offer<srv::SetGuidingMode>(
      "set_guiding_mode", "",
      "Axes that are free while a person holds the guiding buttons. The service itself frees nothing. A real "
      "arm must be in hold: torque control is interrupted for it.",
      [run = &run, arm, n](const auto& request) {
        // A real arm applies it outside a motion only; anything that a controllet holds with the arm would
        // be released.
        const bool simulated = run->backend->capabilities(arm).simulated;
        if (!simulated && run->modes->owner(arm) >= run->modes->arm_count())
          throw std::invalid_argument("a controllet controls the arm: switch the arm to hold first");
        return read_request(request, n);
      });
  if (run.backend->capabilities(arm).has_vacuum) offer_vacuum();
  if (run.backend->capabilities(arm).simulated) {
    offer<std_srvs::srv::SetBool>(
        "set_user_stop", "", "Presses (true) or releases (false) the simulated arm's user stop.",
        [](const auto& request) { return SetUserStop{static_cast<bool>(request.data)}; });
  } else {
    offer<std_srvs::srv::Trigger>("reconnect", "", "Reconnects after a lost connection.",
                                  [](const auto&) { return Reconnect{}; });
  }
}

void ArmServices::offer_vacuum() {
  offer<srv::VacuumOn, GripperRequest>(
      "vacuum/on", "", "Evacuates the vacuum gripper; success: an object is held.",
      [](const auto& request) { return read_request(request); }, kGripperTimeout);
  offer<srv::VacuumDrop, GripperRequest>(
      "vacuum/drop", "", "Releases what the vacuum gripper holds: it falls unless something supports it.",
      [](const auto& request) { return read_request(request); }, kGripperTimeout);
  offer<std_srvs::srv::Trigger, GripperRequest>(
      "vacuum/stop", "", "Switches the pump off: a held object falls sooner or later.",
      [](const auto&) { return VacuumStop{}; }, kArmTimeout, run_.stops);
}

namespace {

// Ends what a gripper follows for this request. False: another client's widths come first.
bool takes(const AdapterContext& run, ArmIndex arm, const GripperRequest& request, const ArmSample& now) {
  if (!run.followed) return true;
  const std::lock_guard lock(run.followed->mutex);
  if (run.followed->grippers.size() <= arm) return true;
  Followed::Gripper& gripper = run.followed->grippers[arm];
  if (gripper.refuses(request, nullptr, now.gripper_width, host_now())) return false;
  if (ends_motion(request) || check(request).empty()) gripper.end(host_now(), true);
  return true;
}

template <typename Request>
void send(const AdapterContext& run, ArmIndex arm, Request request, double timeout_s,
          std::function<void(const RequestAnswer&)> answered) {
  const bool ends = ends_motion(request);
  if (!ends) {
    if (const std::string why = run.executor->late(kRequestPatience); !why.empty())
      return answered({.success = false, .reason = why});
  }
  std::shared_ptr<std::future<RequestAnswer>> future;
  std::optional<GripperRequest> moving;
  const auto newest = [newest = run.newest, arm] { return newest ? newest(arm) : ArmSample{}; };
  try {
    auto answer = [&] {
      if constexpr (std::is_same_v<Request, GripperRequest>) {
        const ArmSample sample = newest();
        if (ending_of(request, sample.gripper_grasped)) moving = request;
        if (!takes(run, arm, request, sample))
          return refuse_request(Followed::refusal(run.modes->arm_name(arm)));
        return multipanda::request_arm(*run.modes, *run.backend, arm, std::move(request), sample.mode);
      } else {
        return multipanda::request_arm(*run.modes, *run.backend, arm, std::move(request));
      }
    };
    future = std::make_shared<std::future<RequestAnswer>>(answer());
  } catch (const std::exception& error) {
    return answered({.success = false, .reason = error.what()});
  }
  const HostTime end = host_now() + std::chrono::nanoseconds(LoopTime::from_seconds(timeout_s).ns);
  const auto done = std::make_shared<std::atomic<bool>>(false);
  const bool refused = future->wait_for(std::chrono::seconds(0)) == std::future_status::ready;
  if (moving && !refused) {  // with a stop of the arm, which no other callback delays
    run.stops->poll_until([=, &run] {
      if (*done) return true;
      const ArmSample sample = newest();
      if (!gripper_stops(*run.modes, arm, sample.mode)) return false;
      if (auto ending = ending_of(*moving, sample.gripper_grasped))
        (void)run.backend->request(arm, std::move(*ending));
      return true;
    });
  }
  (ends ? run.stops : run.executor)->poll_until([=, answered = std::move(answered)] {
    if (future->wait_for(std::chrono::seconds(0)) == std::future_status::ready) {
      *done = true;
      RequestAnswer answer;
      try {
        answer = future->get();
      } catch (const std::exception&) {  // a broken promise
        answer.reason = "the backend did not answer";
      }
      answered(answer);
      return true;
    }
    if (host_now() < end) return false;
    *done = true;
    answered({.success = false, .reason = kRequestUnfinished});
    return true;
  });
}

}  // namespace

void request_arm(const AdapterContext& run, ArmIndex arm, ArmRequest request, double timeout_s,
                 std::function<void(const RequestAnswer&)> answered) {
  send(run, arm, std::move(request), timeout_s, std::move(answered));
}

void request_arm(const AdapterContext& run, ArmIndex arm, GripperRequest request, double timeout_s,
                 std::function<void(const RequestAnswer&)> answered) {
  send(run, arm, std::move(request), timeout_s, std::move(answered));
}

AdapterParts make_arms(const AdapterContext& run) {
  AdapterParts parts;
  for (ArmIndex arm = 0; arm < run.modes->arm_count(); ++arm) {
    if (run.options->motions) parts.push_back(std::make_unique<MotionActions>(run, arm));
    if (!run.options->arms) continue;
    parts.push_back(std::make_unique<ArmServices>(run, arm));
    if (run.backend->capabilities(arm).has_gripper) parts.push_back(std::make_unique<Gripper>(run, arm));
  }
  return parts;
}

}  // namespace multipanda::ros
