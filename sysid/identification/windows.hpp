#pragma once

#include <span>
#include <vector>

#include "core/types/joints.hpp"
#include "sysid/measured/measured_log.hpp"

// Stretches of logs that a fit by rollouts replays.
namespace multipanda {

struct RolloutWindow {
  std::size_t log = 0;
  Eigen::Index first = 0;  // row of the start state; compared rows: first + 1 to first + length
  Eigen::Index length = 0;
  JointVector q, dq;  // start state, smoothed (n x 1)
};

// At most `most` windows of `seconds`, spread evenly, without a gap inside or in the 0.1 s before. `usable`
// may exclude rows (empty: all are usable). Start states are second-order fits over nine samples.
std::vector<RolloutWindow> choose_windows(std::span<const MeasuredLog> logs, double seconds, std::size_t most,
                                          const std::vector<std::vector<char>>& usable = {});

// Period of the control interface from the stamps [s]: the median step.
double period_of(const MeasuredLog& log);

}  // namespace multipanda
