#pragma once

#include <rmw/types.h>
#include <string>

namespace multipanda::ros {

// Depth of the queues of services: further requests and responses displace the oldest ones. The ROS default
// is ten.
inline constexpr std::size_t kServiceDepth = 200;

// Quality of service of a topic. The newest `depth` messages are kept; older ones are replaced, so that no
// writer waits for a reader.
struct Qos {
  enum class Reliability { best_effort, reliable };
  Reliability reliability = Reliability::best_effort;
  std::size_t depth = 5;
  bool transient_local = false;  // late subscribers get the newest messages

  static Qos sensor(std::size_t depth = 5) { return {Reliability::best_effort, depth, false}; }
  static Qos reliable(std::size_t depth = 10) { return {Reliability::reliable, depth, false}; }
  static Qos latched(std::size_t depth = 1) { return {Reliability::reliable, depth, true}; }

  rmw_qos_profile_t profile() const;
  std::string text() const;  // "reliable, newest 10, kept for late subscribers"
};

}  // namespace multipanda::ros
