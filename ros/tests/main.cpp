// The controller and the hardware in a real controller_manager, whose loop is the test (managed_robot.hpp).
#include <cstdlib>
#include <rclcpp/rclcpp.hpp>
#include <rcutils/logging.h>
#include <string>
#include <unistd.h>

#include <gmock/gmock.h>

int main(int argc, char** argv) {
  // Nothing leaves this computer, and no other test hears it, however it was started.
  setenv("ROS_DOMAIN_ID", std::to_string(101 + getpid() % 100).c_str(), 1);
  setenv("FASTDDS_BUILTIN_TRANSPORTS", "SHM", 0);
  setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "SYSTEM_DEFAULT", 0);
  testing::InitGoogleMock(&argc, argv);
  rclcpp::init(argc, argv);
  (void)rcutils_logging_set_default_logger_level(RCUTILS_LOG_SEVERITY_WARN);
  const int result = RUN_ALL_TESTS();
  rclcpp::shutdown();
  return result;
}
