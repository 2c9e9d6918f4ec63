#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <functional>
#include <vector>

namespace multipanda::fci {

inline std::int64_t nanoseconds(double s) { return static_cast<std::int64_t>(std::llround(1e9 * s)); }

// Events of a discrete-event simulation, in whole nanoseconds. Events of the same time happen in the order in
// which they were added, so that a run never depends on anything else.
class EventQueue {
 public:
  using Action = std::function<void()>;

  std::int64_t now_ns() const { return now_ns_; }
  // At `time_ns`, or now if that has passed.
  void at(std::int64_t time_ns, Action action) {
    events_.push_back({std::max(time_ns, now_ns_), added_++, std::move(action)});
    std::push_heap(events_.begin(), events_.end());
  }
  void after(std::int64_t delay_ns, Action action) { at(now_ns_ + delay_ns, std::move(action)); }
  bool empty() const { return events_.empty(); }
  std::int64_t next_ns() const { return events_.front().time_ns; }
  // The next event.
  void step() {
    std::pop_heap(events_.begin(), events_.end());
    Event event = std::move(events_.back());
    events_.pop_back();
    now_ns_ = event.time_ns;
    event.action();
  }
  // All events up to `time_ns`, which then is the time.
  void run_until(std::int64_t time_ns) {
    while (!empty() && next_ns() <= time_ns) step();
    now_ns_ = std::max(now_ns_, time_ns);
  }

 private:
  struct Event {
    std::int64_t time_ns = 0;
    std::uint64_t number = 0;
    Action action;
    bool operator<(const Event& other) const {  // the heap's largest is the earliest
      return time_ns != other.time_ns ? time_ns > other.time_ns : number > other.number;
    }
  };
  std::vector<Event> events_;
  std::int64_t now_ns_ = 0;
  std::uint64_t added_ = 0;
};

}  // namespace multipanda::fci
