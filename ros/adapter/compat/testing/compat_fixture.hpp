// A run with the names of multipanda_ros2 in messages of our own, and a client that knows only these.
#pragma once

#include <atomic>
#include <compat_test_msgs/msg/franka_state.hpp>
#include <compat_test_msgs/srv/get_controllers.hpp>
#include <compat_test_msgs/srv/set_controllers.hpp>
#include <cstdlib>
#include <mutex>
#include <thread>
#include <unistd.h>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/features/feature.hpp"
#include "ros/adapter/ros_adapter.hpp"
#include "runtime/session.hpp"
#include "scene/load.hpp"

namespace multipanda::ros::compat_test {

using namespace std::chrono_literals;
using namespace compat_test_msgs;
using testing::ElementsAre;
using testing::HasSubstr;

inline bool wait_for(const std::function<bool()>& condition, std::chrono::seconds deadline = 30s) {
  const auto until = std::chrono::steady_clock::now() + deadline;
  while (!condition()) {
    if (std::chrono::steady_clock::now() > until) return false;
    std::this_thread::sleep_for(500us);
  }
  return true;
}

constexpr const char* kScene =
    "arms:\n"
    "  - {name: left, base: {position_m: [0, 0.5, 0], rpy_rad: [0, 0, 0.6]},\n"
    "     collision: {torque_upper_nm: 30, wrench_upper: 40}}\n"
    "  - {name: right, base: {position_m: [0.1, -0.5, 0], rpy_rad: [0, 0, -1.2]}}\n"
    "controllets:\n"
    "  - {name: left_joint, type: joint_impedance, arms: left}\n"
    "  - {name: right_joint, type: joint_impedance, arms: right, features: [reluctant]}\n"
    "  - {name: left_hand, type: cartesian_impedance, arms: left}\n"
    "  - {name: right_hand, type: cartesian_impedance, arms: right}\n"
    "  - {name: dual, type: dual_cartesian_impedance, arms: [left, right], parameters: {goals: separate}}\n"
    "active: [left_hand, right_hand]\n"
    "ros: {node: mc, compat: multipanda_ros2}\n";

// Keeps its controllet from starting, if a test says so.
inline std::atomic<bool> reluctant = false;
class Reluctant final : public Feature {
 public:
  static ControlletDescriptor descriptor() { return {.type = "reluctant", .doc = ""}; }
  LawResult start(ControlContext&) override { return reluctant ? LawResult::fault : LawResult::ok; }
  LawResult update(ControlContext&) override { return LawResult::ok; }
};

class Compat : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    setenv("ROS_DOMAIN_ID", std::to_string(1 + ::getpid() % 100).c_str(), 1);
    setenv("FASTDDS_BUILTIN_TRANSPORTS", "SHM", 1);
    setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "SYSTEM_DEFAULT", 1);
    registry = new Registry(Registry::with_builtins());
    registry->add(feature_type<Reluctant>());
    SessionOptions options;
    options.duration_s = 0;
    options.make_adapter = [](const RunContext& run) {
      RosOptions ros;
      static_cast<RosSection&>(ros) = run.scene->ros;
      ros.compat_arm_messages = ros.compat_mode_messages = "compat_test_msgs";
      auto made = std::make_unique<RosAdapter>(run, ros);
      adapter = made.get();
      return made;
    };
    session = new Session(parse_scene(kScene, "test.yaml", *registry), *registry, std::move(options));
    session->start();
    client = new ClientSide;
  }
  static void TearDownTestSuite() {
    delete client;
    session->stop();
    (void)session->finish();
    delete session;
    delete registry;
  }
  struct ClientSide {
    Context context;
    Node node{context, "tester"};
    Executor executor;
    std::mutex mutex;
    std::array<msg::FrankaState, 2> states;
    std::array<std::size_t, 2> counts{};
    std::vector<std::unique_ptr<Subscription<msg::FrankaState>>> subscriptions;
    ClientSide() {
      for (std::size_t i = 0; i < 2; ++i) {
        subscriptions.push_back(std::make_unique<Subscription<msg::FrankaState>>(
            executor, node, std::string(i == 0 ? "/left" : "/right") + "_state_broadcaster/robot_state",
            Qos::reliable(), Doc{}, [this, i](const msg::FrankaState& state) {
              const std::lock_guard lock(mutex);
              states[i] = state;
              ++counts[i];
            }));
      }
      executor.start();
    }
    ~ClientSide() { executor.stop(); }
  };

  // A state that was sent after this call.
  msg::FrankaState state(std::size_t arm) {
    const auto count = [&] {
      const std::lock_guard lock(client->mutex);
      return client->counts[arm];
    };
    const std::size_t before = count();
    EXPECT_TRUE(wait_for([&] { return count() > before + 1; })) << "no states";
    const std::lock_guard lock(client->mutex);
    return client->states[arm];
  }
  template <class S>
  typename S::Response call(const std::string& name, const typename S::Request& request) {
    Client<S> service(client->executor, client->node, name);
    if (!service.wait_until_ready(30)) {
      ADD_FAILURE() << "no service " << name;
      return typename S::Response();
    }
    auto answer = service.call(request);
    if (answer.wait_for(30s) != std::future_status::ready) {
      ADD_FAILURE() << name << " did not answer";
      return typename S::Response();
    }
    return answer.get();
  }
  // A refused request is not answered: that alone tells a client of theirs.
  template <class S>
  void refuse(const std::string& name, const typename S::Request& request) {
    Client<S> service(client->executor, client->node, name);
    ASSERT_TRUE(service.wait_until_ready(30)) << name;
    const std::uint64_t were = adapter->run().counters->requests_refused.load();
    auto answer = service.call(request);
    EXPECT_TRUE(wait_for([&] { return adapter->run().counters->requests_refused.load() == were + 1; }))
        << name;
    EXPECT_EQ(answer.wait_for(1s), std::future_status::timeout) << name;
  }
  using Controllers = std::vector<std::pair<std::string, std::string>>;
  static srv::SetControllers::Request switch_to(const Controllers& controllers) {
    srv::SetControllers::Request request;
    for (const auto& [name, resource] : controllers) {
      request.controllers.emplace_back();
      request.controllers.back().name = name;
      request.controllers.back().resources = {resource};
    }
    return request;
  }
  void set(const Controllers& controllers) {
    (void)call<srv::SetControllers>("/mc/set_controllers", switch_to(controllers));
  }
  void refuse_set(const Controllers& controllers) {
    refuse<srv::SetControllers>("/mc/set_controllers", switch_to(controllers));
  }
  std::vector<std::string> active() {
    std::vector<std::string> names;
    const auto list = call<srv::GetControllers>("/mc/get_controllers", srv::GetControllers::Request());
    for (const auto& one : list.controllers) names.push_back(one.name + " on " + one.resources.at(0));
    return names;
  }
  static Diagnostic line(const std::string& name) {
    for (const auto& each : adapter->diagnostics()) {
      if (each.name == name) return each;
    }
    return {.name = name, .level = Diagnostic::Level::ok, .message = "no line", .values = {}};
  }
  static std::string trouble(const std::string& name) { return line(name).message; }
  static std::uint64_t accepted() { return adapter->run().counters->samples_accepted.load(); }
  static std::uint64_t refused() { return adapter->run().counters->samples_refused.load(); }
  static std::vector<double> parameter(const std::string& instance, const std::string& name) {
    const Instance& law = session->modes().instance(session->modes().find(instance));
    return law.parameter(law.find_parameter(name));
  }
  msg::FrankaState newest(std::size_t arm) {
    const std::lock_guard lock(client->mutex);
    return client->states[arm];
  }
  static std::string owner(ArmIndex arm) {
    return session->modes().instance(session->modes().owner(arm)).name();
  }
  // Streams until the condition holds. On a computer that stalls for the input's timeout the arm is held;
  // then the controllet is activated again, as a client would.
  template <class M>
  bool stream(Publisher<M>& publisher, const M& message, const std::string& name, const std::string& resource,
              const std::string& instance, const std::function<bool()>& reached) {
    const ArmIndex arm = session->modes().instance(session->modes().find(instance)).arm_list()[0];
    return wait_for([&] {
      if (owner(arm) != instance) set({{name, resource}});
      publisher.publish(message);
      std::this_thread::sleep_for(1ms);
      return reached();
    });
  }
  // A client that goes on streaming until the end of the returned thread, whatever happens.
  template <class M>
  static std::jthread keep_streaming(Publisher<M>& publisher, const M& message) {
    return std::jthread([&publisher, message](const std::stop_token& stop) {
      while (!stop.stop_requested()) {
        publisher.publish(message);
        std::this_thread::sleep_for(1ms);
      }
    });
  }
  template <class M>
  std::unique_ptr<Publisher<M>> sender(const std::string& topic) {
    auto made = std::make_unique<Publisher<M>>(client->node, topic, Qos::reliable(1), Doc{});
    EXPECT_TRUE(wait_for([&] { return made->subscribers() > 0; })) << topic;
    return made;
  }

  static inline Registry* registry;
  static inline Session* session;
  static inline RosAdapter* adapter;
  static inline ClientSide* client;
};

inline geometry_msgs::msg::Pose pose_of(const std::array<double, 16>& values) {
  const Eigen::Map<const Eigen::Matrix4d> X(values.data());
  const Eigen::Quaterniond q(Matrix3(X.topLeftCorner<3, 3>()));
  geometry_msgs::msg::Pose pose;
  pose.position.x = X(0, 3), pose.position.y = X(1, 3), pose.position.z = X(2, 3);
  pose.orientation.w = q.w(), pose.orientation.x = q.x();
  pose.orientation.y = q.y(), pose.orientation.z = q.z();
  return pose;
}

}  // namespace multipanda::ros::compat_test
