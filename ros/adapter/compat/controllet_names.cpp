#include "ros/adapter/compat/controllet_names.hpp"

#include <algorithm>
#include <array>
#include <vector>

#include <fmt/format.h>

#include "common/text.hpp"
#include "core/modes/request.hpp"
#include "runtime/request_text.hpp"

namespace multipanda::ros {

namespace {

using Goal = TheirControllet::Goal;
using Parameters = TheirControllet::Parameters;

constexpr const char* kNoJointLawOfTwo =
    "multipanda has no joint law for two arms: request panda_joint_impedance_controller for each arm";

constexpr std::array<TheirControllet, 12> kControllets{{
    {"panda_joint_impedance_controller", "joint_impedance", 1, Goal::joints, Parameters::joints},
    {"comless_panda_joint_impedance_controller", "joint_impedance", 1, Goal::none, Parameters::joints},
    {"panda_joint_velocity_controller", "joint_impedance", 1, Goal::joint_velocity, Parameters::joints},
    {"panda_cartesian_impedance_controller", "cartesian_impedance", 1, Goal::pose, Parameters::cartesian},
    {"comless_panda_cartesian_impedance_controller", "cartesian_impedance", 1, Goal::none,
     Parameters::cartesian},
    {"dual_cartesian_impedance_controller", "dual_cartesian_impedance", 2, Goal::two_poses,
     Parameters::cartesian},
    {"comless_dual_cartesian_impedance_controller", "dual_cartesian_impedance", 2, Goal::none,
     Parameters::cartesian},
    {"twin_cartesian_impedance_controller", "dual_cartesian_impedance", 2, Goal::common_pose,
     Parameters::cartesian},
    // Their goal is an object pose relative to a common base; ours is the pose of the shared frame.
    {"des_coupled_dual_cartesian_impedance_controller", "coupled_dual_cartesian_impedance", 2},
    {"comless_coupled_dual_cartesian_impedance_controller", "coupled_dual_cartesian_impedance", 2},
    {"comless_dual_joint_impedance_controller", nullptr, 2, Goal::none, Parameters::none, kNoJointLawOfTwo},
    {"twin_joint_impedance_controller", nullptr, 2, Goal::none, Parameters::none, kNoJointLawOfTwo},
}};

bool serves(const MultimodeController& modes, InstanceIndex i, const TheirControllet& theirs) {
  const Instance& instance = modes.instance(i);
  return theirs.type != nullptr && instance.descriptor().type == theirs.type &&
         instance.arm_list().size() == theirs.arms;
}

}  // namespace

std::span<const TheirControllet> their_controllets() { return kControllets; }

std::string resource_of(const MultimodeController& modes, InstanceIndex instance) {
  return resource_name(modes, modes.instance(instance).arm_list(), "&");
}

InstanceIndex first_instance(const MultimodeController& modes, const TheirControllet& theirs,
                             const std::string& resource) {
  for (InstanceIndex i = 0; i < modes.instance_count(); ++i) {
    if (serves(modes, i, theirs) && resource_of(modes, i) == resource) return i;
  }
  return kNoInstance;
}

std::optional<InstanceIndex> instance_of(const MultimodeController& modes, const std::string& name,
                                         const std::string& resource, std::string& refusal) {
  if (const InstanceIndex own = modes.find(name); own != kNoInstance) {
    if (resource_of(modes, own) == resource) return own;
    refusal = fmt::format("'{}' controls '{}', not '{}'", name, resource_of(modes, own), resource);
    return {};
  }
  const auto theirs = std::find_if(kControllets.begin(), kControllets.end(),
                                   [&](const TheirControllet& each) { return each.name == name; });
  if (theirs == kControllets.end()) {
    std::vector<std::string> names = instance_names(modes);
    for (const auto& each : kControllets) names.emplace_back(each.name);
    refusal = fmt::format("there is no controllet '{}'{}", name.substr(0, 60), name_hint(name, names, ""));
    return {};
  }
  if (theirs->type == nullptr) {
    refusal = fmt::format("'{}': {}", name, theirs->instead);
    return {};
  }
  if (const InstanceIndex i = first_instance(modes, *theirs, resource); i != kNoInstance) return i;
  std::vector<std::string> others;
  for (InstanceIndex i = 0; i < modes.instance_count(); ++i) {
    if (serves(modes, i, *theirs)) others.push_back("'" + resource_of(modes, i) + "'");
  }
  refusal =
      fmt::format("'{}' on '{}': the scene has no controllet of type '{}' for these arms, in this order; {}",
                  name, resource.substr(0, 60), theirs->type,
                  others.empty() ? "add one to its 'controllets'" : "it has one for " + joined(others));
  return {};
}

std::string their_name(const MultimodeController& modes, InstanceIndex instance) {
  for (const auto& theirs : kControllets) {  // for each type, those with a goal come first
    if (serves(modes, instance, theirs) &&
        first_instance(modes, theirs, resource_of(modes, instance)) == instance)
      return theirs.name;
  }
  return modes.instance(instance).name();
}

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
