#include <array>
#include <chrono>
#include <csignal>
#include <cstdlib>
#include <fstream>
#include <iterator>
#include <optional>
#include <sys/wait.h>
#include <unistd.h>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "logs/mcap_reader.hpp"
#include "logs/mcap_writer.hpp"
#include "logs/messages.hpp"
#include "logs/testing/test_files.hpp"
#include "report/report.hpp"
#include "report/run_of_log.hpp"

namespace multipanda::make_report_test {
namespace {

using testing::HasSubstr;

RunOfLog run_of(double seconds, const std::vector<double>& switches) {
  RunOfLog run;
  for (int i = 0; i <= static_cast<int>(10 * seconds); ++i) run.moments.push_back({0.1 * i, {}});
  for (const double t : switches) run.switches.push_back({t, {"law"}});
  return run;
}

TEST(ChosenMoments, StartSwitchesEndMiddle) {
  const auto few = choose_moments(run_of(10, {4.0}), 4);
  ASSERT_EQ(few.size(), 4u);
  EXPECT_EQ(few[0].moment, 0u);
  EXPECT_NEAR(static_cast<double>(few[1].moment), 40, 1);
  EXPECT_NEAR(static_cast<double>(few[2].moment), 50, 1);
  EXPECT_EQ(few[3].moment, 100u);
  EXPECT_THAT(few[1].caption, HasSubstr("law starts"));
}

TEST(ChosenMoments, NeverMoreThanRequestedAndNeverDuplicates) {
  std::vector<double> many;
  for (int i = 0; i < 300; ++i) many.push_back(0.03 * i);
  for (std::size_t room = 0; room <= 6; ++room) {
    const RunOfLog run = run_of(10, many);
    const auto chosen = choose_moments(run, room);
    EXPECT_EQ(chosen.size(), room);
    for (std::size_t i = 1; i < chosen.size(); ++i)
      EXPECT_GE(run.moments[chosen[i].moment].t - run.moments[chosen[i - 1].moment].t, 0.3);
  }
  EXPECT_TRUE(choose_moments(RunOfLog{}, 4).empty());
}

// A log of 2 s of one arm, without a scene.
void write_log(const std::filesystem::path& log, bool close) {
  McapWriter writer(log, {.chunk_bytes = 20000});
  writer.add(mcap::Metadata{"run", {{"scene", "test"}}});
  const auto states = writer.add_channel<msg::ArmState>("/left/state");
  const auto timing = writer.add_channel<msg::CycleTiming>("/timing");
  for (int i = 0; i < 2000; ++i) {
    msg::ArmState state;
    state.stamp.sec = i / 1000;
    state.stamp.nanosec = static_cast<std::uint32_t>(i % 1000) * 1'000'000u;
    state.cycle = static_cast<std::uint64_t>(i) + 1;
    state.arm = "left";
    state.q.assign(7, 1e-3 * i);
    state.dq.assign(7, 1.0);
    writer.write(states, 1'000'000LL * i, state);
    msg::CycleTiming cycle;
    cycle.stamp = state.stamp;
    cycle.cycle = state.cycle;
    cycle.start = 1e-3 * i;
    cycle.period = 1e-3;
    cycle.total = 12.5e-6;
    writer.write(timing, 1'000'000LL * i, cycle);
  }
  if (close) {
    (void)writer.close();
  } else {
    writer.flush();
  }
}

TEST(Report, OfALogWithoutScene) {
  const TestFolder folder;
  write_log(folder / "log.mcap", true);
  const ReportResult result = make_report(folder.path());
  EXPECT_EQ(result.page, folder / "report.html");
  EXPECT_FALSE(result.repaired);
  const std::string page = content_of(result.page);
  EXPECT_THAT(page, HasSubstr("Run of test"));
  EXPECT_THAT(page, HasSubstr("12.5 µs"));
  EXPECT_THAT(page, HasSubstr("No pictures of the scene: the scene file is not in the log"));
  EXPECT_TRUE(std::filesystem::exists(folder / "left_q.png"));
  EXPECT_FALSE(std::filesystem::exists(folder / "report_data.npz"));  // only on request
}

TEST(Report, RepairsTheLogOfAKilledRun) {
  const TestFolder folder;
  const auto log = folder / "log.mcap";
  write_log(folder / "whole.mcap", true);
  std::string bytes = content_of(folder / "whole.mcap");
  bytes.resize(bytes.size() * 3 / 4);  // as if killed: no index, no footer, half a chunk
  put_content(log, bytes);
  std::filesystem::last_write_time(log,
                                   std::filesystem::file_time_type::clock::now() - std::chrono::hours(1));
  const ReportResult result = make_report(log);
  EXPECT_TRUE(result.repaired);
  EXPECT_THAT(content_of(result.page), HasSubstr("It was repaired"));
}

// The picture of a run whose log says that a box was carried away is that of a scene where it lies there.
TEST(Report, DrawsFreeObjectsWhereTheLogHasThem) {
  const TestFolder folder;
  const auto drawn = [&](const std::string& name, double y, std::optional<double> logged_y) {
    const auto log = folder / (name + ".mcap");
    {
      McapWriter writer(log);
      const std::string scene =
          "name: box\narms: [{name: left, model: fr3}]\nobjects: [{name: parcel, shape: box, size_m: [0.2, "
          "0.1, 0.1], "
          "fixed: false, mass_kg: 1, position_m: [0.6, " +
          std::to_string(y) + ", 0.4]}]\n";
      writer.add(mcap::Attachment{.name = "scene.yaml", .media_type = "text/yaml", .data = scene});
      const auto states = writer.add_channel<msg::ArmState>("/left/state");
      const auto objects = writer.add_channel<msg::ObjectPose>("/objects/parcel");
      for (std::uint64_t i = 0; i <= 300; ++i) {
        msg::ArmState state;
        state.stamp.nanosec = static_cast<std::uint32_t>(i) * 1'000'000u;
        state.cycle = i;
        state.arm = "left";
        state.q = {0, -0.8, 0, -2.4, 0, 1.6, 0.8};
        writer.write(states, static_cast<std::int64_t>(i) * 1'000'000, state);
        msg::ObjectPose pose;
        pose.stamp = state.stamp;
        pose.object = "parcel";
        pose.pose.position = {0.6, logged_y.value_or(0), 0.4};
        pose.pose.orientation.w = 1;
        if (logged_y && i % 20 == 0) writer.write(objects, static_cast<std::int64_t>(i) * 1'000'000, pose);
      }
    }
    std::filesystem::create_directories(folder / name);
    const RunOfLog run = read_run(log);
    EXPECT_EQ(run.scene_missing, "");
    return draw_scene({.scene = run.scene, .moments = {run.moments.back()}}, 1, folder / name);
  };
  const ScenePictures there = drawn("there", 0.3, {}), carried = drawn("carried", -0.3, 0.3),
                      left = drawn("left", -0.3, {});
  if (!there.missing.empty()) GTEST_SKIP() << there.missing;
  ASSERT_EQ(carried.pictures.size(), 1u);
  EXPECT_EQ(carried.note, "");
  EXPECT_THAT(left.note, HasSubstr("initial positions"));
  EXPECT_EQ(content_of(carried.pictures[0].file), content_of(there.pictures[0].file));
  EXPECT_NE(content_of(left.pictures[0].file), content_of(there.pictures[0].file));
}

// A signal ends the program, so this runs in a separate process.
TEST(Report, LeavesNoDataBehindWhenInterrupted) {
  const TestFolder folder;
  write_log(folder / "log.mcap", true);
  const pid_t child = fork();
  if (child == 0) {
    (void)make_report(folder.path());
    _exit(0);
  }
  const auto data = folder / "report_data.npz";
  const auto end = std::chrono::steady_clock::now() + std::chrono::seconds(20);
  while (!std::filesystem::exists(data) && std::chrono::steady_clock::now() < end) usleep(500);
  ASSERT_EQ(kill(child, SIGINT), 0);
  int status = 0;
  ASSERT_EQ(waitpid(child, &status, 0), child);
  ASSERT_TRUE(WIFEXITED(status));
  EXPECT_EQ(WEXITSTATUS(status), 128 + SIGINT);
  EXPECT_FALSE(std::filesystem::exists(data));
  EXPECT_FALSE(std::filesystem::exists(folder / "report.html"));
}

TEST(Report, ReportsErrors) {
  const TestFolder folder;
  try {
    (void)make_report(folder.path());
    FAIL() << "there is no log";
  } catch (const std::runtime_error& error) {
    EXPECT_THAT(error.what(), HasSubstr("there is no log"));
  }
  {
    McapWriter writer(folder / "log.mcap");
    const auto laser = writer.add_channel("/scan", "sensor_msgs/msg/LaserScan", "float32[] ranges");
    const std::array<std::uint8_t, 8> nothing{0, 1, 0, 0};
    writer.write_bytes(laser, 0, nothing);
  }
  try {
    (void)make_report(folder.path());
    FAIL() << "the log of another program";
  } catch (const std::runtime_error& error) {
    EXPECT_THAT(error.what(), testing::AllOf(HasSubstr("its topics: /scan (sensor_msgs/msg/LaserScan)"),
                                             HasSubstr(msg::ArmState::kType)));
  }
}

// Bytes that a closed log has lost in its middle: the report names them and leaves the log as it is.
TEST(Report, NamesDamageOfAClosedLogAndChangesNothing) {
  const TestFolder folder;
  const auto log = folder / "log.mcap";
  write_log(log, true);
  std::string bytes = content_of(log);
  {
    McapScanner scanner(log);
    int chunks = 0;
    while (const auto record = scanner.next()) {
      if (record->opcode == mcap::Opcode::chunk && ++chunks == 3)
        bytes.replace(record->offset + record->content.size() / 2, 20, 20, '\x5a');
    }
    ASSERT_GT(chunks, 5);
  }
  put_content(log, bytes);
  std::filesystem::last_write_time(log,
                                   std::filesystem::file_time_type::clock::now() - std::chrono::hours(1));
  const ReportResult result = make_report(log);
  EXPECT_FALSE(result.repaired);
  EXPECT_EQ(content_of(log), bytes);
  EXPECT_THAT(content_of(result.page), HasSubstr("damaged records are left out"));
}

}  // namespace
}  // namespace multipanda::make_report_test
