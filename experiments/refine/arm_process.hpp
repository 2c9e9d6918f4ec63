#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <sys/types.h>
#include <utility>
#include <vector>

namespace multipanda {

// `multipanda virtual-arm SCENE --hidden SEED` beside this process: arms whose truth is drawn there and told
// to nobody. In lock-step; the world stands still while no arm moves.
class ArmProcess {
 public:
  struct Options {
    std::filesystem::path program;  // multipanda itself
    std::filesystem::path scene;
    std::uint64_t hidden = 1;                                    // seed of the plants
    std::vector<std::pair<std::string, std::string>> addresses;  // arm, loopback address
    std::filesystem::path messages;                              // file for what it says
  };
  // Returns when all arms listen. Throws std::runtime_error with what it said.
  explicit ArmProcess(const Options& options);
  ~ArmProcess();  // ends it
  ArmProcess(const ArmProcess&) = delete;

 private:
  void end();

  pid_t process_ = -1;
};

// One loopback address per arm, different for every call within this process and, as far as numbers go, from
// other processes': 127.x.y.z with x above 0.
std::vector<std::string> free_addresses(std::size_t count);

}  // namespace multipanda
