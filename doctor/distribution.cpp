#include "doctor/distribution.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include <fmt/format.h>

namespace multipanda::doctor {
namespace {

double percentile(const std::vector<double>& sorted, double share) {
  const auto n = static_cast<double>(sorted.size());
  const auto rank = std::clamp<std::size_t>(static_cast<std::size_t>(std::ceil(share * n)), 1, sorted.size());
  return sorted[rank - 1];
}

// 1 2 5 10 ... 10000 us; the first and last bar take all smaller and larger values.
std::vector<double> edges() {
  std::vector<double> edges{0};
  for (double decade = 1; decade <= 1000; decade *= 10) {
    for (const double step : {1.0, 2.0, 5.0}) edges.push_back(step * decade);
  }
  edges.push_back(10000);
  edges.push_back(std::numeric_limits<double>::infinity());
  return edges;
}

}  // namespace

Distribution distribution_of(std::vector<double> us) {
  Distribution result;
  if (us.empty()) return result;
  std::sort(us.begin(), us.end());
  result.count = us.size();
  result.p50 = percentile(us, 0.5);
  result.p99 = percentile(us, 0.99);
  result.p999 = percentile(us, 0.999);
  result.worst = us.back();
  const auto steps = edges();
  for (std::size_t i = 0; i + 1 < steps.size(); ++i) {
    Bar bar{.from = steps[i], .to = steps[i + 1]};
    // A negative value (a clock that steps) counts as zero.
    const auto first = i == 0 ? us.begin() : std::lower_bound(us.begin(), us.end(), bar.from);
    bar.count = static_cast<std::size_t>(std::lower_bound(first, us.end(), bar.to) - first);
    result.bars.push_back(bar);
  }
  const auto filled = [](const Bar& bar) { return bar.count > 0; };
  result.bars.erase(result.bars.begin(), std::find_if(result.bars.begin(), result.bars.end(), filled));
  while (!result.bars.empty() && !filled(result.bars.back())) result.bars.pop_back();
  return result;
}

double share_above(const std::vector<double>& us, double limit) {
  if (us.empty()) return 0;
  const auto above = std::count_if(us.begin(), us.end(), [limit](double value) { return value > limit; });
  return static_cast<double>(above) / static_cast<double>(us.size());
}

std::vector<Figure> Distribution::figures() const {
  return {{"count", static_cast<double>(count), ""},
          {"p50", p50, "us"},
          {"p99", p99, "us"},
          {"p999", p999, "us"},
          {"worst", worst, "us"}};
}

std::string Distribution::text() const {
  const auto number = [](double us) {
    return us < 100 ? fmt::format("{:.3g}", us) : fmt::format("{:.0f}", us);
  };
  return fmt::format("p50 {}, p99 {}, p99.9 {}, worst {} us", number(p50), number(p99), number(p999),
                     number(worst));
}

}  // namespace multipanda::doctor
