#pragma once

#include <vector>

#include "doctor/finding.hpp"

namespace multipanda::doctor {

// Durations that were measured one by one [us].
struct Distribution {
  std::size_t count = 0;
  double p50 = 0, p99 = 0, p999 = 0, worst = 0;
  std::vector<Bar> bars;  // steps of 1, 2, 5 from 1 us; only from the first to the last that is not empty

  std::vector<Figure> figures() const;
  std::string text() const;  // "p50 4.1, p99 9.8, p99.9 31, worst 120 us"
};

// Nearest-rank percentiles: the smallest value that the given share of all do not exceed.
Distribution distribution_of(std::vector<double> us);
// Share of the values above `limit`, 0 to 1.
double share_above(const std::vector<double>& us, double limit);

}  // namespace multipanda::doctor
