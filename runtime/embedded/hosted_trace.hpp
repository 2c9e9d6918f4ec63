#pragma once

#include <atomic>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <limits>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "runtime/command_trace.hpp"
#include "scene/from_parameters.hpp"

namespace multipanda {

// Values of the parameters `performance_trace.*` (docs/ros2_control.md).
struct HostedTraceOptions {
  std::filesystem::path folder;  // for <condition>_<number>.npz
  std::string condition;         // condition of the experiment controller-performance that the page compares
                                 // it with
  // The measurement begins when this controllet follows a stream of set-points, and includes the outputs of
  // its features. Empty: it begins with the activation.
  std::string controllet;
  double duration_s = 30, lead_s = 1;  // kept; skipped before
};

// nullopt: no such parameter. Throws std::invalid_argument: parameter, what was found, what was expected.
std::optional<HostedTraceOptions> hosted_trace_options(const FlatParameters& parameters);

// The performance measurement of a hosted cycle: the cycles of its first activation, in memory allocated by
// the constructor. They are written to a file when that activation, or the cycle, has ended; the loop does
// no I/O.
class HostedTrace {
 public:
  // Messages for the user, from the threads of constructor, relay and file writer.
  using Report = std::function<void(const std::string&)>;

  // Creates the folder. Throws std::invalid_argument (controllet unknown) or std::runtime_error (the folder
  // cannot be written to).
  HostedTrace(HostedTraceOptions options, std::vector<HostedArm> arms, const RecordLayout& layout,
              std::string scene_text, double period_s, Report report);
  ~HostedTrace();  // waits until the file is written
  HostedTrace(const HostedTrace&) = delete;

  // Host's loop: a comparison; during the measurement also a clock reading and a store.
  void step_done(const Tick& tick) noexcept {
    if (!over()) trace_.step_done(tick);
  }
  // The activation ends with this cycle. Later activations are not measured.
  void end(std::uint64_t cycle) noexcept {
    if (!over()) last_cycle_.store(cycle, std::memory_order_release);
  }

  // Relay.
  bool over() const noexcept { return last_cycle_.load(std::memory_order_acquire) != kNoCycle; }
  void take(const CycleRecord& record) {
    if (record.cycle <= last_cycle_.load(std::memory_order_relaxed)) trace_.take(record);
  }
  // Call when the activation or the loop has ended and all records were taken. Only the first call has an
  // effect: it starts the writing thread, so that the relay can serve the next activation. `dropped`: records
  // that the loop could not pass on.
  void write(std::uint64_t dropped) noexcept;

 private:
  static constexpr std::uint64_t kNoCycle = std::numeric_limits<std::uint64_t>::max();
  std::filesystem::path free_name() const;
  std::string about(std::uint64_t dropped) const;
  void write_file(std::uint64_t dropped) noexcept;
  void say(const std::string& text) const;

  const HostedTraceOptions options_;
  const std::vector<HostedArm> arms_;
  const std::string scene_text_;
  const double period_s_;
  const Report report_;
  CommandTrace trace_;
  bool written_ = false;
  std::atomic<std::uint64_t> last_cycle_{kNoCycle};
  std::thread writer_;
};

}  // namespace multipanda
