#include "ros/generators/topic_channel.hpp"

#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <stdexcept>
#include <thread>

#include "common/text.hpp"

namespace multipanda::ros {
namespace {

constexpr double kTimeout = 15;             // for the run to answer and to subscribe [s]
constexpr double kDiagnosticsTimeout = 10;  // for diagnostics newer than the last set-point [s]
constexpr std::uint64_t kCheckEvery = 100;  // number of sends between checks for a subscriber
// Delay for the last samples of a stream to be taken before its goal is sent, and for the goal before this
// node ends.
constexpr auto kSettle = std::chrono::milliseconds(100);

// Returns arguments for rcl. The publishing thread, which has priority, sends messages itself: on a busy
// machine the middleware's own sender would wait for a core while the history fills up. A run does the
// opposite (ros/rcl/context.hpp).
std::vector<std::string> rcl_arguments(const TopicArguments& arguments) {
  setenv("RMW_FASTRTPS_PUBLICATION_MODE", "SYNCHRONOUS", 0);
  if (arguments.remaps.empty()) return {};
  std::vector<std::string> out{"--ros-args"};
  for (const auto& remap : arguments.remaps) {
    out.push_back("-r");
    out.push_back(remap);
  }
  return out;
}

builtin_interfaces::msg::Time now() { return system_time(); }

Pose pose_from(const geometry_msgs::msg::Pose& m) {
  return Pose::from({m.position.x, m.position.y, m.position.z},
                    Quaternion(m.orientation.w, m.orientation.x, m.orientation.y, m.orientation.z));
}

template <typename Done>
bool wait_until(Done&& done, double timeout_s) {
  const auto deadline = std::chrono::steady_clock::now() + std::chrono::duration<double>(timeout_s);
  while (!done()) {
    if (std::chrono::steady_clock::now() > deadline) return false;
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
  return true;
}

std::uint64_t number(const std::string& text) {
  std::uint64_t value = 0;
  for (const char c : text) {
    if (c < '0' || c > '9') return value;
    value = 10 * value + static_cast<std::uint64_t>(c - '0');
  }
  return value;
}

}  // namespace

TopicChannel::TopicChannel(const TopicArguments& arguments)
    : run_(arguments.node.starts_with('/') ? arguments.node : "/" + arguments.node),
      name_space_(run_.substr(0, run_.rfind('/'))),
      context_(rcl_arguments(arguments)),
      node_(context_, arguments.own_node),
      list_arms_(executor_, node_, run_ + "/list_arms"),
      list_controllets_(executor_, node_, run_ + "/list_controllets"),
      diagnostics_in_(executor_, node_, "/diagnostics", Qos::reliable(10), Doc{},
                      [this](const DiagnosticArray& message) { take(message); }) {
  executor_.start();
  if (!list_arms_.wait_until_ready(kTimeout) || !list_controllets_.wait_until_ready(kTimeout)) {
    throw std::runtime_error("no run answers on ROS as " + run_ +
                             ": start one with `multipanda run SCENE --ros`, or give --node and, on both "
                             "sides, the same ROS_DOMAIN_ID");
  }
  controllets_ =
      std::make_unique<ListControllets::Response>(ask(list_controllets_, "the list of controllets"));
}

TopicChannel::~TopicChannel() { executor_.stop(); }

template <class S>
typename S::Response TopicChannel::ask(Client<S>& client, const std::string& what) {
  auto answer = client.call(typename S::Request());
  if (answer.wait_for(std::chrono::duration<double>(kTimeout)) != std::future_status::ready)
    throw std::runtime_error(run_ + " does not answer: " + what);
  return answer.get();
}

void TopicChannel::take(const DiagnosticArray& message) {
  {
    const std::lock_guard lock(mutex_);
    for (const auto& status : message.status) {
      // "multipanda: dual/common_pose"
      const auto colon = status.name.rfind(": ");
      Counts& counts = counts_[colon == std::string::npos ? status.name : status.name.substr(colon + 2)];
      for (const auto& value : status.values) {
        if (value.key == "received") counts.received = number(value.value);
        if (value.key == "refused") counts.refused = number(value.value);
        if (value.key == "last reason") counts.reason = value.value;
      }
    }
    ++diagnostics_;
  }
  arrived_.notify_all();
}

TopicChannel::Counts TopicChannel::counts_of(const Open& open) {
  const auto found = counts_.find(open.controllet + "/" + open.input);
  return found == counts_.end() ? Counts{} : found->second;
}

std::vector<SetPointChannel::Arm> TopicChannel::arms(const std::vector<std::string>& names) {
  if (names.empty()) return {};
  std::vector<std::string> known;
  for (const auto& arm : ask(list_arms_, "the list of arms").arms) known.push_back(arm.name);
  for (const auto& name : names) {
    if (std::find(known.begin(), known.end(), name) == known.end())
      throw std::invalid_argument("the run has no arm '" + name + "'" +
                                  name_hint(name, known, "there are none"));
  }
  std::vector<Arm> list(names.size());
  std::vector<bool> received(names.size(), false);  // guarded by mutex_
  std::vector<std::unique_ptr<Subscription<RobotState>>> subscriptions;
  for (std::size_t i = 0; i < names.size(); ++i) {
    subscriptions.push_back(std::make_unique<Subscription<RobotState>>(
        executor_, node_, name_space_ + "/" + names[i] + "/robot_state", Qos::sensor(1), Doc{},
        [this, &list, &received, i](const RobotState& state) {
          const std::lock_guard lock(mutex_);
          list[i].X_WE = pose_from(state.pose);
          list[i].q = JointVector::Map(state.q.data(), static_cast<Eigen::Index>(state.q.size()));
          received[i] = true;
        }));
  }
  const bool all = wait_until(
      [&] {
        const std::lock_guard lock(mutex_);
        return std::all_of(received.begin(), received.end(), [](bool each) { return each; });
      },
      kTimeout);
  subscriptions.clear();  // no callback afterwards
  if (!all) {
    throw std::runtime_error(
        "no robot_state of the arms arrives on ROS: set rates_hz.robot_state in the scene's section 'ros' to "
        "more than 0");
  }
  return list;
}

template <class M>
void TopicChannel::make(Open& open, std::unique_ptr<Publisher<M>>& stream,
                        std::unique_ptr<Publisher<M>>& goal) {
  // Reliable for subscribers that request it; runs read only the newest message. A depth of a few messages,
  // so that a message being sent does not block the next one.
  stream = std::make_unique<Publisher<M>>(node_, open.topic, Qos::reliable(10), Doc{});
  goal = std::make_unique<Publisher<M>>(node_, open.topic + "/goal", Qos::reliable(10), Doc{});
  if (!wait_until([&] { return stream->subscribers() > 0 && goal->subscribers() > 0; }, kTimeout))
    throw std::runtime_error("there is no subscriber to " + open.topic);
}

SetPointChannel::Stream TopicChannel::open(const std::string& controllet, const std::string& input,
                                           Quantity quantity) {
  std::vector<std::string> names;
  const multipanda_msgs::msg::ControlletInfo* info = nullptr;
  for (const auto& each : controllets_->controllets) {
    names.push_back(each.name);
    if (each.name == controllet) info = &each;
  }
  if (info == nullptr)
    throw std::invalid_argument("the run has no controllet '" + controllet + "'" +
                                name_hint(controllet, names, "there are none"));
  auto open = std::make_unique<Open>();
  names.clear();
  for (const auto& each : info->inputs) {
    names.push_back(each.name);
    if (each.name != input) continue;
    open->topic = each.topic;
    if (each.quantity != to_string(quantity)) {
      throw std::invalid_argument("input '" + input + "' of '" + controllet + "' takes " + each.quantity +
                                  ", not " + std::string(to_string(quantity)));
    }
  }
  if (open->topic.empty()) {
    throw std::invalid_argument(has_no(controllet, "input", input, names));
  }
  open->controllet = controllet;
  open->input = input;
  open->quantity = quantity;
  open->pose_message.header.frame_id = "world";
  if (quantity == Quantity::pose) {
    make(*open, open->pose, open->pose_goal);
  } else {
    make(*open, open->joints, open->joints_goal);
  }
  {
    const std::lock_guard lock(mutex_);
    open->before = counts_of(*open);
  }
  streams_.push_back(std::move(open));
  return streams_.size() - 1;
}

bool TopicChannel::send(Stream stream, std::span<const double> values, std::int64_t) {
  Open& open = *streams_[stream];
  if (++open.sent % kCheckEvery == 0)
    open.has_subscriber = (open.pose ? open.pose->subscribers() : open.joints->subscribers()) > 0;
  if (open.pose) {
    auto& pose = open.pose_message.pose;
    open.pose_message.header.stamp = now();
    pose.position.x = values[0];
    pose.position.y = values[1];
    pose.position.z = values[2];
    pose.orientation.w = values[3];
    pose.orientation.x = values[4];
    pose.orientation.y = values[5];
    pose.orientation.z = values[6];
    const auto failures = open.pose->failures();
    open.pose->publish(open.pose_message);
    return open.has_subscriber && open.pose->failures() == failures;
  }
  open.joints_message.header.stamp = now();
  open.joints_message.position.assign(values.begin(), values.end());
  const auto failures = open.joints->failures();
  open.joints->publish(open.joints_message);
  return open.has_subscriber && open.joints->failures() == failures;
}

void TopicChannel::rest() {
  std::this_thread::sleep_for(kSettle);
  for (const auto& open : streams_) {
    if (open->sent == 0) continue;
    if (open->pose) {
      open->pose_goal->publish(open->pose_message);
    } else {
      open->joints_goal->publish(open->joints_message);
    }
  }
  std::this_thread::sleep_for(kSettle);
}

nlohmann::json TopicChannel::channels() {
  std::unique_lock lock(mutex_);
  // Skips the next report, whose counts may have been taken before the last set-point arrived.
  const std::uint64_t target = diagnostics_ + 2;
  const bool reported = arrived_.wait_for(lock, std::chrono::duration<double>(kDiagnosticsTimeout),
                                          [&] { return diagnostics_ >= target; });
  nlohmann::json list = nlohmann::json::array();
  for (const auto& open : streams_) {
    nlohmann::json entry{{"controllet", open->controllet},
                         {"input", open->input},
                         {"topic", open->topic},
                         {"sent", open->sent},
                         {"failed", open->pose ? open->pose->failures() : open->joints->failures()}};
    if (reported) {
      const Counts counts = counts_of(*open);
      entry["received"] = counts.received - open->before.received;
      entry["lost"] = open->sent > counts.received - open->before.received
                          ? open->sent - (counts.received - open->before.received)
                          : 0;
      entry["refused"] = counts.refused - open->before.refused;
      entry["last_reason"] = counts.reason;
    }
    list.push_back(std::move(entry));
  }
  return list;
}

}  // namespace multipanda::ros
