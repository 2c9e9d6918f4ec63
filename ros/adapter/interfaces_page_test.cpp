#include "ros/adapter/interfaces_page.hpp"

#include <cstdlib>
#include <fstream>
#include <sstream>
#include <unistd.h>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "ros/adapter/scene_interfaces.hpp"

namespace multipanda::ros::interfaces_page_test {
namespace {

using testing::HasSubstr;
using testing::Not;

TEST(InterfacesPage, NamesOfTheSceneBecomePlaceholders) {
  Scene scene;
  scene.arms.resize(2);
  scene.arms[0].name = "left";
  scene.arms[1].name = "right";
  scene.controllets.resize(1);
  scene.controllets[0].name = "soft";
  scene.controllets[0].type = "joint_impedance";
  const std::string page = interfaces_markdown(
      {{"publisher", "/left/wrench", "W", "q", "1 Hz", "of `left_k`"},
       {"publisher", "/right/wrench", "W", "q", "1 Hz", "of `right_k`"},
       {"publisher", "/tf", "T", "q", "1 Hz", "a | b"},
       {"service", "/cell/stop", "S", "", "", "stops"},
       {"action", "/right_gripper/move", "A", "", "", "moves"},
       {"publisher", "/cell/soft/joints_guard/torque", "F", "q", "1 Hz", "see left/wrench"},
       {"subscription", "/cell/soft/joints", "J", "q", "", "follows"}},
      "/cell", scene, {"joints_guard"});
  EXPECT_THAT(
      page,
      HasSubstr("| `<arm>/wrench` | W | q | 1 Hz | of `<arm>_k` |\n| `/tf` | T | q | 1 Hz | a \\| b |\n"));
  EXPECT_THAT(page, HasSubstr("| `~/stop` | S | stops |"));
  EXPECT_THAT(page, HasSubstr("| `<arm>_gripper/move` | A | moves |"));
  EXPECT_THAT(page, HasSubstr("### joint_impedance\n\n**Taken**"));
  EXPECT_THAT(page, HasSubstr("| `~/<instance>/joints` | J | q |   | follows |"));
  EXPECT_THAT(page, HasSubstr("### Features of any controllet\n\n**Published**"));
  EXPECT_THAT(page, HasSubstr("| `~/<instance>/joints_guard/torque` | F | q | 1 Hz | see <arm>/wrench |"));
  EXPECT_THAT(page, Not(HasSubstr("right")));
  EXPECT_THROW(with_tables("no mark", page), std::invalid_argument);
}

TEST(InterfacesPage, IsUpToDate) {
  setenv("ROS_DOMAIN_ID", std::to_string(1 + ::getpid() % 100).c_str(), 1);
  std::ifstream in(MULTIPANDA_SOURCE_DIR "/docs/ros_interfaces.md");
  std::ostringstream page;
  page << in.rdbuf();
  EXPECT_TRUE(with_tables(page.str(), scene_interface_tables("two_arms")) == page.str())
      << "docs/ros_interfaces.md is out of date: build the target ros_interfaces and commit the page";
}

}  // namespace
}  // namespace multipanda::ros::interfaces_page_test
