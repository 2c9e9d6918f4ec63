// What experiments do around runs on arms, without arms: the check-list's texts, the clearance of the way to
// the start, answers from files, and what is kept for a resumption.
#include "experiments/on_arms.hpp"

#include <cmath>
#include <filesystem>
#include <fstream>
#include <numbers>
#include <tuple>

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "experiments/arm_steps.hpp"
#include "experiments/motion_extent.hpp"
#include "experiments/task_runs.hpp"
#include "scene/build.hpp"
#include "scene/load.hpp"

namespace multipanda::on_arms_test {
namespace {

namespace fs = std::filesystem;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::Not;
using Json = nlohmann::ordered_json;

class Folder : public testing::Test {
 protected:
  void SetUp() override {
    folder = fs::path(testing::TempDir()) /
             ("on_arms_" + std::string(testing::UnitTest::GetInstance()->current_test_info()->name()));
    fs::remove_all(folder);
    fs::create_directories(folder);
  }
  void TearDown() override { fs::remove_all(folder); }
  fs::path write(const std::string& name, const std::string& text) const {
    std::ofstream(folder / name) << text;
    return folder / name;
  }
  fs::path folder;
};

template <typename Call>
std::string refusal(Call call) {
  try {
    call();
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
  return "not refused";
}

Scene scene_of(const std::string& text) {
  static const Registry registry = build_registry({});
  return parse_scene(text, "test.yaml", registry);
}

TEST(OnArms, TheExperimentKeepsItsStartsAndItsLimits) {
  const Experiment given = load_experiment("task-3");
  std::vector<std::string> left_out;
  const Experiment arms = for_arms(given, left_out);
  EXPECT_THAT(left_out, ElementsAre("stiction"));
  EXPECT_THAT(arms.plants, ElementsAre("realistic", kMeasured));
  for (const auto& limit : arms.limits) {
    if (limit.at_most.contains("realistic")) {
      EXPECT_EQ(limit.at_most.at(kMeasured), limit.at_most.at("realistic")) << limit.metric;
    }
  }
  // Starts are those of the simulation, objects those of the file.
  const Registry registry = build_registry({});
  const TaskRun simulated{&given.variants.front(), "realistic", 2},
      measured{&arms.variants.front(), kMeasured, 2};
  const Scene a = task_scene(given, simulated, registry), b = task_scene(arms, measured, registry);
  EXPECT_EQ(a.arms[0].q_start, b.arms[0].q_start);
  EXPECT_NE(b.arms[0].q_start, load_scene(given.scene, registry).arms[0].q_start);
  EXPECT_EQ(b.objects[1].X_WO.position, load_scene(given.scene, registry).objects[1].X_WO.position);
  EXPECT_NE(a.objects[1].X_WO.position, b.objects[1].X_WO.position);
}

TEST(OnArms, EveryVariantOfThePapersTasksRunsOnArmsExceptOnesThatChangeThePlant) {
  const Registry registry = build_registry({});
  for (const char* name : {"task-1", "task-2", "task-3", "task-4", "task-5", "ufic-vs-impedance"}) {
    std::vector<std::string> left_out;
    const Experiment arms = for_arms(load_experiment(name), left_out);
    for (const auto& run : task_runs(arms, 1, {}))
      EXPECT_NO_THROW(check_for_arms(task_scene(arms, run, registry), run.variant->name)) << name;
  }
  std::vector<std::string> left_out;
  const Experiment loss = for_arms(load_experiment("contact-loss"), left_out);
  const auto runs = task_runs(loss, 1, {});
  EXPECT_THAT(refusal([&] { check_for_arms(task_scene(loss, runs.front(), registry), "any"); }),
              HasSubstr("which only a simulation can do"));
}

// An object seen from a base that is moved and turned, by hand: p_B = R^T (p_W - p_B0).
TEST(OnArms, ObjectsArePlacedInTheBaseFrameOfEachArm) {
  const Scene scene = scene_of(
      "arms:\n"
      "  - {name: left, base: {position_m: [1, 0, 0.5], rpy_rad: [0, 0, pi/2]}}\n"
      "  - {name: right, base: {position_m: [0, -2, 0]}}\n"
      "objects:\n"
      "  - {name: floor, shape: plane}\n"
      "  - {name: peg, shape: cylinder, diameter_m: 0.02, length_m: 0.1, position_m: [1, 0.4, 0.7]}\n"
      "  - {name: box, shape: box, size_m: [0.1, 0.2, 0.3], position_m: [0, -1, 0.15], fixed: false, "
      "mass_kg: 2}\n");
  const auto objects = objects_to_place(scene);
  ASSERT_EQ(objects.size(), 2u);
  EXPECT_THAT(objects[0].text,
              HasSubstr("(0.400, 0.000, 0.200) m, turned by roll 0.000, pitch 0.000, yaw -1.571 rad "
                        "in the base frame of arm 'left'"));
  EXPECT_THAT(objects[0].text, HasSubstr("(1.000, 2.400, 0.700) m in the base frame of arm 'right'"));
  EXPECT_THAT(objects[1].text, HasSubstr("free, 2 kg"));
  EXPECT_THAT(objects[1].text, HasSubstr("upper face at z = 0.300 m"));
}

TEST(OnArms, TheThresholdsAreTheScenes) {
  Scene scene = scene_of(
      "arms:\n"
      "  - {name: arm, hand: false, collision: {torque_upper_nm: 17, wrench_upper: 23}}\n"
      "  - {name: other, hand: false, base: {position_m: [2, 0, 0]}}\n");
  EXPECT_THAT(describe_arm(scene.arms[0]), HasSubstr("[23, 23, 23, 23, 23, 23] N, N m"));
  EXPECT_THAT(describe_arm(scene.arms[0]),
              HasSubstr("[17, 17, 17, 17, 17, 17, 17] N m at the joints ('collision'"));
  EXPECT_THAT(describe_arm(scene.arms[1]), HasSubstr("[80, 80, 80, 25, 25, 25]"));
}

TEST(OnArms, ArmsWithoutAddressAreNamedOrSimulated) {
  const Scene scene = scene_of("arms:\n  - {name: a}\n  - {name: b, base: {position_m: [2, 0, 0]}}\n");
  BackendOptions options{.kind = BackendKind::fci, .addresses = {{"a", "127.0.0.3"}, {"c", "127.0.0.4"}}};
  EXPECT_THAT(refusal([&] { check_addresses_of_all(scene, options); }), HasSubstr("add --address b=ADDRESS"));
  const Scene mixed = with_connections(scene, backend_of(scene, options));
  EXPECT_TRUE(mixed.arms[0].fci.has_value());
  EXPECT_FALSE(mixed.arms[1].fci.has_value());
  // An address that only the scene has would move an arm that no answer names.
  Scene own = scene;
  own.arms[1].fci.emplace().address = "192.0.2.7";
  EXPECT_THAT(refusal([&] { (void)backend_of(own, options); }), HasSubstr("add --address b=192.0.2.7"));
}

TEST(OnArms, OnlyStartsVary) {
  Experiment given = load_experiment("task-3");
  given.vary = {{.key = "arms.arm.start_rad", .by = 0.1},
                {.key = "arms.arm.tool.mass_kg", .by = 0.1},
                {.key = "objects.table.position_m.2", .by = 0.1}};
  std::vector<std::string> left_out;
  const Experiment arms = for_arms(given, left_out);
  EXPECT_EQ(arms.vary[0].by, 0.1);
  EXPECT_EQ(arms.vary[1].by, 0);
  EXPECT_EQ(arms.vary[2].by, 0);
}

// A watch asks the status of a run: what its scene requested and the loop refused ends it on arms.
TEST(OnArms, ARefusedRequestOfTheSceneIsTrouble) {
  RecordLayout layout;
  layout.instances.push_back({.name = "a"});
  RunMonitor monitor(layout, {}, [](std::size_t, Intervention) { return std::uint64_t{0}; });
  monitor.take(Event{.kind = EventKind::switch_refused, .verdict = Verdict::start_refused, .ticket = 7});
  monitor.publish();
  EXPECT_EQ(monitor.status().refusal, "") << "somebody else asked for it and was told";
  monitor.take(Event{.kind = EventKind::switched});
  monitor.take(Event{.kind = EventKind::parameter_set, .instance = 0});
  monitor.publish();
  EXPECT_EQ(monitor.status().refusal, "");
  monitor.take(Event{.kind = EventKind::switch_refused,
                     .verdict = Verdict::start_refused,
                     .t = LoopTime::from_seconds(1.25)});
  monitor.take(Event{.kind = EventKind::feature_set, .verdict = Verdict::start_refused, .instance = 0});
  monitor.publish();
  EXPECT_THAT(monitor.status().refusal, HasSubstr("at 1.250 s the loop refused a switch"));
}

RunStatus status_of(double time_s, ArmMode left, ArmMode right) {
  RunStatus status;
  status.time_s = time_s;
  status.arms.resize(2);
  status.arms[0].arm = "left";
  status.arms[1].arm = "right";
  status.arms[0].mode = left;
  status.arms[1].mode = right;
  return status;
}

TEST(OnArms, AnArmThatStopsOrNeverMovesStopsTheOther) {
  std::vector<bool> moved;
  EXPECT_EQ(stopped_arm(status_of(0.1, ArmMode::idle, ArmMode::idle), moved), "");
  EXPECT_EQ(stopped_arm(status_of(0.2, ArmMode::move, ArmMode::move), moved), "");
  EXPECT_EQ(stopped_arm(status_of(5, ArmMode::move, ArmMode::move), moved), "");
  EXPECT_THAT(stopped_arm(status_of(5.1, ArmMode::move, ArmMode::idle), moved), HasSubstr("arm 'right'"));
  moved.clear();  // the user stop of one arm was pressed from the beginning
  EXPECT_EQ(stopped_arm(status_of(0.5, ArmMode::move, ArmMode::user_stopped), moved), "");
  EXPECT_THAT(stopped_arm(status_of(1.1, ArmMode::move, ArmMode::user_stopped), moved),
              HasSubstr("arm 'right'"));
}

// Holds come first, one per arm, as in a session.
RecordLayout layout_of(const Scene& scene) {
  RecordLayout layout;
  for (const auto& arm : scene.arms) layout.instances.emplace_back().name = arm.name + "_hold";
  for (const auto& each : scene.controllets) layout.instances.emplace_back().name = each.name;
  return layout;
}

TEST(OnArms, ARunIsWatchedFromItsFirstSampleOn) {
  const Scene scene = scene_of("arms: [{name: arm}]\n");
  const Json expected = Json::array({{{"hand_m", 1},
                                      {"hand_m_per_s", 1},
                                      {"lowest_m", 0.2},
                                      {"highest_m", 2},
                                      {"joint_rad", 0.1},
                                      {"joint_rad_per_s", 0.1}}});
  const std::vector<std::shared_ptr<const ArmModel>> models{build_arm_model(scene.arms[0])};
  const RecordLayout layout = layout_of(scene);
  const auto trouble = [&](double off, std::uint64_t cycle) {
    ArmWatch watch(scene, layout, models, expected);
    CycleRecord record;
    record.cycle = cycle;
    record.arms.resize(1);
    watch.take(record);  // no state of the arm yet
    record.arms[0].sequence = 1;
    for (std::size_t j = 0; j < 7; ++j)
      record.arms[0].q[j] = scene.arms[0].q_start[static_cast<Eigen::Index>(j)] + (j == 3 ? off : 0);
    watch.take(record);
    return watch.trouble({});
  };
  EXPECT_EQ(trouble(0.04, 1), "");
  RunStatus refused;
  refused.refusal = "at 1 s the loop refused a switch (not active)";
  EXPECT_EQ(ArmWatch(scene, layout, models, expected).trouble(refused), refused.refusal);
  EXPECT_THAT(trouble(0.06, 1), HasSubstr("too far from its start"));
  EXPECT_THAT(trouble(-0.06, 4000), HasSubstr("too far from its start")) << "an arm that reports late";
  EXPECT_THROW(ArmWatch(scene, layout, models, Json()), ExperimentInterrupted) << "nothing to compare with";
  // An elbow that swings aside while the hand stays: in simulation it turned by 0.1 rad.
  const auto turned = [&](double angle) {
    MotionExtent extent(scene, models);
    CycleRecord record;
    record.arms.resize(1);
    record.arms[0].sequence = 1;
    for (std::size_t j = 0; j < 7; ++j)
      record.arms[0].q[j] = scene.arms[0].q_start[static_cast<Eigen::Index>(j)];
    extent.take(record);
    ++record.cycle;  // of these, the hand is not computed in every one
    record.arms[0].q[2] += angle;
    extent.take(record);
    return extent.beyond(expected);
  };
  EXPECT_EQ(turned(0.29), "");
  EXPECT_THAT(turned(0.31), HasSubstr("a joint of arm 'arm' turned by 0.31 rad, in simulation 0.10 rad"));
}

// A reflex may have stopped an arm on a person.
TEST(OnArms, NoSceneClearsAReflexByItself) {
  const Scene scene = scene_of("arms: [{name: arm, fci: {address: 127.0.0.1, recover_at_start: true}}]\n");
  EXPECT_THAT(refusal([&] { check_for_arms(scene, "any"); }),
              HasSubstr("'recover_at_start' would clear a reflex"));
}

// The other arm of the scene would go on with its timeline.
TEST(OnArms, AnArmThatIsPutIntoHoldEndsTheRun) {
  const std::string head =
      "duration_s: 4\n"
      "arms: [{name: left, base: {position_m: [1, 2, 0], rpy_rad: [0, 0, 1]}}, {name: right}]\n"
      "controllets:\n"
      "  - {name: a, type: joint_impedance, arms: left}\n"
      "  - {name: b, type: joint_impedance, arms: right}\n"
      "active: [a, b]\n";
  const auto trouble = [](const std::string& text, double t_s, bool first_held) {
    const Scene scene = scene_of(text);
    const Json free{{"hand_m", 9},    {"hand_m_per_s", 9}, {"lowest_m", -9},
                    {"highest_m", 9}, {"joint_rad", 9},    {"joint_rad_per_s", 9}};
    ArmWatch watch(scene, layout_of(scene), {build_arm_model(scene.arms[0]), build_arm_model(scene.arms[1])},
                   Json::array({free, free}));
    CycleRecord record;
    record.arms.resize(2);
    for (std::size_t i = 0; i < 2; ++i) {
      record.arms[i].sequence = 1;
      record.arms[i].owner = static_cast<std::uint16_t>(first_held ? i : i + 2);
      record.arms[i].mode = static_cast<std::uint8_t>(ArmMode::move);
      for (std::size_t j = 0; j < 7; ++j)
        record.arms[i].q[j] = scene.arms[i].q_start[static_cast<Eigen::Index>(j)];
    }
    watch.take(record);
    record.t = LoopTime::from_seconds(t_s);
    record.arms[0].owner = 2;
    record.arms[1].owner = 1;
    watch.take(record);
    return watch.trouble({});
  };
  EXPECT_EQ(trouble(head, 2, false), "arm 'right' was put into hold");
  EXPECT_EQ(trouble(head, 2, true), "") << "it has not begun yet";
  EXPECT_EQ(trouble(head, 3.995, false), "") << "the end of the run";
  EXPECT_EQ(trouble(head + "timeline: [{at_s: 1, switch: {deactivate: [b]}}]\n", 2, false), "")
      << "on purpose";
  EXPECT_EQ(trouble(head + "timeline: [{at_s: 3, switch: {deactivate: [b]}}]\n", 2, false),
            "arm 'right' was put into hold")
      << "before that";
}

// Joint 1 turns an arm by half a turn: its hand, 0.31 m in front of the base, passes through that of the
// other arm, although both ends are free.
TEST(PathClearance, FindsWhatBothEndsDoNotShow) {
  Scene scene = scene_of(
      "arms:\n"
      "  - {name: left, base: {position_m: [0, 0, 0]}}\n"
      "  - {name: right, base: {position_m: [0.6, 0, 0]}}\n");
  JointMove move{.arm = 0, .from = scene.arms[0].q_start, .goal = scene.arms[0].q_start};
  move.from[0] = -std::numbers::pi / 2;
  move.goal[0] = std::numbers::pi / 2;
  scene.arms[1].q_start[0] = std::numbers::pi;  // faces the left one
  const PathClearance crossing = path_clearance(scene, {move}, false);
  EXPECT_LT(crossing.least, 0.0);
  EXPECT_GT(crossing.at_start, 0.05);
  EXPECT_GT(crossing.at_end, 0.05);
  EXPECT_TRUE(crossing.blocked(0.02));
  EXPECT_THAT(crossing.pair, HasSubstr("left"));
  EXPECT_THAT(crossing.pair, HasSubstr("right"));

  scene.arms[1].X_WB.position.x() = 3;  // out of reach
  EXPECT_FALSE(path_clearance(scene, {move}, false).blocked(0.02));
}

TEST(PathClearance, ObjectsCountOnlyWhenTheyAreThere) {
  Scene scene = scene_of(
      "arms: [{name: arm}]\n"
      "objects:\n"
      "  - {name: floor, shape: plane}\n"
      "  - {name: post, shape: cylinder, diameter_m: 0.05, length_m: 1.5, position_m: [0.31, 0, 0.75]}\n");
  JointMove move{.arm = 0, .from = scene.arms[0].q_start, .goal = scene.arms[0].q_start};
  move.from[0] = -1;
  move.goal[0] = 1;
  EXPECT_FALSE(path_clearance(scene, {move}, false).blocked(0.02));
  const PathClearance with = path_clearance(scene, {move}, true);
  EXPECT_TRUE(with.blocked(0.02));
  EXPECT_THAT(with.pair, HasSubstr("post"));
}

// A contact where the path begins permits nothing else on the way.
TEST(PathClearance, AContactAtTheStartDoesNotHideAnotherObject) {
  const std::string head =
      "arms: [{name: arm}]\n"
      "objects:\n"
      "  - {name: post, shape: cylinder, diameter_m: 0.05, length_m: 1.5, position_m: [0.31, 0, 0.75]}\n";
  Scene scene = scene_of(head);
  JointMove move{.arm = 0, .from = scene.arms[0].q_start, .goal = scene.arms[0].q_start};
  move.from[0] = -1;
  move.goal[0] = 1;
  ModelTerms terms(build_arm_model(scene.arms[0]));
  terms.set_config(arm_config(scene.arms[0]).frames, {}, {});
  JointVector behind = move.from;
  behind[0] -= 0.3;  // 9 cm: the ball touches the hand from where it does not go
  terms.update(behind, JointVector::Zero(7));
  const Vector3 p = terms.X_WE().position;
  Scene touching =
      scene_of(head + fmt::format("  - {{name: ball, shape: sphere, diameter_m: 0.2, position_m: "
                                  "[{}, {}, {}]}}\n",
                                  p.x(), p.y(), p.z()));
  const PathClearance both = path_clearance(touching, {move}, true);
  EXPECT_TRUE(both.blocked(0.02));
  EXPECT_THAT(both.pair, HasSubstr("post"));
  touching.objects.erase(touching.objects.begin());
  const PathClearance ball = path_clearance(touching, {move}, true);
  EXPECT_LT(ball.at_start, 0.0);
  EXPECT_FALSE(ball.blocked(0.02)) << "it only leaves the ball: " << ball.pair << ' ' << ball.least;
  std::swap(move.from, move.goal);
  move.goal[0] = 2 * behind[0] - move.goal[0];  // through the ball, to its other side
  EXPECT_TRUE(path_clearance(touching, {move}, true).blocked(0.02));
}

TEST(PathClearance, AnArmMayLeaveAContact) {
  EXPECT_FALSE(
      (PathClearance{.at_start = -0.001, .at_end = 0.01, .least = -0.001, .pair = {}}).blocked(0.02));
  EXPECT_TRUE((PathClearance{.at_start = -0.001, .at_end = 0.01, .least = -0.01, .pair = {}}).blocked(0.02));
}

// A joint that swings by a sine: amplitude and speed are known.
TEST(MotionExtentOf, ASwingingJoint) {
  Scene scene = scene_of("arms: [{name: arm, base: {position_m: [1, 2, 3], rpy_rad: [0.2, 0, 1]}}]\n");
  MotionExtent extent(scene, {build_arm_model(scene.arms[0])});
  CycleRecord record;
  record.arms.resize(1);
  const double rate = 2, amplitude = 0.3;
  ArmSample& arm_sample = record.arms[0];
  arm_sample.sequence = 1;
  for (std::size_t j = 0; j < 7; ++j) arm_sample.q[j] = scene.arms[0].q_start[static_cast<Eigen::Index>(j)];
  for (int k = 0; k < 4000; ++k) {
    const double t = 1e-3 * k;
    record.cycle = static_cast<std::uint64_t>(k) + 1;
    ArmSample& arm = record.arms[0];
    arm.q[0] = scene.arms[0].q_start[0] + amplitude * std::sin(rate * t);
    arm.dq[0] = amplitude * rate * std::cos(rate * t);
    extent.take(record);
  }
  const Json arm = extent.json().at(0);
  ModelTerms terms(build_arm_model(scene.arms[0]));
  terms.set_config(arm_config(scene.arms[0]).frames, {}, {});
  terms.update(scene.arms[0].q_start, JointVector::Zero(7));
  const Vector3 p_B = (scene.arms[0].X_WB.inverse() * terms.X_WE()).position;
  const double radius = std::hypot(p_B.x(), p_B.y());
  EXPECT_EQ(arm["joint"], 1);
  EXPECT_NEAR(arm["joint_rad"].get<double>(), amplitude, 1e-4);
  EXPECT_NEAR(arm["joint_rad_per_s"].get<double>(), amplitude * rate, 1e-6);
  EXPECT_NEAR(arm["hand_m"].get<double>(), 2 * radius * std::sin(amplitude / 2), 1e-4);
  EXPECT_NEAR(arm["hand_m_per_s"].get<double>(), radius * amplitude * rate, 1e-3);
  EXPECT_NEAR(arm["lowest_m"].get<double>(), p_B.z(), 1e-9);
  EXPECT_NEAR(arm["highest_m"].get<double>(), p_B.z(), 1e-9);
  EXPECT_THAT(describe_extent(extent.json()), HasSubstr("joint 1 by 0.30 rad"));

  EXPECT_EQ(extent.beyond(extent.json()), "");
  for (const auto& [key, change, says] :
       {std::tuple{"hand_m", -0.06, "went"}, std::tuple{"hand_m_per_s", -0.3, "moved at"},
        std::tuple{"lowest_m", 0.06, "sank"}, std::tuple{"highest_m", -0.06, "rose"}}) {
    Json expected = extent.json();
    expected[0][key] = expected[0][key].get<double>() + change;
    EXPECT_THAT(extent.beyond(expected), HasSubstr(says));
    expected[0][key] = expected[0][key].get<double>() - 0.5 * change;
    EXPECT_EQ(extent.beyond(expected), "") << "within the margin";
  }
}

class Finished : public Folder {};

TEST_F(Finished, RunsAreKeptAndOnlyTheSameExperimentGoesOn) {
  const Json what{{"seed", 1}, {"scenes", {{"a", "text"}}}};
  {
    FinishedRuns runs(folder, what, false);
    runs.add("a_1", {{"log", "x"}});
    runs.add("a_2", {{"log", "y"}});
  }
  FinishedRuns again(folder, what, true);
  ASSERT_NE(again.find("a_2"), nullptr);
  EXPECT_EQ((*again.find("a_2"))["log"], "y");
  EXPECT_EQ(again.find("a_3"), nullptr);
  EXPECT_THAT(refusal([&] {
                FinishedRuns(folder, {{"seed", 2}, {"scenes", {{"a", "text"}}}}, true);
              }),
              HasSubstr("another seed: 1, now 2"));
  again.remove_file();
  EXPECT_THAT(refusal([&] { FinishedRuns(folder, what, true); }), HasSubstr("no interrupted experiment"));
  FinishedRuns fresh(folder, what, false);
  EXPECT_EQ(fresh.count(), 0u);
}

class Beside : public Folder {};

TEST_F(Beside, LogsAreNamedByVariantOrByTheFolderOfAnExperiment) {
  ExperimentVariant a{.name = "mu01_k10"}, b{.name = "k1"};
  const std::vector<const ExperimentVariant*> both{&a, &b};
  fs::create_directories(folder / "logs");
  for (const char* name : {"measured_mu01_k10_1", "measured_mu01_k10_2", "measured_k1_1_interrupted",
                           "measured_other_1", "realistic_k1_1"})
    write("logs/" + std::string(name) + ".mcap", "");
  const auto found = beside_logs({folder.string()}, both);
  ASSERT_EQ(found.size(), 2u);
  EXPECT_EQ(found[0].variant, &a);
  EXPECT_EQ(found[0].repeat + found[1].repeat, 3u);
  const auto log = write("one.mcap", "").string();
  EXPECT_EQ(beside_logs({"k1=" + log}, both).at(0).variant, &b);
  EXPECT_EQ(beside_logs({log}, {&a}).at(0).variant, &a);
  EXPECT_THAT(refusal([&] { beside_logs({log}, both); }), HasSubstr("name the one of this log"));
  EXPECT_THAT(refusal([&] { beside_logs({"k2=" + log}, both); }), HasSubstr("no variant 'k2'"));
  EXPECT_THAT(refusal([&] { beside_logs({"k1=" + log, "k1=" + log}, both); }), HasSubstr("two logs"));
  EXPECT_THAT(refusal([&] { beside_logs({"k1=/none"}, both); }), HasSubstr("there is no log"));
  EXPECT_THAT(refusal([&] { beside_logs({folder.string()}, {&b}); }), HasSubstr("has no log of a variant"));
}

TEST_F(Beside, MeasurementsAreNamedByConditionOrByTheirFolder) {
  const std::vector<std::string> both{"NF", "CA-MA"};
  const std::string content = "PK about.npy stages_us.npy";  // as at the end of the archive
  for (const char* name : {"NF_1", "NF_2", "CA-MA_12", "MA_1", "NF_x", "NF_"})
    write(std::string(name) + ".npz", content);
  const auto found = beside_traces({folder.string()}, both);
  ASSERT_EQ(found.size(), 3u);
  EXPECT_EQ(found[0].condition, "CA-MA");
  EXPECT_EQ(found[2].file.filename(), "NF_2.npz");
  const auto file = write("mine.npz", content).string();
  EXPECT_EQ(beside_traces({"NF=" + file}, both).at(0).file, fs::absolute(file));
  EXPECT_EQ(beside_traces({(folder / "CA-MA_12.npz").string()}, both).at(0).condition, "CA-MA");
  EXPECT_TRUE(beside_traces({}, both).empty());
  EXPECT_THAT(refusal([&] { beside_traces({file}, both); }), HasSubstr("--beside NF=" + file));
  EXPECT_THAT(refusal([&] { beside_traces({"CA=" + file}, both); }), HasSubstr("no condition 'CA'"));
  EXPECT_THAT(refusal([&] { beside_traces({"NF=/none.npz"}, both); }), HasSubstr("there is no file"));
  EXPECT_THAT(refusal([&] { beside_traces({folder.string()}, {"C-MA"}); }), HasSubstr("such as C-MA_1.npz"));
  const auto other = write("NF_3.npz", "PK stages_us.npy").string();
  EXPECT_THAT(refusal([&] { beside_traces({other}, both); }), HasSubstr("is not a measurement"));
}

}  // namespace
}  // namespace multipanda::on_arms_test
