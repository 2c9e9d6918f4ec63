#include "sysid/identification/repeated_motion.hpp"

#include <algorithm>
#include <tuple>

namespace multipanda {
namespace {

using Eigen::Index;

constexpr Index kShortest = 100;      // of a period [kept rows of 10 ms]
constexpr Index kStep = 5;            // between tried periods and compared rows
constexpr double kSame = 0.03;        // largest difference of a joint's position [rad]
constexpr double kMovingJoint = 0.1;  // of the fastest joint [rad/s]
constexpr double kShare = 0.2;        // of the moving rows, which the repetition must cover

}  // namespace

Index repeated_after(const FilteredLog& log) {
  const Eigen::MatrixXd q = log.kept_rows(log.q), dq = log.kept_rows(log.dq);
  const auto moves = [&](Index row) { return dq.row(row).cwiseAbs().maxCoeff() > kMovingJoint; };
  Index moving = 0;
  for (Index row = 0; row < q.rows(); row += kStep) moving += moves(row) ? 1 : 0;
  Index best = 0, most = 0;
  for (Index lag = kShortest; lag < q.rows(); lag += kStep) {
    Index same = 0;
    for (Index row = lag; row < q.rows(); row += kStep) {
      if (moves(row) && (q.row(row) - q.row(row - lag)).cwiseAbs().maxCoeff() < kSame) ++same;
    }
    if (same > most) std::tie(best, most) = std::tuple(lag, same);
  }
  return static_cast<double>(most) >= kShare * static_cast<double>(std::max<Index>(1, moving)) ? best : 0;
}

std::vector<BlockRange> block_ranges(const FilteredLog& log, std::size_t blocks) {
  const auto count = static_cast<Index>(log.kept.size()), parts = static_cast<Index>(blocks);
  const Index repeated = blocks > 1 ? repeated_after(log) : 0, period = repeated > 0 ? repeated : count;
  std::vector<BlockRange> out;
  for (Index start = 0; start < count; start += period) {
    for (Index b = 0; b < parts; ++b) {
      const Index begin = start + period * b / parts, end = std::min(count, start + period * (b + 1) / parts);
      if (begin < end) out.push_back({static_cast<std::size_t>(b), begin, end});
    }
  }
  return out;
}

}  // namespace multipanda
