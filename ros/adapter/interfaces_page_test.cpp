#include "ros/adapter/interfaces_page.hpp"

#include <cstdlib>
#include <fstream>
#include <sstream>
#include <unistd.h>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

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
  const std::string page =
      interfaces_markdown({{"publisher", "/left/wrench", "W", "q", "1 Hz", "of `left_k`"},
                           {"publisher", "/right/wrench", "W", "q", "1 Hz", "of `right_k`"},
                           {"publisher", "/tf", "T", "q", "1 Hz", "a | b"},
                           {"service", "/cell/stop", "S", "", "", "Stops."},
                           {"service", "/left/recover", "R", "", "", "Recovers."},
                           {"service", "/left_server/recovery", "R", "", "", "As left/recover."},
                           {"action", "/right_gripper/move", "A", "", "", "moves"},
                           {"publisher", "/cell/soft/joints_guard/torque", "F", "q", "1 Hz", "of the guard"},
                           {"publisher", "/cell/soft/joints/reference", "J", "q", "1 Hz", "followed now"},
                           {"publisher", "/cell/soft/error", "F", "q", "1 Hz", "of the law"},
                           {"publisher", "/cell/soft/torque", "F", "q", "1 Hz", "of the law"},
                           {"publisher", "/cell/soft/axis", "V", "reliable, newest 10", "1 Hz", "of the law"},
                           {"subscription", "/cell/soft/joints", "J", "q", "", "see left/wrench"},
                           {"subscription", "/cell/soft/joints/goal", "J", "q", "", "goal"}},
                          "/cell", scene, {"joints_guard"});
  EXPECT_THAT(
      page,
      HasSubstr("| `<arm>/wrench` | W | q | 1 Hz | of `<arm>_k` |\n| `/tf` | T | q | 1 Hz | a \\| b |\n"));
  EXPECT_THAT(page, HasSubstr("| `~/stop` | S | Stops. |"));
  EXPECT_THAT(page, HasSubstr("| `<arm>/recover` | R | Recovers. Also `<arm>_server/recovery`. |\n\n"));
  EXPECT_THAT(page, HasSubstr("| `<arm>_gripper/move` | A | moves |"));
  EXPECT_THAT(
      page,
      HasSubstr("|---|---|---|---|---|---|\n"
                "| joint_impedance | `~/<instance>/joints` | J | q |   | see <arm>/wrench |\n"
                "| joint_impedance | `~/<instance>/error`, `torque` | F | q | 1 Hz | outputs |\n"
                "| joint_impedance | `~/<instance>/axis` | V |   | 1 Hz | outputs |\n"
                "| any, with the feature | `~/<instance>/joints_guard/torque` | F | q | 1 Hz | outputs |\n"));
  EXPECT_THAT(page, Not(HasSubstr("joints/goal")));
  EXPECT_THAT(page, Not(HasSubstr("joints/reference")));
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
