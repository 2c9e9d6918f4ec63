#pragma once

#include <optional>

#include "ros/adapter/every.hpp"
#include "ros/adapter/part.hpp"
#include "ros/rcl/rcl.hpp"

namespace multipanda::ros {

// A topic that is published every n-th cycle, into one message that keeps its memory, and only while somebody
// listens. A rate of 0: there is no such topic.
template <class M>
class Topic {
 public:
  Topic(Node& node, const std::string& name, const Qos& qos, double rate_hz, double period_s,
        const std::string& doc)
      : every_(rate_hz, period_s) {
    if (!every_.off()) publisher_.emplace(node, name, qos, Doc{every_.words(period_s), doc});
  }

  M message;
  // Is it time, and does somebody listen? Then fill `message` and publish() it.
  bool due(std::uint64_t cycle) { return publisher_ && every_.due(cycle) && publisher_->subscribers() > 0; }
  void publish() { publisher_->publish(message); }

 private:
  Every every_;
  std::optional<Publisher<M>> publisher_;
};

// Of a record of the loop [s].
inline double period_of(const RunWorld& world) { return world.backend->capabilities(0).period_s; }

}  // namespace multipanda::ros
