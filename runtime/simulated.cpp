#include "runtime/simulated.hpp"

#include "backends/mujoco/mujoco_backend.hpp"
#include "backends/pinocchio/pinocchio_backend.hpp"
#include "runtime/virtual_backend.hpp"

namespace multipanda {

bool has_simulators() { return true; }

std::unique_ptr<Backend> make_simulated(const Scene& scene, const BackendOptions& options,
                                        const BackendPace& pace) {
  if (options.kind == BackendKind::pinocchio) return std::make_unique<PinocchioBackend>(scene, pace.paced);
  if (options.kind == BackendKind::virtual_arms) {
    const VirtualPace clock = !pace.paced        ? VirtualPace::unpaced
                              : options.lockstep ? VirtualPace::waiting
                                                 : VirtualPace::realtime;
    return std::make_unique<VirtualBackend>(scene, clock, pace.report, options.real_sensors);
  }
  return std::make_unique<MujocoBackend>(scene,
                                         MujocoOptions{.pace = pace.paced ? Pace::realtime : Pace::unpaced});
}

}  // namespace multipanda
