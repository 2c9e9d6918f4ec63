#pragma once

#include <string>
#include <sys/types.h>
#include <vector>

namespace multipanda::ros2_control_tests {

// `multipanda virtual-arm` in lock-step, as a separate process: two Pandas behind sockets of this computer.
// Throws std::runtime_error if it does not start.
class VirtualArms {
 public:
  // `addresses`: addresses used before; empty: free ones.
  explicit VirtualArms(const std::vector<std::string>& names, std::vector<std::string> addresses = {});
  ~VirtualArms();
  VirtualArms(const VirtualArms&) = delete;
  const std::vector<std::string>& addresses() const { return addresses_; }
  // Sends one command line and returns its answer.
  std::string control(const std::string& command);

 private:
  std::string line(int descriptor);

  std::vector<std::string> addresses_;
  std::string scene_file_;
  pid_t process_ = -1;
  int in_ = -1, out_ = -1, errors_ = -1;
};

// Returns MULTIPANDA_PROGRAM; empty if it does not exist.
std::string program();

}  // namespace multipanda::ros2_control_tests
