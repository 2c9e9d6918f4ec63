#include "ros/adapter/arms/gripper.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include <fmt/format.h>

#include "ros/adapter/arms/arm_requests.hpp"
#include "ros/adapter/arms/arm_services.hpp"
#include "ros/adapter/state/messages.hpp"

namespace multipanda::ros {
namespace {

constexpr double kFeedbackRate = 20;  // [Hz]
constexpr std::size_t kFingers = 2;

double not_negative(double value, const char* what) {
  if (std::isfinite(value) && value >= 0) return value;
  throw std::invalid_argument(fmt::format("{}: expected 0 or more, found {:.4g}", what, value));
}

}  // namespace

GripperRequest read_gripper_command(const control_msgs::action::GripperCommand::Goal& goal, double width,
                                    double max_width) {
  const double target = 2 * not_negative(goal.command.position, "command.position (of a finger) [m]");
  const double effort = not_negative(goal.command.max_effort, "command.max_effort [N]");
  if (max_width > 0 && target > max_width + 1e-3)
    throw std::invalid_argument(fmt::format(
        "command.position: a finger opens by at most {:.4g} m, found {:.4g} m", max_width / 2, target / 2));
  if (effort == 0 || target >= width)
    return GripperMove{.width = std::min(target, max_width > 0 ? max_width : target)};
  return GripperGrasp{
      .width = target, .force = effort, .tolerance_inner = target, .tolerance_outer = max_width};
}

Gripper::Gripper(const AdapterContext& run, ArmIndex arm)
    : run_(run),
      arm_(arm),
      prefix_(run.modes->arm_name(arm) + "_gripper/"),
      joints_(*run.node, prefix_ + "joint_states", Qos::reliable(), run.options->rates_hz.gripper,
              period_of(run), "The two fingers; each position is half of the width between them [m]."),
      feedback_due_(kFeedbackRate, period_of(run)),
      stop_(*run.stops, *run.node, prefix_ + "stop",
            Doc{"", "Stops the fingers and releases the grasp. A running goal is aborted."},
            [this](const auto&, auto reply) {
              request_arm(run_, arm_, GripperStop{}, kArmTimeout, [this, reply](const RequestAnswer& answer) {
                reply(response_of<std_srvs::srv::Trigger::Response>(run_, answer));
              });
            }) {
  for (std::size_t finger = 1; finger <= kFingers; ++finger)
    joints_.message.name.push_back(fmt::format("{}_finger_joint{}", run.modes->arm_name(arm), finger));
  joints_.message.position.assign(kFingers, 0);

  const auto feedback = [](auto& message, const Width& now) { message.current_width = now.now; };
  const auto result = [](auto& message, const auto&, const Width&, const RequestAnswer& answer) {
    message.success = answer.success;
    message.error = answer.reason;
  };
  homing_ = offer<Homing>(
      "homing", "Opens and closes the fingers to find the largest width.",
      [](const Homing::Goal&) { return GripperHoming{}; }, feedback, result);
  move_ = offer<Move>(
      "move", "Moves the fingers to a width [m] at a speed [m/s].",
      [](const Move::Goal& goal) {
        return GripperMove{goal.width, goal.speed};
      },
      feedback, result);
  grasp_ = offer<Grasp>(
      "grasp", "Closes or opens the fingers until they meet an object, and holds it with a force [N].",
      [](const Grasp::Goal& goal) {
        return GripperGrasp{.width = goal.width,
                            .speed = goal.speed,
                            .force = goal.force,
                            .tolerance_inner = goal.epsilon.inner,
                            .tolerance_outer = goal.epsilon.outer};
      },
      feedback, result);
  command_ = offer<Command>(
      "gripper_action",
      "Gripper action of MoveIt: position of a finger, half of the width [m]. max_effort 0 moves the "
      "fingers; above 0, closing grasps what they meet [N].",
      [this](const Command::Goal& goal) {
        const Width now = width();
        return read_gripper_command(goal, now.now, now.max);
      },
      [](Command::Feedback& message, const Width& now) {
        message.position = now.now / 2;
        message.stalled = now.grasped;
      },
      [](Command::Result& message, const Command::Goal& goal, const Width& now, const RequestAnswer& answer) {
        message.position = now.now / 2;
        message.effort = now.grasped ? goal.command.max_effort : 0;
        message.stalled = now.grasped;
        message.reached_goal = answer.success;
      });
}

template <class A>
std::unique_ptr<ActionServer<A>> Gripper::offer(
    const std::string& name, const std::string& doc,
    std::function<GripperRequest(const typename A::Goal&)> read,
    std::function<void(typename A::Feedback&, const Width&)> fill,
    std::function<void(typename A::Result&, const typename A::Goal&, const Width&, const RequestAnswer&)>
        conclude) {
  using Goal = typename ActionServer<A>::GoalPtr;
  const auto refuse = [this, conclude, name](const Goal& goal, const std::string& why) {
    typename A::Result result;
    conclude(result, goal->message(), width(), {.success = false, .reason = why});
    // GripperCommand has no field for the reason.
    if constexpr (std::is_same_v<A, Command>) run_.warn(prefix_ + name, prefix_ + name + ": " + why);
    run_.count_request(false);
    goal->abort(result);
  };
  typename ActionServer<A>::Callbacks callbacks;
  // A goal is always accepted, since a rejection carries no text; its result has the reason of a failure.
  callbacks.on_goal = [](const typename A::Goal&) { return GoalDecision::accept(); };
  callbacks.on_accepted = [this, read, fill, conclude, refuse](Goal goal) {
    GripperRequest request;
    try {
      request = read(goal->message());
    } catch (const std::invalid_argument& error) {
      return refuse(goal, error.what());
    }
    if (const std::string why = check(request); !why.empty()) return refuse(goal, why);
    auto running = std::make_shared<Running>();
    running->feedback = [goal, fill](const Width& now) {
      typename A::Feedback feedback;
      fill(feedback, now);
      goal->feedback(feedback);
    };
    {
      const std::lock_guard lock(mutex_);
      if (running_) running_->preempted = true;
      running_ = running;
    }
    request_arm(run_, arm_, std::move(request), kGripperTimeout,
                [this, goal, conclude, refuse, running](const RequestAnswer& answer) {
                  bool preempted = false;
                  {
                    const std::lock_guard lock(mutex_);
                    preempted = running->preempted;
                    if (running_ == running) running_ = nullptr;
                  }
                  if (!answer.success && !goal->cancel_requested())
                    return refuse(goal, preempted ? "a newer goal took over" : answer.reason);
                  typename A::Result result;
                  conclude(result, goal->message(), width(), answer);
                  run_.count_request(true);
                  if (answer.success) {
                    goal->succeed(result);
                  } else {
                    goal->canceled(result);
                  }
                });
  };
  callbacks.on_cancel = [this](const Goal&) {
    request_arm(run_, arm_, GripperStop{}, kArmTimeout, [](const RequestAnswer&) {});
    return true;
  };
  return std::make_unique<ActionServer<A>>(*run_.executor, *run_.node, prefix_ + name, Doc{"", doc},
                                           std::move(callbacks));
}

Gripper::Width Gripper::width() const {
  const std::lock_guard lock(mutex_);
  return width_;
}

void Gripper::take(const CycleRecord& record) {
  const ArmSample& arm = record.arms[arm_];
  std::shared_ptr<Running> running;
  const Width now{arm.gripper_width, arm.gripper_max_width, arm.gripper_grasped, arm.gripper_moving};
  {
    const std::lock_guard lock(mutex_);
    width_ = now;
    running = running_;
  }
  if (feedback_due_.due(record.cycle) && running) running->feedback(now);
  if (!joints_.due(record.cycle)) return;
  joints_.message.header.stamp = to_time(run_.stamps.of(record));
  joints_.message.position.assign(kFingers, now.now / 2);
  joints_.publish();
}

}  // namespace multipanda::ros
