// The controller's measurement of itself in a controller_manager. The numbers in its file are checked without
// one, by ros/host/performance_trace_test.py.
#include <filesystem>
#include <fstream>
#include <iterator>
#include <unistd.h>

#include <gtest/gtest.h>

#include "tested_robot.hpp"

namespace multipanda::ros2_control_tests {
namespace {

namespace fs = std::filesystem;

TEST(PerformanceTrace, IsWrittenOnceTheControllerIsDeactivated) {
  const fs::path folder =
      fs::temp_directory_path() / ("multipanda_performance_" + std::to_string(::getpid()));
  fs::remove_all(folder);
  std::string text = parameters();
  const std::string active = "    active: [left_joints, right_joints]\n";
  text.insert(text.find(active) + active.size(), "    performance_trace: {folder: " + folder.string() +
                                                     ", condition: NF, duration_s: 0.5, lead_s: 0.1}\n");
  {
    Robot robot(mujoco_component("arms", kArms), text);
    ManagedRobot& managed = robot.managed;
    ASSERT_TRUE(managed.load("multimode"));
    ASSERT_TRUE(managed.switch_to({"multimode"}));
    managed.cycles(1000);
    EXPECT_TRUE(fs::is_empty(folder));
    ASSERT_TRUE(managed.switch_to({}, {"multimode"}));
    EXPECT_TRUE(managed.cycles_until([&] { return fs::exists(folder / "NF_1.npz"); }, 300'000));
    ASSERT_TRUE(managed.unload("multimode"));
    EXPECT_EQ(managed.failed_updates(), 0);
  }
  std::ifstream in(folder / "NF_1.npz", std::ios::binary);
  const std::string content{std::istreambuf_iterator<char>(in), {}};
  // 500 cycles of two arms, 3 x 7 numbers each.
  EXPECT_GT(content.size(), std::size_t{500} * 2 * 21 * 8);
  EXPECT_NE(content.find("stages_us.npy"), std::string::npos);
  EXPECT_NE(content.find("about.npy"), std::string::npos);
  fs::remove_all(folder);
}

}  // namespace
}  // namespace multipanda::ros2_control_tests
