#pragma once

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "ros/adapter/compat/controllet_names.hpp"
#include "ros/adapter/compat/untyped.hpp"

namespace multipanda::ros {

// Services of one arm under the names and with the types of multipanda_ros2 (<arm>_param_service_server/...,
// <arm>_error_recovery_service_server/error_recovery) or franka_ros2 (service_server/..., below <arm>/ if
// there are several arms). They make the same requests as <arm>/set_load ..., with the same refusals.
class CompatArmServices : public AdapterPart {
 public:
  // Throws std::invalid_argument for missing types, and for types that do not fit.
  CompatArmServices(const AdapterContext& run, const CompatPackages& packages, ArmIndex arm);

 private:
  // Reads a request; throws std::invalid_argument, which refuses it.
  using Read = std::function<ArmRequest(const void* request)>;
  // `reads`: makes the reader for a type.
  void offer(const std::string& name, const std::string& type,
             const std::function<Read(const MessageType& request)>& reads);

  const AdapterContext& run_;
  const CompatPackages packages_;
  const ArmIndex arm_;
  std::vector<std::unique_ptr<UntypedService>> services_;
};

}  // namespace multipanda::ros
