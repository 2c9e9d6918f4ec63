// Subscribes to all topics of a run and reports how many messages arrive: `ros_listener SECONDS`, one JSON
// object. Waits up to 30 s for a run.
#include <atomic>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <geometry_msgs/msg/pose_stamped.hpp>
#include <geometry_msgs/msg/twist_stamped.hpp>
#include <geometry_msgs/msg/wrench_stamped.hpp>
#include <map>
#include <memory>
#include <multipanda_msgs/msg/object_poses.hpp>
#include <multipanda_msgs/msg/robot_model.hpp>
#include <multipanda_msgs/msg/robot_state.hpp>
#include <rcl/graph.h>
#include <rosgraph_msgs/msg/clock.hpp>
#include <sensor_msgs/msg/joint_state.hpp>
#include <std_msgs/msg/float64.hpp>
#include <std_msgs/msg/float64_multi_array.hpp>
#include <string>
#include <tf2_msgs/msg/tf_message.hpp>
#include <thread>
#include <vector>

#include <nlohmann/json.hpp>

#include "ros/rcl/rcl.hpp"

namespace multipanda::ros {
namespace {

using Steady = std::chrono::steady_clock;

struct Received {
  std::size_t count = 0;
  Steady::time_point last;
  double longest_gap_s = 0;
  void one() {
    const auto now = Steady::now();
    if (count++ > 0)
      longest_gap_s = std::max(longest_gap_s, std::chrono::duration<double>(now - last).count());
    last = now;
  }
};

class Listener {
 public:
  Listener(Executor& executor, Node& node) : executor_(executor), node_(node) {}

  // Subscribes to all published topics of the types known here; returns their number.
  std::size_t listen() {
    rcutils_allocator_t allocator = rcutils_get_default_allocator();
    rcl_names_and_types_t found = rcl_get_zero_initialized_names_and_types();
    check(rcl_get_topic_names_and_types(node_.handle(), &allocator, false, &found), "topics of the graph");
    for (std::size_t i = 0; i < found.names.size; ++i) {
      const std::string name = found.names.data[i];
      if (found.types[i].size != 1 || received_.count(name) > 0 || node_.publishers_of(name) == 0) continue;
      subscribe(name, found.types[i].data[0]);
    }
    check(rcl_names_and_types_fini(&found), "topics of the graph");
    return received_.size();
  }
  void begin() {
    for (auto& [name, received] : received_) received = Received();
  }
  nlohmann::ordered_json result(double seconds) const {
    nlohmann::ordered_json out;
    for (const auto& [name, received] : received_) {
      out[name] = {{"rate_hz", static_cast<double>(received.count) / seconds},
                   {"longest_gap_ms", 1e3 * received.longest_gap_s}};
    }
    return out;
  }

 private:
  template <class M>
  void add(const std::string& name) {
    Received& received = received_[name];
    subscriptions_.push_back(std::make_shared<Subscription<M>>(
        executor_, node_, name, Qos::sensor(100), Doc{}, [&received](const M&) { received.one(); }));
  }
  template <class M>
  bool add_if(const std::string& name, const std::string& type) {
    if (rosidl_generator_traits::name<M>() != type) return false;
    add<M>(name);
    return true;
  }
  void subscribe(const std::string& name, const std::string& type) {
    (void)(add_if<multipanda_msgs::msg::RobotState>(name, type) ||
           add_if<multipanda_msgs::msg::RobotModel>(name, type) ||
           add_if<multipanda_msgs::msg::ObjectPoses>(name, type) ||
           add_if<sensor_msgs::msg::JointState>(name, type) ||
           add_if<geometry_msgs::msg::WrenchStamped>(name, type) ||
           add_if<geometry_msgs::msg::PoseStamped>(name, type) ||
           add_if<geometry_msgs::msg::TwistStamped>(name, type) ||
           add_if<std_msgs::msg::Float64>(name, type) ||
           add_if<std_msgs::msg::Float64MultiArray>(name, type) ||
           add_if<rosgraph_msgs::msg::Clock>(name, type) || add_if<tf2_msgs::msg::TFMessage>(name, type));
  }

  Executor& executor_;
  Node& node_;
  std::map<std::string, Received> received_;  // executor's thread, or any while it is stopped
  std::vector<std::shared_ptr<void>> subscriptions_;
};

int listen(double seconds) {
  Context context;
  Node node(context, "ros_listener");
  Executor executor;
  Listener listener(executor, node);
  const auto timeout = Steady::now() + std::chrono::seconds(30);
  while (node.publishers_of("/joint_states") == 0) {
    if (Steady::now() > timeout) {
      std::fprintf(stderr, "there is no publisher of /joint_states: start a run with --ros\n");
      return EXIT_FAILURE;
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  }
  std::this_thread::sleep_for(std::chrono::seconds(1));  // for the discovery of the other topics
  listener.listen();
  executor.start();
  std::this_thread::sleep_for(std::chrono::seconds(1));  // for publishers to discover this node
  executor.stop();
  listener.begin();
  const auto begin = Steady::now();
  executor.start();
  std::this_thread::sleep_for(std::chrono::duration<double>(seconds));
  executor.stop();
  const double heard_for = std::chrono::duration<double>(Steady::now() - begin).count();
  std::printf("%s\n", listener.result(heard_for).dump().c_str());
  return EXIT_SUCCESS;
}

}  // namespace
}  // namespace multipanda::ros

int main(int argc, char** argv) try {
  if (argc != 2) {
    std::fprintf(stderr, "usage: ros_listener SECONDS\n");
    return EXIT_FAILURE;
  }
  return multipanda::ros::listen(std::atof(argv[1]));
} catch (const std::exception& error) {
  std::fprintf(stderr, "%s\n", error.what());
  return EXIT_FAILURE;
}
