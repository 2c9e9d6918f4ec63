#pragma once

#include <vector>

#include "doctor/finding.hpp"

namespace multipanda::doctor {

// Distribution of single durations [us].
struct Distribution {
  std::size_t count = 0;
  double p50 = 0, p99 = 0, p999 = 0, worst = 0;
  std::vector<Bar> bars;  // steps of 1, 2, 5 from 1 us; from the first to the last nonempty one

  std::vector<Figure> figures() const;
  std::string text() const;  // "p50 4.1, p99 9.8, p99.9 31, worst 120 us"
};

// Nearest-rank percentile: the smallest value that a given fraction of all values does not exceed.
Distribution distribution_of(std::vector<double> us);
// Fraction of the values above `limit`, 0 to 1.
double share_above(const std::vector<double>& us, double limit);

}  // namespace multipanda::doctor
