#include "cli/live_table.hpp"

#include <algorithm>
#include <limits>

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace multipanda::cli::live_table_test {
namespace {

using testing::HasSubstr;
using testing::Not;

RunStatus status_of(std::size_t arms) {
  RunStatus status{.time_s = 5, .rate_hz = 1000, .cycle_us = 12.3, .cycle_us_worst = 45.6, .cycles = 5000};
  for (std::size_t i = 0; i < arms; ++i) {
    status.arms.push_back({.arm = fmt::format("an_arm_with_a_long_name_{}", i),
                           .controllet = "a_controllet_with_a_name_that_is_longer_than_its_column",
                           .tracking_error = 0.00123,
                           .tracking_unit = "m",
                           .torque_use = 0.345});
  }
  for (int i = 0; i < 20; ++i)
    status.news.push_back(fmt::format("{:9.3f} s  {}", 0.1 * i, std::string(200, 'x')));
  return status;
}

TEST(LiveTable, FitsItsScreenWhateverTheNamesAndArms) {
  for (const std::size_t arms : {1u, 2u, 4u, 16u}) {
    for (const std::size_t width : {20u, 80u, 100u, 200u}) {
      for (const std::size_t height : {12u, 23u, 60u}) {
        const auto lines = table_lines(status_of(arms), std::string(150, 's'), 20, {width, height, false});
        EXPECT_LE(lines.size(), height) << arms;
        for (const auto& line : lines) EXPECT_LE(line.size(), std::min<std::size_t>(width, 100)) << line;
      }
    }
  }
}

TEST(LiveTable, ShowsWhatCounts) {
  RunStatus status = status_of(2);
  status.arms[0].arm = "left";
  status.arms[0].controllet = "left_pose";
  status.arms[1].interventions = 7;
  std::string text;
  for (const auto& line : table_lines(status, "two_arms", 20, {})) text += line + "\n";
  for (const char* part :
       {"two_arms", "25 %", "1000 Hz", "12.3 us", "45.6", "1.23 mm", "34 %", "left_pose", " 7"}) {
    EXPECT_THAT(text, HasSubstr(part));
  }
  EXPECT_THAT(text, Not(HasSubstr("\x1b")));
}

TEST(LiveTable, ShowsHowArmsOnTheNetworkFare) {
  RunStatus status = status_of(2);
  status.arms[0].mode = ArmMode::reflex;
  status.arms[0].connection = ConnectionStatistics{.lost = 17, .command_success_rate = 0.93};
  std::string text;
  for (const auto& line : table_lines(status, "two_arms", 20, {})) {
    text += line + "\n";
    EXPECT_LE(line.size(), 100u);
  }
  for (const char* part : {"mode", "success", "lost", "reflex", "93 %", "17", "-"}) {
    EXPECT_THAT(text, HasSubstr(part));
  }
  EXPECT_THAT(plain_line(status, 0), HasSubstr("reflex success 93 % lost 17"));
}

TEST(LiveTable, ShowsWhyAnArmStoppedWithin80Columns) {
  for (const bool connected : {false, true}) {
    RunStatus status = status_of(2);
    status.arms[0].mode = ArmMode::reflex;
    status.arms[0].errors = "cartesian_reflex";
    status.arms[0].interventions = 1234567;
    if (connected) status.arms[1].connection = ConnectionStatistics{.lost = 12345, .command_success_rate = 1};
    status.news = {
        "   12.345 s  arm 'left' stopped itself at 12.345 s: cartesian_reflex",
        "   12.345 s    force along z: 45.1 N at the flange, beyond the threshold of 40 N; the arm had "
        "touched something, or its payload is not declared as it is"};
    std::string text;
    for (const auto& line : table_lines(status, "two_arms", 20, {79, 23, false})) {
      EXPECT_LE(line.size(), 79u);
      EXPECT_THAT(line, Not(HasSubstr("touched~")));
      // Joins wrapped lines, so that a phrase may continue on the next one.
      text += (text.empty() ? "" : " ") + line.substr(std::min(line.find_first_not_of(' '), line.size()));
    }
    for (const char* part :
         {"reflex", "1234567", "cartesian_reflex", "threshold of 40 N", "declared as it is"})
      EXPECT_THAT(text, HasSubstr(part));
    EXPECT_THAT(plain_line(status, 0), HasSubstr("stopped: cartesian_reflex"));
  }
}

TEST(LiveTable, KeepsItsHeightWhileNewsComeIn) {
  RunStatus early = status_of(2);
  early.news.clear();
  EXPECT_EQ(table_lines(early, "s", 20, {}).size(), table_lines(status_of(2), "s", 20, {}).size());
}

TEST(LiveTable, WithoutSetPointThereIsNoError) {
  RunStatus status = status_of(1);
  status.arms[0].tracking_error = {};
  EXPECT_THAT(plain_line(status, 0), Not(HasSubstr("mm")));
  status.arms[0].tracking_error = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THAT(plain_line(status, 0), Not(HasSubstr("nan")));
}

}  // namespace
}  // namespace multipanda::cli::live_table_test
