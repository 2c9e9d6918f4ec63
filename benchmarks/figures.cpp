#include <algorithm>
#include <stdexcept>

#include "benchmarks/cases.hpp"
#include "core/types/statistics.hpp"
#include "core/types/time.hpp"

namespace multipanda::bench {
namespace {

constexpr std::size_t kBlock = 100;  // consecutive calls of one case

}  // namespace

Figures figures_of(std::vector<double> values) {
  if (values.empty()) throw std::logic_error("no measurement was made");
  return {quantile(values, 0.5), quantile(values, 0.999), quantile(values, 1)};
}

void measure_in_turns(std::vector<Case>& cases, std::size_t samples, double budget_s) {
  for (Case& c : cases) {
    c.durations.reserve(samples);
    for (std::size_t i = 0; i < kBlock; ++i)
      c.once();  // until a steady state is reached and pages are
                 // mapped
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
