#pragma once

#include <atomic>
#include <cstdint>
#include <string>
#include <thread>

#include "core/record/cycle_record.hpp"
#include "ros/adapter/part.hpp"

namespace multipanda::ros {

// From the thread that takes the loop's records to the parts of the adapter, which publish on a thread of
// their own: a reader that is slow, or DDS, can never hold up the log, let alone the loop. Where the
// publisher's thread falls behind, records are left out and counted.
class RecordRelay {
 public:
  static constexpr std::size_t kRecords = 100;  // that may wait: what is older is of no use to anybody

  // The parts outlive it. What they throw in take() is counted and told to `failed`, once per part.
  RecordRelay(const RecordLayout& layout, const Parts& parts,
              std::function<void(const std::string&)> failed = nullptr);
  ~RecordRelay();  // hands on what is there, then ends the thread
  RecordRelay(const RecordRelay&) = delete;

  // --- one thread; neither waits nor allocates ---
  void take(const CycleRecord& record);
  void take(const Event& event);

  // --- any thread ---
  std::uint64_t dropped() const {  // records and events
    return ring_.dropped_records.load(std::memory_order_relaxed) +
           ring_.dropped_events.load(std::memory_order_relaxed);
  }
  std::uint64_t handed_on() const { return handed_on_.load(std::memory_order_acquire); }  // records
  // Mean time of the publisher's thread on one record, all parts together, so far [s].
  double mean_time_s() const;

 private:
  void run();
  bool hand_on();
  template <typename What>
  void give(const What& what);
  void wake();
  void wait(std::uint32_t seen);

  const Parts& parts_;
  const std::function<void(const std::string&)> failed_;
  std::vector<bool> has_failed_;  // of each part
  RecordRing ring_;
  std::atomic<std::uint32_t> posted_{0};  // changes with everything posted; the thread waits on it
  std::atomic<bool> waiting_{false};      // the thread is about to sleep, or sleeps
  std::atomic<bool> stop_{false};
  std::atomic<std::uint64_t> handed_on_{0};
  std::atomic<std::int64_t> busy_ns_{0};
  std::thread thread_;
};

}  // namespace multipanda::ros
