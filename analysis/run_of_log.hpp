#pragma once

#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "core/controllets/controllet.hpp"
#include "scene/scene.hpp"

namespace multipanda {

// What the report needs of a log beyond the arrays of its export.
struct RunOfLog {
  std::map<std::string, std::string> run;                     // metadata: scene, seed, versions, machine
  std::optional<std::map<std::string, std::string>> missing;  // metadata written at the end; none: killed
  std::string layout;                                         // layout.json, as text; may be empty
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

// Reads a log once, as far as it is whole. Throws std::runtime_error when it cannot be read at all.
// `controllets`: types that its scene may name beyond multipanda's own and the plugins'.
RunOfLog read_run(const std::filesystem::path& log, const std::vector<ControlletType>& controllets = {});

}  // namespace multipanda
