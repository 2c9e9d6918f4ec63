#include "core/rt/cycle_histogram.hpp"

#include <algorithm>
#include <bit>
#include <cmath>

namespace multipanda {

// Below 128 ns every number has its own bucket. Above, an octave [2^k, 2^(k+1)) is cut into 128 equal steps.
std::size_t CycleHistogram::bucket(std::uint64_t ns) {
  if (ns < kSteps) return static_cast<std::size_t>(ns);
  const int octave =
      static_cast<int>(std::bit_width(ns)) - 1 - kStepBits;  // 0: numbers of 8 bits, steps of 1 ns
  if (octave >= kOctaves) return kSteps * (kOctaves + 1) - 1;
  const std::size_t step = static_cast<std::size_t>(ns >> octave) - kSteps;
  return kSteps * (static_cast<std::size_t>(octave) + 1) + step;
}

std::int64_t CycleHistogram::upper_end(std::size_t bucket) {
  if (bucket < kSteps) return static_cast<std::int64_t>(bucket);
  const std::size_t octave = bucket / kSteps - 1, step = bucket % kSteps;
  return static_cast<std::int64_t>(((kSteps + step + 1) << octave) - 1);
}

void CycleHistogram::add(std::int64_t ns) {
  ns = std::max<std::int64_t>(ns, 0);
  ++counts_[bucket(static_cast<std::uint64_t>(ns))];
  ++count_;
  max_ = std::max(max_, ns);
}

std::int64_t CycleHistogram::percentile(double share) const {
  if (count_ == 0) return 0;
  const auto rank = std::clamp<std::uint64_t>(
      static_cast<std::uint64_t>(std::ceil(share * static_cast<double>(count_))), 1, count_);
  std::uint64_t seen = 0;
  for (std::size_t i = 0; i < counts_.size(); ++i) {
    seen += counts_[i];
    if (seen >= rank) return std::min(upper_end(i), max_);
  }
  return max_;
}

}  // namespace multipanda
