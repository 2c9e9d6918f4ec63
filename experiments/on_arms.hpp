#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "experiments/experiment.hpp"
#include "experiments/kinds.hpp"
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

// Throws std::invalid_argument if the scene's timeline moves objects, which only a simulation can do, and as
// check_no_recovery does.
void check_for_arms(const Scene& scene, const std::string& variant);

// An object that a person must place for a run on arms.
struct PlacedObject {
  std::string name;
  std::string text;  // shape, size, pose in the base frame of each arm, surface
};
std::vector<PlacedObject> objects_to_place(const Scene& scene);  // without planes

// Equipment, address and reflex thresholds of an arm; several lines.
std::string describe_arm(const SceneArm& arm);

// A log of arms that is shown beside the simulated runs of a variant.
struct BesideLog {
  const ExperimentVariant* variant = nullptr;
  std::size_t repeat = 1;
  std::filesystem::path log;
};

// The logs that `--beside` names: "VARIANT=LOG", "LOG" if only one variant runs, or the folder of an
// experiment on arms, which has a log of each variant and repeat. Throws std::invalid_argument: no such log
// or variant.
std::vector<BesideLog> beside_logs(const std::vector<std::string>& named,
                                   const std::vector<const ExperimentVariant*>& variants);

// Exports the log to `folder`/data, and returns the run as the page's plan has it. `like`: the same variant's
// run in simulation. The timeline is that of the scene in the log. Throws std::runtime_error (unreadable) or
// std::invalid_argument (another scene's arms).
nlohmann::ordered_json beside_run(const BesideLog& log, const nlohmann::ordered_json& like,
                                  const std::filesystem::path& folder);

// A measurement by the multimode controller inside a controller_manager (runtime/embedded/hosted_trace.hpp)
// that is shown beside a condition of the performance experiment.
struct BesideTrace {
  std::string condition;
  std::filesystem::path file;  // absolute
};

// The measurements that `--beside` names: "CONDITION=FILE", a file <condition>_<number>.npz, or a folder of
// such files. `conditions`: those that run. Throws std::invalid_argument: no such file or condition, or not a
// file of such a measurement.
std::vector<BesideTrace> beside_traces(const std::vector<std::string>& named,
                                       const std::vector<std::string>& conditions);

}  // namespace multipanda
