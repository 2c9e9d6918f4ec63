#include "benchmarks/figures.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "core/types/time.hpp"

namespace multipanda::bench {
namespace {

constexpr std::size_t kBlock = 100;  // calls of one case in a row

double rank(const std::vector<double>& sorted, double share) {
  const auto count = static_cast<double>(sorted.size());
  const auto index = static_cast<std::size_t>(std::ceil(share * count)) - 1;
  return sorted[std::min(index, sorted.size() - 1)];
}

}  // namespace

Figures figures_of(std::vector<double> values) {
  if (values.empty()) throw std::logic_error("no measurement was made");
  std::sort(values.begin(), values.end());
  return {rank(values, 0.5), rank(values, 0.999), values.back()};
}

void measure_in_turns(std::vector<Case>& cases, std::size_t samples, double budget_s) {
  for (Case& c : cases) {
    c.durations.reserve(samples);
    for (std::size_t i = 0; i < kBlock; ++i) c.once();  // to a steady state, pages touched
  }
  const HostTime begin = host_now();
  for (std::size_t done = 0; done < samples && seconds(host_now() - begin) < budget_s;) {
    const std::size_t block = std::min(kBlock, samples - done);
    for (Case& c : cases) {
      for (std::size_t i = 0; i < block; ++i) {
        const HostTime before = host_now();
        c.once();
        c.durations.push_back(static_cast<double>((host_now() - before).count()) * 1e-3);
      }
    }
    done += block;
  }
  for (Case& c : cases) {
    if (c.verify) c.verify();
  }
}

}  // namespace multipanda::bench
