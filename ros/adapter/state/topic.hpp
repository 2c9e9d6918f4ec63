#pragma once

#include <optional>

#include "ros/adapter/adapter_part.hpp"
#include "ros/adapter/rate_divider.hpp"
#include "ros/rcl/rcl.hpp"

namespace multipanda::ros {

// A topic published every n-th cycle while it has a subscriber, with one reused message. At a rate of 0 the
// topic does not exist.
template <class M>
class Topic {
 public:
  Topic(Node& node, const std::string& name, const Qos& qos, double rate_hz, double period_s,
        const std::string& doc)
      : every_(rate_hz, period_s) {
    if (!every_.off()) publisher_.emplace(node, name, qos, Doc{every_.text(period_s), doc});
  }

  M message;
  // If this returns true, fill `message` and call publish().
  bool due(std::uint64_t cycle) { return publisher_ && every_.due(cycle) && publisher_->subscribers() > 0; }
  void publish() { publisher_->publish(message); }

 private:
  RateDivider every_;
  std::optional<Publisher<M>> publisher_;
};

// Period of the loop [s].
inline double period_of(const RunContext& run) { return run.backend->period(); }

}  // namespace multipanda::ros
