#include "sysid/identification/windows.hpp"

#include <algorithm>
#include <cmath>

namespace multipanda {
namespace {

using Eigen::Index;

constexpr Index kHalf = 4;       // of the samples that a start state is smoothed over
constexpr double kSettle = 0.1;  // before a window [s]

// Value at the middle of 2 kHalf + 1 samples, of the parabola through them in the least-squares sense.
JointVector smooth(const Eigen::MatrixXd& series, Index row) {
  // Weights of Savitzky and Golay (1964) for second order, nine points.
  constexpr double kWeights[] = {-21, 14, 39, 54, 59, 54, 39, 14, -21};
  JointVector value = JointVector::Zero(series.cols());
  for (Index i = -kHalf; i <= kHalf; ++i)
    value += kWeights[i + kHalf] / 231.0 * series.row(row + i).transpose();
  return value;
}

}  // namespace

double period_of(const MeasuredLog& log) {
  std::vector<double> steps;
  for (Index k = 0; k + 1 < log.samples(); ++k) steps.push_back(log.t[k + 1] - log.t[k]);
  if (steps.empty()) return 0;
  const auto middle = steps.begin() + static_cast<std::ptrdiff_t>(steps.size() / 2);
  std::nth_element(steps.begin(), middle, steps.end());
  return *middle;
}

std::vector<RolloutWindow> choose_windows(std::span<const MeasuredLog> logs, double seconds, std::size_t most,
                                          const std::vector<std::vector<char>>& usable) {
  std::vector<RolloutWindow> all;
  for (std::size_t l = 0; l < logs.size(); ++l) {
    const MeasuredLog& log = logs[l];
    if (log.samples() < 3) continue;
    const double period = period_of(log);
    const auto length = std::max<Index>(2, static_cast<Index>(std::lround(seconds / period)));
    const auto before = static_cast<Index>(std::ceil(kSettle / period)) + kHalf;
    Index good_since = 0;  // first row without a gap up to here
    Index next = before;
    for (Index k = 1; k < log.samples(); ++k) {
      if (std::abs(log.t[k] - log.t[k - 1] - period) > 0.2 * period) good_since = k;
      next = std::max(next, good_since + before);
      const Index first = k - length;
      if (first < next) continue;
      const auto is_usable = [&](Index row) {
        return usable.empty() || usable[l][static_cast<std::size_t>(row)] != 0;
      };
      bool whole = true;
      for (Index row = first; row <= k && whole; ++row) whole = is_usable(row);
      if (!whole) continue;
      all.push_back({.log = l,
                     .first = first,
                     .length = length,
                     .q = smooth(log.q, first),
                     .dq = smooth(log.dq, first)});
      next = k;
    }
  }
  if (all.size() <= most) return all;
  std::vector<RolloutWindow> chosen;
  for (std::size_t i = 0; i < most; ++i) chosen.push_back(all[i * all.size() / most]);
  return chosen;
}

}  // namespace multipanda
