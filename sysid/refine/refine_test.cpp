#include "sysid/refine/refine.hpp"

#include <cstdlib>
#include <filesystem>
#include <numbers>
#include <unistd.h>

#include <gtest/gtest.h>

#include "models/write_robot.hpp"
#include "scene/build.hpp"
#include "scene/load.hpp"
#include "sysid/identification/testing/simulated_log.hpp"

namespace multipanda::refine_test {
namespace {

namespace fs = std::filesystem;

fs::path folder(const std::string& name) {
  const fs::path path = fs::path(testing::TempDir()) / ("refine_" + std::to_string(getpid())) / name;
  fs::remove_all(path);
  fs::create_directories(path);
  return path;
}

// An arm that differs from the table in everything that refine identifies.
RobotDescription other_arm() {
  RobotDescription robot = load_robot("fer");
  for (std::size_t i = 1; i < robot.links.size(); ++i) {
    robot.links[i].mass *= i % 2 == 0 ? 1.06 : 0.95;
    robot.links[i].com += Vector3(0.004, -0.003, 0.005);
  }
  const RigidBody load{.mass = 0.5, .com = {0.01, 0.0, 0.05}, .inertia = 1e-3 * Matrix3::Identity()};
  robot.links.back() = merged(robot.links.back(), moved(load, robot.flange.pose()));
  robot.friction->p1 *= 1.3;
  robot.actuation = Actuation{.torque_bandwidth_hz = 40, .command_delay = 0.0022};
  return robot;
}

TEST(Refine, ImprovesAKnownPlant) {
  const fs::path directory = folder("known");
  const std::string file = (directory / "truth.yaml").string();
  write_robot(other_arm(), load_robot("fer"), file);
  const char* task = std::getenv("MULTIPANDA_REFINE_TASK");
  const Experiment experiment = load_experiment(task == nullptr ? "task-1" : task);
  RefineOptions options{.repeats = 2, .directory = directory, .page = false};
  options.target.known = {{"arm", file}, {"left", file}, {"right", file}};
  const RefineResult result = refine(experiment, options, {.line = [](const std::string& line) {
                                       std::printf("%s\n", line.c_str());
                                       std::fflush(stdout);
                                     }});
  EXPECT_TRUE(result.faults.empty());
  ASSERT_EQ(result.rounds.size(), 1u);
  for (const auto& changes : result.rounds[0].changes) {
    for (const auto& change : changes) {
      EXPECT_FALSE(change.worse) << change.name;
      if (change.name == "F_EE" || change.name == "q") {
        EXPECT_LT(change.ratio, 0.5) << change.name;
      }
    }
  }
  const auto& found = result.rounds[0].arms[0].found;
  EXPECT_NEAR(found["delay_s"].get<double>(), 0.0022, 0.0002);
  EXPECT_NEAR(found["bandwidth_hz"].get<double>(), 40, 2);
  // The model is read back as written, and is the plant of a scene.
  EXPECT_NO_THROW(load_robot(result.rounds[0].arms[0].model.string()));
}

// Joint by joint the refined plant moves what the arm moves, links and motors: neither with the rotors of its
// model where the arm's torque loop hides them, nor with rotors twice where they act. Simulations of it are
// virtual arms, whose rotors act by default.
TEST(Refine, MotorsThatActCountOnce) {
  const fs::path file = folder("motors") / "a.yaml";
  const RobotDescription prior = load_robot("fer");
  for (const double hidden : {1.0, 0.5, 0.0}) {
    Scene scene = test::scene_of({test::arm_named("a")}, PlantFidelity::realistic());
    scene.arms[0].rotor_hidden = hidden;
    const MeasuredLog log = test::record(scene, test::RichMotion(21), {.duration_s = 8, .dither_nm = 0.5});
    (void)identify_arm(scene.arms[0], prior, std::span(&log, 1), {.family = "rigid", .file = file});
    const JointVector truth = test::Loop(scene).backend.world().joint_inertia(0);
    scene.arms[0].plant_model = file;
    scene.arms[0].rotor_hidden = 0;
    const JointVector refined = test::Loop(scene).backend.world().joint_inertia(0);
    for (Eigen::Index j = 0; j < 7; ++j) {
      EXPECT_NEAR(refined[j], truth[j], 0.06 * prior.rotor_inertia[j]) << "joint " << j + 1 << ", " << hidden;
    }
  }
}

// Two arms side by side turn away from each other, to the sides; a single one stays as it is.
TEST(Refine, ExcitesArmsOneAfterTheOtherFacingAway) {
  const OpenedScene pair = open_scene(experiments_folder() + "/scenes/task_5.yaml");
  const ExcitationFile file = read_excitation(excitation_path("fer"), pair.registry);
  const std::vector<RobotDescription> robots(2, load_robot("fer"));
  const ExcitationRun run = excitation_run(pair.scene, {file, file}, robots, 3);
  const Scene scene = parse_scene(run.scene, pair.scene.path, pair.registry);
  ASSERT_EQ(run.windows.size(), 2u);
  EXPECT_GT(run.windows[1].begin, run.windows[0].end - 1e-9);
  EXPECT_NEAR(scene.arms[0].q_start[0] - file.motion.q_start[0], std::numbers::pi / 2,
              1e-3);  // the left arm to the left
  EXPECT_NEAR(scene.arms[1].q_start[0] - file.motion.q_start[0], -std::numbers::pi / 2, 0.2);
  for (const auto& object : scene.objects) EXPECT_EQ(object.shape, SceneObject::Shape::plane);
  EXPECT_EQ(scene.timeline.size(), 4u);
  EXPECT_GT(scene.duration_s, run.windows[1].end);

  const OpenedScene alone = open_scene(experiments_folder() + "/scenes/task_4.yaml");
  const ExcitationRun single = excitation_run(alone.scene, {file}, {robots[0]}, 3);
  const Scene bare = parse_scene(single.scene, alone.scene.path, alone.registry);
  EXPECT_LT((bare.arms[0].q_start - file.motion.q_start).norm(), 1e-9);
  EXPECT_EQ(bare.arms[0].tool.mass, alone.scene.arms[0].tool.mass);
}

// Rows at the given time, all parts alike.
TEST(Refine, CutsLogs) {
  MeasuredLog log;
  log.t = Eigen::VectorXd::LinSpaced(1001, 0, 1);
  log.q = log.dq = log.tau = log.t.replicate(1, 7);
  const MeasuredLog part = cut(log, 0.25, 0.5);
  EXPECT_EQ(part.samples(), 251);
  EXPECT_NEAR(part.t[0], 0.25, 1e-12);
  EXPECT_EQ(part.q(250, 3), part.t[250]);
  EXPECT_EQ(part.F_EE.rows(), 0);
}

}  // namespace
}  // namespace multipanda::refine_test
