#include "ros/adapter/compat/goals.hpp"

#include <algorithm>
#include <stdexcept>

#include <fmt/format.h>

#include "ros/adapter/compat/numbers.hpp"
#include "ros/adapter/names.hpp"
#include "support/spelling.hpp"

namespace multipanda::ros {
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

Numbers pose_numbers(const MessageType& type, const std::string& path) {
  std::vector<std::string> paths;
  for (const char* part : {"position.x", "position.y", "position.z", "orientation.w", "orientation.x",
                           "orientation.y", "orientation.z"})
    paths.push_back(path + "." + part);
  return {type, paths, 7};  // in the order of Target
}

InputPort& port_of(const Inputs& inputs, const MultimodeController& modes, InstanceIndex instance,
                   const std::string& input) {
  const std::string name = modes.instance(instance).name() + "/" + input;
  for (const auto& port : inputs.ports()) {
    if (port->name() == name) return *port;
  }
  throw std::invalid_argument("there is no input '" + name + "'");
}

// One pose of a message for one input, in the base of the input's arm.
struct PoseGoal {
  InputPort* port;
  Numbers numbers;
  std::string frame;
};

// All poses of a message or none.
void receive(const std::vector<PoseGoal>& goals, const void* message, double waited_s) {
  std::vector<std::vector<double>> values;
  for (const auto& goal : goals) {
    values.push_back(goal.numbers.read(message));
    const std::string why = goal.port->problem(values.back(), goal.frame);
    if (why.empty()) continue;
    for (const auto& refused : goals) refused.port->refuse(goal.port->name() + ": " + why);
    return;
  }
  for (std::size_t i = 0; i < goals.size(); ++i)
    goals[i].port->receive(values[i], goals[i].frame, Delivery::stream, waited_s, &goals);
}

std::vector<double> as_list(const JointVector& v) { return {v.data(), v.data() + v.size()}; }

JointVector as_vector(const std::vector<double>& v) {
  return Eigen::Map<const Eigen::VectorXd>(v.data(), static_cast<Eigen::Index>(v.size()));
}

// Fields of the message that nothing here follows.
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

JointVector VelocityGoal::next(const JointVector& dq, const JointVector& q, HostTime now) {
  const bool again = started_ && seconds(now - last_) <= timeout_s_;
  started_ = false;
  if (!dq.allFinite()) throw std::invalid_argument("a number is not finite");
  for (Eigen::Index i = 0; i < dq.size(); ++i) {
    if (std::abs(dq[i]) > dq_max_[i]) {
      throw std::invalid_argument(
          fmt::format("joint {}: {:.4g} rad/s is above its limit, {:.4g} rad/s", i + 1, dq[i], dq_max_[i]));
    }
  }
  const JointVector q_d =
      again ? JointVector(q_d_ + seconds(now - last_) * dq) : JointVector(q + kFirst * dq);
  Eigen::Index farthest = 0;
  if (const double distance = (q_d - q).cwiseAbs().maxCoeff(&farthest); distance > kWindow) {
    throw std::invalid_argument(fmt::format(
        "joint {}: its set-point ran {:.4g} rad away from the arm, more than {:g}: it moves slower than "
        "requested",
        farthest + 1, distance, kWindow));
  }
  q_d_ = q_d;
  last_ = now;
  started_ = true;
  return q_d_;
}

CompatGoals::CompatGoals(const AdapterContext& run, const CompatPackages& packages, const Inputs& inputs)
    : run_(run), q_(run.modes->arm_count()) {
  const MultimodeController& modes = *run.modes;
  for (InstanceIndex i = 0; i < modes.instance_count(); ++i) {
    for (const auto& theirs : their_controllets()) {
      if (theirs.goal != Goal::none && theirs.type != nullptr &&
          first_instance(modes, theirs, resource_of(modes, i)) == i)
        open(theirs, i, packages, inputs);
    }
  }
}

void CompatGoals::take(const CycleRecord& record) {
  const std::lock_guard lock(mutex_);
  for (std::size_t a = 0; a < q_.size(); ++a) q_[a] = record.arms[a].q;
  seen_ = true;
}

JointVector CompatGoals::measured(ArmIndex arm) const {
  const std::lock_guard lock(mutex_);
  if (!seen_) throw std::invalid_argument("the run has not begun");
  const auto n = static_cast<Eigen::Index>(run_.models[arm]->joint_count());
  return Eigen::Map<const Eigen::VectorXd>(q_[arm].data(), n);
}

void CompatGoals::open(const TheirControllet& theirs, InstanceIndex instance, const CompatPackages& packages,
                       const Inputs& inputs) {
  const MultimodeController& modes = *run_.modes;
  const Instance& law = modes.instance(instance);
  const auto type = MessageType::find(packages.modes, message_of(theirs.goal));
  const auto port = [&](const char* input) { return &port_of(inputs, modes, instance, input); };
  const auto frame = [&](std::size_t i) { return base_frame(modes.arm_name(law.arm_list()[i])); };

  UntypedSubscription::Callback callback;
  std::vector<InputPort*> ports;
  if (theirs.goal == Goal::joints) {
    const Numbers q(type, {"q"}, run_.models[law.arm_list()[0]]->joint_count());
    ports = {port("joints")};
    callback = [to = ports[0], q, key = std::make_shared<char>()](const void* message, double waited_s) {
      to->receive(q.read(message), "", Delivery::stream, waited_s, key.get());
    };
  } else if (theirs.goal == Goal::joint_velocity) {
    const ArmIndex arm = law.arm_list()[0];
    const Numbers qd(type, {"qd"}, run_.models[arm]->joint_count());
    InputPort* to = port("joints");
    ports = {to};
    const auto velocity =
        std::make_shared<VelocityGoal>(run_.models[arm]->limits().dq_max, to->spec().timeout_s);
    callback = [this, to, qd, arm, velocity](const void* message, double waited_s) {
      const JointVector q_d = velocity->next(as_vector(qd.read(message)), measured(arm), host_now());
      if (!to->receive(as_list(q_d), "", Delivery::stream, waited_s, velocity.get())) velocity->restart();
    };
  } else {
    std::vector<PoseGoal> goals;
    if (theirs.goal == Goal::pose) {
      goals.push_back({port("pose"), pose_numbers(type, "pose"), frame(0)});
    } else {
      const bool two = theirs.goal == Goal::two_poses;
      goals.push_back({port("first_pose"), pose_numbers(type, two ? "l_pose" : "pose"), frame(0)});
      goals.push_back({port("second_pose"), pose_numbers(type, two ? "r_pose" : "pose"), frame(1)});
    }
    for (const auto& goal : goals) ports.push_back(goal.port);
    // The law follows these inputs only with separate goals.
    const std::size_t choice = law.find_parameter("goals");
    callback = [goals = std::make_shared<std::vector<PoseGoal>>(goals), choice, &law](const void* message,
                                                                                      double waited_s) {
      if (choice < law.parameter_count() && law.parameter(choice)[0] < 0.5)
        throw std::invalid_argument("the parameter goals of '" + law.name() +
                                    "' is 'common': set it to 'separate'");
      receive(*goals, message, waited_s);
    };
  }
  // A refusal counts at the input's port, like any other.
  const auto guarded = [ports, callback](const void* message, double waited_s) {
    try {
      callback(message, waited_s);
    } catch (const std::invalid_argument& error) {
      for (InputPort* to : ports) to->refuse(error.what());
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

}  // namespace multipanda::ros
