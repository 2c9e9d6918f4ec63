#pragma once

#include <future>

#include "core/cycle/backend.hpp"

namespace multipanda::fci {

// What hangs on the flange and has a connection of its own: a parallel gripper or a vacuum gripper. It owns
// its socket and its thread; the arm's connection neither waits for it nor falls with it.
class EndEffector {
 public:
  virtual ~EndEffector() = default;

  // Off the loop. Throws std::runtime_error (address, port, why, what to do). Called again after a loss.
  virtual void connect() = 0;
  virtual bool is_vacuum() const = 0;

  // Any thread; answered when the motion is over. A new motion ends the one that runs.
  virtual std::future<ArmAnswer> request(const ArmRequest& request) = 0;

  // Loop thread: as last reported. No lock, no allocation.
  virtual multipanda::GripperState state() const noexcept = 0;
};

}  // namespace multipanda::fci
