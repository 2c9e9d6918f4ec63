#pragma once

#include <string>
#include <vector>

#include "analysis/excitation/excitation_motion.hpp"
#include "core/modes/registry.hpp"
#include "scene/scene.hpp"

namespace multipanda {

// The motion of an excitation's scene file (as `excite` writes them): of its first arm.
struct ExcitationFile {
  std::string path;
  ExcitationMotion motion;
  double max_speed = 0;  // that the input must allow [rad/s]
};
// Throws SceneError, std::invalid_argument (no motion of joints in it).
ExcitationFile read_excitation(const std::string& path, const Registry& registry);

// The shipped one for a model: experiments/scenes/excitation_MODEL.yaml. Throws std::invalid_argument if
// there is none, saying how to make one.
std::string excitation_path(const std::string& model);

// A run in which the arms of a scene go through their excitations, one after the other, everything else
// removed but floors. Where arms stand near each other, each is turned about its first joint so that it faces
// away from the others, and the others wait turned away likewise.
struct ExcitationRun {
  std::string scene;  // text
  struct Window {
    std::string arm;
    double begin = 0, end = 0;  // of its motion, in the log's time [s]
  };
  std::vector<Window> windows;
};
// `excitations`: one per arm. Throws std::invalid_argument: an arm that cannot face away within its range.
ExcitationRun excitation_run(const Scene& scene, const std::vector<ExcitationFile>& excitations,
                             const std::vector<RobotDescription>& robots, std::uint64_t seed);

// The arms of a scene go to where the scene begins, from wherever they stand: for real arms, before a task.
std::string approach_scene(const Scene& scene);

}  // namespace multipanda
