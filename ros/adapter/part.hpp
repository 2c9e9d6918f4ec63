#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "core/record/cycle_record.hpp"
#include "core/types/tick.hpp"
#include "core/types/time.hpp"
#include "ros/adapter/ros_options.hpp"
#include "runtime/run_adapter.hpp"

namespace multipanda::ros {

class Context;
class Node;
class Executor;

// One line of /diagnostics.
struct Diagnostic {
  enum class Level : std::uint8_t { ok = 0, warn = 1, error = 2 };  // as diagnostic_msgs/DiagnosticStatus
  std::string name;                                                 // "pose0/pose"
  Level level = Level::ok;
  std::string message;
  std::vector<std::pair<std::string, std::string>> values;
};

// The stamps of this run's messages [ns]: simulated time, or the wall clock of the moment.
struct Stamps {
  bool simulated = false;
  std::int64_t wall_minus_host_ns = 0;  // measured once, at the start

  std::int64_t of(const CycleRecord& record) const { return at(record.t, record.start); }
  std::int64_t at(LoopTime t, HostTime host) const { return simulated ? t.ns : host.ns + wall_minus_host_ns; }
};

// What all parts count together, for loop statistics.
struct AdapterCounters {
  std::atomic<std::uint64_t> samples_accepted{0}, samples_refused{0};  // messages to inputs
  std::atomic<std::uint64_t> requests{0}, requests_refused{0};         // services and actions
  std::atomic<std::uint64_t> records_dropped{0};                       // before the publisher's thread
};

// What every part of the adapter works on. References stay valid for the part's life.
struct AdapterWorld : RunWorld {
  Context* context = nullptr;
  Node* node = nullptr;
  Executor* executor = nullptr;
  const RosOptions* options = nullptr;
  Stamps stamps;
  AdapterCounters* counters = nullptr;
  // Of all parts; any thread, once all parts are there.
  std::function<std::vector<Diagnostic>()> diagnostics;
  // A line for the user (warning), not more often than once a second per `topic`. Any thread but the loop's.
  std::function<void(const std::string& topic, const std::string& text)> warn;
};

// A part of the adapter. Its constructor creates its entities. Their callbacks run on the executor's thread,
// take() on the publisher's: a part guards for itself what both use. Neither ever waits for the loop.
class Part {
 public:
  virtual ~Part() = default;
  // Publisher thread, in order. Every record that found room in the adapter's ring: few are missing, and none
  // is repeated.
  virtual void take(const CycleRecord&) {}
  virtual void take(const Event&) {}
  // Loop's thread, between two steps: for what only the world itself can tell. No allocation, no lock.
  // Called only where needs_loop() says so, which is asked once, before the first step.
  virtual void on_loop(const Tick&, const Backend&) {}
  virtual bool needs_loop() const { return false; }
  virtual std::vector<Diagnostic> diagnostics() const { return {}; }  // any thread
};

using Parts = std::vector<std::unique_ptr<Part>>;

}  // namespace multipanda::ros
