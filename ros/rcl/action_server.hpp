#pragma once

#include <action_msgs/msg/goal_status.hpp>
#include <action_msgs/msg/goal_status_array.hpp>
#include <action_msgs/srv/cancel_goal.hpp>
#include <array>
#include <chrono>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <utility>
#include <vector>

#include "ros/rcl/publisher.hpp"
#include "ros/rcl/service.hpp"

namespace multipanda::ros {

using Uuid = std::array<std::uint8_t, 16>;

struct GoalDecision {
  bool accepted = false;
  // reason of a rejection; actions have no field for it, so it is passed to Callbacks::refused
  std::string reason;
  static GoalDecision accept() { return {true, ""}; }
  static GoalDecision reject(std::string why) { return {false, std::move(why)}; }
};

// State machine of an action without its types. An action consists of three services (send_goal, cancel_goal,
// get_result) and two topics (feedback, status). Any thread.
class ActionGoals {
 public:
  using Status = std::int8_t;               // action_msgs/msg/GoalStatus
  static constexpr std::size_t kKept = 32;  // number of ended goals whose results are kept

  ActionGoals(Node& node, const std::string& name);

  struct Entry {
    Uuid id{};
    builtin_interfaces::msg::Time accepted;
    Status status = action_msgs::msg::GoalStatus::STATUS_UNKNOWN;
  };
  bool add(const Uuid& id, builtin_interfaces::msg::Time& stamp);  // false: already known
  Status status(const Uuid& id) const;                             // STATUS_UNKNOWN: not known
  bool known(const Uuid& id) const;
  // Returns false if the goal has ended or the transition is not allowed.
  bool change(const Uuid& id, Status status);
  // Returns the goals that a cancel request selects: one goal, all, or all accepted until a time.
  std::vector<Uuid> meant_by(const action_msgs::msg::GoalInfo& info) const;
  // Removes the oldest ended goals beyond kKept and returns their ids.
  std::vector<Uuid> forget();
  bool any_running() const;

 private:
  void publish();
  mutable std::mutex mutex_;
  std::vector<Entry> goals_;
  Publisher<action_msgs::msg::GoalStatusArray> status_;
};

builtin_interfaces::msg::Time system_time();

// An action server. The owner of a goal's shared pointer ends it by succeed(), abort() or canceled(); a goal
// whose owner drops it is aborted. Callbacks run on the executor's thread; the goal's own functions may be
// called from any thread.
template <class A>
class ActionServer {
 public:
  using GoalMessage = typename A::Goal;
  using Result = typename A::Result;
  using Feedback = typename A::Feedback;

 private:
  using SendGoal = typename A::Impl::SendGoalService;
  using GetResult = typename A::Impl::GetResultService;
  using FeedbackMessage = typename A::Impl::FeedbackMessage;
  using CancelGoal = action_msgs::srv::CancelGoal;
  using GoalStatus = action_msgs::msg::GoalStatus;

  struct Shared {  // data needed by goals; outlives the server's entities
    Shared(Node& node, const std::string& name)
        : goals(node, name), feedback(node, name + "/_action/feedback", Qos::reliable(10), Doc{}) {}
    ActionGoals goals;
    Publisher<FeedbackMessage> feedback;
    std::mutex mutex;
    std::map<Uuid, Result> results;
    std::map<Uuid, std::vector<typename Service<GetResult>::Reply>> waiting;

    void end(const Uuid& id, ActionGoals::Status status, const Result& result) {
      const std::lock_guard lock(mutex);
      if (!goals.change(id, status)) return;
      results[id] = result;
      if (auto found = waiting.extract(id))
        for (const auto& reply : found.mapped()) reply(response(status, result));
      for (const Uuid& old : goals.forget()) results.erase(old);
    }
    static typename GetResult::Response response(ActionGoals::Status status, const Result& result) {
      typename GetResult::Response answer;
      answer.status = status;
      answer.result = result;
      return answer;
    }
  };

 public:
  class Goal {
   public:
    Goal(std::shared_ptr<Shared> shared, const Uuid& id, GoalMessage goal)
        : shared_(std::move(shared)), id_(id), goal_(std::move(goal)) {}
    Goal(const Goal&) = delete;
    ~Goal() { abort(Result()); }
    const Uuid& id() const { return id_; }
    const GoalMessage& message() const { return goal_; }
    // These functions do nothing after the goal has ended.
    void feedback(const Feedback& feedback) {
      if (!active()) return;
      FeedbackMessage message;
      message.goal_id.uuid = id_;
      message.feedback = feedback;
      shared_->feedback.publish(message);
    }
    void succeed(const Result& result) { shared_->end(id_, GoalStatus::STATUS_SUCCEEDED, result); }
    void abort(const Result& result) { shared_->end(id_, GoalStatus::STATUS_ABORTED, result); }
    // After a cancel request; also directly from on_cancel.
    void canceled(const Result& result) {
      shared_->goals.change(id_, GoalStatus::STATUS_CANCELING);
      shared_->end(id_, GoalStatus::STATUS_CANCELED, result);
    }
    bool active() const {
      const auto status = shared_->goals.status(id_);
      return status == GoalStatus::STATUS_EXECUTING || status == GoalStatus::STATUS_CANCELING;
    }
    bool cancel_requested() const { return shared_->goals.status(id_) == GoalStatus::STATUS_CANCELING; }

