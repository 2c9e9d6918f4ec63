// Controller and hardware in a real controller_manager, whose loop the test runs (managed_robot.hpp).
#include <cstdlib>
#include <iterator>
#include <rclcpp/rclcpp.hpp>
#include <rcutils/logging.h>
#include <string>
#include <unistd.h>

#include <gmock/gmock.h>

int main(int argc, char** argv) {
  // Keeps all traffic on this computer and apart from other tests.
  setenv("ROS_DOMAIN_ID", std::to_string(101 + getpid() % 100).c_str(), 1);
  setenv("FASTDDS_BUILTIN_TRANSPORTS", "SHM", 0);
  setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "SYSTEM_DEFAULT", 0);
  testing::InitGoogleMock(&argc, argv);
  // As launch files start ros2_control_node: this rule renames every node that has none of its own.
  const char* const arguments[] = {argv[0], "--ros-args", "-r", "__node:=controller_manager"};
  rclcpp::init(static_cast<int>(std::size(arguments)), arguments);
  (void)rcutils_logging_set_default_logger_level(RCUTILS_LOG_SEVERITY_WARN);
  const int result = RUN_ALL_TESTS();
  rclcpp::shutdown();
  return result;
}
