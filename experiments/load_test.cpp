#include <algorithm>
#include <fstream>
#include <tuple>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "experiments/experiment.hpp"
#include "experiments/kinds.hpp"
#include "experiments/task_runs.hpp"
#include "scene/build.hpp"

namespace multipanda::load_test {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;

const std::string kFile = experiments_folder() + "/invented.yaml";
const std::string kHead = "title: invented\nscene: scenes/task_1.yaml\n";

Experiment read(const std::string& rest) { return parse_experiment(kHead + rest, kFile); }

std::string refusal(const std::string& text) {
  try {
    (void)parse_experiment(text, kFile);
  } catch (const ConfigError& error) {
    return error.what();
  }
  return "not refused";
}

std::vector<std::string> names(const std::vector<ExperimentVariant>& variants) {
  std::vector<std::string> list;
  for (const auto& variant : variants) list.push_back(variant.name);
  return list;
}

TEST(Experiments, ShippedOnesAreReadWithAllTheirScenes) {
  ASSERT_FALSE(available_experiments().empty());
  for (const auto& name : available_experiments()) {
    SCOPED_TRACE(name);
    const Experiment experiment = load_experiment(name);
    EXPECT_FALSE(experiment.title.empty());
    EXPECT_FALSE(experiment.limits.empty()) << "nothing could fail";
    if (experiment.kind != kTaskKind) continue;
    const Registry registry = build_registry({});
    for (const auto& run : task_runs(experiment, 2, {})) {
      const Scene scene = task_scene(experiment, run, registry);
      EXPECT_TRUE(scene.plant.name.starts_with(run.plant)) << scene.plant.name;
      EXPECT_GT(scene.duration_s, 0);
    }
  }
}

TEST(Experiments, MetricsOfLimitsAreKnownBeforeAnythingRuns) {
  EXPECT_THAT(refusal(kHead + "limits: [{metric: x_rsme_m, at_most: 1}]\n"), HasSubstr("'x_rmse_m'"));
  // The pages name the metrics: both lists are the same.
  for (const auto& [kind, page, list] : {std::tuple{"task", "task_metrics.py", "NAMES"},
                                         std::tuple{"performance", "performance.py", "LABELS"}}) {
    std::ifstream file(experiments_folder() + "/pages/" + page);
    std::vector<std::string> known;
    bool inside = false;
    for (std::string line; std::getline(file, line);) {
      if (line.starts_with(list)) inside = true;
      if (inside && line.starts_with("}")) break;
      if (inside && line.starts_with("    \"")) known.push_back(line.substr(5, line.find('"', 5) - 5));
    }
    EXPECT_THAT(find_kind(kind)->metrics, testing::UnorderedElementsAreArray(known)) << page;
  }
}

TEST(Experiments, AnEventAfterTheEndOfTheSceneIsRefused) {
  const Experiment e = read("set: {duration_s: 0.5}\n");
  try {
    (void)task_scene(e, task_runs(e, 1, {}).at(0), build_registry({}));
    FAIL() << "not refused";
  } catch (const ConfigError& error) {
    EXPECT_THAT(error.what(), HasSubstr("the scene ends before this event"));
  }
}

TEST(Experiments, AxesAreCombinedAndSingleVariantsFollow) {
  const Experiment e = read(
      "axes:\n"
      "  - {name: friction, choices: [{name: a, label: A, set: {duration_s: 1}}, {name: b}]}\n"
      "  - {name: stiffness, choices: [{name: x, set: {duration_s: 2}}, {name: y, reported: true}]}\n"
      "variants: [{name: alone, label: by itself}]\n"
      "limits: [{metric: x_rmse_m, at_most: {ideal: 3}, variants: [x]}, {metric: limiter_hits, at_least: "
      "1}]\n");
  EXPECT_THAT(names(e.variants), ElementsAre("a_x", "a_y", "b_x", "b_y", "alone"));
  EXPECT_EQ(e.variants[0].label, "A, x");
  EXPECT_THAT(e.variants[0].tags, ElementsAre("a", "x", "a_x"));
  ASSERT_EQ(e.variants[0].set.size(), 2u);
  EXPECT_EQ(e.variants[0].set[1].value, "2") << "a later axis has the last word";
  EXPECT_TRUE(e.variants[1].reported);
  EXPECT_FALSE(e.variants[2].reported);
  EXPECT_EQ(e.limits[0].at_most.size(), 1u);
  EXPECT_EQ(e.limits[1].at_least.at("realistic"), 1) << "one number is for every plant";
  EXPECT_EQ(chosen_variants(e, {"x"}).size(), 2u);
  EXPECT_EQ(chosen_variants(e, {"alone"}).size(), 1u);
  EXPECT_THROW(chosen_variants(e, {"alona"}), std::invalid_argument);
  EXPECT_EQ(task_runs(e, 3, {"x"}).size(), 2u * 3u * 2u);
}

TEST(Experiments, RepeatsAreVariedAlikeEverywhereAndDifferFromEachOther) {
  const Experiment e = read(
      "seed: 4\n"
      "variants: [{name: a}, {name: b, set: {duration_s: 3}}]\n"
      "vary: [{key: arms.arm.start_rad, by: 0.02}]\n");
  const Registry registry = build_registry({});
  const auto start = [&](std::size_t variant, const std::string& plant, std::size_t repeat) {
    return task_scene(e, {&e.variants[variant], plant, repeat}, registry).arms[0].q_start;
  };
  const JointVector first = start(0, "ideal", 1);
  EXPECT_EQ(first, start(1, "realistic", 1));
  EXPECT_EQ(first, start(0, "ideal", 1));
  EXPECT_NE(first, start(0, "ideal", 2));
  JointVector middle(7);
  middle << 0, -0.7854, 0, -2.3562, 0, 1.5708, 0.7854;
  for (std::size_t repeat = 1; repeat <= 20; ++repeat) {
    const double away = (start(0, "ideal", repeat) - middle).lpNorm<Eigen::Infinity>();
    EXPECT_LE(away, 0.02);
    EXPECT_GT(away, 0.002);
  }
  Experiment other = e;
  other.seed = 5;
  EXPECT_NE(first, task_scene(other, {&other.variants[0], "ideal", 1}, registry).arms[0].q_start);
  EXPECT_EQ(task_scene(e, {&e.variants[1], "ideal", 1}, registry).duration_s, 3);
}

TEST(Experiments, InvalidExperimentsAreRefusedWithTheReason) {
  EXPECT_THAT(refusal("title: x\nscne: y\n"), HasSubstr("did you mean 'scene'?"));
  EXPECT_THAT(refusal("title: x\n"), HasSubstr("the key 'scene' is missing"));
  EXPECT_THAT(refusal("title: x\nscene: nowhere.yaml\n"), HasSubstr("there is no file"));
  EXPECT_THAT(refusal("title: x\nkind: tusk\n"), HasSubstr("did you mean 'task'?"));
  EXPECT_THAT(refusal(kHead + "limits: [{metric: held}]\n"), HasSubstr("'at_most' or 'at_least'"));
  EXPECT_THAT(refusal(kHead + "limits: [{metric: held, at_most: {idael: 1}}]\n"),
              HasSubstr("did you mean 'ideal'?"));
  EXPECT_THAT(refusal(kHead + "limits: [{metric: held, at_most: 1, variants: [b]}]\n"),
              HasSubstr("no variant or choice 'b'"));
  EXPECT_THAT(refusal(kHead + "variants: [{name: a}, {name: a}]\n"), HasSubstr("names must differ"));
  EXPECT_THAT(refusal(kHead + "measure: {window: {after: contct}}\n"), HasSubstr("did you mean 'contact'?"));
  EXPECT_THAT(refusal(kHead + "measure: {force: [{arm: arm, instance: a}]}\n"),
              HasSubstr("'direction' is missing"));
  EXPECT_THAT(refusal("title: ["), HasSubstr("not readable as YAML"));
  EXPECT_THAT(refusal("[]"), HasSubstr("expected a mapping"));
}

TEST(Experiments, AnOverrideThatTheSceneRefusesSaysWhichVariant) {
  const Experiment e = read("variants: [{name: odd, set: {duration_s: -1}}]\n");
  try {
    (void)task_scene(e, {&e.variants[0], "ideal", 1}, build_registry({}));
    FAIL() << "not refused";
  } catch (const ConfigError& error) {
    EXPECT_THAT(error.what(), HasSubstr("variant 'odd', plant 'ideal'"));
    EXPECT_THAT(error.what(), HasSubstr("duration_s"));
  }
}

TEST(Experiments, AnUnknownNameGetsTheNearestName) {
  try {
    (void)load_experiment("task-11");
    FAIL() << "not refused";
  } catch (const ConfigError& error) {
    EXPECT_THAT(error.what(), HasSubstr("did you mean 'task-1'?"));
  }
}

}  // namespace
}  // namespace multipanda::load_test
