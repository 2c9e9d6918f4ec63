// The controller on robots of other manufacturers, in a controller_manager with our MuJoCo hardware. Only the
// robot description tells it about the robot. Skipped without the Python package example-robot-data.
#include <cmath>
#include <filesystem>
#include <fstream>
#include <geometry_msgs/msg/pose_stamped.hpp>
#include <sstream>

#include <gtest/gtest.h>

#include "descriptions.hpp"
#include "tested_robot.hpp"

namespace multipanda::ros2_control_tests {
namespace {

struct Make {
  const char *name, *file;
  std::vector<ImportedRobot::Arm> arms;
  std::vector<std::vector<double>> home;
};
std::ostream& operator<<(std::ostream& out, const Make& make) { return out << make.name; }

const std::vector<Make> kMakes = {
    {"ur5",
     "ur_description/urdf/ur5_robot.urdf",
     {{"ur5", "base_link", "tool0"}},
     {{0, -1.2, 1.4, -1.7, -1.5, 0}}},
    {"baxter",
     "baxter_description/urdf/baxter.urdf",
     {{"baxter_left", "torso", "left_gripper"}, {"baxter_right", "torso", "right_gripper"}},
     {{-0.3, -0.6, -0.4, 1.4, 0.4, 0.9, 0}, {0.3, -0.6, 0.4, 1.4, -0.4, 0.9, 0}}},
    {"tiago_pro",
     "tiago_pro_description/robots/tiago_pro.urdf",
     {{"tiago_left", "torso_lift_link", "arm_left_tool_link"},
      {"tiago_right", "torso_lift_link", "arm_right_tool_link"}},
     {{0.6, -0.9, 0.3, -1.3, -0.8, 0.6, 0.2}, {-0.6, -0.9, -0.3, -1.3, 0.8, 0.6, -0.2}}}};

constexpr const char* kBase = "position_m: [0.8, -0.5, 0.6], rpy_rad: [0.2, 0.0, 0.7]";

std::string listed(const std::vector<double>& values) {
  std::ostringstream text;
  text.precision(17);
  for (std::size_t i = 0; i < values.size(); ++i) text << (i > 0 ? ", " : "") << values[i];
  return "[" + text.str() + "]";
}

// A folder of files, removed by the destructor.
class Folder {
 public:
  Folder() {
    std::string pattern = (std::filesystem::temp_directory_path() / "other_robots_XXXXXX").string();
    if (mkdtemp(pattern.data()) == nullptr) throw std::runtime_error("cannot make the folder " + pattern);
    path_ = pattern;
  }
  ~Folder() { std::filesystem::remove_all(path_); }
  std::string write(const std::string& name, const std::string& text) {
    std::ofstream(path_ / name) << text;
    return (path_ / name).string();
  }

