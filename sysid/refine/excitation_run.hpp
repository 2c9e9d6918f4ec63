#pragma once

#include <string>
#include <vector>

#include "core/modes/registry.hpp"
#include "scene/scene.hpp"
#include "sysid/excitation/excitation_motion.hpp"

namespace multipanda {

// The motion in an excitation's scene file (as written by `excite`), of its first arm.
struct ExcitationFile {
  std::string path;
  ExcitationMotion motion;
  double max_speed = 0;  // speed that the input must allow [rad/s]
};
// Throws ConfigError, std::invalid_argument (no motion of joints in it).
ExcitationFile read_excitation(const std::string& path, const Registry& registry);

// The shipped excitation for a model: experiments/scenes/excitation_MODEL.yaml. Throws std::invalid_argument
// if there is none, and says how to make one.
std::string excitation_path(const std::string& model);

// A run in which the arms of a scene perform their excitations in turn, with everything else but floors
// removed. Arms that stand close together turn about their first joint to face away from the others, and the
// waiting arms stay turned away.
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

// The arms of a scene go to the scene's start from any position: for real arms, before a task.
std::string approach_scene(const Scene& scene);

}  // namespace multipanda
