#include <algorithm>
#include <chrono>
#include <random>

#include "ros/rcl/action_client.hpp"
#include "ros/rcl/action_server.hpp"

namespace multipanda::ros {

namespace {

using action_msgs::msg::GoalStatus;

bool over(ActionGoals::Status status) {
  return status == GoalStatus::STATUS_SUCCEEDED || status == GoalStatus::STATUS_CANCELED ||
         status == GoalStatus::STATUS_ABORTED;
}

// The state machine of a goal, from the ROS 2 design article "Actions".
bool may_follow(ActionGoals::Status from, ActionGoals::Status to) {
  switch (to) {
    case GoalStatus::STATUS_EXECUTING:
      return from == GoalStatus::STATUS_ACCEPTED;
    case GoalStatus::STATUS_CANCELING:
      return from == GoalStatus::STATUS_ACCEPTED || from == GoalStatus::STATUS_EXECUTING;
    case GoalStatus::STATUS_CANCELED:
      return from == GoalStatus::STATUS_CANCELING;
    case GoalStatus::STATUS_SUCCEEDED:
    case GoalStatus::STATUS_ABORTED:
      return from == GoalStatus::STATUS_EXECUTING || from == GoalStatus::STATUS_CANCELING;
    default:
      return false;
  }
}

bool not_after(const builtin_interfaces::msg::Time& a, const builtin_interfaces::msg::Time& b) {
  return a.sec < b.sec || (a.sec == b.sec && a.nanosec <= b.nanosec);
}

}  // namespace

builtin_interfaces::msg::Time system_time() {
  const auto now = std::chrono::duration_cast<std::chrono::nanoseconds>(
                       std::chrono::system_clock::now().time_since_epoch())
                       .count();
  builtin_interfaces::msg::Time time;
  time.sec = static_cast<std::int32_t>(now / 1'000'000'000);
  time.nanosec = static_cast<std::uint32_t>(now % 1'000'000'000);
  return time;
}

Uuid random_uuid() {
  static std::mutex mutex;
  static std::random_device device;
  const std::lock_guard lock(mutex);
  Uuid id;
  for (auto& byte : id) byte = static_cast<std::uint8_t>(device());
  return id;
}

ActionGoals::ActionGoals(Node& node, const std::string& name)
    : status_(node, name + "/_action/status", Qos::latched(), Doc{}) {}

bool ActionGoals::add(const Uuid& id, builtin_interfaces::msg::Time& stamp) {
  const std::lock_guard lock(mutex_);
  if (std::ranges::find(goals_, id, &Entry::id) != goals_.end()) return false;
  stamp = system_time();
  goals_.push_back({id, stamp, GoalStatus::STATUS_ACCEPTED});
  publish();
  return true;
}

ActionGoals::Status ActionGoals::status(const Uuid& id) const {
  const std::lock_guard lock(mutex_);
  const auto found = std::ranges::find(goals_, id, &Entry::id);
  return found == goals_.end() ? Status{GoalStatus::STATUS_UNKNOWN} : found->status;
}

bool ActionGoals::known(const Uuid& id) const { return status(id) != GoalStatus::STATUS_UNKNOWN; }

bool ActionGoals::change(const Uuid& id, Status status) {
  const std::lock_guard lock(mutex_);
  const auto found = std::ranges::find(goals_, id, &Entry::id);
  if (found == goals_.end() || !may_follow(found->status, status)) return false;
  found->status = status;
  publish();
  return true;
}

std::vector<Uuid> ActionGoals::meant_by(const action_msgs::msg::GoalInfo& info) const {
  const std::lock_guard lock(mutex_);
  const bool any_id = info.goal_id.uuid == Uuid{};
  const bool any_time = info.stamp.sec == 0 && info.stamp.nanosec == 0;
  std::vector<Uuid> meant;
  for (const Entry& goal : goals_) {
    if (over(goal.status)) continue;
    const bool by_id = !any_id && goal.id == info.goal_id.uuid;
    const bool by_time = !any_time && not_after(goal.accepted, info.stamp);
    if (by_id || by_time || (any_id && any_time)) meant.push_back(goal.id);
  }
  return meant;
}

std::vector<Uuid> ActionGoals::forget() {
  const std::lock_guard lock(mutex_);
  auto surplus = std::ranges::count_if(goals_, [](const Entry& goal) { return over(goal.status); }) -
                 static_cast<std::ptrdiff_t>(kKept);
  std::vector<Uuid> forgotten;
  std::erase_if(goals_, [&](const Entry& goal) {
    if (surplus <= 0 || !over(goal.status)) return false;
    --surplus;
    forgotten.push_back(goal.id);
    return true;
  });
  return forgotten;
}

bool ActionGoals::any_running() const {
  const std::lock_guard lock(mutex_);
  return std::ranges::any_of(goals_, [](const Entry& goal) { return !over(goal.status); });
}

void ActionGoals::publish() {
  action_msgs::msg::GoalStatusArray message;
  for (const Entry& goal : goals_) {
    GoalStatus status;
    status.goal_info.goal_id.uuid = goal.id;
    status.goal_info.stamp = goal.accepted;
    status.status = goal.status;
    message.status_list.push_back(status);
  }
  status_.publish(message);
}

}  // namespace multipanda::ros
