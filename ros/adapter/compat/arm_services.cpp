#include "ros/adapter/compat/arm_services.hpp"

#include <array>
#include <optional>
#include <stdexcept>

#include "ros/adapter/adapter_part.hpp"
#include "ros/adapter/arms/arm_requests.hpp"
#include "ros/adapter/arms/arm_services.hpp"
#include "ros/adapter/compat/goals.hpp"
#include "ros/adapter/compat/message_type.hpp"
#include "ros/adapter/compat/mode_services.hpp"
#include "ros/adapter/compat/state_fields.hpp"
#include "scene/build.hpp"

namespace multipanda::ros {

namespace {

namespace srv = multipanda_msgs::srv;

// Thresholds for constant velocity or for acceleration.
struct Thresholds {
  Thresholds(const MessageType& type, std::size_t joints, const std::string& when)
      : lower_torque(type, {"lower_torque_thresholds_" + when}, joints),
        upper_torque(type, {"upper_torque_thresholds_" + when}, joints),
        lower_force(type, {"lower_force_thresholds_" + when}, 6),
        upper_force(type, {"upper_force_thresholds_" + when}, 6) {}
  Numbers lower_torque, upper_torque, lower_force, upper_force;
};

}  // namespace

void CompatArmServices::offer(const std::string& name, const std::string& type_name,
                              const std::function<Read(const MessageType& request)>& reads) {
  const auto type = ServiceType::find(packages_.arms, type_name);
  const Read read = reads(type.request);
  const Numbers success(type.response, {"success"}, 1);
  const Text error(type.response, "error");
  services_.push_back(std::make_unique<UntypedService>(
      *run_.executor, *run_.node, name, type,
      Doc{"", "In the types of the other system; the same requests and refusals as `" +
                  run_.modes->arm_name(arm_) + "/...`."},
      [this, read, success, error](const void* request, const UntypedService::Reply& reply) {
        const auto answered = [this, reply, success, error](const RequestAnswer& answer) {
          run_.count_request(answer.success);
          reply([&](void* response) {
            success.write(response, std::array{answer.success ? 1.0 : 0.0});
            error.write(response, answer.reason);
          });
        };
        try {
          request_arm(run_, arm_, read(request), kArmTimeout, answered);
        } catch (const std::invalid_argument& refused) {
          answered({.success = false, .reason = refused.what()});
        }
      }));
}

CompatArmServices::CompatArmServices(const AdapterContext& run, const CompatPackages& packages, ArmIndex arm)
    : run_(run), packages_(packages), arm_(arm) {
  const std::string name = run.modes->arm_name(arm);
  const bool theirs = packages.with == RosSection::Compat::multipanda_ros2;
  const std::string server = theirs                        ? name + "_param_service_server/"
                             : run.modes->arm_count() == 1 ? "service_server/"
                                                           : name + "/service_server/";
  const std::size_t n = run.models[arm]->joint_count();
  if (theirs) {
    offer(name + "_error_recovery_service_server/error_recovery", "ErrorRecovery",
          [](const MessageType&) -> Read { return [](const void*) { return RecoverFromError{}; }; });
  }
  offer(server + "set_load", "SetLoad", [n](const MessageType& type) -> Read {
    const Numbers mass(type, {"mass"}, 1), center(type, {"center_of_mass"}, 3),
        inertia(type, {"load_inertia"}, 9);
    return [=](const void* request) {
      srv::SetLoad::Request ours;
      ours.mass = mass.read(request)[0];
      center.read(request, ours.center_of_mass);
      inertia.read(request, ours.load_inertia);
      return read_request(ours, n);
    };
  });
  // NE_T_EE, from the nominal end effector, which is the scene's.
  offer(server + "set_tcp_frame", "SetTCPFrame",
        [X_FN = arm_config(run.scene->arms.at(arm)).frames.X_FE](const MessageType& type) -> Read {
          const Numbers X(type, {"transformation"}, 16);
          return [=](const void* request) -> ArmRequest {
            return SetFrames{X_FN * read_transform(X.read(request), "transformation"), {}};
          };
        });
  offer(server + "set_stiffness_frame", "SetStiffnessFrame", [](const MessageType& type) -> Read {
    const Numbers X(type, {"transformation"}, 16);
    return [=](const void* request) -> ArmRequest {
      return SetFrames{{}, read_transform(X.read(request), "transformation")};
    };
  });
  offer(server + "set_joint_stiffness", "SetJointStiffness", [n](const MessageType& type) -> Read {
    const Numbers stiffness(type, {"joint_stiffness"}, n);
    return [=](const void* request) {
      srv::SetJointStiffness::Request ours;
      ours.joint_stiffness = stiffness.read(request);
      return read_request(ours, n);
    };
  });
  offer(server + "set_cartesian_stiffness", "SetCartesianStiffness", [n](const MessageType& type) -> Read {
    const Numbers stiffness(type, {"cartesian_stiffness"}, 6);
    return [=](const void* request) {
      srv::SetCartesianStiffness::Request ours;
      stiffness.read(request, ours.cartesian_stiffness);
      return read_request(ours, n);
    };
  });
  const SetCollisionThresholds most = most_thresholds(run, arm);
  const auto thresholds = [n, most](bool full) {
    return [=](const MessageType& type) -> Read {
      const Thresholds nominal(type, n, "nominal");
      const auto accelerating =
          full ? std::optional<Thresholds>(std::in_place, type, n, "acceleration") : std::nullopt;
      return [=](const void* request) {
        srv::SetCollisionBehavior::Request ours;
        ours.lower_torque_thresholds_nominal = nominal.lower_torque.read(request);
        ours.upper_torque_thresholds_nominal = nominal.upper_torque.read(request);
        nominal.lower_force.read(request, ours.lower_force_thresholds_nominal);
        nominal.upper_force.read(request, ours.upper_force_thresholds_nominal);
        if (accelerating) {
          ours.lower_torque_thresholds_acceleration = accelerating->lower_torque.read(request);
          ours.upper_torque_thresholds_acceleration = accelerating->upper_torque.read(request);
          accelerating->lower_force.read(request, ours.lower_force_thresholds_acceleration);
          accelerating->upper_force.read(request, ours.upper_force_thresholds_acceleration);
        }
        return read_thresholds(ours, n, most);
      };
    };
  };
  offer(server + "set_force_torque_collision_behavior", "SetForceTorqueCollisionBehavior", thresholds(false));
  offer(server + "set_full_collision_behavior", "SetFullCollisionBehavior", thresholds(true));
}

AdapterParts make_compat(const AdapterContext& run, const Inputs* inputs) {
  AdapterParts parts;
  const RosOptions& options = *run.options;
  if (options.compat == RosSection::Compat::none) return parts;
  const CompatPackages packages{options.compat, options.compat_arm_messages, options.compat_mode_messages};
  if (options.state) parts.push_back(std::make_unique<CompatState>(run, packages));
  for (ArmIndex arm = 0; options.arms && arm < run.modes->arm_count(); ++arm)
    parts.push_back(std::make_unique<CompatArmServices>(run, packages, arm));
  if (options.compat == RosSection::Compat::multipanda_ros2 && inputs != nullptr) {
    const auto names = std::make_shared<AskedNames>(*run.modes);
    parts.push_back(std::make_unique<CompatModes>(run, packages, names));
    parts.push_back(std::make_unique<CompatGoals>(run, packages, *inputs, names));
  }
  return parts;
}

}  // namespace multipanda::ros
