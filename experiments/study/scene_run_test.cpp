#include "experiments/study/scene_run.hpp"

#include <cmath>
#include <filesystem>
#include <fstream>

#include <Eigen/Geometry>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "common/own_files.hpp"
#include "scene/load.hpp"

namespace multipanda::scene_run_test {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;
using testing::Contains;
using testing::HasSubstr;

SceneRun one_arm(double seconds = 0.05) {
  SceneRun run{.scene = scenes_folder() + "/one_arm.yaml", .set = {}, .vary = {}};
  run.set.push_back({.key = "plant.fidelity", .value = "realistic", .place = {}});
  run.seconds = seconds;
  return run;
}

std::string refusal(const SceneRun& run) {
  try {
    check_scene_run(run);
  } catch (const std::exception& error) {
    return error.what();
  }
  return "not refused";
}

TEST(SceneRun, DependsOnItsInputsAloneNotOnThoseBefore) {
  const Json first = run_scene(one_arm());
  SceneRun other = one_arm();
  other.seed = 2;
  const Json second = run_scene(other);
  EXPECT_EQ(first["figures"], run_scene(one_arm())["figures"]);
  EXPECT_NE(first["figures"]["digest"], second["figures"]["digest"]);
  EXPECT_EQ(first["figures"]["cycles"], 50);
  EXPECT_EQ(first["success"], true);
  EXPECT_GE(first["cost"]["whole_s"].get<double>(), first["cost"]["loop_s"].get<double>());
}

TEST(SceneRun, VariesWithTheSeedWithinTheBound) {
  SceneRun run = one_arm(0.01);
  run.vary.push_back({.key = "objects.box.position_m.0", .by = 0.05, .place = {}});
  run.seed = 1;
  double lowest = INFINITY, highest = -INFINITY;
  const double nominal = run_scene(one_arm(0.01))["figures"]["box/position_m"][0];
  for (run.seed = 1; run.seed <= 5; ++run.seed) {
    const double x = run_scene(run)["figures"]["box/position_m"][0];
    EXPECT_NEAR(x, nominal, 0.05 + 1e-4);  // it moves by less than 0.1 mm in 10 ms
    lowest = std::min(lowest, x);
    highest = std::max(highest, x);
  }
  EXPECT_GT(highest - lowest, 0.005);
}

// By the manufacturer's Denavit-Hartenberg parameters (Craig's convention), published for the FER.
TEST(SceneRun, TheFlangeIsWhereThePublishedKinematicsHaveIt) {
  constexpr double kTurn = 1.5707963267948966;
  const double a[] = {0, 0, 0, 0.0825, -0.0825, 0, 0.088};
  const double d[] = {0.333, 0, 0.316, 0, 0.384, 0, 0};
  const double alpha[] = {0, -kTurn, kTurn, kTurn, -kTurn, kTurn, kTurn};
  const Json figures = run_scene(one_arm())["figures"];
  Eigen::Isometry3d X = Eigen::Isometry3d::Identity();
  for (std::size_t j = 0; j < 7; ++j) {
    X = X * Eigen::AngleAxisd(alpha[j], Vector3::UnitX()) * Eigen::Translation3d(a[j], 0, 0) *
        Eigen::AngleAxisd(figures["arm/q_end_rad"][j].get<double>(), Vector3::UnitZ()) *
        Eigen::Translation3d(0, 0, d[j]);
  }
  const Vector3 p_WF = X * Vector3(0, 0, 0.107);
  EXPECT_NEAR(figures["arm/flange_end_x_m"].get<double>(), p_WF.x(), 1e-9);
  EXPECT_NEAR(figures["arm/flange_end_y_m"].get<double>(), p_WF.y(), 1e-9);
  EXPECT_NEAR(figures["arm/flange_end_z_m"].get<double>(), p_WF.z(), 1e-9);
}

TEST(SceneRun, IsReadFromALine) {
  const SceneRun run = scene_run_from(Json::parse(
      R"({"scene": "s.yaml", "set": [["a.b", "1"]], "vary": [["c", 0.5]], "seed": 7, "seconds": null})"));
  EXPECT_EQ(run.set.at(0).key, "a.b");
  EXPECT_EQ(run.set.at(0).value, "1");
  EXPECT_EQ(run.vary.at(0).by, 0.5);
  EXPECT_EQ(run.seed, 7U);
  EXPECT_FALSE(run.seconds);
  EXPECT_THROW((void)scene_run_from(Json::parse("{}")), std::invalid_argument);
}

TEST(SceneRun, RealArmsAndEndlessScenesAreRefused) {
  SceneRun run = one_arm();
  run.set.push_back({.key = "arms.arm.fci", .value = "{address: 172.16.0.2}", .place = {}});
  EXPECT_THAT(refusal(run), HasSubstr("a study runs simulated arms only"));
  SceneRun endless = one_arm();
  endless.seconds.reset();
  endless.set.push_back({.key = "duration_s", .value = "0", .place = {}});
  EXPECT_THAT(refusal(endless), HasSubstr("expected a duration"));
}

TEST(SceneRun, NamesTheFilesOfItsModelsWithTheirBases) {
  const fs::path folder = fs::path(MULTIPANDA_BINARY_DIR) / "study_models";
  fs::create_directories(folder);
  std::ofstream(folder / "middle.yaml") << "name: middle\ntitle: Middle\nbase: fer\n";
  std::ofstream(folder / "own.yaml") << "name: own\ntitle: Own\nbase: middle\n";
  SceneRun run = one_arm();
  run.set.push_back({.key = "arms.arm.plant_model", .value = (folder / "own.yaml").string(), .place = {}});
  const auto files = scene_files(run);
  for (const auto& file :
       {folder / "own.yaml", folder / "middle.yaml", share_folder() / "models" / "fer.yaml"})
    EXPECT_THAT(files, Contains(file.string()));
}

}  // namespace
}  // namespace multipanda::scene_run_test
