#include "core/rt/cycle_histogram.hpp"

#include <algorithm>
#include <cmath>
#include <random>
#include <vector>

#include <gtest/gtest.h>

namespace multipanda::cycle_histogram_test {
namespace {

TEST(CycleHistogram, IsEmptyAtFirst) {
  const CycleHistogram histogram;
  EXPECT_EQ(histogram.count(), 0u);
  EXPECT_EQ(histogram.percentile(0.5), 0);
}

TEST(CycleHistogram, SmallDurationsAreExact) {
  CycleHistogram histogram;
  for (int ns = 1; ns <= 100; ++ns) histogram.add(ns);
  EXPECT_EQ(histogram.percentile(0.5), 50);
  EXPECT_EQ(histogram.percentile(0.99), 99);
  EXPECT_EQ(histogram.percentile(1.0), 100);
}

// Against sorting: durations over six decades, each percentile within one step (1/128) above the true one.
TEST(CycleHistogram, PercentilesAgreeWithSorting) {
  std::mt19937 random(20);
  std::uniform_real_distribution<double> decade(2, 8);
  std::vector<std::int64_t> all(20'001);
  CycleHistogram histogram;
  for (auto& ns : all) {
    ns = static_cast<std::int64_t>(std::pow(10.0, decade(random)));
    histogram.add(ns);
  }
  std::sort(all.begin(), all.end());
  for (const double share : {0.001, 0.1, 0.5, 0.9, 0.99, 0.999, 1.0}) {
    const auto rank = static_cast<std::size_t>(std::ceil(share * static_cast<double>(all.size())));
    const auto truth = static_cast<double>(all[rank - 1]);
    const auto answer = static_cast<double>(histogram.percentile(share));
    EXPECT_GE(answer, truth) << share;
    EXPECT_LE(answer, truth * (1 + 1.0 / 128) + 1) << share;
  }
  EXPECT_EQ(histogram.max(), all.back());
}

TEST(CycleHistogram, AcceptsValuesOutOfRange) {
  CycleHistogram histogram;
  histogram.add(-5);
  histogram.add(60'000'000'000);  // a minute
  EXPECT_EQ(histogram.percentile(0.5), 0);
  EXPECT_EQ(histogram.max(), 60'000'000'000);
  EXPECT_LE(histogram.percentile(1.0), 60'000'000'000);
}

}  // namespace
}  // namespace multipanda::cycle_histogram_test
