#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <mutex>
#include <optional>
#include <span>
#include <string>

#include "core/modes/multimode_controller.hpp"
#include "ros/adapter/adapter_part.hpp"

namespace multipanda::ros {

// The controllets of multipanda_ros2 and their counterparts here.
struct TheirControllet {
  enum class Goal { none, joints, joint_velocity, pose, common_pose, two_poses };
  enum class Parameters { none, joints, cartesian };
  const char* name;
  const char* type;  // type of our controllet; nullptr: none, see `instead`
  std::size_t arms = 1;
  Goal goal = Goal::none;
  Parameters parameters = Parameters::none;
  const char* instead = "";
};

std::span<const TheirControllet> their_controllets();

// The instance for a name and a resource ("left", "left&right") of multipanda_ros2: the first one in the
// scene of that type and with those arms. Instance names are also valid. Returns nothing and fills `refusal`
// if there is none.
std::optional<InstanceIndex> instance_of(const MultimodeController& modes, const std::string& name,
                                         const std::string& resource, std::string& refusal);

// The first instance of that type and these arms; kNoInstance: none.
InstanceIndex first_instance(const MultimodeController& modes, const TheirControllet& theirs,
                             const std::string& resource);
// "left&right"
std::string resource_of(const MultimodeController& modes, InstanceIndex instance);
// The name in multipanda_ros2 for an instance, of those with a goal if there are any; otherwise its own.
std::string their_name(const MultimodeController& modes, InstanceIndex instance);

// The name in multipanda_ros2 under which each controllet was activated. Several of their names may share one
// controllet, which then takes goals only under its active name: a controllet requested without goals must
// keep the arm at rest.
class AskedNames {
 public:
  explicit AskedNames(const MultimodeController& modes) : modes_(modes) {}

  void take(const Event& event);  // publisher's thread: starts and stops requested in other ways

  // --- executor's thread ---
  // Between ask() and answered() the instances take no goals under any name: such goals were sent before
  // the switch.
  void ask(InstanceSet instances);
  void answered(InstanceSet instances);
  bool about_to_start(InstanceIndex instance) const { return asking_[instance] > 0; }
  // The loop started an instance in the answer's cycle, on request under `name`. Valid until it starts or
  // stops in a later cycle.
  void accept(InstanceIndex instance, const std::string& name, const Answer& answer);

  // The name in the request that started it; otherwise their_name().
  std::string name(InstanceIndex instance);
  // Why goals under this name are refused; empty: they are not.
  std::string refusal(InstanceIndex instance, const std::string& asking);
  // The newest known cycle in which it started or stopped; 0: none.
  std::uint64_t since(InstanceIndex instance) const;

 private:
  struct Asked {
    std::string name;
    std::uint64_t cycle = 0, ticket = 0;
  };
  std::uint64_t changed(InstanceIndex instance) const;

  const MultimodeController& modes_;
  std::map<InstanceIndex, Asked> asked_;                // executor's thread
  std::array<std::uint32_t, kMaxInstances> asking_{};   // pending requests; executor's thread
  mutable std::mutex mutex_;                            // protects:
  std::array<std::uint64_t, kMaxInstances> changed_{};  // newest cycle in which it started or stopped
};

// The system whose names and types a run offers besides its own, and the packages of its messages.
struct CompatPackages {
  RosSection::Compat with = RosSection::Compat::none;
  std::string arms = "franka_msgs", modes = "multi_mode_control_msgs";
};

// "left", or "left_and_right", as in the names of topics.
inline std::string resource_name(const MultimodeController& modes, const std::vector<ArmIndex>& arms,
                                 const char* between) {
  std::string name;
  for (const ArmIndex arm : arms) name += (name.empty() ? "" : between) + modes.arm_name(arm);
  return name;
}

}  // namespace multipanda::ros
