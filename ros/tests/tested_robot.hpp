#pragma once

#include <algorithm>
#include <memory>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "descriptions.hpp"
#include "managed_robot.hpp"

namespace multipanda::ros2_control_tests {

// Two arms, `left` and `right`: parameters of the manager and of its controllers, for one arm or both, from
// this project and others. `more`: keys of every arm of the controller `multimode`, in YAML.
std::string parameters(const std::string& more = "");

// Other hardware has no multipanda_state, so the parameters must say how it compensates gravity.
inline const char* const kForeign =
    "gravity_compensation: robot, state_interfaces: [position, velocity, effort]";

inline const std::vector<std::string> kArms = {"left", "right"};

// A managed robot with operations for the tests: positions of the arms, and what a user sends and calls.
class Robot {
 public:
  Robot(const Component& component, const std::string& text) : Robot(robot({component}), text) {}
  Robot(const std::string& description, const std::string& text) : managed(description, text) {}

  double q(const std::string& arm, int joint) { return managed.value(joint_name(arm, joint) + "/position"); }
  double effort(const std::string& arm, int joint) {
    return managed.value(joint_name(arm, joint) + "/effort");
  }
  double worst_speed(const std::string& arm);  // of any joint since probe().reset_worst() [rad/s]
  double distance(const std::string& arm, const std::vector<double>& goal);  // of the worst joint [rad]
  std::vector<double> where(const std::string& arm);

  template <class Service>
  auto call(const std::string& name, typename Service::Request request) {
    const auto client = managed.user()->create_client<Service>(name);
    if (!managed.cycles_until([&] { return client->service_is_ready(); }, 300'000)) {
      throw std::runtime_error("no service " + name);
    }
    return managed.finish(
        client->async_send_request(std::make_shared<typename Service::Request>(std::move(request))).share());
  }

  // Waits for a subscriber, then sends `message` once.
  template <class Message>
  typename rclcpp::Publisher<Message>::SharedPtr send(const std::string& topic, const Message& message) {
    auto publisher = managed.user()->create_publisher<Message>(topic, rclcpp::QoS(10));
    EXPECT_TRUE(managed.cycles_until([&] { return publisher->get_subscription_count() > 0; }, 300'000))
        << topic;
    publisher->publish(message);
    return publisher;
  }

  // Sends a joint goal to our controller.
  void send_joints(const std::string& topic, const std::string& arm, const std::vector<double>& q_d);

  // Sends one point, to rest, to a joint trajectory controller.
  void send_trajectory(const std::string& controller, const std::string& arm, const std::vector<double>& q_d,
                       int seconds);

  ManagedRobot managed;

 private:
  std::vector<std::shared_ptr<rclcpp::PublisherBase>> senders_;
};

std::vector<double> home_with(int joint, double change);

}  // namespace multipanda::ros2_control_tests
