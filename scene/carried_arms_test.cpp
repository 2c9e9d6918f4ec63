// Arms that stand on another arm: what a scene says of them, what it is refused for, where they start.
#include <filesystem>
#include <fstream>
#include <unistd.h>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/cycle/control_cycle.hpp"
#include "scene/build.hpp"
#include "scene/testing/test_scenes.hpp"

namespace multipanda::carried_arms_test {
namespace {

using testing::HasSubstr;

const std::string kTorso = std::string(MULTIPANDA_SOURCE_DIR) + "/scene/testing/torso_arm.yaml";

// Lines 1 and 2: the carrier. What a test adds begins in line 3.
std::string carrier(const std::string& more = "base: {position_m: [0.4, -0.7, 0.2], rpy_rad: [0, 0, 0.9]}") {
  return "arms:\n  - {name: left, hand: false, model: " + kTorso + ", " + more + "}\n";
}
const std::string kMount = "position_m: [-0.02, -0.15, 0.4], rpy_rad: [1.0, 0.1, -0.3]";
std::string carried(const std::string& more, const std::string& name = "right") {
  return "  - {name: " + name + ", hand: false, " + more + "}\n";
}
std::string on_left(const std::string& joint = "1", const std::string& mount = kMount) {
  return "base_on: {arm: left, joint: " + joint + ", " + mount + "}";
}

Pose turned(double angle) {
  return {Eigen::AngleAxisd(angle, Vector3::UnitZ()).toRotationMatrix(), Vector3::Zero()};
}

void expect_same(const Pose& found, const Pose& expected) {
  EXPECT_LT((found.position - expected.position).norm(), 1e-12);
  EXPECT_LT((found.rotation - expected.rotation).norm(), 1e-12);
}

TEST(CarriedArm, StartsWhereItsCarrierHasIt) {
  const Scene scene = parse(carrier("base: {position_m: [0.4, -0.7, 0.2], rpy_rad: [0, 0, 0.9]}, "
                                    "start_rad: [-0.7, 0.3, 0.2, -0.4, -1.8, 0.2, 1.7, 0.5]") +
                            carried(on_left()) + carried("base: {position_m: [3, 0, 0]}", "other"));
  const SceneArm& arm = scene.arms[1];
  ASSERT_TRUE(arm.mount.has_value());
  EXPECT_EQ(arm.mount->carrier, 0u);
  EXPECT_EQ(arm.mount->joint, 0u);
  EXPECT_EQ(arm.mount_place.line, 3);
  const Pose X_JB{rotation_from_rpy({1.0, 0.1, -0.3}), {-0.02, -0.15, 0.4}};
  expect_same(arm.mount->X_JB, X_JB);
  // The figures of torso_arm.yaml: joint1 is at [0.02, -0.01, 0.45], turned by 0.3 about z.
  const Pose X_WB_left{rotation_from_rpy({0, 0, 0.9}), {0.4, -0.7, 0.2}};
  const Pose X_BJ{rotation_from_rpy({0, 0, 0.3}), {0.02, -0.01, 0.45}};
  expect_same(arm.X_WB, X_WB_left * X_BJ * turned(-0.7) * X_JB);

  EXPECT_FALSE(scene.arms[0].mount.has_value());
  EXPECT_FALSE(scene.arms[2].mount.has_value());
  EXPECT_EQ(carried_arm(scene), &arm);
  const CycleConfig config = build_cycle_config(scene);
  EXPECT_FALSE(config.arms[0].mount.has_value());
  ASSERT_TRUE(config.arms[1].mount.has_value());
  expect_same(config.arms[1].mount->X_JB, X_JB);
  expect_same(config.arms[1].model->X_WB(), arm.X_WB);
}

// The base behind a later joint of the torso: two yaws, the second one beside the first.
TEST(CarriedArm, StandsBehindAnyUprightJoint) {
  const std::string text = R"(name: two_yaws
title: Two yaws
joints:
  joint1: {position_m: [0, 0, 0.3]}
  joint2: {position_m: [0.2, 0.1, 0.1], rpy_rad: [3.141592653589793, 0, 0]}
flange: {position_m: [0.1, 0, 0]}
inertials:
  link0: {mass_kg: 9, com_m: [0, 0, 0], inertia_kg_m2: {xx: 0.1, yy: 0.1, zz: 0.1, xy: 0, xz: 0, yz: 0}}
  link1: {mass_kg: 5, com_m: [0, 0, 0], inertia_kg_m2: {xx: 0.1, yy: 0.1, zz: 0.1, xy: 0, xz: 0, yz: 0}}
  link2: {mass_kg: 5, com_m: [0, 0, 0], inertia_kg_m2: {xx: 0.1, yy: 0.1, zz: 0.1, xy: 0, xz: 0, yz: 0}}
limits:
  joint1: {lower_rad: -2, upper_rad: 2, velocity_rad_per_s: 2, effort_nm: 80}
  joint2: {lower_rad: -2, upper_rad: 2, velocity_rad_per_s: 2, effort_nm: 80}
interface_limits:
  acceleration_rad_per_s2: [10, 10]
  jerk_rad_per_s3: [1000, 1000]
  torque_rate_nm_per_s: [1000, 1000]
home_rad: [0, 0]
self_collision: {capsules: {}, ignored_pairs: []}
)";
  const auto file =
      std::filesystem::path(testing::TempDir()) / ("two_yaws_" + std::to_string(::getpid()) + ".yaml");
  std::ofstream(file) << text;
  const Scene scene =
      parse("arms:\n  - {name: left, hand: false, start_rad: [0.5, -1.1], model: " + file.string() + "}\n" +
            carried(on_left("2")));
  std::filesystem::remove(file);
  EXPECT_EQ(scene.arms[1].mount->joint, 1u);
  const Pose X_J1{Matrix3::Identity(), {0, 0, 0.3}};
  const Pose X_J1J2{Vector3(1, -1, -1).asDiagonal(), {0.2, 0.1, 0.1}};
  expect_same(scene.arms[1].X_WB, X_J1 * turned(0.5) * X_J1J2 * turned(-1.1) * scene.arms[1].mount->X_JB);
}

TEST(CarriedArm, IsRefusedByWhatNeedsAStandingBase) {
  const Scene still = parse("arms:\n  - {name: left}\n");
  EXPECT_EQ(carried_arm(still), nullptr);
  refuse_carried_arms(still, "commission");
  const Scene scene = parse(carrier() + carried(on_left()));
  try {
    refuse_carried_arms(scene, "commission");
    ADD_FAILURE() << "was not refused";
  } catch (const ConfigError& error) {
    EXPECT_EQ(error.place().line, 3);
    EXPECT_STREQ(
        error.what(),
        "s.yaml:3: arm 'right' stands on arm 'left': commission cannot place a moving base; run it with "
        "`multipanda run` on the simulation (backend mujoco)");
  }
}

struct Refusal {
  std::string what, text;
  int line;
  std::vector<std::string> fragments;
};
void PrintTo(const Refusal& refusal, std::ostream* out) { *out << refusal.what; }

class CarriedArmRefused : public testing::TestWithParam<Refusal> {};

TEST_P(CarriedArmRefused, NamesPlaceAndExpectation) {
  const Refusal& refusal = GetParam();
  try {
    parse(refusal.text);
    FAIL() << "was read:\n" << refusal.text;
  } catch (const ConfigError& error) {
    EXPECT_EQ(error.place().line, refusal.line) << error.what();
    for (const auto& fragment : refusal.fragments) EXPECT_THAT(error.what(), HasSubstr(fragment));
  }
}

INSTANTIATE_TEST_SUITE_P(
    BaseOn, CarriedArmRefused,
    testing::Values(
        Refusal{"both keys",
                carrier() + carried("base: {position_m: [0, 0, 1]}, " + on_left()),
                3,
                {"arm 'right'", "base or base_on", "both"}},
        Refusal{"unknown arm",
                carrier() + carried("base_on: {arm: lift, joint: 1}"),
                3,
                {"arm 'right': base_on: arm", "there is no arm 'lift' before this one", "'left'"}},
        Refusal{"carrier later",
                "arms:\n" + carried(on_left()) + "  - {name: left, hand: false, model: " + kTorso + "}\n",
                2,
                {"there is no arm 'left' before this one", "earlier in the file"}},
        Refusal{
            "itself", carrier() + carried("base_on: {arm: right, joint: 1}"), 3, {"cannot stand on itself"}},
        Refusal{"carried carrier",
                carrier() + carried(on_left()) + carried("base_on: {arm: right, joint: 1}", "third"),
                4,
                {"arm 'right' stands on arm 'left'", "stands in the world"}},
        Refusal{"two on one",
                carrier() + carried(on_left()) + carried(on_left("1", "position_m: [0.5, 0, 0]"), "third"),
                4,
                {"already carries arm 'right', line 3", "one carried arm"}},
        Refusal{"joint 0", carrier() + carried(on_left("0")), 3, {"joint", "1 to 16"}},
        Refusal{"joint out of range",
                carrier() + carried(on_left("9")),
                3,
                {"base_on: joint", "arm 'left' has 8 joints; expected 1 to 8, found 9"}},
        Refusal{"no joint", carrier() + carried("base_on: {arm: left}"), 3, {"joint"}},
        Refusal{"no arm", carrier() + carried("base_on: {joint: 1}"), 3, {"arm"}},
        Refusal{"real carrier",
                carrier("fci: 172.16.0.2") + carried(on_left()),
                3,
                {"arm 'left' has the key 'fci'", "simulated"}},
        Refusal{"real carried arm",
                carrier() + carried("fci: 172.16.0.2, " + on_left()),
                3,
                {"arm 'right'", "the arm has the key 'fci'", "simulated"}},
        Refusal{"a real arm beside them",
                carrier() + carried(on_left()) +
                    carried("base: {position_m: [3, 0, 0]}, fci: 172.16.0.2", "other"),
                3,
                {"arm 'right' stands on arm 'left'", "real arm", "backend mujoco"}},
        Refusal{"inside its carrier",
                carrier() + carried(on_left("1", "position_m: [0, 0, -0.4]")),
                3,
                {"is inside arm 'left'"}},
        Refusal{"a pitch joint below the base",
                carrier() + carried(on_left("2")),
                3,
                {"arm 'right': base_on: joint", "joint2", "'left'", "degrees from vertical"}},
        Refusal{"a torso that leans",
                carrier("base: {rpy_rad: [0.1, 0, 0]}") + carried(on_left()),
                3,
                {"joint1", "'left'", "5.73 degrees from vertical"}}));

// A slide whose axis leans by 2.3 degrees still bears its own carriage, but no other arm.
TEST(CarriedArm, IsRefusedOnASlideThatLeans) {
  const auto file =
      std::filesystem::path(testing::TempDir()) / ("rail_" + std::to_string(::getpid()) + ".yaml");
  std::ofstream(file) << R"(name: rail
title: Rail
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
  const auto scene = [&](double roll) {
    return "arms:\n  - {name: left, hand: false, start_rad: [0.3], model: " + file.string() +
           ", base: {rpy_rad: [" + std::to_string(roll) + ", 0, 0.4]}}\n" +
           carried(on_left("1", "position_m: [0.1, 0.2, 0.3]"));
  };
  const double level = std::acos(0.0);
  const SceneArm arm = parse(scene(level)).arms[1];
  // The carriage slides along the base's z axis, which lies along -y of a base turned by pi/2 about x.
  const Pose X_WB_left{rotation_from_rpy({level, 0, 0.4}), Vector3::Zero()};
  EXPECT_LT((arm.X_WB.position - X_WB_left * Vector3(0.1, 0.2, 0.3 + 0.3 + 0.3)).norm(), 1e-6);
  try {
    parse(scene(level - 0.04));
    ADD_FAILURE() << "was read";
  } catch (const ConfigError& error) {
    EXPECT_EQ(error.place().line, 3) << error.what();
    EXPECT_THAT(error.what(), HasSubstr("2.29 degrees from level"));
  }
  std::filesystem::remove(file);
}

}  // namespace
}  // namespace multipanda::carried_arms_test
