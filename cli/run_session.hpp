#pragma once

#include <mutex>
#include <optional>
#include <string>

#include "cli/console.hpp"
#include "runtime/session.hpp"
#include "runtime/signals.hpp"

namespace multipanda::cli {

// Ctrl-C, SIGTERM and a closed terminal end the session in hold; a second one ends the process at once.
// Make it before the session: threads that exist already, those of the simulation among them, would take the
// signals themselves.
class StopSignals {
 public:
  explicit StopSignals(const Console& console);
  void attach(Session& session);  // a signal that came before counts
  void end();                     // signals act as usual again

 private:
  void stop();

  const Console& console_;
  std::mutex mutex_;
  Session* session_ = nullptr;
  bool asked_ = false;
  std::optional<SignalWatch> watch_;
};

// Runs a session to its end, showing it on the console; ends `signals`.
RunSummary run_session(Session& session, StopSignals& signals, const Console& console);

// What a run was, for people.
void print_summary(const RunSummary& summary, const Console& console);
// Per switch: when, what, how long, how large the torque step.
void print_switches(const RunSummary& summary, const Console& console);

}  // namespace multipanda::cli
