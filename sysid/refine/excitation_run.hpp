#pragma once

#include <string>
#include <vector>

#include "core/modes/registry.hpp"
#include "scene/scene.hpp"
#include "sysid/excitation/excitation_motion.hpp"

namespace multipanda {

// The motion of the first arm in an excitation's scene file (written by `excite`).
struct ExcitationFile {
  std::string path;
  ExcitationMotion motion;
  double max_speed = 0;  // speed that the input must allow [rad/s]
};
// Throws ConfigError, or std::invalid_argument if the scene has no motion of joints.
ExcitationFile read_excitation(const std::string& path, const Registry& registry);

// The shipped excitation for a model: experiments/scenes/excitation_MODEL.yaml. Throws std::invalid_argument
// if there is none.
std::string excitation_path(const std::string& model);

// A run in which the arms of a scene perform their excitations in turn; of the other objects only floors
// remain. Arms that stand close together face away from each other by turning their first joint, also while
// they wait.
struct ExcitationRun {
  std::string scene;  // text
  struct Window {
    std::string arm;
    double begin = 0, end = 0;  // of its motion, in the log's time [s]
  };
  std::vector<Window> windows;
};
// `excitations`: one per arm. Throws std::invalid_argument for an arm that cannot face away within its range.
ExcitationRun excitation_run(const Scene& scene, const std::vector<ExcitationFile>& excitations,
                             const std::vector<RobotDescription>& robots, std::uint64_t seed);

// Moves the arms to the scene's start from any position: for real arms, before a task.
std::string approach_scene(const Scene& scene);

}  // namespace multipanda
