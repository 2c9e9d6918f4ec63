#include <cmath>
#include <cstring>
#include <limits>

#include <fmt/format.h>
#include <gtest/gtest.h>

#include "experiments/study/scene_run.hpp"

namespace multipanda::run_figures_test {
namespace {

RecordLayout layout() {
  RecordLayout layout;
  layout.arms = {{.name = "arm", .joint_count = 2}};
  RecordLayout::Instance law;
  law.name = "law";
  law.outputs = {{.name = "force_n", .offset = 0, .size = 1}, {.name = "wrench", .offset = 1, .size = 6}};
  layout.instances = {law};
  layout.output_count = 7;
  return layout;
}

CycleRecord record(std::uint64_t cycle, double q0, double torque0, double torque1, double output) {
  CycleRecord record(1, 0, 7);
  record.cycle = cycle;
  record.arms[0].q = {q0, 2};
  record.arms[0].dq = {-0.5, 0.25};
  record.arms[0].tau_cmd = {torque0, torque1};
  record.outputs = {output, 0, 0, 0, 0, 0, 0};
  return record;
}

TEST(RunFigures, AreThoseOfThreeRecordsByHand) {
  RunFigures figures(layout());
  const double none = std::numeric_limits<double>::quiet_NaN();
  auto first = record(1, 0.1, 3, -4, none);  // the law is not active yet
  first.arms[0].has_contact_truth = true;
  first.arms[0].F_K_W_true = {3, 0, 4, 100, 100, 100};  // 5 N; moments do not count
  auto second = record(2, 0.2, -6, 0, 2);
  second.arms[0].has_contact_truth = true;
  second.arms[0].F_K_W_true = {0, 0, -1, 0, 0, 0};
  second.arms[0].interventions = 7;
  auto third = record(3, 0.3, 1, 1, -1);
  third.arms[0].has_contact_truth = true;
  third.arms[0].interventions = 9;
  for (const auto& taken : {first, second, third}) figures.take(taken);
  const auto json = figures.json();
  EXPECT_EQ(json["cycles"], 3);
  EXPECT_EQ(json["arm/torque_max_nm"], 6.0);
  EXPECT_DOUBLE_EQ(json["arm/torque_rms_nm"].get<double>(), std::sqrt((9 + 16 + 36 + 0 + 1 + 1) / 6.0));
  EXPECT_EQ(json["arm/speed_max_rad_per_s"], 0.5);
  EXPECT_EQ(json["arm/force_max_n"], 5.0);
  EXPECT_DOUBLE_EQ(json["arm/force_mean_n"].get<double>(), 2.0);
  EXPECT_FALSE(json.contains("arm/force_est_max_n"));
  EXPECT_EQ(json["arm/interventions"], 9);
  EXPECT_EQ(json["arm/q_end_rad"], nlohmann::ordered_json::array({0.3, 2.0}));
  EXPECT_EQ(json["law/force_n/min"], -1.0);
  EXPECT_EQ(json["law/force_n/max"], 2.0);
  EXPECT_EQ(json["law/force_n/end"], -1.0);
  EXPECT_FALSE(json.contains("law/wrench/min"));  // scalars only
}

// The published 64-bit FNV-1a of the bytes that the numbers have on a little-endian machine.
std::string digest_of(const std::vector<double>& numbers) {
  std::vector<unsigned char> bytes(numbers.size() * sizeof(double));
  std::memcpy(bytes.data(), numbers.data(), bytes.size());
  std::uint64_t hash = 14695981039346656037ULL;
  for (const unsigned char byte : bytes) hash = (hash ^ byte) * 1099511628211ULL;
  return fmt::format("{:016x}", hash);
}

TEST(RunFigures, TheDigestIsOfEveryBit) {
  const auto digest = [](double q0) {
    RunFigures figures(layout());
    figures.take(record(1, q0, 3, -4, 0));
    return figures.json()["digest"].get<std::string>();
  };
  EXPECT_EQ(digest(0.1), digest_of({0.1, 2, -0.5, 0.25, 3, -4}));
  EXPECT_NE(digest(0.1), digest(std::nextafter(0.1, 1)));
  EXPECT_NE(digest(0.0), digest(-0.0));
}

}  // namespace
}  // namespace multipanda::run_figures_test
