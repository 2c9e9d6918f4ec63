#include "experiments/yaml_tree.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace multipanda::yaml_tree_test {
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

TEST(YamlTree, ValuesAreSetByNameAndByNumber) {
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

TEST(YamlTree, AnUnknownPathIsRefusedWithTheNearestName) {
  YAML::Node root = tree();
  const auto put_at = [&](const char* key) {
    return refusal([&] { put(root, {.key = key, .value = "1", .place = {"task.yaml", 7}}); });
  };
  EXPECT_THAT(put_at("objects.tabel.friction"), HasSubstr("task.yaml:7"));
  EXPECT_THAT(put_at("objects.tabel.friction"), HasSubstr("did you mean 'table'?"));
  EXPECT_THAT(put_at("object.table.friction"), HasSubstr("did you mean 'objects'?"));
  EXPECT_THAT(put_at("objects.2.friction"), HasSubstr("there is no '2'"));
  EXPECT_THAT(put_at("objects.table.friction.static"), HasSubstr("leads nowhere"));
  EXPECT_EQ(yaml_text(root), yaml_text(tree())) << "a refused path changed the tree";
}

TEST(YamlTree, NumbersAreVariedByTheirDraws) {
  YAML::Node root = tree();
  std::vector<double> draws{0.5, -1, 0.25, 0.75};
  std::size_t next = 0;
  const auto draw = [&] { return draws.at(next++); };
  vary(root, {.key = "objects.table.friction", .by = 0.2, .place = {}}, draw);
  vary(root, {.key = "objects.table.position_m", .by = 0.01, .place = {}}, draw);
  EXPECT_DOUBLE_EQ(root["objects"][1]["friction"].as<double>(), 0.4);
  EXPECT_DOUBLE_EQ(root["objects"][1]["position_m"][0].as<double>(), 0.39);
  EXPECT_DOUBLE_EQ(root["objects"][1]["position_m"][1].as<double>(), 0.0025);
  EXPECT_DOUBLE_EQ(root["objects"][1]["position_m"][2].as<double>(), 0.3075);
  EXPECT_THAT(refusal([&] { vary(root, {.key = "objects.table.name", .by = 1, .place = {}}, draw); }),
              HasSubstr("plain decimal number"));
}

TEST(YamlTree, JsonHasNumbersBooleansAndStrings) {
  const auto json =
      yaml_json(YAML::Load("{a: 1, b: 2.5, c: true, d: word, e: '7', f: [1, -2e-3], g: {h: x}}"));
  EXPECT_EQ(json.dump(), R"({"a":1,"b":2.5,"c":true,"d":"word","e":"7","f":[1,-0.002],"g":{"h":"x"}})");
}

}  // namespace
}  // namespace multipanda::yaml_tree_test
