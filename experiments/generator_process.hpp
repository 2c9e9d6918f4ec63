#pragma once

#include <filesystem>
#include <string>
#include <sys/types.h>
#include <vector>

#include <nlohmann/json.hpp>

#include "support/child_process.hpp"

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

// Path of this program.
std::filesystem::path own_program();

}  // namespace multipanda
