#pragma once

#include <chrono>
#include <csignal>
#include <filesystem>
#include <functional>
#include <string>
#include <sys/types.h>
#include <thread>
#include <vector>

namespace multipanda {

// A program that runs alongside this one. It is started without a shell, reads nothing, and handles signals
// by itself: signals that this program blocks or ignores have their usual effect. Ctrl-C reaches both.
class ChildProcess {
 public:
  struct Options {
    std::filesystem::path program;
    std::vector<std::string> arguments;
    std::filesystem::path output,
        errors;        // files that standard output and standard error replace; empty: none
    int channel = -1;  // this descriptor is its descriptor 3
  };
  explicit ChildProcess(const Options& options);  // throws std::runtime_error if it does not start
  ~ChildProcess();                                // kills it if it still runs
  ChildProcess(const ChildProcess&) = delete;

  pid_t id() const { return process_; }
  bool running();
  // Sends SIGTERM, waits for the end, and kills the process after `patience`.
  void stop(std::chrono::milliseconds patience);
  int exit_code() const;  // -1: still running, or ended by a signal
  // Its output so far.
  std::string output() const;
  std::string errors() const;

 private:
  Options options_;
  pid_t process_ = -1;
  bool ended_ = false;
  int status_ = 0;
};

struct ProgramResult {
  int exit_code = -1;  // -1: did not start, or ended by a signal
  std::string output;  // the last 8 kB of standard output and standard error
  std::string reason;  // why it did not start or which signal ended it; empty otherwise
  bool good() const { return exit_code == 0; }
};

// Runs a program as above and waits for its end.
ProgramResult run_program(const std::filesystem::path& program, const std::vector<std::string>& arguments);

// Handles SIGINT, SIGTERM and SIGHUP on a thread of its own, outside of signal handlers. The first signal
// calls `on_first`; one that comes 2 s later or more ends the process at once with the exit code 128 + its
// number. Those in between are ignored: somebody who presses Ctrl-C twice expects the arms to stop, not to
// lose their loop.
//
// Construct it before any other thread: threads inherit the mask that blocks these signals.
class SignalWatch {
 public:
  static constexpr std::chrono::seconds kPatience{2};  // with the first signal

  explicit SignalWatch(std::function<void(int signal)> on_first);  // throws std::system_error
  ~SignalWatch();                                                  // restores the signals
  SignalWatch(const SignalWatch&) = delete;

 private:
  void watch();

  std::function<void(int)> on_first_;
  sigset_t signals_{}, before_{};
  int signal_file_ = -1, end_file_ = -1;
  std::thread thread_;
};

}  // namespace multipanda
