#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <mutex>
#include <string>

#include "core/modes/multimode_controller.hpp"

namespace multipanda::ros {

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

}  // namespace multipanda::ros
