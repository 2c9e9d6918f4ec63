// What a scene is refused for if an arm has prismatic joints.
#include <filesystem>
#include <fstream>
#include <unistd.h>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "scene/testing/test_scenes.hpp"

namespace multipanda::scene_prismatic_joints_test {
namespace {

const char* const kSlide = R"(name: slide
title: Slide
joints:
  joint1: {position_m: [0, 0, 0.3], type: prismatic}
flange: {position_m: [0.1, 0, 0]}
inertials:
  link0: {mass_kg: 9, com_m: [0, 0, 0], inertia_kg_m2: {xx: 0.1, yy: 0.1, zz: 0.1, xy: 0, xz: 0, yz: 0}}
  link1: {mass_kg: 12, com_m: [0, 0, 0], inertia_kg_m2: {xx: 0.1, yy: 0.1, zz: 0.1, xy: 0, xz: 0, yz: 0}}
limits:
  joint1: {lower_m: -1, upper_m: 1, velocity_m_per_s: 5, effort_n: 500}
interface_limits:
  acceleration_rad_per_s2: [10]
  jerk_rad_per_s3: [1000]
  torque_rate_nm_per_s: [9000]
home_rad: [0]
self_collision: {capsules: {}, ignored_pairs: []}
)";

// A slide along z of its base: vertical, unless the base lies on its side.
TEST(PrismaticJointInAScene, BearsNoWeight) {
  const auto file =
      std::filesystem::path(testing::TempDir()) / ("slide_" + std::to_string(::getpid()) + ".yaml");
  std::ofstream(file) << kSlide;
  const auto refusal = [&](const std::string& rpy, const std::string& more = "") -> std::string {
    try {
      parse("arms:\n  - name: left\n    hand: false\n    model: " + file.string() +
            "\n    base: {rpy_rad: " + rpy + "}\n" + more);
    } catch (const ConfigError& error) {
      return error.what();
    }
    return {};
  };
  EXPECT_THAT(refusal("[0, 0, 0]"),
              testing::AllOf(testing::StartsWith("s.yaml:4: "), testing::HasSubstr("joint1 of arm 'left'"),
                             testing::HasSubstr("90 degrees"), testing::HasSubstr("brake")));
  EXPECT_EQ(refusal("[pi/2, 0, 0.4]"), "");
  // 12 kg and sin(0.04) g press with 4.71 N, and 8.63 N with 10 kg more: a quarter of 34.5 N.
  const std::string leans = "[1.530796, 0, 0.4]", force = "    safety: {torque_max_nm: 30}\n";
  const std::string payload = "    largest_load_kg: 10\n";
  EXPECT_EQ(refusal(leans, force), "");
  EXPECT_EQ(refusal(leans, payload), "");
  EXPECT_THAT(refusal(leans, payload + force), testing::HasSubstr("of its 30 N"));
  EXPECT_THAT(refusal(leans, "    safety: {torque_max_nm: 18}\n"), testing::HasSubstr("of its 18 N"));
  // A preset's number for a revolute joint is none for the axis.
  try {
    parse_scene(
        "arms:\n  - {name: left, hand: false, base: {rpy_rad: [pi/2, 0, 0]}, model: " + file.string() +
            "}\ncontrollets:\n  - {name: a, type: joint_impedance, arms: left, parameters: {preset: "
            "reference}}\n",
        "s.yaml", Registry::with_builtins());
    ADD_FAILURE() << "was read";
  } catch (const ConfigError& error) {
    EXPECT_THAT(error.what(), testing::HasSubstr("for revolute joints"));
  }
  std::filesystem::remove(file);
}

}  // namespace
}  // namespace multipanda::scene_prismatic_joints_test
