#pragma once

#include <functional>
#include <future>
#include <map>
#include <mutex>
#include <string>
#include <utility>

#include "ros/rcl/action_server.hpp"
#include "ros/rcl/publisher.hpp"
#include "ros/rcl/service.hpp"

namespace multipanda::ros {

Uuid random_uuid();

// Calls an action. For tests and the project's own nodes.
template <class A>
class ActionClient {
  using SendGoal = typename A::Impl::SendGoalService;
  using GetResult = typename A::Impl::GetResultService;
  using FeedbackMessage = typename A::Impl::FeedbackMessage;
  using CancelGoal = action_msgs::srv::CancelGoal;

 public:
  using Feedback = std::function<void(const typename A::Feedback&)>;  // executor's thread
  ActionClient(Executor& executor, Node& node, const std::string& name)
      : send_goal_(executor, node, name + "/_action/send_goal"),
        cancel_goal_(executor, node, name + "/_action/cancel_goal"),
        get_result_(executor, node, name + "/_action/get_result"),
        feedback_(executor, node, name + "/_action/feedback", Qos::reliable(100), Doc{},
                  [this](const FeedbackMessage& message) { take(message); }) {}

  bool wait_until_ready(double timeout_s) const {
    return send_goal_.wait_until_ready(timeout_s) && cancel_goal_.wait_until_ready(timeout_s) &&
           get_result_.wait_until_ready(timeout_s);
  }
  // The response tells whether the goal was accepted.
  std::future<typename SendGoal::Response> send(const Uuid& id, const typename A::Goal& goal,
                                                Feedback feedback = nullptr) {
    {
      const std::lock_guard lock(mutex_);
      listeners_.try_emplace(id, std::move(feedback));
    }
    typename SendGoal::Request request;
    request.goal_id.uuid = id;
    request.goal = goal;
    return send_goal_.call(request);
  }
  // Ready when the goal has ended; status as in action_msgs/msg/GoalStatus.
  std::future<typename GetResult::Response> result(const Uuid& id) {
    typename GetResult::Request request;
    request.goal_id.uuid = id;
    return get_result_.call(request);
  }
  std::future<CancelGoal::Response> cancel(const Uuid& id) {
    CancelGoal::Request request;
    request.goal_info.goal_id.uuid = id;
    return cancel_goal_.call(request);
  }

 private:
  void take(const FeedbackMessage& message) {
    Feedback listener;
    {
      const std::lock_guard lock(mutex_);
      const auto found = listeners_.find(message.goal_id.uuid);
      if (found != listeners_.end()) listener = found->second;
    }
    if (listener) listener(message.feedback);
  }

  std::mutex mutex_;
  std::map<Uuid, Feedback> listeners_;
  Client<SendGoal> send_goal_;
  Client<CancelGoal> cancel_goal_;
  Client<GetResult> get_result_;
  Subscription<FeedbackMessage> feedback_;
};

}  // namespace multipanda::ros
