#pragma once

#include <memory>
#include <string>
#include <vector>

#include "ros/adapter/compat/asked_names.hpp"
#include "ros/adapter/compat/controllet_names.hpp"
#include "ros/adapter/compat/measured_arms.hpp"
#include "ros/adapter/compat/numbers.hpp"
#include "ros/adapter/compat/packages.hpp"
#include "ros/adapter/compat/untyped.hpp"
#include "ros/adapter/controllets/inputs.hpp"

namespace multipanda::ros {

// The goals of multipanda_ros2, /<resources>/<its controllet>/desired_pose, as streams of our inputs, with
// their checks, limits and timeouts. Also refuses goals under a name that was not requested, goals far from
// the arm, and goals while the arm's state is too old.
class CompatGoals : public AdapterPart {
 public:
  // Throws std::invalid_argument for missing or unsuitable types.
  CompatGoals(const AdapterContext& run, const CompatPackages& packages, const Inputs& inputs,
              std::shared_ptr<AskedNames> names);
  void take(const CycleRecord& record) override { arms_.take(record); }
  void take(const Event& event) override { arms_.take(event); }

 private:
  using Receive = UntypedSubscription::Callback;  // may throw std::invalid_argument, which refuses the
                                                  // message
  // One pose of a message for one input, in the base of the input's arm.
  struct PoseGoal {
    InputPort* port;
    Numbers numbers;
    std::string frame;
    ArmIndex arm;
  };
  void open(const TheirControllet& theirs, InstanceIndex instance, const CompatPackages& packages,
            const Inputs& inputs);
  Receive receive_joints(InputPort& to, const MessageType& type, ArmIndex arm);
  Receive receive_velocities(InputPort& to, const MessageType& type, ArmIndex arm, InstanceIndex instance);
  Receive receive_poses(std::vector<PoseGoal> goals, const Instance& law);
  void take_poses(const std::vector<PoseGoal>& goals, const void* message, double waited_s);
  std::string not_asked_for(InstanceIndex instance, const std::string& name);

  const AdapterContext& run_;
  std::shared_ptr<AskedNames> names_;
  MeasuredArms arms_;
  std::vector<std::unique_ptr<UntypedSubscription>> subscriptions_;
};

}  // namespace multipanda::ros
