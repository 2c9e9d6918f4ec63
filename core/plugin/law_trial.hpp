#pragma once

#include <cstdint>
#include <functional>

#include "core/controllets/controllet.hpp"

// Tests a controllet on random states before it moves an arm: are all torques finite, and how long does a
// tick take? Off the loop only.
namespace multipanda {

struct LawTrialOptions {
  std::size_t states = 10000;
  std::uint32_t seed = 1;
  int repeats = 3;       // of each state
  double most_us = 100;  // ends once more than a thousandth of all states took longer
};

// One state, and the law's result. Valid during the call only.
struct LawTrialState {
  std::size_t number = 0;
  bool started = false;  // started directly before this tick, or refused to start
  const ControlContext& context;
  LawResult result = LawResult::ok;
};

struct LawTrial {
  std::size_t states = 0;
  std::size_t faults = 0;       // faults, exceptions, torques or outputs that are not finite
  std::size_t first_fault = 0;  // the number of the state
  // Processor time of one tick with the model terms that it uses [us]. The shortest of the repeats of a state
  // counts: an interrupt during one of them is not the law's.
  double median_us = 0, p999_us = 0, worst_us = 0;
};

// Positions within the limits of the models, velocities within theirs; estimated torques up to a tenth of the
// limits of effort; parameters within their bounds; set-points up to 0.3 m, 0.5 rad (poses), anywhere within
// the limits (joints), up to 10 (others), in motion. It starts again every 100 states, so that memory is
// used. `each` sees every state after the first call of the law on it.
LawTrial try_law(const ControlletType& type, ArmModels models, const LawTrialOptions& options,
                 const std::function<void(const LawTrialState&)>& each = {});

}  // namespace multipanda
