// Whole runs: scenes from files, MuJoCo, logs and replay together.
#include <cstdlib>
#include <filesystem>
#include <map>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "backends/replay/replay_backend.hpp"
#include "logs/mcap_reader.hpp"
#include "runtime/session.hpp"
#include "scene/build.hpp"
#include "scene/load.hpp"

namespace multipanda::whole_test {
namespace {

using testing::IsEmpty;

class WholeRun : public testing::Test {
 protected:
  WholeRun() {
    std::string pattern = (std::filesystem::temp_directory_path() / "whole_run_XXXXXX").string();
    folder_ = mkdtemp(pattern.data());
  }
  ~WholeRun() override { std::filesystem::remove_all(folder_); }

  RunSummary run(const Scene& scene, SessionOptions options) {
    Session session(scene, registry_, std::move(options));
    session.start();
    return session.finish();
  }

  const Registry registry_ = Registry::with_builtins();
  std::filesystem::path folder_;
};

// Shipped scenes must run without a deactivated controllet, a refused switch or a contact at the start.
TEST_F(WholeRun, EveryShippedSceneRunsItsWholeTimeline) {
  ASSERT_GE(available_scenes().size(), 4u);
  for (const auto& name : available_scenes()) {
    const Scene scene = load_scene(name, registry_);
    bool touched = false;
    double moved = 0;
    JointArray first{};
    SessionOptions options{.paced = false};
    if (scene.duration_s == 0) options.duration_s = 5.0;
    options.observer = [&](const CycleRecord& record) {
      if (record.cycle == 1) first = record.arms[0].q;
      for (std::size_t j = 0; j < first.size(); ++j) {
        moved = std::max(moved, std::abs(record.arms[0].q[j] - first[j]));
      }
      for (const auto& arm : record.arms) {
        for (const double f : arm.F_K_W_true) touched = touched || (record.cycle < 10 && f != 0);
      }
    };
    const RunSummary summary = run(scene, options);
    EXPECT_THAT(summary.faults(), IsEmpty()) << name;
    EXPECT_THAT(summary.interventions, IsEmpty()) << name;
    EXPECT_FALSE(touched) << name;
    EXPECT_GT(moved, 0.05) << name << ": nothing moved, so the test is empty";
  }
}

// All messages of a log except those with times of the computer.
std::map<std::string, std::vector<std::vector<std::uint8_t>>> simulated_messages(
    const std::filesystem::path& log) {
  std::map<std::string, std::vector<std::vector<std::uint8_t>>> messages;
  McapReader reader(log);
  while (const auto message = reader.next()) {
    const std::string& topic = message->channel->topic;
    if (topic == "/timing" || topic == "/switch_timing") continue;
    messages[topic].emplace_back(message->data.begin(), message->data.end());
  }
  return messages;
}

TEST_F(WholeRun, TheLogsOfTwoUnpacedRunsAreBitIdentical) {
  Scene scene = load_scene("two_arms", registry_);
  scene.plant = PlantFidelity::realistic();  // its noise depends on the seed
  std::map<std::string, std::vector<std::vector<std::uint8_t>>> logs[2];
  for (auto& log : logs) {
    const RunSummary summary = run(scene, {.paced = false, .duration_s = 6, .record = folder_});
    ASSERT_THAT(summary.missing, IsEmpty());
    log = simulated_messages(summary.log);
  }
  for (const char* topic : {"/left/state", "/left/command", "/right/state", "/switches"}) {
    ASSERT_FALSE(logs[0][topic].empty()) << topic;
  }
  ASSERT_EQ(logs[0]["/left/state"].size(), 6000u);
  for (const auto& [topic, messages] : logs[0]) EXPECT_EQ(messages, logs[1][topic]) << topic;
  EXPECT_EQ(logs[0].size(), logs[1].size());
}

TEST_F(WholeRun, ARecordedRunReplayedGivesTheSameCommands) {
  const Scene scene = load_scene("two_arms", registry_);
  const RunSummary recorded = run(scene, {.paced = false, .record = folder_});
  ASSERT_THAT(recorded.faults(), IsEmpty());
  ASSERT_GT(recorded.switches.size(), 1u);
  ReplayBackend* replay = nullptr;
  SessionOptions options{.paced = false, .duration_s = 0};
  options.make_backend = [&](const Scene& s) {
    std::vector<ReplayBackend::Arm> arms;
    for (const auto& arm : s.arms) {
      const ArmConfig config = arm_config(arm);
      arms.push_back({arm.name, config.frames, config.tool, config.load});
    }
    auto backend = std::make_unique<ReplayBackend>(recorded.log, arms);
    replay = backend.get();
    return backend;
  };
  Session session(scene, registry_, options);
  session.start();
  const RunSummary again = session.finish();
  EXPECT_EQ(again.cycles, recorded.cycles);
  EXPECT_EQ(replay->compared(), 2 * recorded.cycles);
  EXPECT_EQ(replay->largest_difference(), 0.0);
}

TEST_F(WholeRun, FourArmsAtOneKilohertzLoseNoSample) {
  const RunSummary summary =
      run(load_scene("four_arms", registry_), {.paced = true, .duration_s = 3, .record = folder_});
  EXPECT_EQ(summary.cycles, 3000u);
  EXPECT_EQ(summary.records_lost, 0u);
  EXPECT_THAT(summary.missing, IsEmpty());
  const auto messages = simulated_messages(summary.log);
  std::size_t states = 0;
  for (const auto& [topic, all] : messages) {
    if (topic.ends_with("/state")) {
      ++states;
      EXPECT_EQ(all.size(), 3000u) << topic;
    }
  }
  EXPECT_EQ(states, 4u);
}

// Controllets support other arms: an arm of another manufacturer with six joints.
TEST_F(WholeRun, ASixJointArmOfAnotherManufacturerReachesItsTarget) {
  const std::string model = MULTIPANDA_SOURCE_DIR "/tests/models/ur5e.yaml";
  const Scene scene = parse_scene(
      "arms:\n"
      "  - {name: other, model: " +
          model +
          ", hand: false, start_rad: [0.3, -1.4, 1.8, -1.9, -1.5, 0.2],\n"
          "     base: {position_m: [0.4, -0.3, 0.5], rpy_rad: [0.2, -0.1, 1.0]}}\n"
          "controllets:\n"
          "  - {name: pose, type: cartesian_impedance, arms: other, features: [joint_limits]}\n"
          "  - {name: joints, type: joint_impedance, arms: other}\n"
          "active: [pose]\n"
          "timeline:\n"
          "  - {at_s: 2.5, switch: {activate: joints}}\n"
          "  - {at_s: 2.6, reference: {controllet: joints, input: joints, q_rad: [0.5, -1.2, 1.6, -1.9, "
          "-1.5, 0.4], duration_s: 1.5}}\n",
      "six_joints.yaml", registry_);
  JointArray last{};
  SessionOptions options{.paced = false, .duration_s = 6};
  options.observer = [&](const CycleRecord& record) { last = record.arms[0].q; };
  const RunSummary summary = run(scene, options);
  EXPECT_THAT(summary.faults(), IsEmpty());
  const double goal[6] = {0.5, -1.2, 1.6, -1.9, -1.5, 0.4};
  for (std::size_t j = 0; j < 6; ++j) EXPECT_NEAR(last[j], goal[j], 1e-3) << "joint " << j + 1;
}

}  // namespace
}  // namespace multipanda::whole_test
