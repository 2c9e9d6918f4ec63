#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <rcl/node.h>
#include <string>
#include <vector>

namespace multipanda::ros {

// Hardware of ros2_control, behind numbers and texts: what the plugins need and nothing else.
// docs/ros2_control.md says what the parameters and interfaces are.
class __attribute__((visibility("default"))) HardwareHost {
 public:
  enum class Kind : std::uint8_t { mujoco, fci };
  // What the parameters say beside the scene.
  struct Extras {
    bool services = true;  // parameter `services`
  };

  // Builds everything, connects nothing. `say`: for the user, from other threads. Throws
  // std::invalid_argument: which parameter, and the cure.
  HardwareHost(Kind kind, const std::map<std::string, std::string>& parameters,
               std::function<void(const std::string&)> say);
  ~HardwareHost();
  HardwareHost(const HardwareHost&) = delete;

  const Extras& extras() const;
  struct Number {
    std::string prefix, name;
    double* value = nullptr;  // stays for the host's life
  };
  std::vector<Number> states() const;
  std::vector<Number> commands() const;

  // --- off the loop ---
  void connect();  // throws std::runtime_error with the cure
  void disconnect();
  // Services of the arms (recover, set_load, ...; docs/ros_interfaces.md) on this node, which outlives them.
  void serve(rcl_node_t* node);
  void stop_serving();
  // False: `why`. Nothing has changed.
  bool prepare_switch(const std::vector<std::string>& start, const std::vector<std::string>& stop,
                      std::string& why) const;

  // --- loop; nothing of it waits ---
  void perform_switch(const std::vector<std::string>& start, const std::vector<std::string>& stop) noexcept;
  void deactivate() noexcept;
  bool read() noexcept;   // false: no arm is left; fault() says why
  bool write() noexcept;  // the same
  std::string fault() const;

 private:
  struct Implementation;
  std::unique_ptr<Implementation> self_;
};

}  // namespace multipanda::ros
