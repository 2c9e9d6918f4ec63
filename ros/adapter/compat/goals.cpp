#include "ros/adapter/compat/goals.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <stdexcept>

#include <fmt/format.h>

#include "common/text.hpp"
#include "core/record/arm_config.hpp"
#include "ros/adapter/adapter_part.hpp"
#include "ros/adapter/compat/message_type.hpp"
#include "runtime/request_text.hpp"
#include "scene/build.hpp"

namespace multipanda::ros {

MeasuredArms::MeasuredArms(const RunContext& run) {
  for (std::size_t i = 0; i < run.models.size(); ++i) {
    arms_.push_back({run.models[i]->q_home(), 0, arm_config(run.scene->arms.at(i)).frames.X_FE});
    terms_.emplace_back(run.models[i]);
  }
}

void MeasuredArms::take(const CycleRecord& record) {
  const std::lock_guard lock(mutex_);
  for (std::size_t i = 0; i < arms_.size(); ++i) {
    const ArmSample& sample = record.arms[i];
    arms_[i].q = Eigen::Map<const Eigen::VectorXd>(sample.q.data(), arms_[i].q.size());
    arms_[i].age_s = sample.age_s;
  }
  start_ = record.start;
  seen_ = true;
}

void MeasuredArms::take(const Event& event) {
  ArmFrames frames;
  Load tool, load;
  if (event.arm >= arms_.size() || !read_arm_config(event, frames, tool, load)) return;
  const std::lock_guard lock(mutex_);
  arms_[event.arm].X_FE = frames.X_FE;
}

MeasuredArms::Joints MeasuredArms::joints(ArmIndex arm, HostTime now) const {
  const std::lock_guard lock(mutex_);
  if (!seen_) throw std::invalid_argument("the run has not begun");
  return {arms_[arm].q, arms_[arm].age_s + seconds(now - start_)};
}

Pose MeasuredArms::end_effector(ArmIndex arm, HostTime now) {
  const Joints at = joints(arm, now);
  check_age(at.age_s);
  terms_[arm].update(at.q, JointVector::Zero(at.q.size()));
  const std::lock_guard lock(mutex_);
  return terms_[arm].X_WF() * arms_[arm].X_FE;
}

void check_age(double age_s) {
  if (age_s <= kOldestState) return;
  throw std::invalid_argument(fmt::format(
      "the newest state of the arm is {:.3g} s old, more than {:g}: the run is paused, or this computer is "
      "overloaded",
      age_s, kOldestState));
}

std::string too_far(const Pose& X_goal, const Pose& X_measured) {
  const Vector6 away = pose_error(X_goal, X_measured);
  const double position = away.head<3>().norm(), rotation = away.tail<3>().norm();
  if (!(position <= kFarthestPosition)) {
    return fmt::format(
        "the goal is {:.3g} m away from the end effector, more than {:g}: send goals from where the arm is",
        position, kFarthestPosition);
  }
  if (!(rotation <= kFarthestRotation)) {
    return fmt::format(
        "the goal is turned by {:.3g} rad from the end effector, more than {:g}: send goals from where the "
        "arm is",
        rotation, kFarthestRotation);
  }
  return {};
}

std::string too_far(std::span<const double> q_goal, const JointVector& q_measured) {
  for (std::size_t i = 0; i < q_goal.size(); ++i) {
    const double away = std::abs(q_goal[i] - q_measured[static_cast<Eigen::Index>(i)]);
    if (!(away <= kFarthestJoint)) {
      return fmt::format(
          "joint {}: the goal is {:.3g} rad away from the arm, more than {:g}: send goals from where the arm "
          "is",
          i + 1, away, kFarthestJoint);
    }
  }
  return {};
}

namespace {

using Goal = TheirControllet::Goal;

const char* message_of(Goal goal) {
  switch (goal) {
    case Goal::joints:
      return "JointGoal";
    case Goal::joint_velocity:
      return "VelocityGoal";
    case Goal::two_poses:
      return "DualCartesianImpedanceGoal";
    default:
      return "CartesianImpedanceGoal";
  }
}

InputPort& port_of(const Inputs& inputs, const MultimodeController& modes, InstanceIndex instance,
                   const std::string& input) {
  const std::string name = modes.instance(instance).name() + "/" + input;
  for (const auto& port : inputs.ports()) {
    if (port->name() == name) return *port;
  }
  throw std::invalid_argument("there is no input '" + name + "'");
}

std::vector<double> as_list(const JointVector& v) { return {v.data(), v.data() + v.size()}; }

JointVector as_vector(const std::vector<double>& v) {
  return Eigen::Map<const Eigen::VectorXd>(v.data(), static_cast<Eigen::Index>(v.size()));
}

// Fields of the message that are ignored.
std::string not_followed(Goal goal) {
  switch (goal) {
    case Goal::joints:
      return "qd (velocities follow from the positions)";
    case Goal::joint_velocity:
      return "";
    default:
      return "postures of the null space (a parameter here)";
  }
}

}  // namespace

CompatGoals::CompatGoals(const AdapterContext& run, const CompatPackages& packages, const Inputs& inputs,
                         std::shared_ptr<AskedNames> names)
    : run_(run), names_(std::move(names)), arms_(run) {
  const MultimodeController& modes = *run.modes;
  for (InstanceIndex i = 0; i < modes.instance_count(); ++i) {
    for (const auto& theirs : their_controllets()) {
      if (theirs.goal != Goal::none && theirs.type != nullptr &&
          first_instance(modes, theirs, resource_of(modes, i)) == i)
        open(theirs, i, packages, inputs);
    }
  }
}

CompatGoals::Receive CompatGoals::receive_joints(InputPort& to, const MessageType& type, ArmIndex arm) {
  const Numbers q(type, {"q"}, run_.models[arm]->joint_count());
  return [this, &to, q, arm, key = std::make_shared<char>()](const void* message, double waited_s) {
    const auto goal = q.read(message);
    const MeasuredArms::Joints at = arms_.joints(arm, host_now());
    check_age(at.age_s);
    if (const std::string why = too_far(goal, at.q); !why.empty()) throw std::invalid_argument(why);
    to.receive(goal, "", Delivery::stream, waited_s, key.get());
  };
}

CompatGoals::Receive CompatGoals::receive_velocities(InputPort& to, const MessageType& type, ArmIndex arm,
                                                     InstanceIndex instance) {
  const Numbers qd(type, {"qd"}, run_.models[arm]->joint_count());
  struct Stream {
    VelocityGoal goal;
    std::uint64_t since = 0;
  };
  const VelocityGoal fresh(run_.models[arm]->limits().dq_max, to.spec().timeout_s);
  return [this, &to, qd, arm, instance, fresh, stream = std::make_shared<Stream>(Stream{fresh})](
             const void* message, double waited_s) {
    if (const std::uint64_t since = names_->since(instance); since != stream->since) *stream = {fresh, since};
    const HostTime now = host_now();
    const MeasuredArms::Joints at = arms_.joints(arm, now);
    const JointVector q_d = stream->goal.next(as_vector(qd.read(message)), at.q, at.age_s, now);
    if (!to.receive(as_list(q_d), "", Delivery::stream, waited_s, stream.get())) stream->goal.restart();
  };
}

CompatGoals::Receive CompatGoals::receive_poses(std::vector<PoseGoal> poses, const Instance& law) {
  const std::size_t choice = law.find_parameter("goals");
  return [this, goals = std::make_shared<std::vector<PoseGoal>>(std::move(poses)), choice, &law](
             const void* message, double waited_s) {
    // The law of two arms follows these inputs only with separate goals.
    if (choice < law.parameter_count() && law.parameter(choice)[0] < 0.5)
      throw std::invalid_argument("the parameter goals of '" + law.name() +
                                  "' is 'common': set it to 'separate'");
    take_poses(*goals, message, waited_s);
  };
}

// All poses of a message or none: two hands with different senders would crush or pull the object
// between them.
void CompatGoals::take_poses(const std::vector<PoseGoal>& goals, const void* message, double waited_s) {
  const HostTime now = host_now();
  std::vector<Target> targets;
  double timeout_s = 0;
  for (const auto& goal : goals) {
    auto found = goal.port->admits(goal.numbers.read(message), goal.frame, waited_s, &goals, now);
    if (found.why.empty())
      found.why = too_far(Pose::from(found.target.values.data()), arms_.end_effector(goal.arm, now));
    if (!found.why.empty()) {
      for (const auto& all : goals) all.port->refuse(goal.port->name() + ": " + found.why, found.not_active);
      return;
    }
    targets.push_back(found.target);
    timeout_s = std::max(timeout_s, goal.port->spec().timeout_s);
  }
  const HostTime until = now + std::chrono::nanoseconds(std::llround(1e9 * timeout_s));
  for (std::size_t i = 0; i < goals.size(); ++i) goals[i].port->post(targets[i], &goals, until);
}

std::string CompatGoals::not_asked_for(InstanceIndex instance, const std::string& name) {
  (void)names_->name(instance);  // clears it while the instance is inactive, even if events were lost
  if ((run_.modes->active() & bit(instance)) != 0) return names_->refusal(instance, name);
  return reason(*run_.modes, {.kind = Request::Kind::set_target, .instance = instance}, Verdict::not_active);
}

void CompatGoals::open(const TheirControllet& theirs, InstanceIndex instance, const CompatPackages& packages,
                       const Inputs& inputs) {
  const MultimodeController& modes = *run_.modes;
  const Instance& law = modes.instance(instance);
  const auto type = MessageType::find(packages.modes, message_of(theirs.goal));
  std::vector<InputPort*> ports;
  const auto port = [&](const char* input) -> InputPort& {
    ports.push_back(&port_of(inputs, modes, instance, input));
    return *ports.back();
  };
  const auto pose = [&](const char* input, const char* path, std::size_t i) {
    const ArmIndex arm = law.arm_list()[i];
    return PoseGoal{&port(input), Numbers(type, pose_parts(path), 7), base_frame(modes.arm_name(arm)), arm};
  };

  Receive receive;
  if (theirs.goal == Goal::joints) {
    receive = receive_joints(port("joints"), type, law.arm_list()[0]);
  } else if (theirs.goal == Goal::joint_velocity) {
    receive = receive_velocities(port("joints"), type, law.arm_list()[0], instance);
  } else if (theirs.goal == Goal::pose) {
    receive = receive_poses({pose("pose", "pose", 0)}, law);
  } else {
    const bool two = theirs.goal == Goal::two_poses;
    std::vector<PoseGoal> poses;
    poses.push_back(pose("first_pose", two ? "l_pose" : "pose", 0));
    poses.push_back(pose("second_pose", two ? "r_pose" : "pose", 1));
    receive = receive_poses(std::move(poses), law);
  }
  // The input's port counts such a refusal like any other.
  const auto guarded = [this, ports, receive, instance, name = std::string(theirs.name)](const void* message,
                                                                                         double waited_s) {
    const auto refuse = [&](const std::string& why, bool not_active) {
      for (InputPort* to : ports) to->refuse(why, not_active);
    };
    if (const std::string why = not_asked_for(instance, name); !why.empty()) return refuse(why, true);
    try {
      receive(message, waited_s);
    } catch (const std::invalid_argument& error) {
      refuse(error.what(), false);
    }
  };
  const std::string topic =
      resource_name(modes, law.arm_list(), "_and_") + "/" + theirs.name + "/desired_pose";
  std::string doc = "stream to `~/" + law.name() + "`, in the bases of the arms";
  if (const std::string ignored = not_followed(theirs.goal); !ignored.empty())
    doc += "; not followed: " + ignored;
  subscriptions_.push_back(
      std::make_unique<UntypedSubscription>(*run_.executor, *run_.node, topic, type, Qos::sensor(1),
                                            Doc{"up to 1000 Hz; held when silent", doc + "."}, guarded));
}

JointVector VelocityGoal::next(const JointVector& dq, const JointVector& q, double age_s, HostTime now) {
  const bool again = started_ && seconds(now - last_) <= timeout_s_;
  if (seconds(now - heard_) > timeout_s_) ran_away_.reset();
  heard_ = now;
  started_ = false;
  if (!dq.allFinite()) throw std::invalid_argument("a number is not finite");
  for (Eigen::Index i = 0; i < dq.size(); ++i) {
    if (std::abs(dq[i]) > dq_max_[i]) {
      throw std::invalid_argument(
          fmt::format("joint {}: {:.4g} rad/s is above its limit, {:.4g} rad/s", i + 1, dq[i], dq_max_[i]));
    }
  }
  check_age(age_s);
  if (ran_away_ && ran_away_->side * dq[ran_away_->joint] > 0) {
    throw std::invalid_argument(fmt::format(
        "joint {} did not follow, and may push against something: send 0, a velocity in the other direction, "
        "or nothing for {:g} s",
        ran_away_->joint + 1, timeout_s_));
  }
  ran_away_.reset();
  JointVector q_d = q + kFirst * dq;
  for (Eigen::Index i = 0; again && i < dq.size(); ++i) {
    if (dq[i] != 0) {
      q_d[i] = q_d_[i] + seconds(now - last_) * dq[i];
    } else {
      q_d[i] = dq_[i] == 0 ? q_d_[i] : q[i];
    }
  }
  Eigen::Index farthest = 0;
  if (const double distance = (q_d - q).cwiseAbs().maxCoeff(&farthest); distance > kWindow) {
    ran_away_ = RanAway{farthest, q_d[farthest] > q[farthest] ? 1.0 : -1.0};
    throw std::invalid_argument(
        fmt::format("joint {}: its set-point is {:.4g} rad away from the arm, more than {:g}: the joint "
                    "moves slower than requested",
                    farthest + 1, distance, kWindow));
  }
  q_d_ = q_d;
  dq_ = dq;
  last_ = now;
  started_ = true;
  return q_d_;
}

}  // namespace multipanda::ros
