#pragma once

#include <atomic>
#include <cstdint>
#include <string>
#include <thread>

#include "core/record/cycle_record.hpp"
#include "ros/adapter/adapter_part.hpp"

namespace multipanda::ros {

// Carries the loop's records to the adapter's parts, which publish on a separate thread. So neither a slow
// reader nor the middleware can delay the log or the loop. If the publisher's thread falls behind, records
// are dropped and counted.
class RecordRelay {
 public:
  static constexpr std::size_t kRecords = 100;  // capacity; older records are useless

  // The parts outlive the relay. Exceptions from take() are counted and passed to `failed`, once per part.
  RecordRelay(const RecordLayout& layout, const AdapterParts& parts,
              std::function<void(const std::string&)> failed = nullptr);
  ~RecordRelay();  // delivers the remaining records, then ends the thread
  RecordRelay(const RecordRelay&) = delete;

  // Called from one thread; neither wait nor allocate.
  void take(const CycleRecord& record);
  void take(const Event& event);

  // Any thread.
  std::uint64_t dropped() const {  // records and events
    return ring_.dropped_records.load(std::memory_order_relaxed) +
           ring_.dropped_events.load(std::memory_order_relaxed);
  }
  std::uint64_t handed_on() const { return handed_on_.load(std::memory_order_acquire); }  // records

 private:
  void run();
  bool hand_on();
  template <typename What>
  void give(const What& what);
  void wake();
  void wait(std::uint32_t seen);

  const AdapterParts& parts_;
  const std::function<void(const std::string&)> failed_;
  std::vector<bool> has_failed_;  // one per part
  RecordRing ring_;
  std::atomic<std::uint32_t> posted_{0};  // changes with every post; the thread waits on it
  std::atomic<bool> waiting_{false};      // the thread sleeps or is about to sleep
  std::atomic<bool> stop_{false};
  std::atomic<std::uint64_t> handed_on_{0};
  std::thread thread_;
};

}  // namespace multipanda::ros
