#pragma once

#include <string>

#include "core/cycle/backend.hpp"

namespace multipanda {

// The simulated world of a backend. A backend with a world implements it.
class SimulationView {
 public:
  virtual ~SimulationView() = default;

  // After the loop's end: why the simulation failed; empty: no failure.
  virtual std::string fault() const = 0;
};

// nullptr: the backend has no simulated world.
inline const SimulationView* simulation_of(const Backend& backend) {
  return dynamic_cast<const SimulationView*>(&backend);
}

}  // namespace multipanda
