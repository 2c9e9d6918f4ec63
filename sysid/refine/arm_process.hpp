#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include "support/child_process.hpp"

namespace multipanda {

// `multipanda virtual-arm SCENE --hidden SEED` alongside this process: arms whose hidden properties are
// drawn from a seed. They run in lock-step; the world is paused while no arm moves.
class ArmProcess {
 public:
  struct Options {
    std::filesystem::path program;  // multipanda itself
    std::filesystem::path scene;
    std::uint64_t hidden = 1;                                    // seed of the plants
    bool motors = false;                                         // RefineTarget::motors
    std::vector<std::pair<std::string, std::string>> addresses;  // arm, loopback address
    std::filesystem::path messages;                              // file for its messages
  };
  // Returns when all arms listen. Throws std::runtime_error with the messages of the process.
  explicit ArmProcess(const Options& options);
  ~ArmProcess();

 private:
  static std::vector<std::string> arguments(const Options& options);

  ChildProcess process_;
};

// One loopback address per arm, 127.x.y.z with x above 0. Every call within this process returns others;
// other processes are likely to get others, too.
std::vector<std::string> free_addresses(std::size_t count);

}  // namespace multipanda
