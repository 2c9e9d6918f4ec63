#include "ros/adapter/compat/asked_names.hpp"

#include <algorithm>

#include <fmt/format.h>

#include "core/modes/request.hpp"
#include "ros/adapter/compat/controllet_names.hpp"

namespace multipanda::ros {

void AskedNames::take(const Event& event) {
  if (event.kind != EventKind::switched) return;
  const std::lock_guard lock(mutex_);
  for_each(InstanceSet{event.started | event.stopped},
           [&](InstanceIndex i) { changed_[i] = std::max(changed_[i], event.cycle); });
}

std::uint64_t AskedNames::changed(InstanceIndex instance) const {
  const std::lock_guard lock(mutex_);
  return changed_[instance];
}

void AskedNames::ask(InstanceSet instances) {
  for_each(instances, [&](InstanceIndex i) { ++asking_[i]; });
}

void AskedNames::answered(InstanceSet instances) {
  for_each(instances, [&](InstanceIndex i) { --asking_[i]; });
}

void AskedNames::accept(InstanceIndex instance, const std::string& name, const Answer& answer) {
  Asked& asked = asked_[instance];
  if (answer.ticket < asked.ticket) return;  // answers may arrive in any order
  asked = {name, answer.cycle, answer.ticket};
}

std::string AskedNames::name(InstanceIndex instance) {
  if (const auto asked = asked_.find(instance); asked != asked_.end()) {
    const bool active = (modes_.active() & bit(instance)) != 0;
    if (active && changed(instance) <= asked->second.cycle) return asked->second.name;
    asked_.erase(asked);  // stopped or started by another request since
  }
  return their_name(modes_, instance);
}

std::string AskedNames::refusal(InstanceIndex instance, const std::string& asking) {
  if (about_to_start(instance)) return "set_controllers is about to start the controllet again";
  const std::string active = name(instance);
  if (active == asking) return {};
  return fmt::format("'{}' is active as '{}': request '{}' by set_controllers first",
                     modes_.instance(instance).name(), active, asking);
}

std::uint64_t AskedNames::since(InstanceIndex instance) const {
  const auto asked = asked_.find(instance);
  return std::max(changed(instance), asked == asked_.end() ? 0 : asked->second.cycle);
}

}  // namespace multipanda::ros
