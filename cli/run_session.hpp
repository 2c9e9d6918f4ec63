#pragma once

#include <mutex>
#include <optional>
#include <string>

#include "cli/console.hpp"
#include "common/signals.hpp"
#include "runtime/session.hpp"

namespace multipanda::cli {

// Ctrl-C, SIGTERM and a closed terminal end the session in hold; a second signal, 2 s later or more, ends the
// process at once.
// Construct it before the session: existing threads, such as the simulation's, would receive the signals.
class StopSignals {
 public:
  explicit StopSignals(const Console& console);
  void attach(Session& session);  // an earlier signal counts
  void end();                     // restores the signals
  void stop();                    // same effect as the first signal

 private:
  const Console& console_;
  std::mutex mutex_;
  Session* session_ = nullptr;
  bool requested_ = false;
  std::optional<SignalWatch> watch_;
};

// Runs a session to its end, shows it on the console, and ends `signals`.
RunSummary run_session(Session& session, StopSignals& signals, const Console& console);

// Prints the human-readable summary of a run.
void print_summary(const RunSummary& summary, const Console& console);
// Prints time, change, duration and torque step of each switch.
void print_switches(const RunSummary& summary, const Console& console);

}  // namespace multipanda::cli