   private:
    std::shared_ptr<Shared> shared_;
    Uuid id_;
    GoalMessage goal_;
  };
  using GoalPtr = std::shared_ptr<Goal>;

  struct Callbacks {
    std::function<GoalDecision(const GoalMessage&)> on_goal;
    std::function<void(GoalPtr)> on_accepted;  // directly after acceptance, with the same goal
    // true: granted, and cancel_requested() returns true from then on
    std::function<bool(const GoalPtr&)> on_cancel;
    std::function<void(const std::string& reason)> refused;  // may be empty
  };

  ActionServer(Executor& executor, Node& node, const std::string& name, const Doc& doc, Callbacks callbacks)
      : callbacks_(std::move(callbacks)),
        shared_(std::make_shared<Shared>(node, name)),
        send_goal_(executor, node, name + "/_action/send_goal", Doc{},
                   [this](const auto& request, auto reply) { take_goal(request, reply); }),
        cancel_goal_(executor, node, name + "/_action/cancel_goal", Doc{},
                     [this](const auto& request, auto reply) { take_cancel(request, reply); }),
        get_result_(executor, node, name + "/_action/get_result", Doc{},
                    [this](const auto& request, auto reply) { take_result(request, reply); }) {
    if (doc.text.empty()) return;
    std::string type = rosidl_generator_traits::name<FeedbackMessage>();  // pkg/action/Name_FeedbackMessage
    type.resize(type.rfind('_'));
    node.describe({"action", node.resolve(name), type, "", doc.rate, doc.text});
  }

 private:
  void take_goal(const typename SendGoal::Request& request, const typename Service<SendGoal>::Reply& reply) {
    typename SendGoal::Response answer;
    GoalDecision decision = shared_->goals.known(request.goal_id.uuid)
                                ? GoalDecision::reject("a goal with this id was sent before")
                                : callbacks_.on_goal(request.goal);
    if (decision.accepted) answer.accepted = shared_->goals.add(request.goal_id.uuid, answer.stamp);
    reply(answer);
    if (!answer.accepted) {
      if (callbacks_.refused) callbacks_.refused(decision.reason);
      return;
    }
    auto goal = std::make_shared<Goal>(shared_, request.goal_id.uuid, request.goal);
    running_[goal->id()] = goal;
    std::erase_if(running_, [](const auto& each) { return each.second.expired(); });
    shared_->goals.change(goal->id(), GoalStatus::STATUS_EXECUTING);
    callbacks_.on_accepted(std::move(goal));
  }

  void take_cancel(const CancelGoal::Request& request, const Service<CancelGoal>::Reply& reply) {
    CancelGoal::Response answer;
    answer.return_code = CancelGoal::Response::ERROR_REJECTED;
    const auto meant = shared_->goals.meant_by(request.goal_info);
    if (meant.empty()) {
      const bool known = shared_->goals.known(request.goal_info.goal_id.uuid);
      answer.return_code =
          known ? CancelGoal::Response::ERROR_GOAL_TERMINATED : CancelGoal::Response::ERROR_UNKNOWN_GOAL_ID;
      if (request.goal_info.goal_id.uuid == Uuid{}) answer.return_code = CancelGoal::Response::ERROR_NONE;
    }
    std::vector<GoalPtr> granted;
    for (const Uuid& id : meant) {
      const auto found = running_.find(id);
      const auto goal = found == running_.end() ? nullptr : found->second.lock();
      if (!goal || !callbacks_.on_cancel(goal)) continue;
      // on_cancel may already have ended the goal.
      if (!shared_->goals.change(id, GoalStatus::STATUS_CANCELING) &&
          shared_->goals.status(id) != GoalStatus::STATUS_CANCELED)
        continue;
      action_msgs::msg::GoalInfo info;
      info.goal_id.uuid = id;
      answer.goals_canceling.push_back(info);
      answer.return_code = CancelGoal::Response::ERROR_NONE;
    }
    reply(answer);
  }

  void take_result(const typename GetResult::Request& request,
                   const typename Service<GetResult>::Reply& reply) {
    const Uuid& id = request.goal_id.uuid;
    const std::lock_guard lock(shared_->mutex);
    const auto found = shared_->results.find(id);
    if (found != shared_->results.end()) {
      reply(Shared::response(shared_->goals.status(id), found->second));
    } else if (shared_->goals.known(id)) {
      shared_->waiting[id].push_back(reply);
    } else {
      reply(Shared::response(GoalStatus::STATUS_UNKNOWN, Result{}));
    }
  }

  Callbacks callbacks_;
  std::shared_ptr<Shared> shared_;
  std::map<Uuid, std::weak_ptr<Goal>> running_;  // executor's thread
  Service<SendGoal> send_goal_;                  // destroyed first, since it uses the others
  Service<CancelGoal> cancel_goal_;
  Service<GetResult> get_result_;
};

}  // namespace multipanda::ros
