#pragma once

#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "core/controllets/controllet.hpp"
#include "scene/scene.hpp"

namespace multipanda {

// The part of a log that the report needs beyond the exported arrays.
struct RunOfLog {
  std::map<std::string, std::string> run;  // metadata: scene, seed, versions, machine
  std::optional<std::map<std::string, std::string>>
      missing;         // metadata written at the end; none: the run was killed
  std::string layout;  // layout.json, as text; may be empty
  std::string scene_text;
  std::optional<Scene> scene;  // rebuilt; none: see scene_missing
  std::string scene_missing;   // why there is no scene

  // Joint positions of all arms at some moments, about ten per second, in order of time.
  struct Moment {
    double t = 0;
    std::map<std::string, std::vector<double>> q;  // by arm
  };
  std::vector<Moment> moments;
  struct SwitchMoment {
    double t = 0;
    std::vector<std::string> started;
  };
  std::vector<SwitchMoment> switches;  // accepted ones
};

// Reads a log once, as far as it is complete. Throws std::runtime_error if it cannot be read at all.
// `controllets`: types that its scene may name beyond the built-in ones and the plug-ins'.
RunOfLog read_run(const std::filesystem::path& log, const std::vector<ControlletType>& controllets = {});

}  // namespace multipanda
