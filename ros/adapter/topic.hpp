#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <optional>
#include <string>

#include <fmt/format.h>

#include "ros/adapter/adapter_part.hpp"
#include "ros/rcl/rcl.hpp"

namespace multipanda::ros {

// Divides the loop's rate: true on every n-th cycle, for a rate in Hz of the loop's time.
class RateDivider {
 public:
  // A rate above the loop's rate means every cycle; 0 means never.
  RateDivider(double rate_hz, double period_s)
      : cycles_(rate_hz > 0 ? std::max<std::uint64_t>(
                                  1, static_cast<std::uint64_t>(std::lround(1 / (rate_hz * period_s))))
                            : 0) {}

  bool off() const { return cycles_ == 0; }
  // Returns whether a message is due at this cycle: at the first record, then at the multiples of n, so that
  // topics of one rate carry the same stamps. Dropped records only delay it.
  bool due(std::uint64_t cycle) {
    if (off() || (started_ && cycle / cycles_ <= turn_)) return false;
    turn_ = cycle / cycles_;
    started_ = true;
    return true;
  }
  // For lists of interfaces, for example "100 Hz".
  std::string text(double period_s) const {
    return off() ? "off" : fmt::format("{:.4g} Hz", 1 / (static_cast<double>(cycles_) * period_s));
  }

 private:
  std::uint64_t cycles_, turn_ = 0;
  bool started_ = false;
};

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
