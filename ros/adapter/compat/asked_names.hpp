#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <mutex>
#include <string>

#include "core/modes/multimode_controller.hpp"

namespace multipanda::ros {

// By which of their names each of our controllets was activated. Several of theirs are one of ours here,
// which takes goals only under that name: a controllet without goals is asked for to keep the arm at rest.
class AskedNames {
 public:
  explicit AskedNames(const MultimodeController& modes) : modes_(modes) {}

  void take(const Event& event);  // publisher's thread: what any other way in starts or stops

  // --- executor's thread ---
  // From ask() to answered() the instances take no goals under any name: those were sent before the switch.
  void ask(InstanceSet instances);
  void answered(InstanceSet instances);
  bool about_to_start(InstanceIndex instance) const { return asking_[instance] > 0; }
  // The loop has started an instance in the answer's cycle, because it was asked for by `name`. This holds
  // until it starts or stops in a later one.
  void accept(InstanceIndex instance, const std::string& name, const Answer& answer);

  // The name of the request that started it; otherwise their_name().
  std::string name(InstanceIndex instance);
  // Why it takes no goals under this name; empty: it does.
  std::string refusal(InstanceIndex instance, const std::string& asking);
  // The newest cycle known in which it started or stopped; 0: none.
  std::uint64_t since(InstanceIndex instance) const;

 private:
  struct Asked {
    std::string name;
    std::uint64_t cycle = 0, ticket = 0;
  };
  std::uint64_t changed(InstanceIndex instance) const;

  const MultimodeController& modes_;
  std::map<InstanceIndex, Asked> asked_;                // executor's thread
  std::array<std::uint32_t, kMaxInstances> asking_{};   // requests under way; executor's thread
  mutable std::mutex mutex_;                            // guards:
  std::array<std::uint64_t, kMaxInstances> changed_{};  // newest cycle in which it started or stopped
};

}  // namespace multipanda::ros
