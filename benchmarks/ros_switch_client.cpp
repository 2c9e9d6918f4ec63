// Switches controllets of a run that was started with --ros, by the service, as a user's program does. Prints
// for each trial the milliseconds from just before sending the request to the first torque.
//   multipanda_ros_switch_client TRIALS
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <multipanda_msgs/srv/switch_controllets.hpp>
#include <random>
#include <thread>

#include "core/types/time.hpp"
#include "ros/rcl/rcl.hpp"

namespace {

using multipanda::host_now;
using multipanda_msgs::srv::SwitchControllets;

int run(int trials) {
  multipanda::ros::Context context;
  multipanda::ros::Node node(context, "switch_client");
  multipanda::ros::Executor executor;
  multipanda::ros::Client<SwitchControllets> service(executor, node, "/multipanda/switch_controllets");
  executor.start();
  if (!service.wait_until_ready(10)) {
    std::fprintf(stderr, "there is no service /multipanda/switch_controllets\n");
    return 1;
  }
  SwitchControllets::Request together, apart;
  together.activate = {"dual"};
  apart.activate = {"left_cartesian", "right_cartesian"};
  std::mt19937_64 random(1);
  std::uniform_int_distribution<int> pause_us(1000, 3000);
  for (int i = -2; i < trials; ++i) {  // the first trials warm up the connection
    std::this_thread::sleep_for(std::chrono::microseconds(pause_us(random)));
    const std::int64_t sent = host_now().ns;
    auto answer = service.call(i % 2 == 0 ? together : apart);
    if (answer.wait_for(std::chrono::seconds(5)) != std::future_status::ready) {
      std::fprintf(stderr, "no answer within 5 s\n");
      return 1;
    }
    const auto response = answer.get();
    if (!response.accepted) {
      std::fprintf(stderr, "refused: %s\n", response.reason.c_str());
      return 1;
    }
    if (i >= 0) std::printf("%.6f\n", 1e-6 * static_cast<double>(response.first_torque_ns - sent));
  }
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  const int trials = argc == 2 ? std::atoi(argv[1]) : 0;
  if (trials < 1) {
    std::fprintf(stderr, "usage: multipanda_ros_switch_client TRIALS\n");
    return 2;
  }
  try {
    return run(trials);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 1;
  }
}
