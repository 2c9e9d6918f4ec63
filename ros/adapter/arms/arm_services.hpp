#pragma once

#include <memory>
#include <string>
#include <vector>

#include "ros/adapter/part.hpp"
#include "ros/rcl/executor.hpp"

namespace multipanda::ros {

// Services of one arm that its backend answers: recovery, loads, frames, stiffnesses, thresholds of contact;
// each also under the name that users of the reference system know.
class ArmServices : public Part {
 public:
  ArmServices(const AdapterWorld& world, ArmIndex arm);

 private:
  // Service `type` under the arm's name and, if there is one, under the alias. `read` may throw
  // std::invalid_argument, which refuses.
  template <class S>
  void offer(const std::string& name, const std::string& alias, const std::string& doc,
             std::function<ArmRequest(const typename S::Request&)> read);

  const AdapterWorld& world_;
  const ArmIndex arm_;
  std::vector<std::unique_ptr<Incoming>> services_;
};

}  // namespace multipanda::ros
