#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <sys/types.h>
#include <vector>

#include <nlohmann/json.hpp>

#include "common/process.hpp"

namespace multipanda {

// A child process `multipanda generate circular-field` that publishes to a run at 1 kHz, to its live-input
// socket or its ROS topics.
class GeneratorProcess {
 public:
  struct Options {
    std::filesystem::path program;  // the multipanda program
    std::filesystem::path course, socket;
    std::string ros_node;  // node of the run; empty: use the socket
    double seconds = 30;
    std::filesystem::path messages;  // file for its standard error
  };
  explicit GeneratorProcess(const Options& options);  // throws std::runtime_error if it does not start

  pid_t id() const { return process_.id(); }
  bool running() { return process_.running(); }
  // Makes the generator brake and close its connection, waits for its end and returns its report. Throws
  // std::runtime_error with its messages if there is no report.
  nlohmann::ordered_json finish(double timeout_s = 40);

 private:
  static std::vector<std::string> arguments(const Options& options);

  ChildProcess process_;
};

// Path of the program `multipanda`, which is next to this one.
std::filesystem::path own_program();

// CPU and memory usage of processes, from /proc. Not for the loop.

// Totals since the start. The difference of two readings over the time between them is the load.
struct ProcessUsage {
  bool present = false;  // false: the process is gone (or /proc cannot be read)
  double cpu_s = 0;      // of all its threads [core seconds]
  double memory_mb = 0;  // resident, as `top` shows it (RES)
};
ProcessUsage process_usage(pid_t process);

// Usage of one thread of this process.
struct ThreadUsage {
  double cpu_s = 0;
  double waited_s = 0;  // ready to run while another thread had the core
};
ThreadUsage thread_usage(pid_t thread);

struct MachineUsage {
  double busy_s = 0;  // of all cores and processes [core seconds]
  double load_1min = 0;
};
MachineUsage machine_usage();

double machine_memory_mb();

}  // namespace multipanda
