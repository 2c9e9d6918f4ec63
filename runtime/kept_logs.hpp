#pragma once

#include <chrono>
#include <condition_variable>
#include <cstddef>
#include <deque>
#include <filesystem>
#include <functional>
#include <future>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <stop_token>
#include <string>
#include <thread>
#include <vector>

#include "logs/recorder.hpp"
#include "runtime/live_input/request_handler.hpp"

namespace multipanda {

// The last 30 s of a run without a log, written as a log on request and 2 s after a fault. Faults in a row
// have one log per 30 s, together without a gap. Until then the records wait in files in memory that the
// program does not map: they add nothing to its own memory, and it locks none of it.
class KeptLogs {
 public:
  static constexpr std::chrono::seconds kBefore{30}, kAfter{2};
  static constexpr std::size_t kMost = 10;  // logs of a run

  struct Parts {
    RecordLayout layout;
    std::vector<RecordedArm> arms;                   // at the start
    std::function<RecorderOptions()> options;        // called on the writing thread
    std::function<std::filesystem::path()> folder;   // called for a log, on any thread; empty: there is none
    std::function<void(const std::string&)> report;  // on any thread
  };
  explicit KeptLogs(Parts parts);  // throws std::system_error if there is no such memory

  // --- the thread that takes the loop's records, in the loop's order ---
  void take(const Event& event);
  void take(const EpisodeMark& mark);
  void take(const CycleRecord& record);
  void fault();                                 // with the newest record
  std::vector<std::filesystem::path> finish();  // after the last record; all logs

  KeptLog keep();  // any thread

 private:
  struct Segment;
  using Segments = std::deque<std::shared_ptr<Segment>>;
  CycleRecord empty_record() const;
  template <class T>
  void put(std::span<const T> values);
  void put_changes(const CycleRecord& record);
  void flush();
  void begin_segment();
  KeptLog begin_log();
  void write_logs(const std::stop_token& end);
  RequestAnswer write(const std::filesystem::path& log, const Segments& segments) const;

  const Parts parts_;
  LoopTime now_;
  std::optional<LoopTime> due_;  // a log of faults
  LoopTime next_due_;            // earliest

  std::mutex mutex_;               // of all that follows
  std::vector<RecordedArm> arms_;  // now
  Segments segments_;
  std::vector<std::byte> buffer_;              // for the newest
  std::vector<std::uint64_t> words_, before_;  // of the newest record and the one before
  std::vector<std::filesystem::path> logs_;
  std::deque<std::packaged_task<RequestAnswer()>> jobs_;
  std::condition_variable_any changed_;
  std::jthread writer_;  // here from the start, before memory is locked: it would have 8 MB of stack
};

}  // namespace multipanda
