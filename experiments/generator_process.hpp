#pragma once

#include <filesystem>
#include <string>
#include <sys/types.h>

#include <nlohmann/json.hpp>

namespace multipanda {

// `multipanda generate circular-field` beside this process: publishes to a run at 1 kHz, to its live-input
// socket or its ROS topics.
class GeneratorProcess {
 public:
  struct Options {
    std::filesystem::path program;  // multipanda itself
    std::filesystem::path course, socket;
    std::string ros_node;  // of the run; empty: by the socket
    double seconds = 30;
    std::filesystem::path messages;  // file for what it says while it runs
  };
  explicit GeneratorProcess(const Options& options);  // throws std::runtime_error: it does not start
  ~GeneratorProcess();                                // ends it
  GeneratorProcess(const GeneratorProcess&) = delete;

  pid_t id() const { return process_; }
  bool running();  // false: it has ended by itself
  // Lets it brake and say goodbye, waits for its end, and returns its report. Throws std::runtime_error with
  // what it said if there is none.
  nlohmann::ordered_json finish(double timeout_s = 40);

 private:
  bool reap(bool block);
  void signal(int number) const;

  std::filesystem::path report_, messages_;
  pid_t process_ = -1;
  bool ended_ = false;
  int status_ = 0;
};

// This program's own file.
std::filesystem::path own_program();

}  // namespace multipanda
