#include "scene/rewrite.hpp"

#include <cmath>
#include <filesystem>
#include <fstream>
#include <functional>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <yaml-cpp/yaml.h>

#include "scene/load.hpp"

namespace multipanda::rewrite_test {
namespace {

using testing::HasSubstr;

YAML::Node tree() {
  return YAML::Load(
      "plant: {fidelity: ideal}\n"
      "objects:\n"
      "  - {name: floor, shape: plane}\n"
      "  - {name: table, friction: 0.3, position_m: [0.4, 0, 0.3], contact: {stiffness_n_per_m: 10000}}\n"
      "timeline: [{at_s: 1, stop: all}, {at_s: 2, motion: {period_s: 3}}]\n");
}

std::string refusal(const std::function<void()>& work) {
  try {
    work();
  } catch (const ConfigError& error) {
    return error.what();
  }
  return "not refused";
}

TEST(SceneRewrite, ValuesAreSetByNameAndByNumber) {
  YAML::Node root = tree();
  put(root, {.key = "objects.table.contact.stiffness_n_per_m", .value = "1000", .place = {}});
  put(root, {.key = "objects.table.position_m.2", .value = "0.5", .place = {}});
  put(root, {.key = "timeline.1.at_s", .value = "7", .place = {}});
  put(root, {.key = "timeline.motion.motion.period_s", .value = "4", .place = {}});
  put(root, {.key = "objects.0", .value = "{name: ground, shape: plane}", .place = {}});
  put(root, {.key = "objects.table.contact.damping_ratio", .value = "0.3", .place = {}});  // a new key
  put(root, {.key = "seed", .value = "5", .place = {}});
  EXPECT_EQ(root["objects"][1]["contact"]["stiffness_n_per_m"].as<double>(), 1000);
  EXPECT_EQ(root["objects"][1]["contact"]["damping_ratio"].as<double>(), 0.3);
  EXPECT_EQ(root["objects"][1]["position_m"][2].as<double>(), 0.5);
  EXPECT_EQ(root["objects"][1]["position_m"][0].as<double>(), 0.4);
  EXPECT_EQ(root["objects"][0]["name"].as<std::string>(), "ground");
  EXPECT_EQ(root["timeline"][0]["at_s"].as<double>(), 1);
  EXPECT_EQ(root["timeline"][1]["at_s"].as<double>(), 7);
  EXPECT_EQ(root["timeline"][1]["motion"]["period_s"].as<double>(), 4);
  EXPECT_EQ(root["seed"].as<int>(), 5);
  EXPECT_EQ(root["plant"]["fidelity"].as<std::string>(), "ideal");
}

TEST(SceneRewrite, AnUnknownPathIsRefusedWithTheNearestName) {
  YAML::Node root = tree();
  const auto put_at = [&](const char* key) {
    return refusal([&] { put(root, {.key = key, .value = "1", .place = {"task.yaml", 7}}); });
  };
  EXPECT_THAT(put_at("objects.tabel.friction"), HasSubstr("task.yaml:7"));
  EXPECT_THAT(put_at("objects.tabel.friction"), HasSubstr("did you mean 'table'?"));
  EXPECT_THAT(put_at("object.table.friction"), HasSubstr("did you mean 'objects'?"));
  EXPECT_THAT(put_at("objects.2.friction"), HasSubstr("there is no '2'"));
  EXPECT_THAT(put_at("objects.table.friction.static"), HasSubstr("does not exist"));
  EXPECT_EQ(yaml_text(root), yaml_text(tree())) << "a refused path changed the tree";
}

TEST(SceneRewrite, NumbersAreVariedByTheirDraws) {
  YAML::Node root = tree();
  SeededDraw draw(3, 1), same(3, 1);
  vary(root, {.key = "objects.table.friction", .by = 0.2, .place = {}}, draw);
  vary(root, {.key = "objects.table.position_m", .by = 0.01, .place = {}}, draw);
  EXPECT_DOUBLE_EQ(root["objects"][1]["friction"].as<double>(), 0.3 + 0.2 * same());
  const double place[] = {0.4, 0, 0.3};
  for (std::size_t k = 0; k < 3; ++k)
    EXPECT_DOUBLE_EQ(root["objects"][1]["position_m"][k].as<double>(), place[k] + 0.01 * same());
  EXPECT_LT(std::abs(same()), 1);
  EXPECT_THAT(refusal([&] { vary(root, {.key = "objects.table.name", .by = 1, .place = {}}, draw); }),
              HasSubstr("plain decimal number"));
}

TEST(SceneBase, IsWrittenAndReadAgain) {
  const OpenedScene opened = open_scene("two_arms");
  const Pose X_WB{rotation_from_rpy({0.01, -0.02, 3.0}), Vector3(0.1, -0.3, 0.02)};
  const std::string text = with_base(opened.scene.text, "right", X_WB, "note");
  const Scene read = parse_scene(text, "scene.yaml", opened.registry);
  EXPECT_LT(pose_error(X_WB, read.arms[1].X_WB).norm(), 1e-6);
  EXPECT_LT(pose_error(opened.scene.arms[0].X_WB, read.arms[0].X_WB).norm(), 1e-12);
  EXPECT_EQ(read.controllets.size(), opened.scene.controllets.size());
  EXPECT_THROW(with_base(opened.scene.text, "middle", X_WB, ""), std::invalid_argument);
}

// Additions leave the text around them as it is, whatever the lists of the scene look like.
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
}  // namespace multipanda::rewrite_test
