#pragma once

#include <memory>
#include <string>
#include <vector>

#include "ros/adapter/adapter_part.hpp"
#include "ros/rcl/executor.hpp"

namespace multipanda::ros {

// Services of one arm that its backend answers: recovery, loads, frames, stiffnesses, contact thresholds.
// Each also has its name in multipanda_ros2.
class ArmServices : public AdapterPart {
 public:
  ArmServices(const AdapterContext& run, ArmIndex arm);

 private:
  // Offers service S under the arm's name and, if `alias` is not empty, under the alias. `read` may throw
  // std::invalid_argument, which refuses the request.
  template <class S>
  void offer(const std::string& name, const std::string& alias, const std::string& doc,
             std::function<ArmRequest(const typename S::Request&)> read);

  const AdapterContext& run_;
  const ArmIndex arm_;
  std::vector<std::unique_ptr<Incoming>> services_;
};

}  // namespace multipanda::ros
