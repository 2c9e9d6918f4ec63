#include "scene/additions.hpp"

#include <filesystem>
#include <fstream>

#include <gtest/gtest.h>

#include "config_file/config_error.hpp"
#include "scene/load.hpp"

// Additions leave the text around them as it is, whatever the lists of the scene look like.
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
  const std::filesystem::path folder = testing::TempDir() + "additions \"b\"";
  std::filesystem::create_directories(folder);
  for (const char* name : {"c.so", "own.so"}) std::ofstream(folder / name) << "x";
  const std::filesystem::path near = std::filesystem::relative(folder / "c.so");
  const std::string file = (folder / "s.yaml").string();
  const std::string text = with_additions("plugins: [own.so]\n" + kArm, file, {.plugins = {near.string()}});
  const auto paths = scene_plugins(text, file);
  ASSERT_EQ(paths.size(), 2u);
  EXPECT_TRUE(paths[0].starts_with("/")) << paths[0];
  EXPECT_TRUE(std::filesystem::equivalent(paths[0], folder / "c.so"));
  EXPECT_TRUE(std::filesystem::equivalent(paths[1], folder / "own.so"));
  std::filesystem::remove_all(folder);
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
