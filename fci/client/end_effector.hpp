#pragma once

#include <future>

#include "core/cycle/backend.hpp"

namespace multipanda::fci {

// A parallel gripper or a vacuum gripper with a connection of its own. It owns its socket and its thread. The
// arm's connection does not depend on it.
class EndEffector {
 public:
  virtual ~EndEffector() = default;

  // Off the loop. Throws std::runtime_error with address, port, reason and remedy. Called again after a loss.
  virtual void connect() = 0;
  virtual bool is_vacuum() const = 0;

  // Any thread; answered when the motion is over. A new motion ends the running one.
  virtual std::future<RequestAnswer> request(const GripperRequest& request) = 0;

  // Loop thread. The last reported state. No lock, no allocation.
  virtual multipanda::GripperState state() const noexcept = 0;
};

}  // namespace multipanda::fci
