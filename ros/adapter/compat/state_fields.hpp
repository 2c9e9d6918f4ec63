#pragma once

#include <cstdint>
#include <memory>
#include <mutex>
#include <string>
#include <utility>
#include <vector>

#include "arm_interface/arm_error.hpp"
#include "ros/adapter/compat/controllet_names.hpp"
#include "ros/adapter/compat/message_type.hpp"
#include "ros/adapter/compat/untyped.hpp"
#include "ros/adapter/state/arm_models.hpp"
#include "ros/adapter/topic.hpp"

namespace multipanda::ros {

// Sources of a message about the state of one arm.
struct ArmReport {
  const ArmSample& sample;
  const ArmModels::Arm& arm;
  ModelTerms& terms;  // at this sample
  const Pose& X_FN;   // nominal end effector: that of the scene at the start
  std::int64_t stamp_ns;
};

using StateRules = std::vector<FieldRule<ArmReport>>;

// franka_msgs/FrankaState of multipanda_ros2, and franka_msgs/FrankaRobotState of franka_ros2: the arm's
// interface in its own names. Poses and wrenches are in the base, transforms column-major, signs as in
// CONVENTIONS.md. What the arm does not report is NaN. `joint_count`: of the arm.
StateRules franka_state_rules(std::size_t joint_count);
StateRules franka_robot_state_rules(std::size_t joint_count);

// Writes such messages. One thread at a time.
class StateWriter {
 public:
  // Throws std::invalid_argument, as FieldMap does.
  StateWriter(const MessageType& type, const ArmModels::Arm& arm, StateRules rules);
  void prepare(void* message) const;  // names and frames, once per message
  void fill(const ArmReport& report, void* message) { map_.fill(report, message); }
  std::vector<std::string> unknown() const;

 private:
  std::vector<std::pair<Text, std::string>> texts_;
  std::vector<std::pair<Texts, std::vector<std::string>>> lists_;
  std::vector<std::string> known_;
  FieldMap<ArmReport> map_;
};

// Name of the flag in the messages Errors of the other system.
std::string error_field(ArmError error);

// Column-major 4 x 4.
void write_transform(const Pose& X, std::span<double> out);
// The pose in a column-major 4 x 4 matrix. Throws std::invalid_argument if it is not a pose; `what`:
// its name.
Pose read_transform(std::span<const double> values, const std::string& what);

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
