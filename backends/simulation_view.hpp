#pragma once

#include <optional>
#include <string>

#include "core/cycle/backend.hpp"
#include "core/types/spatial.hpp"

namespace multipanda {

// What a backend that has a world of its own can tell of it beyond the arms' states. Implemented beside
// Backend.
class SimulationView {
 public:
  virtual ~SimulationView() = default;

  // After the loop's end: why the simulation stopped by itself; empty: it did not.
  virtual std::string fault() const = 0;
  // Loop thread, between two wait(): the object's pose in the world, of the states that were read. None: the
  // world has no such object, or cannot tell now. No allocation, no lock.
  virtual std::optional<Pose> object_pose(const std::string& name) const = 0;
};

// nullptr: the backend has no world of its own.
inline const SimulationView* simulation_of(const Backend& backend) {
  return dynamic_cast<const SimulationView*>(&backend);
}

}  // namespace multipanda
