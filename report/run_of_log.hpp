#pragma once

#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "core/controllets/controllet.hpp"
#include "scene/scene.hpp"

namespace multipanda {

// Parts of a log that the report needs besides the exported arrays.
struct RunOfLog {
  std::map<std::string, std::string> run;  // metadata: scene, seed, versions, machine
  // Metadata written at the end; none: the run was killed.
  std::optional<std::map<std::string, std::string>> missing;
  std::string layout;  // layout.json, as text; may be empty
  std::string scene_text;
  std::optional<Scene> scene;  // rebuilt; none: see scene_missing
  std::string scene_missing;   // why there is no scene

  // Joint positions of all arms, and the newest poses of free objects, at some moments, about ten per second,
  // in order of time.
  struct Moment {
    double t = 0;
    std::map<std::string, std::vector<double>> q;  // by arm
    std::map<std::string, Pose> objects;           // X_WO, by object
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

struct ScenePictures {
  struct Picture {
    std::filesystem::path file;
    std::string caption;
  };
  std::vector<Picture> pictures;
  std::string missing;  // why there are no pictures; empty: there are
  std::string note;     // what the pictures omit
};

// The moments to draw: the start, switches, then the middle and the end if there is room.
struct ChosenMoment {
  std::size_t moment = 0;  // index in RunOfLog::moments
  std::string caption;
};
std::vector<ChosenMoment> choose_moments(const RunOfLog& run, std::size_t at_most);

// Writes scene_0.png, ... into the folder. Does not throw on problems with scene or graphics; `missing` then
// has the reason.
ScenePictures draw_scene(const RunOfLog& run, std::size_t at_most, const std::filesystem::path& directory);

}  // namespace multipanda
