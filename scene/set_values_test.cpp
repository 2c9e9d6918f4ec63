#include <map>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "scene/load.hpp"

namespace multipanda {
namespace {

using testing::HasSubstr;

std::string refusal(const std::string& setting) {
  const OpenedScene opened = open_scene("one_arm");
  try {
    with_values(opened, {setting});
  } catch (const ConfigError& error) {
    return error.what();
  }
  return "not refused";
}

TEST(SetValues, AreThoseOfTheSceneAndOfItsText) {
  const OpenedScene opened = open_scene("one_arm");
  const Scene scene = with_values(opened, {"controllets.cartesian.inputs.pose.timeout_s=0.7",
                                           "controllets.joint.inputs={joints: {timeout_s: 0.3}}",
                                           "contact_bounds={hand_speed_m_per_s: 0.1}"});
  std::map<std::string, double> timeouts_s;
  for (const auto& controllet : scene.controllets)
    for (const auto& input : controllet.inputs) timeouts_s[input.name] = input.timeout_s;
  EXPECT_EQ(timeouts_s, (std::map<std::string, double>{{"pose", 0.7}, {"joints", 0.3}}));
  EXPECT_EQ(scene.contact_bounds.hand_speed, 0.1);
  EXPECT_EQ(scene.path, opened.scene.path);
  const Scene again = parse_scene(scene.text, opened.scene.path, opened.registry);
  EXPECT_EQ(again.contact_bounds.hand_speed, 0.1);
  EXPECT_EQ(with_values(opened, {}).controllets.size(), opened.scene.controllets.size());
}

TEST(SetValues, ThatAreNoneAreRefused) {
  EXPECT_THAT(refusal("timeout_s"), HasSubstr("--set: expected KEY=VALUE, found 'timeout_s'"));
  EXPECT_THAT(refusal("=1"), HasSubstr("expected KEY=VALUE"));
  EXPECT_THAT(refusal("controllets.cartesia.parameters={}"), HasSubstr("did you mean 'cartesian'"));
  EXPECT_THAT(refusal("controllets.cartesian.inputs={pose: {timeout_s: -1}}"), HasSubstr("timeout_s"));
  EXPECT_THAT(refusal("controllets.cartesian.inputs={pose: "), HasSubstr("is not YAML"));
  EXPECT_THAT(refusal("seeed=2"), HasSubstr("seeed"));
}

}  // namespace
}  // namespace multipanda
