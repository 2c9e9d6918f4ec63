#include <functional>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "sysid/measured/testing/test_logs.hpp"

namespace multipanda::check_test {
namespace {

using testing::HasSubstr;

std::string refusal(MeasuredLog log) {
  try {
    check_measured(log);
    return "";
  } catch (const LogRefused& error) {
    return error.what();
  }
}

struct Damage {
  const char* name;
  std::function<void(MeasuredLog&)> spoil;
  std::vector<std::string> says;
};

class BadData : public testing::TestWithParam<Damage> {};

TEST_P(BadData, IsRefusedWithTheNumberThatShowsIt) {
  MeasuredLog log = swinging_log();
  ASSERT_EQ(refusal(log), "");
  GetParam().spoil(log);
  const std::string said = refusal(log);
  for (const auto& text : GetParam().says) EXPECT_THAT(said, HasSubstr(text));
}

constexpr double kDegrees = 180 / 3.14159265358979;
INSTANTIATE_TEST_SUITE_P(
    All, BadData,
    testing::Values(
        Damage{
            "nan", [](MeasuredLog& l) { l.tau(1500, 3) = std::nan(""); }, {"t = 1.5 s", "tau4", "one of 1"}},
        Damage{"negative", [](MeasuredLog& l) { l.t.array() -= 0.5; }, {"negative (-0.5 s)"}},
        Damage{"falling",
               [](MeasuredLog& l) { l.t.tail(1000).array() -= 1.0; },
               {"decreases from", "several recordings"}},
        Damage{"rounded", [](MeasuredLog& l) { l.t = (l.t.array() * 100).floor() / 100; }, {"rounded"}},
        Damage{
            "gap", [](MeasuredLog& l) { l.t.tail(1000).array() += 0.4; }, {"gap of 0.401 s", "t = 2.401 s"}},
        Damage{"short",
               [](MeasuredLog& l) { l = swinging_log(0.049); },
               {"too short: 50 samples, 0.049 s", "log_size"}},
        Damage{"milliseconds", [](MeasuredLog& l) { l.t *= 1000; }, {"1 s apart", "milliseconds"}},
        Damage{"microseconds", [](MeasuredLog& l) { l.t *= 1e6; }, {"1e+03 s apart", "microseconds"}},
        Damage{"nanoseconds", [](MeasuredLog& l) { l.t *= 1e9; }, {"1e+06 s apart", "nanoseconds"}},
        Damage{"kiloseconds", [](MeasuredLog& l) { l.t *= 0.1; }, {"dq1 is 0.1 times"}},
        Damage{"q_in_degrees", [](MeasuredLog& l) { l.q *= kDegrees; }, {"q1 reaches 17.", "degrees"}},
        Damage{"small_q_in_degrees",
               [](MeasuredLog& l) { l.q *= 0.2 * kDegrees, l.dq *= 0.2; },
               {"0.0175 times the slope", "q in degrees"}},
        Damage{
            "dq_in_degrees", [](MeasuredLog& l) { l.dq *= kDegrees; }, {"57.3 times", "degrees per second"}},
        Damage{"rpm", [](MeasuredLog& l) { l.dq *= 9.5493; }, {"9.55 times", "rpm"}},
        Damage{"sign", [](MeasuredLog& l) { l.dq.col(2) *= -1; }, {"dq3 is -1 times", "opposite sign"}},
        Damage{"swapped", [](MeasuredLog& l) { l.dq.col(5).swap(l.dq.col(0)); }, {"dq1 is"}},
        Damage{"frozen_torque",
               [](MeasuredLog& l) { l.tau.col(1).setConstant(2.5); },
               {"tau2 is 2.5 in every sample"}},
        Damage{"frozen_position",
               [](MeasuredLog& l) { l.q.col(6).setConstant(1.0); },
               {"q7 is 1 in every sample"}},
        Damage{"stalled",
               [](MeasuredLog& l) {
                 for (Eigen::Index k = 1000; k < 1150; ++k)
                   l.q.row(k) = l.q.row(1000), l.dq.row(k) = l.dq.row(1000);
               },
               {"repeat for 0.149 s", "t = 1 s"}}),
    [](const auto& each) { return each.param.name; });

// Faults that do not prevent a log's use are reported and counted.
TEST(OddData, GivesWarnings) {
  const auto warning = [](const std::function<void(MeasuredLog&)>& spoil) {
    MeasuredLog log = swinging_log();
    spoil(log);
    check_measured(log);
    return log.warnings.empty() ? std::string() : log.warnings[0];
  };
  EXPECT_EQ(warning([](MeasuredLog&) {}), "");
  EXPECT_THAT(warning([](MeasuredLog& l) { l.t.tail(1000).array() += 0.03; }), HasSubstr("longest 31 ms"));
  EXPECT_THAT(warning([](MeasuredLog& l) { l.dq.col(3) *= 1.08; }), HasSubstr("dq4 is 1.08 times"));
  EXPECT_THAT(warning([](MeasuredLog& l) { l = swinging_log(3.0, 7, 0.01); }), HasSubstr("every 10 ms"));
  // A recorder at 1 kHz that holds rows of 500 Hz, of an arm that hardly moves.
  EXPECT_THAT(warning([](MeasuredLog& l) {
                for (Eigen::MatrixXd* values : {&l.q, &l.dq, &l.tau}) {
                  *values *= 1e-3;
                  for (Eigen::Index k = 1; k < l.samples(); k += 2) values->row(k) = values->row(k - 1);
                }
              }),
              HasSubstr("50 % of the samples repeat the one before"));
  EXPECT_EQ(warning([](MeasuredLog& l) {
              for (Eigen::MatrixXd* values : {&l.q, &l.dq, &l.tau}) *values *= 0;
            }),
            "")
      << "a simulation at rest";
  EXPECT_THAT(warning([](MeasuredLog& l) { l.t[700] = l.t[699]; }),
              HasSubstr("1 samples have the same time"));
}

TEST(OddData, SamplesWithEqualStampsAreRemovedFromEveryQuantity) {
  MeasuredLog log = swinging_log();
  log.lines.resize(static_cast<std::size_t>(log.samples()));
  for (std::size_t k = 0; k < log.lines.size(); ++k) log.lines[k] = k + 2;
  log.t[700] = log.t[699];
  const Eigen::MatrixXd q = log.q;
  check_measured(log);
  EXPECT_EQ(log.samples(), q.rows() - 1);
  EXPECT_EQ(log.q.rows(), log.samples());
  EXPECT_EQ(log.tau.rows(), log.samples());
  EXPECT_EQ(log.q.row(700), q.row(701));
  EXPECT_EQ(log.lines[700], 703u);
}

// Noise as on real arms is no reason to refuse: positions 1e-4 rad, velocities 0.01 rad/s, and an
// arm at rest.
TEST(OddData, NoiseAndRestPass) {
  std::mt19937 random(7);
  std::normal_distribution<double> normal;
  MeasuredLog log = swinging_log();
  const auto noise = [&](double size) { return size * normal(random); };
  log.q = log.q.unaryExpr([&](double v) { return v + noise(1e-4); }).eval();
  log.dq = log.dq.unaryExpr([&](double v) { return v + noise(1e-2); }).eval();
  check_measured(log);
  EXPECT_TRUE(log.warnings.empty());
  log.q.setConstant(0.5), log.dq.setZero(), log.tau.setConstant(3);
  check_measured(log);
  EXPECT_TRUE(log.warnings.empty());
}

TEST(WrongRobot, IsRefusedByJointsRangesAndLimits) {
  RobotRanges ranges{"ranges", Eigen::VectorXd::Constant(7, -1), Eigen::VectorXd::Constant(7, 1),
                     Eigen::VectorXd::Constant(7, 1.5), Eigen::VectorXd::Constant(7, 20)};
  const auto said = [&](MeasuredLog log) -> std::string {
    try {
      check_robot(log, ranges);
      return log.warnings.empty() ? "" : log.warnings[0];
    } catch (const LogRefused& error) {
      return error.what();
    }
  };
  EXPECT_EQ(said(swinging_log()), "");
  EXPECT_THAT(said(swinging_log(3.0, 6)), HasSubstr("6 joints, expected 7 for robot 'ranges'"));
  ranges.q_min[3] = 0.2;
  EXPECT_THAT(said(swinging_log()), HasSubstr("q4 is -0.3 rad, outside the range 0.2 to 1"));
  ranges.q_min[3] = -1, ranges.tau_max[1] = 2;
  EXPECT_THAT(said(swinging_log()), HasSubstr("tau2 reaches 6 N m, robot 'ranges' has at most 2"));
  ranges.tau_max[1] = 5;
  EXPECT_THAT(said(swinging_log()), HasSubstr("tau2 reaches 6 N m"));  // a warning
}

}  // namespace
}  // namespace multipanda::check_test
