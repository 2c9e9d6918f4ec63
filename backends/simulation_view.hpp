#pragma once

#include <optional>
#include <string>

#include "core/cycle/backend.hpp"
#include "core/types/spatial.hpp"

namespace multipanda {

// The simulated world of a backend, beyond the arms' states. A backend with a world implements it.
class SimulationView {
 public:
  virtual ~SimulationView() = default;

  // After the loop's end: why the simulation failed; empty: it did not.
  virtual std::string fault() const = 0;
  // Loop thread, between two wait(): the object's pose in the world, of the states that were read. None: no
  // such object, or its pose is unknown. No allocation, no lock.
  virtual std::optional<Pose> object_pose(const std::string& name) const = 0;
};

// nullptr: the backend has no simulated world.
inline const SimulationView* simulation_of(const Backend& backend) {
  return dynamic_cast<const SimulationView*>(&backend);
}

}  // namespace multipanda
