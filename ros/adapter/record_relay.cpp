#include "ros/adapter/record_relay.hpp"

#include <exception>
#include <pthread.h>

namespace multipanda::ros {

RecordRelay::RecordRelay(const RecordLayout& layout, const Parts& parts,
                         std::function<void(const std::string&)> failed)
    : parts_(parts),
      failed_(std::move(failed)),
      has_failed_(parts.size()),
      ring_(layout, kRecords),
      thread_([this] { run(); }) {}

RecordRelay::~RecordRelay() {
  stop_.store(true, std::memory_order_release);
  wake();
  thread_.join();
}

// A futex: one system call where the publisher's thread sleeps, none where it is busy.
void RecordRelay::wake() {
  posted_.fetch_add(1, std::memory_order_release);
  posted_.notify_one();
}

void RecordRelay::take(const CycleRecord& record) {
  if (!ring_.ring.push(record)) ring_.dropped_records.fetch_add(1, std::memory_order_relaxed);
  wake();
}

void RecordRelay::take(const Event& event) {
  if (!ring_.events.push(event)) ring_.dropped_events.fetch_add(1, std::memory_order_relaxed);
  wake();
}

void RecordRelay::run() {
  pthread_setname_np(pthread_self(), "ros_publisher");  // so that its share of the computer can be seen
  for (;;) {
    const std::uint32_t seen = posted_.load(std::memory_order_acquire);
    const bool last = stop_.load(std::memory_order_acquire);  // read before the rings, so that all is taken
    while (hand_on()) {
    }
    if (last) return;
    posted_.wait(seen, std::memory_order_acquire);
  }
}

// Events first, as in the log: their cycle's record is the one before or after.
bool RecordRelay::hand_on() {
  bool busy = false;
  while (const Event* event = ring_.events.front()) {
    busy = true;
    give(*event);
    ring_.events.pop();
  }
  if (const CycleRecord* record = ring_.ring.front()) {
    busy = true;
    const HostTime begin = host_now();
    give(*record);
    busy_ns_.fetch_add((host_now() - begin).count(), std::memory_order_relaxed);
    ring_.ring.pop();
    handed_on_.fetch_add(1, std::memory_order_release);
  }
  return busy;
}

// A part that fails must not take the others with it.
template <typename What>
void RecordRelay::give(const What& what) {
  for (std::size_t i = 0; i < parts_.size(); ++i) {
    try {
      parts_[i]->take(what);
    } catch (const std::exception& error) {
      if (!has_failed_[i] && failed_) failed_(error.what());
      has_failed_[i] = true;
    }
  }
}

double RecordRelay::mean_time_s() const {
  const auto count = handed_on_.load(std::memory_order_acquire);
  return count == 0 ? 0
                    : 1e-9 * static_cast<double>(busy_ns_.load(std::memory_order_relaxed)) /
                          static_cast<double>(count);
}

}  // namespace multipanda::ros
