#pragma once

#include <rmw/types.h>
#include <string>

namespace multipanda::ros {

// Requests and responses that may be under way at once; of more than that, the oldest are lost. ROS keeps
// ten.
inline constexpr std::size_t kServiceDepth = 200;

// What is promised about messages between publisher and subscriber. The newest `depth` are kept; older ones
// give way, so that no writer waits for a reader.
struct Qos {
  enum class Reliability { best_effort, reliable };
  Reliability reliability = Reliability::best_effort;
  std::size_t depth = 5;
  bool transient_local = false;  // who comes late gets the newest ones

  static Qos sensor(std::size_t depth = 5) { return {Reliability::best_effort, depth, false}; }
  static Qos reliable(std::size_t depth = 10) { return {Reliability::reliable, depth, false}; }
  static Qos latched(std::size_t depth = 1) { return {Reliability::reliable, depth, true}; }

  rmw_qos_profile_t profile() const;
  std::string words() const;  // "reliable, newest 10, kept for late comers"
};

}  // namespace multipanda::ros
