#include "report/scene_pictures.hpp"

#include <algorithm>
#include <span>

#include "backends/mujoco/mujoco_backend.hpp"
#include "backends/mujoco/picture.hpp"

namespace multipanda {
namespace {

// qpos of the whole model: arms as recorded, everything else as at the start.
std::vector<double> positions(const World& world, const Scene& scene, const RunOfLog::Moment& moment) {
  const mjData* data = world.data();
  std::vector<double> qpos(data->qpos, data->qpos + world.model()->nq);
  for (std::size_t i = 0; i < scene.arms.size(); ++i) {
    const auto recorded = moment.q.find(scene.arms[i].name);
    if (recorded == moment.q.end()) continue;
    const auto& places = world.arm(i).qpos;
    for (std::size_t k = 0; k < std::min(places.size(), recorded->second.size()); ++k)
      qpos[static_cast<std::size_t>(places[k])] = recorded->second[k];
  }
  return qpos;
}

void draw(const RunOfLog& run, const std::vector<ChosenMoment>& chosen,
          const std::filesystem::path& directory, ScenePictures& out) {
  const Scene& scene = *run.scene;
  const MujocoBackend backend(scene, {.pace = Pace::unpaced});
  const World& world = backend.world();
  Painter painter(world.model());
  if (!painter.works()) {
    out.missing = painter.reason();
    return;
  }
  for (const ChosenMoment& c : chosen) {
    const std::filesystem::path file = directory / ("scene_" + std::to_string(out.pictures.size()) + ".png");
    out.missing = painter.paint(positions(world, scene, run.moments[c.moment]), file);
    if (!out.missing.empty()) return;
    out.pictures.push_back({file, c.caption});
  }
  const bool free_objects =
      std::any_of(scene.objects.begin(), scene.objects.end(), [](const SceneObject& o) { return !o.fixed; });
  if (free_objects)
    out.note =
        "Free objects are drawn at their initial positions, because the log does not contain their motion.";
}

}  // namespace

ScenePictures draw_scene(const RunOfLog& run, std::size_t at_most, const std::filesystem::path& directory) {
  ScenePictures out;
  const auto chosen = choose_moments(run, at_most);
  if (!run.scene) {
    out.missing = run.scene_missing;
  } else if (chosen.empty()) {
    out.missing = "the log has no joint positions";
  } else {
    try {
      draw(run, chosen, directory, out);
    } catch (const std::exception& error) {
      out.missing = error.what();
    }
  }
  return out;
}

}  // namespace multipanda
