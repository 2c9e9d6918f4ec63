#include <chrono>
#include <csignal>
#include <cstdlib>
#include <fstream>
#include <iterator>
#include <sys/wait.h>
#include <unistd.h>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "logs/mcap_writer.hpp"
#include "logs/messages.hpp"
#include "logs/testing/test_files.hpp"
#include "report/report.hpp"
#include "report/scene_pictures.hpp"

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
}

}  // namespace
}  // namespace multipanda::make_report_test
