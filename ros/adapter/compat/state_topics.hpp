#pragma once

#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "ros/adapter/compat/packages.hpp"
#include "ros/adapter/compat/state_fields.hpp"
#include "ros/adapter/compat/untyped.hpp"
#include "ros/adapter/rate_divider.hpp"

namespace multipanda::ros {

// The arms' states in the messages of multipanda_ros2 or franka_ros2, at the rate of <arm>/robot_state:
//   multipanda_ros2  <arm>_state_broadcaster/robot_state, franka_robot_state_broadcaster/robot_state of a
//                    single arm, and the services <resources>/get_robot_states
//   franka_ros2      <arm>/franka_robot_state_broadcaster/robot_state, without <arm>/ for a single arm
class CompatState : public AdapterPart {
 public:
  // Throws std::invalid_argument for missing types, and for types that do not fit.
  CompatState(const AdapterContext& run, const CompatPackages& packages);
  void take(const CycleRecord& record) override;
  void take(const Event& event) override { models_.take(event); }

 private:
  struct PerArm {
    StateWriter writer;
    std::shared_ptr<void> message;
    RateDivider every;
    std::vector<std::unique_ptr<UntypedPublisher>> publishers;
  };
  struct Asked {
    std::vector<std::size_t> arms;
    UntypedService::Reply reply;
  };
  void offer_states();
  ArmReport report(const CycleRecord& record, std::size_t arm);
  void answer(const CycleRecord& record);

  const AdapterContext& run_;
  const CompatPackages packages_;
  ArmModels models_;
  std::vector<Pose> X_FN_;
  std::vector<PerArm> arms_;
  std::vector<StateWriter> parts_;  // of answers, one per arm
  std::optional<Parts> states_;
  std::mutex mutex_;
  std::vector<Asked> asked_;  // until the next record
  std::vector<std::unique_ptr<UntypedService>> services_;
};

}  // namespace multipanda::ros
