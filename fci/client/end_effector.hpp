#pragma once

#include <future>
#include <memory>
#include <string>

#include "core/cycle/backend.hpp"
#include "fci/wire/commands.hpp"

namespace multipanda::fci {

// A parallel gripper or vacuum gripper with its own connection, socket and thread, independent of the
// arm's connection.
class EndEffector {
 public:
  virtual ~EndEffector() = default;

  // Off the loop. Throws std::runtime_error with address, port, reason and remedy. Called again after a loss.
  virtual void connect() = 0;
  virtual bool is_vacuum() const = 0;

  // Any thread; answered when the motion has ended. A new motion ends the running one.
  virtual std::future<RequestAnswer> request(const GripperRequest& request) = 0;

  // Loop thread. The last reported state. No lock, no allocation.
  virtual multipanda::GripperState state() const noexcept = 0;
};

// The hand's gripper of one arm, and the vacuum gripper; `name`: of the arm. Not connected yet.
std::unique_ptr<EndEffector> gripper_link(const std::string& name, const std::string& address,
                                          std::uint16_t port = kGripperPort);
std::unique_ptr<EndEffector> vacuum_link(const std::string& name, const std::string& address,
                                         std::uint16_t port = kVacuumPort);
// A Robotiq 2F gripper at a serial port; `model`: 2f-85 or 2f-140.
std::unique_ptr<EndEffector> robotiq_link(const std::string& name, const std::string& port,
                                          const std::string& model);

}  // namespace multipanda::fci
