// The figure that says what a model is worth on new motion: the blocks behind it, and its formula.
#include <cmath>
#include <map>

#include <gtest/gtest.h>

#include "sysid/identification/filtered_log.hpp"
#include "sysid/identification/identify_parts.hpp"

namespace multipanda::cross_validation_test {
namespace {

using Eigen::Index;

// Two joints on a circle that a second frequency disturbs; a whole `ratio` of both repeats after the period.
FilteredLog swinging(double seconds, double period, double ratio) {
  FilteredLog log;
  const auto rows = static_cast<Index>(seconds / kProtocolStep);
  log.t = kProtocolStep * Eigen::VectorXd::LinSpaced(rows, 0, static_cast<double>(rows - 1));
  const double w = 2 * M_PI / period;
  log.q.resize(rows, 2);
  log.dq.resize(rows, 2);
  const Eigen::ArrayXd slow = w * log.t.array(), fast = ratio * slow;
  log.q << (slow.sin() + 0.1 * fast.cos()).matrix(), slow.cos().matrix();
  log.dq << (w * slow.cos() - 0.1 * ratio * w * fast.sin()).matrix(), (-w * slow.sin()).matrix();
  for (Index i = 200; i < rows - 200; i += 10) log.kept.push_back(i);
  return log;
}

TEST(Blocks, CoverEveryRowOnceInOrder) {
  for (const FilteredLog& log : {swinging(7.5, 13, std::sqrt(3)), swinging(17, 5, 2)}) {
    Index next = 0;
    std::map<std::size_t, Index> size;
    for (const BlockRange& range : block_ranges(log, 3)) {
      EXPECT_EQ(range.begin, next);
      EXPECT_LT(range.begin, range.end);
      size[range.block] += range.end - range.begin;
      next = range.end;
    }
    EXPECT_EQ(next, static_cast<Index>(log.kept.size()));
    EXPECT_EQ(size.size(), 3u);
  }
}

TEST(Blocks, AMotionThatRepeatsItselfIsCutByItsPhase) {
  const FilteredLog repeated = swinging(17, 5, 2);
  EXPECT_NEAR(static_cast<double>(repeated_after(repeated)), 500, 5);  // 5 s; twice it matches less often
  EXPECT_EQ(repeated_after(swinging(7.5, 13, std::sqrt(3))), 0);
  EXPECT_EQ(repeated_after(swinging(4.9, 5, 2)), 0);  // not yet once
  // No position of one block occurs in another one, but at their borders.
  std::map<std::size_t, std::vector<Eigen::Vector2d>> states;
  for (const BlockRange& range : block_ranges(repeated, 3)) {
    for (Index i = range.begin + 20; i < range.end - 20; i += 7) {
      const Index row = repeated.kept[static_cast<std::size_t>(i)];
      states[range.block].emplace_back(repeated.q(row, 0), repeated.q(row, 1));
    }
  }
  const auto nearest = [&](std::size_t a, std::size_t b) {
    double best = INFINITY;
    for (const auto& x : states[a]) {
      for (const auto& y : states[b]) best = std::min(best, (x - y).norm());
    }
    return best;
  };
  EXPECT_GT(std::min({nearest(0, 1), nearest(1, 2), nearest(0, 2)}), 0.02);
}

// y = a x + noise of spread s, with N rows: a fit to m rows errs on new rows with s^2 (1 + p / m) and shows
// s^2 (1 - p / m) on its own, for p coefficients. The formula turns the first for m = 2 N / 3 into it for N.
TEST(Expected, UndoesTheMissingRowsOfABlockedFit) {
  const double s = 0.1, N = 300, p = 30;
  const auto on_new = [&](double m) { return Eigen::VectorXd::Constant(1, s * std::sqrt(1 + p / m)); };
  const Eigen::VectorXd fitted = Eigen::VectorXd::Constant(1, s * std::sqrt(1 - p / N));
  const double found = expected_rmse(on_new(2 * N / 3), fitted, 3)[0], truth = on_new(N)[0];
  EXPECT_NEAR(found, truth, 0.02 * truth);
  EXPECT_EQ(expected_rmse(Eigen::VectorXd::Constant(1, 0.05), Eigen::VectorXd::Constant(1, 0.06), 3)[0],
            0.06);
}

}  // namespace
}  // namespace multipanda::cross_validation_test