 private:
  std::filesystem::path path_;
};

double distance(const urdf::Pose& a, const urdf::Pose& b) {
  return std::hypot(a.position.x - b.position.x, a.position.y - b.position.y, a.position.z - b.position.z);
}

double angle(const urdf::Pose& a, const urdf::Pose& b) {
  const urdf::Rotation& p = a.rotation;
  const urdf::Rotation& q = b.rotation;
  return 2 * std::acos(std::min(1.0, std::abs(p.x * q.x + p.y * q.y + p.z * q.z + p.w * q.w)));
}

class OtherRobots : public testing::TestWithParam<Make> {};

TEST_P(OtherRobots, ArriveInCartesianImpedance) {
  const Make& make = GetParam();
  const std::filesystem::path file = std::filesystem::path(ROBOTS_FOLDER) / make.file;
  if (!std::filesystem::exists(file)) GTEST_SKIP() << "no " << file << ": pip install example-robot-data";
  const ImportedRobot imported(file.string(), make.arms);

  Folder folder;
  Component component{make.name,  "multipanda_hardware/MujocoSystem", {}, {},
                      {"effort"}, imported.joints(make.arms[0].name)};
  std::string names, arms, controllets, active;
  for (std::size_t i = 0; i < make.arms.size(); ++i) {
    const auto& arm = make.arms[i];
    const std::string model = "name: " + arm.name + "\nurdf: " + file.string() +
                              "\nbase_link: " + arm.base_link + "\ntip_link: " + arm.tip_link +
                              "\nhome_rad: " + listed(make.home[i]) + "\n";
    const std::string comma = i > 0 ? ", " : "";
    names += comma + arm.name;
    component.arms.push_back(arm.name);
    component.parameters["arms." + arm.name + ".model"] = folder.write(arm.name + ".yaml", model);
    component.parameters["arms." + arm.name + ".hand"] = "false";
    component.parameters["arms." + arm.name + ".base.position_m"] = "[0.8, -0.5, 0.6]";
    component.parameters["arms." + arm.name + ".base.rpy_rad"] = "[0.2, 0, 0.7]";
    arms += comma + arm.name + ": {model: robot_description, hand: false, base_link: " + arm.base_link +
            ", tip_link: " + arm.tip_link + ", base: {" + kBase + "}}";
    controllets += comma + "to_" + arm.name + ": {type: cartesian_impedance, arms: " + arm.name + "}";
    active += comma + "to_" + arm.name;
  }
  component.parameters["arm_names"] = names;
  Robot robot(imported.description(component),
              "controller_manager:\n  ros__parameters:\n    update_rate: 1000\n"
              "    multimode: {type: multipanda_controller/MultimodeController}\n"
              "multimode:\n  ros__parameters:\n    arm_names: [" +
                  names + "]\n    arms: {" + arms + "}\n    controllets: {" + controllets +
                  "}\n    active: [" + active + "]\n");
  ManagedRobot& managed = robot.managed;
  ASSERT_TRUE(managed.load("multimode"));
  ASSERT_TRUE(managed.switch_to({"multimode"}));
  managed.cycles(200);

  const auto where = [&](const std::string& arm) {
    std::vector<double> q;
    for (int j = 1; j <= component.joints; ++j) q.push_back(robot.q(arm, j));
    return q;
  };
  std::map<std::string, urdf::Pose> goals;
  for (std::size_t i = 0; i < make.arms.size(); ++i) {
    const std::string& arm = make.arms[i].name;
    EXPECT_LT(distance(imported.tip(arm, where(arm)), imported.tip(arm, make.home[i])), 1e-3) << arm;
    auto q = make.home[i];
    for (std::size_t k = 0; k < q.size(); ++k) q[k] += k % 3 == 1 ? -0.25 : 0.2;
    goals[arm] = imported.tip(arm, q);
    ASSERT_GT(distance(goals[arm], imported.tip(arm, make.home[i])), 0.1) << arm;
    geometry_msgs::msg::PoseStamped message;
    message.header.frame_id = arm + "_link0";
    message.pose.position.x = goals[arm].position.x;
    message.pose.position.y = goals[arm].position.y;
    message.pose.position.z = goals[arm].position.z;
    message.pose.orientation.x = goals[arm].rotation.x;
    message.pose.orientation.y = goals[arm].rotation.y;
    message.pose.orientation.z = goals[arm].rotation.z;
    message.pose.orientation.w = goals[arm].rotation.w;
    robot.send("/multimode/to_" + arm + "/pose/goal", message);
  }
  const auto left = [&] {
    double worst = 0;
    for (const auto& [arm, goal] : goals)
      worst = std::max(worst, distance(imported.tip(arm, where(arm)), goal));
    return worst;
  };
  EXPECT_TRUE(managed.cycles_until([&] { return left() < 1e-3; }, 200'000)) << left();
  managed.cycles(1000);  // and stays there
  for (const auto& [arm, goal] : goals) {
    const urdf::Pose tip = imported.tip(arm, where(arm));
    EXPECT_LT(distance(tip, goal), 1e-3) << arm;           // [m]
    EXPECT_LT(angle(tip, goal), 0.1 * M_PI / 180) << arm;  // [rad]
    RecordProperty(arm + "_mm", std::to_string(1e3 * distance(tip, goal)));
  }
  EXPECT_EQ(managed.failed_updates(), 0);
}

INSTANTIATE_TEST_SUITE_P(All, OtherRobots, testing::ValuesIn(kMakes),
                         [](const auto& info) { return std::string(info.param.name); });

}  // namespace
}  // namespace multipanda::ros2_control_tests
