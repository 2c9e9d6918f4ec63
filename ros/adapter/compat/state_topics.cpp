#include <map>

#include "common/text.hpp"
#include "ros/adapter/compat/state_fields.hpp"
#include "ros/adapter/topic.hpp"

namespace multipanda::ros {
namespace {

bool franka_ros2(const CompatPackages& packages) { return packages.with == RosSection::Compat::franka_ros2; }

StateRules rules_of(const CompatPackages& packages, std::size_t joint_count) {
  return franka_ros2(packages) ? franka_robot_state_rules(joint_count) : franka_state_rules(joint_count);
}

std::vector<std::string> topics_of(const CompatPackages& packages, const std::string& arm, bool single) {
  const std::string usual = "franka_robot_state_broadcaster/robot_state";
  if (franka_ros2(packages)) return {single ? usual : arm + "/" + usual};
  const std::string own = arm + "_state_broadcaster/robot_state";
  return single ? std::vector{own, usual} : std::vector{own};
}

}  // namespace

CompatState::CompatState(const AdapterContext& run, const CompatPackages& packages)
    : run_(run), packages_(packages), models_(run) {
  const auto type =
      MessageType::find(packages.arms, franka_ros2(packages) ? "FrankaRobotState" : "FrankaState");
  const bool single = models_.arms().size() == 1;
  const double period = period_of(run);
  for (const auto& arm : models_.arms()) {
    X_FN_.push_back(arm.frames.X_FE);
    arms_.push_back({StateWriter(type, arm, rules_of(packages, arm.joint_count)),
                     type.make(),
                     RateDivider(run.options->rates_hz.robot_state, period),
                     {}});
    PerArm& made = arms_.back();
    made.writer.prepare(made.message.get());
    if (made.every.off()) continue;
    for (const auto& topic : topics_of(packages, arm.name, single)) {
      made.publishers.push_back(std::make_unique<UntypedPublisher>(
          *run.node, topic, type, Qos::reliable(),
          Doc{made.every.text(period), "State of the arm in the message of the other system."}));
    }
  }
  if (const auto unknown = arms_.front().writer.unknown(); !unknown.empty())
    run.warn("compat/" + type.name(), type.name() + ": left at their defaults: " + joined(unknown));
  if (!franka_ros2(packages)) offer_states();
}

// One service per arm, and per group of arms that a controllet controls.
void CompatState::offer_states() {
  const auto type = ServiceType::find(packages_.modes, "GetRobotStates");
  states_.emplace(type.response, "states");
  for (const auto& arm : models_.arms())
    parts_.emplace_back(states_->type(), arm, rules_of(packages_, arm.joint_count));
  std::map<std::string, std::vector<std::size_t>> resources;
  const auto add = [&](const std::vector<ArmIndex>& arms) {
    resources.emplace(resource_name(*run_.modes, arms, "_and_"),
                      std::vector<std::size_t>(arms.begin(), arms.end()));
  };
  for (ArmIndex a = 0; a < run_.modes->arm_count(); ++a) add({a});
  for (InstanceIndex i = 0; i < run_.modes->instance_count(); ++i) add(run_.modes->instance(i).arm_list());
  for (const auto& [name, arms] : resources) {
    services_.push_back(std::make_unique<UntypedService>(
        *run_.executor, *run_.node, name + "/get_robot_states", type,
        Doc{"", "States of these arms, at the next cycle."},
        [this, arms = arms](const void*, const UntypedService::Reply& reply) {
          const std::lock_guard lock(mutex_);
          // A paused run keeps the newest requests, as many as a service's queue holds.
          if (asked_.size() >= kServiceDepth) asked_.erase(asked_.begin());
          asked_.push_back({arms, reply});
        }));
  }
}

ArmReport CompatState::report(const CycleRecord& record, std::size_t arm) {
  return {record.arms[arm], models_.arms()[arm], models_.terms(arm), X_FN_[arm], run_.stamps.of(record)};
}

void CompatState::answer(const CycleRecord& record) {
  std::vector<Asked> asked;
  {
    const std::lock_guard lock(mutex_);
    asked.swap(asked_);
  }
  for (const auto& one : asked) {
    one.reply([&](void* response) {
      states_->resize(response, one.arms.size());
      for (std::size_t i = 0; i < one.arms.size(); ++i) {
        StateWriter& writer = parts_[one.arms[i]];
        writer.prepare(states_->at(response, i));
        writer.fill(report(record, one.arms[i]), states_->at(response, i));
      }
    });
    run_.count_request(true);
  }
}

void CompatState::take(const CycleRecord& record) {
  models_.take(record);
  for (std::size_t i = 0; i < arms_.size(); ++i) {
    PerArm& arm = arms_[i];
    if (!arm.every.due(record.cycle)) continue;
    bool filled = false;
    for (const auto& publisher : arm.publishers) {
      if (publisher->subscribers() == 0) continue;
      if (!filled) arm.writer.fill(report(record, i), arm.message.get());
      filled = true;
      publisher->publish(arm.message.get());
    }
  }
  answer(record);
}

}  // namespace multipanda::ros
