#include "scene/from_parameters.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "scene/load.hpp"
#include "scene/testing/test_scenes.hpp"

namespace multipanda::from_parameters_test {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;

FlatParameters two_arms() {
  return {{"update_rate", std::int64_t{1000}},
          {"use_sim_time", true},
          {"arm_names", std::vector<std::string>{"right", "left"}},
          {"arms.left.base.position_m", std::vector<double>{0, 0.26, 0}},
          {"arms.left.gravity_compensation", std::string("robot")},
          {"arms.left.joints", std::vector<std::string>{"a", "b", "c", "d", "e", "f", "g"}},
          {"arms.right.hand", false},
          {"arms.right.state_interfaces", std::vector<std::string>{"position", "velocity"}},
          {"controllets.pair.type", std::string("duo")},
          {"controllets.pair.arms", std::vector<std::string>{"left", "right"}},
          {"controllets.pair.features", std::vector<std::string>{"joint_limits"}},
          {"controllets.pair.parameters.stiffness_n_per_m", std::vector<double>{100, 0.1, 1.0 / 3}},
          {"controllets.pair.parameters.joint_limits.range_rad", 0.25},
          {"controllets.pair.parameters.axes", std::string("tool")},
          {"controllets.pair.inputs.pose.max_speed_m_per_s", std::int64_t{2}},
          {"controllets.solo1.type", std::string("solo")},
          {"controllets.solo1.arms", std::string("right")},
          {"active", std::vector<std::string>{"pair"}}};
}

std::string refusal(FlatParameters parameters) {
  try {
    const ParameterScene scene = scene_from_parameters(parameters);
    (void)parse_scene(scene.yaml, "parameters", registry());
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
  return "none";
}

FlatParameters with(const std::string& name, ParameterValue value) {
  FlatParameters parameters = two_arms();
  std::erase_if(parameters, [&](const auto& p) { return p.first == name; });
  parameters.emplace_back(name, std::move(value));
  return parameters;
}

TEST(FromParameters, GiveTheSameSceneAsAFile) {
  const ParameterScene parameters = scene_from_parameters(two_arms());
  const Scene scene = parse_scene(parameters.yaml, "parameters", registry());
  ASSERT_EQ(scene.arms.size(), 2u);
  EXPECT_EQ(scene.arms[0].name, "right");
  EXPECT_FALSE(scene.arms[0].hand);
  EXPECT_EQ(scene.arms[1].name, "left");
  EXPECT_EQ(scene.arms[1].X_WB.position, Vector3(0, 0.26, 0));
  ASSERT_EQ(scene.controllets.size(), 2u);
  const InstanceConfig& pair = scene.controllets[0];
  EXPECT_EQ(pair.name, "pair");
  EXPECT_THAT(pair.arms, ElementsAre(1, 0));
  EXPECT_THAT(pair.features, ElementsAre("joint_limits"));
  const auto value = [&](const std::string& name) {
    for (const auto& p : pair.parameters) {
      if (p.name == name) return p.values;
    }
    return std::vector<double>{};
  };
  EXPECT_THAT(value("stiffness_n_per_m"), ElementsAre(100, 0.1, 1.0 / 3));  // to the last bit
  EXPECT_THAT(value("joint_limits.range_rad"), testing::Each(0.25));
  EXPECT_THAT(value("axes"), ElementsAre(1));
  ASSERT_EQ(pair.inputs.size(), 1u);
  EXPECT_EQ(pair.inputs[0].max_speed, 2);
  EXPECT_THAT(scene.active, ElementsAre("pair"));
}

TEST(FromParameters, RemovesTheKeysOfTheHost) {
  const ParameterScene scene = scene_from_parameters(two_arms());
  ASSERT_EQ(scene.arms.size(), 2u);
  EXPECT_EQ(scene.arms[0].gravity, HostedArm::Gravity::unspecified);
  EXPECT_EQ(scene.arms[1].gravity, HostedArm::Gravity::robot);
  EXPECT_EQ(scene.arms[1].joints.size(), 7u);
  EXPECT_FALSE(scene.arms[1].forces_by_robot);
  EXPECT_FALSE(scene.arms[0].has_effort || scene.arms[0].has_robot_state);
  EXPECT_TRUE(scene.arms[1].has_effort && scene.arms[1].has_robot_state);
}

TEST(FromParameters, AsksForTheRobotDescription) {
  FlatParameters parameters = with("arms.left.model", std::string("robot_description"));
  parameters.emplace_back("arms.left.tip_link", std::string("tool0"));
  const auto scene =
      scene_from_parameters(parameters, [](const HostedArm& arm) { return "/m/" + arm.tip_link; });
  EXPECT_THAT(scene.yaml, HasSubstr("model: /m/tool0"));
  EXPECT_THAT(scene.yaml, HasSubstr("hand: false"));  // it is among the description's links
  EXPECT_THAT(refusal(parameters), HasSubstr("no robot description"));
}

TEST(FromParameters, RefusalsNameTheParameter) {
  EXPECT_THAT(refusal(with("arm_names", std::vector<std::string>{"right"})),
              HasSubstr("parameter 'arms.left': there is no arm of this name in arm_names"));
  EXPECT_THAT(refusal(with("arms.left.gravity_compensation", std::string("robots"))),
              HasSubstr("'arms.left.gravity_compensation': found 'robots'; did you mean 'robot'?"));
  EXPECT_THAT(refusal(with("controllet.pair.type", std::string("duo"))),
              HasSubstr("did you mean 'controllets.pair.type'?"));
  EXPECT_THAT(refusal(with("controllets.pair.type.x", 1.0)), HasSubstr("already has a value"));
  EXPECT_THAT(refusal(with("controllets.pair.type", std::string("dou"))),
              HasSubstr("controllet 'pair': type"));
  EXPECT_THAT(refusal(with("arms.left.tip_link", std::string("x"))), HasSubstr("model: robot_description"));
  EXPECT_THAT(refusal({{"controllets.a.type", std::string("solo")}}), HasSubstr("no arms"));
  EXPECT_THAT(refusal(with("arms..model", std::string("fer"))), HasSubstr("between the dots"));
  EXPECT_THAT(refusal(with("arms.left.state_interfaces", std::vector<std::string>{"position"})),
              HasSubstr("position and velocity are required"));
  EXPECT_THAT(refusal(with("arms.left.state_interfaces", std::vector<std::string>{"efort"})),
              HasSubstr("did you mean 'effort'?"));
  EXPECT_EQ(refusal(two_arms()), "none");
}

TEST(FromParameters, SceneFilesMayAlsoNameTheirItems) {
  const Scene scene = parse(
      "arms: {left: {}, right: {base: {position_m: [0, 1, 0]}}}\n"
      "objects: {table: {shape: box, size_m: [1, 1, 0.1]}}\n"
      "controllets: {a: {type: solo, arms: left}}\nactive: a\n");
  EXPECT_EQ(scene.arms.at(1).name, "right");
  EXPECT_EQ(scene.objects.at(0).name, "table");
  EXPECT_EQ(scene.controllets.at(0).name, "a");
  EXPECT_THROW((void)parse("arms: {left: {name: right}}\n"), std::invalid_argument);
  EXPECT_THROW((void)parse("arms: {left: 3}\n"), std::invalid_argument);
}

}  // namespace
}  // namespace multipanda::from_parameters_test
