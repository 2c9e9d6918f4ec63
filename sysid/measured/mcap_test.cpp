#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/model/model_terms.hpp"
#include "logs/mcap_writer.hpp"
#include "logs/messages.hpp"
#include "logs/testing/test_files.hpp"
#include "scene/build.hpp"
#include "sysid/measured/scene_model.hpp"
#include "sysid/measured/testing/test_logs.hpp"

namespace multipanda::mcap_test {
namespace {

using testing::HasSubstr;

constexpr const char* kScene = R"(name: one
arms:
  - {name: left, model: fer, base: {position_m: [0.1, 0.2, 0.3], rpy_rad: [0, 0, 0.5]}, load_declared: {mass_kg: 0.4, com_m: [0, 0, 0.1]}}
controllets:
  - {name: hold, type: joint_impedance, arms: left}
active: [hold]
)";

msg::Time stamp_of(std::int64_t ns) {
  msg::Time time;
  time.sec = static_cast<std::int32_t>(ns / 1'000'000'000);
  time.nanosec = static_cast<std::uint32_t>(ns % 1'000'000'000);
  return time;
}

// A log of `truth` without the given cycles, as from a recorder that fell behind.
struct Faults {
  std::vector<std::uint64_t> lost, without_command, stale;
  std::int64_t stamp_jitter_ns = 0;
};
void write_log(const MeasuredLog& truth, const std::filesystem::path& path, const Faults& faults,
               const std::string& scene = kScene) {
  McapWriter writer(path);
  writer.add(mcap::Metadata{"run", {{"scene_path", "one.yaml"}}});
  writer.add(mcap::Attachment{0, 0, "scene.yaml", "application/yaml", scene});
  const auto state_channel = writer.add_channel<msg::ArmState>("/left/state");
  const auto command_channel = writer.add_channel<msg::ArmCommand>("/left/command");
  const auto wrench_channel = writer.add_channel<msg::ArmWrench>("/left/wrench");
  const auto is = [](const std::vector<std::uint64_t>& list, std::uint64_t cycle) {
    return std::find(list.begin(), list.end(), cycle) != list.end();
  };
  msg::ArmState state;
  for (Eigen::Index k = 0; k < truth.samples(); ++k) {
    const auto cycle = static_cast<std::uint64_t>(k) + 1;
    if (is(faults.lost, cycle)) continue;
    const std::int64_t ns = 1'000'000 * k + (k % 3 - 1) * faults.stamp_jitter_ns + 5'000'000;
    const auto row = [&](const Eigen::MatrixXd& values) {
      const Eigen::VectorXd v = values.row(k);
      return std::vector<double>(v.begin(), v.end());
    };
    state.arm = "left";
    if (!is(faults.stale, cycle)) {
      state.sequence = cycle + 40;
      state.robot_time_ns = static_cast<std::int64_t>(cycle + 40) * 1'000'000;
      state.q = row(truth.q), state.dq = row(truth.dq), state.tau_j = row(truth.tau);
      state.tau_j_d = row(0.5 * truth.tau);
    }
    state.stamp = stamp_of(ns), state.cycle = cycle;
    writer.write(state_channel, ns, state);
    msg::ArmCommand command;
    command.arm = "left", command.cycle = cycle, command.tau_cmd = row(0.25 * truth.tau);
    if (!is(faults.without_command, cycle)) writer.write(command_channel, ns, command);
    msg::ArmWrench wrench;
    wrench.arm = "left", wrench.cycle = cycle, wrench.has_estimate = true;
    wrench.estimated.force.z = static_cast<double>(cycle);
    writer.write(wrench_channel, ns, wrench);
  }
  writer.close();
}

class OurLogs : public testing::Test {
 protected:
  MeasuredLog truth_ = [] {
    MeasuredLog log = swinging_log(0.5);
    // Inside the range of a fer.
    const JointVector home = (JointVector(7) << 0, -0.8, 0, -2.3, 0, 1.5, 0.8).finished();
    log.q.rowwise() += home.transpose();
    return log;
  }();
  TestFolder folder_;
};

TEST_F(OurLogs, EverySampleHasPoseAndGravityOfTheScenesArm) {
  write_log(truth_, folder_ / "log.mcap", {});
  const auto logs = read_measured(folder_.path());
  ASSERT_EQ(logs.size(), 1u);
  const MeasuredLog& log = logs[0];
  EXPECT_EQ(log.arm, "left");
  EXPECT_TRUE(log.warnings.empty()) << log.warnings[0];
  EXPECT_EQ(log.q, truth_.q);
  EXPECT_EQ(log.tau_d, 0.5 * truth_.tau);
  EXPECT_EQ(log.tau_cmd, 0.25 * truth_.tau);
  EXPECT_EQ(log.F_EE(99, 2), 100.0);
  EXPECT_EQ(log.F_true.rows(), 0);
  ASSERT_EQ(log.x_EE.rows(), log.samples());

  // An independent way: the state as the loop sees it, at one sample.
  const Scene scene = rebuild_scene(kScene, "one.yaml");
  const auto config = arm_config(scene.arms[0]);
  ModelTerms terms(build_arm_model(scene.arms[0]));
  ArmState state;
  state.q = truth_.q.row(321), state.dq = truth_.dq.row(321);
  state.config_version = 3;
  state.frames = config.frames, state.tool = config.tool, state.load = config.load;
  terms.update(state);
  EXPECT_LT((log.x_EE.row(321).transpose() - terms.X_WE().position).norm(), 1e-12);
  EXPECT_LT((log.gravity.row(321).transpose() - terms.g()).norm(), 1e-12);
  const Eigen::MatrixXd error = log.control_error();
  EXPECT_LT(
      (error.row(321) - (0.5 * truth_.tau.row(321) - (truth_.tau.row(321) - terms.g().transpose()))).norm(),
      1e-12);
}

// Rows stay aligned when cycles, commands or packets are missing.
TEST_F(OurLogs, LostRecordsAreCountedAndTheOthersKeepTheirTimes) {
  Faults faults;
  for (std::uint64_t cycle = 101; cycle <= 120; ++cycle) faults.lost.push_back(cycle);
  faults.without_command = {300, 301};
  faults.stale = {400};
  write_log(truth_, folder_ / "log.mcap", faults);
  const auto log = read_measured(folder_.path()).at(0);
  ASSERT_EQ(log.samples(), truth_.samples() - 20 - 2 - 1);
  const std::string all = testing::PrintToString(log.warnings);
  EXPECT_THAT(all, HasSubstr("20 cycles are missing"));
  EXPECT_THAT(all, HasSubstr("2 cycles lack their command"));
  EXPECT_THAT(all, HasSubstr("1 cycles had no new packet"));
  EXPECT_THAT(all, HasSubstr("longest 21 ms"));
  for (Eigen::Index k = 0; k < log.samples(); ++k) {
    const auto row = static_cast<Eigen::Index>(std::lround((log.t[k] - 0.005) * 1000));
    ASSERT_EQ(log.q.row(k), truth_.q.row(row));
    ASSERT_EQ(log.tau_cmd.row(k), 0.25 * truth_.tau.row(row));
    ASSERT_EQ(log.F_EE(k, 2), static_cast<double>(row + 1));
  }
}

TEST_F(OurLogs, TheArmsOwnClockReplacesStampsWithJitter) {
  Faults faults;
  faults.stamp_jitter_ns = 400'000;
  write_log(truth_, folder_ / "log.mcap", faults);
  const auto log = read_measured(folder_.path()).at(0);
  for (Eigen::Index k = 1; k < log.samples(); ++k) ASSERT_NEAR(log.t[k] - log.t[k - 1], 0.001, 1e-9);
}

TEST_F(OurLogs, WrongArmWrongFileAndMissingSceneAreReported) {
  write_log(truth_, folder_ / "log.mcap", {}, "name: broken\narms: 3\n");
  const auto log = read_measured(folder_.path()).at(0);
  EXPECT_EQ(log.gravity.rows(), 0);
  EXPECT_EQ(log.control_error().rows(), 0);
  EXPECT_THAT(testing::PrintToString(log.warnings), HasSubstr("no x_EE, no gravity"));
  MeasuredLogOptions options;
  options.arm = "right";
  EXPECT_THROW(read_measured(folder_.path(), options), std::invalid_argument);
  put_content(folder_ / "other.mcap", "not a log");
  EXPECT_THROW(read_measured(folder_ / "other.mcap"), LogRefused);
}

// A log from another source is completed from the scene's arm.
TEST_F(OurLogs, ACsvIsCompletedFromAScene) {
  write_log(truth_, folder_ / "log.mcap", {});
  const auto ours = read_measured(folder_.path()).at(0);
  write_plain_csv(truth_, folder_ / "log.csv");
  auto csv = read_measured(folder_ / "log.csv").at(0);
  complete_from_scene(csv, ours.scene_text, ours.scene_path, "left");
  EXPECT_LT((csv.x_EE - ours.x_EE).cwiseAbs().maxCoeff(), 1e-12);
  EXPECT_LT((csv.gravity - ours.gravity).cwiseAbs().maxCoeff(), 1e-12);
  EXPECT_THROW(complete_from_scene(csv, ours.scene_text, "", "right"), std::invalid_argument);
}

// A recording of a real arm by ros2 bag, and the same numbers as a table, if they are available.
TEST(RealLog, ARosbagOfJointStatesIsReadLikeItsTable) {
  const std::filesystem::path data = std::filesystem::path(MULTIPANDA_SOURCE_DIR) / "../shared/data";
  if (!std::filesystem::exists(data / "panda_bag_first_13s.mcap")) GTEST_SKIP() << "no recording in " << data;
  const auto bag = read_measured(data / "panda_bag_first_13s.mcap").at(0),
             table = read_measured(data / "panda_bag_first_13s.csv").at(0);
  EXPECT_EQ(bag.arm, "fer");
  ASSERT_EQ(bag.samples(), 400);
  ASSERT_EQ(table.samples(), 400);
  EXPECT_LT((bag.t - table.t).cwiseAbs().maxCoeff(), 1e-7);  // the table has nine digits
  EXPECT_LT((bag.q - table.q).cwiseAbs().maxCoeff(), 1e-8);
  EXPECT_LT((bag.dq - table.dq).cwiseAbs().maxCoeff(), 1e-8);
  EXPECT_LT((bag.tau - table.tau).cwiseAbs().maxCoeff(), 1e-6);
}

}  // namespace
}  // namespace multipanda::mcap_test
