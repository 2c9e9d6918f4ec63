#pragma once

#include <algorithm>
#include <cmath>
#include <span>
#include <vector>

namespace multipanda {

// The smallest of the values that a share (0 to 1) of them does not exceed (nearest rank). Reorders the
// values, of which there is at least one.
inline double quantile(std::vector<double>& values, double share) {
  const auto rank = static_cast<std::ptrdiff_t>(std::ceil(share * static_cast<double>(values.size())));
  const auto place = values.begin() + std::max<std::ptrdiff_t>(rank - 1, 0);
  std::nth_element(values.begin(), place, values.end());
  return *place;
}

// The median; the smaller of the two in the middle if their number is even.
inline double median(std::span<const double> values) {
  std::vector<double> copy(values.begin(), values.end());
  return quantile(copy, 0.5);
}

}  // namespace multipanda
