#include "scene/additions.hpp"

#include <gtest/gtest.h>

#include "config_file/config_error.hpp"
#include "scene/load.hpp"

// Additions leave the text around them as it is. The scene that is read has them, whatever its lists look
// like.
namespace multipanda::additions_test {
namespace {

const std::string kArm = "arms: [{name: arm, model: fer}]\n";
const std::string kEntry = "{name: added, type: joint_impedance, arms: arm}";
const std::string kOther = "{name: own, type: hold, arms: arm}";

std::vector<std::string> names(const std::string& text) {
  std::vector<std::string> found;
  for (const auto& config : parse_scene(text, "scene.yaml", Registry::with_builtins()).controllets)
    found.push_back(config.name);
  return found;
}

using Names = std::vector<std::string>;

TEST(SceneAdditions, ControlletsJoinListsOfEveryForm) {
  const SceneAdditions additions{.controllets = {kEntry}};
  const auto with = [&](const std::string& list) {
    return names(with_additions(kArm + list, "s.yaml", additions));
  };
  EXPECT_EQ(with(""), Names{"added"});
  EXPECT_EQ(with("controllets: []\n"), Names{"added"});
  const Names both{"added", "own"};
  EXPECT_EQ(with("controllets: [" + kOther + "]\n"), both);
  EXPECT_EQ(with("controllets:   # of the file\n  - " + kOther + "  # it\n"), both);
  EXPECT_EQ(with("controllets:\n- name: own\n  type: hold\n  arms: arm\n"), both);
  EXPECT_EQ(
      with("controllets:\n  # \xc2\xb5 before\n  - {name: own, type: hold, arms: arm}\nduration_s: 3\n"),
      both);
  EXPECT_EQ(names(with_additions(kArm.substr(0, kArm.size() - 1), "s.yaml", additions)), Names{"added"});
}

TEST(SceneAdditions, PluginsAreAbsoluteAndQuoted) {
  const std::string text =
      with_additions("plugins: [own.so]\n" + kArm, "folder/s.yaml", {.plugins = {"/a \"b\"/c.so", "d.so"}});
  const auto paths = scene_plugins(text, "/folder/s.yaml");
  ASSERT_EQ(paths.size(), 3u);
  EXPECT_EQ(paths[0], "/a \"b\"/c.so");
  EXPECT_TRUE(paths[1].front() == '/' && paths[1].ends_with("/d.so")) << paths[1];
  EXPECT_EQ(paths[2], "/folder/own.so");
}

TEST(SceneAdditions, NothingChangesWithoutAny) {
  const std::string text = kArm + "controllets:\n  - " + kOther + "\n";
  EXPECT_EQ(with_additions(text, "s.yaml", {}), text);
}

TEST(SceneAdditions, WhatIsNoListOrNoMappingIsRefused) {
  EXPECT_THROW(with_additions(kArm + "controllets: 3\n", "s.yaml", {.controllets = {kEntry}}), ConfigError);
  EXPECT_THROW(with_additions(kArm + "controllets:\n", "s.yaml", {.controllets = {kEntry}}), ConfigError);
  EXPECT_THROW(with_additions(kArm, "s.yaml", {.controllets = {"added"}}), ConfigError);
  EXPECT_THROW(with_additions(kArm, "s.yaml", {.controllets = {"{name: a}\n- {name: b}"}}), ConfigError);
}

}  // namespace
}  // namespace multipanda::additions_test
