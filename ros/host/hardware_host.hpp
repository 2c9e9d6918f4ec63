#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <rcl/node.h>
#include <string>
#include <vector>

namespace multipanda::ros {

// Hardware for ros2_control. The interface uses only numbers and strings. docs/ros2_control.md describes
// parameters and interfaces.
class __attribute__((visibility("default"))) HardwareHost {
 public:
  enum class Kind : std::uint8_t { mujoco, fci };
  // Parameters that are not part of the scene.
  struct Extras {
    bool services = true;  // parameter `services`
  };

  // Builds everything, connects to nothing. `report` receives messages for the user, from other threads.
  // Throws std::invalid_argument with the parameter and the remedy.
  HardwareHost(Kind kind, const std::map<std::string, std::string>& parameters,
               std::function<void(const std::string&)> report);
  ~HardwareHost();
  HardwareHost(const HardwareHost&) = delete;

  const Extras& extras() const;
  struct Number {
    std::string prefix, name;
    double* value = nullptr;  // valid for the host's lifetime
  };
  std::vector<Number> states() const;
  std::vector<Number> commands() const;

  // Off the loop.
  void connect();  // throws std::runtime_error with the remedy
  void disconnect();
  // The same with stop_serving(), for the loop's thread: returns at once; a thread does the work, and the
  // other functions off the loop wait for it. It keeps `node` until the services on it have ended.
  void disconnect_later(std::shared_ptr<void> node) noexcept;
  // Offers services of the arms (recover, set_load, ...; docs/ros_interfaces.md) on this node, which must
  // outlive them.
  void serve(rcl_node_t* node);
  void stop_serving();
  // On failure returns false, sets `why` and changes nothing.
  bool prepare_switch(const std::vector<std::string>& start, const std::vector<std::string>& stop,
                      std::string& why) const;

  // Loop; these functions do not wait.
  void perform_switch(const std::vector<std::string>& start, const std::vector<std::string>& stop) noexcept;
  void deactivate() noexcept;
  bool read() noexcept;  // false: no arm left; fault() gives the reason
  // As read(). `stamp_ns`: the time of this cycle on the program's clock.
  bool write(std::int64_t stamp_ns) noexcept;
  std::string fault() const;

 private:
  struct Implementation;
  std::unique_ptr<Implementation> self_;
};

}  // namespace multipanda::ros
