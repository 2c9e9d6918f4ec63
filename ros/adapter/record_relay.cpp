#include "ros/adapter/record_relay.hpp"

#include <exception>
#include <linux/futex.h>
#include <pthread.h>
#include <sys/syscall.h>
#include <unistd.h>

namespace multipanda::ros {

RecordRelay::RecordRelay(const RecordLayout& layout, const AdapterParts& parts,
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

// A plain futex: one system call if the publisher's thread sleeps, none if it is busy. std::atomic::wait()
// first yields the processor a few times, which costs up to a tenth of a second on a busy computer.
void RecordRelay::wake() {
  posted_.fetch_add(1);
  if (waiting_.load()) syscall(SYS_futex, &posted_, FUTEX_WAKE_PRIVATE, 1, nullptr, nullptr, 0);
}

// Waits until the counter exceeds `seen`. May wake spuriously.
void RecordRelay::wait(std::uint32_t seen) {
  static_assert(sizeof(posted_) == sizeof(seen) && decltype(posted_)::is_always_lock_free);
  waiting_.store(true);
  if (posted_.load() == seen) syscall(SYS_futex, &posted_, FUTEX_WAIT_PRIVATE, seen, nullptr, nullptr, 0);
  waiting_.store(false);
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
  pthread_setname_np(pthread_self(), "ros_publisher");  // names the thread in top and /proc
  for (;;) {
    const std::uint32_t seen = posted_.load();
    // read before the rings, so that they are emptied
    const bool last = stop_.load(std::memory_order_acquire);
    while (hand_on()) {
    }
    if (last) return;
    wait(seen);
  }
}

// Events first, as in the log: their cycle's record is the previous or the next one.
bool RecordRelay::hand_on() {
  bool busy = false;
  while (const Event* event = ring_.events.front()) {
    busy = true;
    give(*event);
    ring_.events.pop();
  }
  if (const CycleRecord* record = ring_.ring.front()) {
    busy = true;
    give(*record);
    ring_.ring.pop();
    handed_on_.fetch_add(1, std::memory_order_release);
  }
  return busy;
}

// An exception of one part must not affect the others.
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

}  // namespace multipanda::ros
