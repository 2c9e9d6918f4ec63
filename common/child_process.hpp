#pragma once

#include <chrono>
#include <filesystem>
#include <string>
#include <sys/types.h>
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

}  // namespace multipanda
