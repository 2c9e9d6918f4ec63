#pragma once

#include <string>
#include <vector>

#include "experiments/experiment.hpp"
#include "runtime/backends.hpp"
#include "scene/scene.hpp"

// Experiments on arms that this program does not simulate: real ones, or virtual arms of another process.
namespace multipanda {

// The plant of the runs on arms, in figures, names and results. A run in simulation precedes each.
inline constexpr const char* kMeasured = "measured";

// The experiment as arms run it: on the plant `realistic` (or its last one), then on the arms. The limits of
// that plant also apply to the arms. Only starts vary, by the same amounts as in simulation, since a person
// cannot place objects within 2 mm. Variants that change the plant are left out; `left_out` has their names.
Experiment for_arms(Experiment experiment, std::vector<std::string>& left_out);

// The backend of a scene: its arms that have an address in `options` are reached there; the others, if there
// are any, are simulated here. Throws std::invalid_argument: an arm has an address only in its scene.
BackendOptions backend_of(const Scene& scene, const BackendOptions& options);
// Throws std::invalid_argument: an arm of the scene has no address.
void check_addresses_of_all(const Scene& scene, const BackendOptions& options);

// Throws std::invalid_argument: an arm would clear a reflex by itself. It may have stopped on a person, so on
// arms only a person clears it.
void check_no_recovery(const Scene& scene);

// Throws std::invalid_argument: the scene's timeline moves objects, which only a simulation does; or as
// check_no_recovery.
void check_for_arms(const Scene& scene, const std::string& variant);

// An object that a person must place for a run on arms.
struct PlacedObject {
  std::string name;
  std::string text;  // shape, size, pose in the base frame of each arm, surface
};
std::vector<PlacedObject> objects_to_place(const Scene& scene);  // without planes

// Equipment, address and reflex thresholds of an arm; several lines.
std::string describe_arm(const SceneArm& arm);

}  // namespace multipanda
