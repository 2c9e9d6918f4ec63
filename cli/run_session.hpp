#pragma once

#include <functional>
#include <mutex>
#include <optional>
#include <string>
#include <thread>

#include "cli/program.hpp"
#include "common/process.hpp"
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

// Calls `on_end` once, on a separate thread, when standard input ends. A program that starts a run keeps the
// other end of a pipe: however it ends, even by SIGKILL, the kernel closes the pipe, and the run ends in
// hold. Input is discarded.
//
// Construct it after the SignalWatch, whose mask its thread inherits.
class InputEndWatch {
 public:
  explicit InputEndWatch(std::function<void()> on_end);  // throws std::system_error
  ~InputEndWatch();
  InputEndWatch(const InputEndWatch&) = delete;
  InputEndWatch& operator=(const InputEndWatch&) = delete;

 private:
  void watch();

  std::function<void()> on_end_;
  int end_file_ = -1;
  std::thread thread_;
};

}  // namespace multipanda::cli
