#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "core/types/time.hpp"

namespace multipanda {

// How often a log contains each kind of per-cycle message: every Nth cycle; 0: never. Events, switches,
// interventions, episodes and arm configurations are always complete.
struct LogEvery {
  std::uint64_t state = 1, command = 1, wrench = 1, references = 1, outputs = 1, timing = 1;
  std::uint64_t model = 10, report = 10, objects = 16;

  // "state=10", "all=100". Throws std::invalid_argument with what is expected.
  void set(const std::string& choice);
  // "state=10 command=0": differences from the default; empty: none.
  std::string text() const;
};

// Marks in a log the beginning and the result of an attempt at a task.
struct EpisodeMark {
  enum class Kind : std::uint8_t { start, success, failure, discard };
  Kind kind = Kind::start;
  std::uint64_t episode = 0;  // its number in this run, from 1
  std::uint64_t cycle = 0;    // after this cycle
  LoopTime t;
};
std::string_view to_string(EpisodeMark::Kind kind);
const std::vector<std::string>& episode_marks();  // their names

}  // namespace multipanda
