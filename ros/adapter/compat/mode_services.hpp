#pragma once

#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "ros/adapter/compat/controllet_names.hpp"
#include "ros/adapter/compat/untyped.hpp"
#include "ros/adapter/controllets/parameter_services.hpp"

namespace multipanda::ros {

// ~/set_controllers, ~/get_controllers and <resources>/<controllet>/parameters of multipanda_ros2. Their
// answers have no fields, so a refused request is not answered: otherwise a stiff arm could be taken for a
// soft one. The log and /diagnostics give the reason.
class CompatModes : public AdapterPart {
 public:
  // Throws std::invalid_argument for missing types, and for types that do not fit.
  CompatModes(const AdapterContext& run, const CompatPackages& packages, std::shared_ptr<AskedNames> names);
  void take(const Event& event) override { names_->take(event); }
  std::vector<Diagnostic> diagnostics() const override;

 private:
  void offer(const std::string& name, const ServiceType& type, const std::string& doc,
             UntypedService::Callback callback);
  void offer_set(const CompatPackages& packages);
  std::string torn_apart(InstanceSet activate) const;
  void switch_to(const std::map<InstanceIndex, std::string>& asked, const UntypedService::Reply& reply);
  void offer_get(const CompatPackages& packages);
  void offer_parameters(const TheirControllet& theirs, InstanceIndex instance,
                        const CompatPackages& packages);
  // Sets all or none of the parameters, in one cycle, and then replies. Throws std::invalid_argument if the
  // instance is active under another name than `name`.
  void set(const std::string& service, const std::string& name, InstanceIndex instance,
           const std::vector<std::pair<std::string, std::vector<double>>>& values,
           const UntypedService::Reply& reply);
  // The parameters of an instance under each of its names, as requests.
  struct SetParameters {
    int under_way = 0;  // pending client requests
    std::string last;   // the name whose values are active; empty: none was set by name
    std::map<std::string, std::vector<Request>> of;  // values set under each name
    std::vector<Request> before;                     // values before any name set them
    const std::vector<Request>& values(const std::string& name) const {
      const auto own = of.find(name);
      return own == of.end() ? before : own->second;
    }
  };
  // Requests that restore the values set under this name, if only another name has changed them since.
  std::vector<Request> given_back(InstanceIndex instance, const std::string& name) const;
  void accept(const std::string& service);
  void refuse(const std::string& service, const std::string& why);

  const AdapterContext& run_;
  ParameterTable table_;
  std::shared_ptr<AskedNames> names_;
  std::map<InstanceIndex, SetParameters> set_parameters_;  // executor's thread
  struct Refused {
    std::string why;  // reason of the newest refusal of a service; empty: not refused
    HostTime logged{};
  };
  mutable std::mutex mutex_;
  std::map<std::string, Refused> refused_;
  std::vector<std::unique_ptr<UntypedService>> services_;  // destroyed first
};

// Stiffnesses of our Cartesian laws, in world axes, for a 6 x 6 stiffness in the axes of an arm's base
// (column by column). Throws std::invalid_argument if it is not diagonal in the world, where ours are.
Vector6 stiffness_in_world(std::span<const double> K_B, const Matrix3& R_WB);

}  // namespace multipanda::ros
