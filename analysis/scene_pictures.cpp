#include "analysis/scene_pictures.hpp"

namespace multipanda {

ScenePictures draw_scene(const RunOfLog& run, std::size_t at_most, const std::filesystem::path&) {
  ScenePictures out;
  if (!run.scene) {
    out.missing = run.scene_missing;
  } else if (choose_moments(run, at_most).empty()) {
    out.missing = "no joint position is in the log";
  } else {
    out.missing = "this program cannot draw";
  }
  return out;
}

}  // namespace multipanda
