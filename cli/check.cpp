#include <algorithm>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "cli/program.hpp"
#include "models/looks.hpp"
#include "runtime/session.hpp"
#include "scene/load.hpp"

namespace multipanda::cli {
namespace {

// Where the base of an arm is; that of a carried arm moves, and is given at the start.
std::string base_text(const Scene& scene, const SceneArm& arm) {
  const auto point = [](const Vector3& p) {
    return fmt::format("({:.4g}, {:.4g}, {:.4g}) m", p.x(), p.y(), p.z());
  };
  if (!arm.mount) {
    const Vector3& p = arm.X_WB.position;
    return fmt::format("base at ({:g}, {:g}, {:g}) m", p.x(), p.y(), p.z());
  }
  const Vector3 rpy = rpy_of(arm.mount->X_JB.rotation) + Vector3::Zero();  // no "-0"
  return fmt::format(
      "stands on arm '{}', link behind joint {}, there at {} and turned by ({:.4g}, {:.4g}, {:.4g}) rad, at "
      "the start at {} in the world",
      scene.arms[arm.mount->carrier].name, arm.mount->joint + 1, point(arm.mount->X_JB.position), rpy.x(),
      rpy.y(), rpy.z(), point(arm.X_WB.position));
}

int run(const std::string& name) {
  OpenedScene opened = open_scene(name);
  // Builds everything as for a run, so that everything that a run refuses is refused here.
  Session session(std::move(opened.scene), opened.registry, {.paced = false, .moving_bases = true});
  const Scene& scene = session.scene();
  fmt::print("{}: {}{} ({} plant, {} physics step{} per cycle, {} objects)\n", scene.name, scene.description,
             scene.description.empty() ? scene.path : "", scene.plant.name, scene.substeps,
             scene.substeps == 1 ? "" : "s", scene.objects.size());
  for (const auto& arm : scene.arms) {
    fmt::print("  arm {}: {}{}, {} joints, {}\n", arm.name, arm.model, arm.hand ? " with hand" : "",
               arm.q_start.size(), base_text(scene, arm));
    for (const auto& text : arm.loosened) fmt::print("    looser than the manufacturer's limit: {}\n", text);
    if (!arm.unguarded.empty()) fmt::print("    not kept apart: {}\n", fmt::join(arm.unguarded, ", "));
  }
  for (const auto& text : scene.lifted) fmt::print("  contact bound lifted: {}\n", text);
  for (const auto& text : scene.unsafer_laws) fmt::print("  law without all safeguards: {}\n", text);
  for (const auto& text : scene.lowered) fmt::print("  {}\n", text);
  for (const auto& text : scene.near_leaders) fmt::print("  {}\n", text);
  for (InstanceIndex i = 0; i < session.modes().instance_count(); ++i) {
    const Instance& instance = session.modes().instance(i);
    std::vector<std::string> arms, features;
    for (const ArmIndex arm : instance.arm_list()) arms.push_back(scene.arms[arm].name);
    for (std::size_t f = 0; f < instance.feature_count(); ++f) {
      if (instance.feature_on(f)) features.push_back(instance.feature_descriptor(f).type);
    }
    const bool active =
        std::find(scene.active.begin(), scene.active.end(), instance.name()) != scene.active.end();
    fmt::print("  controllet {}: {} on {}{}{}\n", instance.name(), instance.descriptor().type,
               fmt::join(arms, ", "),
               features.empty() ? "" : fmt::format(", with {}", fmt::join(features, ", ")),
               active ? ", active at the start" : "");
  }
  if (!scene.timeline.empty()) {
    const double last = scene.timeline.back().at_s;
    fmt::print("  timeline: {} event{}, the last at {:g} s\n", scene.timeline.size(),
               scene.timeline.size() == 1 ? "" : "s", last);
    const auto after = std::ranges::find_if(
        scene.timeline, [&](const auto& event) { return event.at_s >= scene.duration_s; });
    if (scene.duration_s > 0 && after != scene.timeline.end()) {
      const auto count = scene.timeline.end() - after;
      fmt::print("  warning: the scene ends at {:g} s: {} event{} from {:g} s on never happen{}\n",
                 scene.duration_s, count, count == 1 ? "" : "s", after->at_s, count == 1 ? "s" : "");
    }
  }
  fmt::print("ok\n");
  return kSuccess;
}

}  // namespace

void add_check(Program& program) {
  auto scene = std::make_shared<std::string>();
  CLI::App* command = program.add("check", "Read and build a scene without running it, and describe it",
                                  "  multipanda check two_arms\n"
                                  "  multipanda check my/scene.yaml && multipanda run my/scene.yaml");
  command->add_option("scene", *scene, "Name (see multipanda list scenes) or path of a scene file")
      ->required();
  program.on(command, [scene] { return run(*scene); });
}

}  // namespace multipanda::cli
