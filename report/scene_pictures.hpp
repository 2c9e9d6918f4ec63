#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "report/run_of_log.hpp"

namespace multipanda {

struct ScenePictures {
  struct Picture {
    std::filesystem::path file;
    std::string caption;
  };
  std::vector<Picture> pictures;
  std::string missing;  // why there are no pictures; empty: there are some
  std::string note;     // what the pictures do not show
};

// The moments to draw: the start, switches, then the middle and the end if there is room.
struct ChosenMoment {
  std::size_t moment = 0;  // index in RunOfLog::moments
  std::string caption;
};
std::vector<ChosenMoment> choose_moments(const RunOfLog& run, std::size_t at_most);

// Writes scene_0.png, ... into the folder. Never throws because of the scene or the graphics; `missing` then
// has the reason.
ScenePictures draw_scene(const RunOfLog& run, std::size_t at_most, const std::filesystem::path& directory);

}  // namespace multipanda
