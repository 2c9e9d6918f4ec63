#include <algorithm>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "cli/program.hpp"
#include "models/robot_description.hpp"
#include "runtime/session.hpp"
#include "runtime/simulated.hpp"
#include "runtime/softened_laws.hpp"
#include "scene/load.hpp"

namespace multipanda::cli {
namespace {

std::string numbers_text(const Vector3& v) {
  return fmt::format("({:.4g}, {:.4g}, {:.4g})", v.x(), v.y(), v.z());
}

std::string place_text(const Pose& X) {
  const Vector3 rpy = rpy_of(X.rotation) + Vector3::Zero();  // no "-0"
  return fmt::format("at {} m", numbers_text(X.position)) +
         (rpy.norm() < 1e-6 ? "" : fmt::format(", turned by {} rad", numbers_text(rpy)));
}

// Description of an arm's base; a carried arm's base moves, and is given at the start.
std::string base_text(const Scene& scene, const SceneArm& arm) {
  if (!arm.mount) return "base " + place_text(arm.X_WB);
  return fmt::format("stands on arm '{}', link behind joint {}, there {}; at the start {} in the world",
                     scene.arms[arm.mount->carrier].name, arm.mount->joint + 1, place_text(arm.mount->X_JB),
                     place_text(arm.X_WB));
}

int run(const std::string& name) {
  OpenedScene opened = open_scene(name);
  // Builds everything as for a run, so that everything that a run refuses is refused here.
  const BackendKind kind = has_simulators() ? BackendKind::as_scene : BackendKind::fci;
  Session session(std::move(opened.scene), opened.registry,
                  {.backend = {.kind = kind}, .moving_bases = true});
  const Scene& scene = session.scene();
  fmt::print("{}: {}{} ({} plant, {} physics step{} per cycle, {} objects)\n", scene.name, scene.description,
             scene.description.empty() ? scene.path : "", scene.plant.name, scene.substeps,
             scene.substeps == 1 ? "" : "s", scene.objects.size());
  for (const auto& arm : scene.arms) {
    fmt::print("  arm {}: {}{}, {} joints, {}\n", arm.name, arm.model, arm.hand ? " with hand" : "",
               arm.q_start.size(), base_text(scene, arm));
    for (const auto& text : arm.loosened) fmt::print("    looser than the manufacturer's limit: {}\n", text);
    if (!arm.unguarded.empty())
      fmt::print("    not checked for collisions: {}\n", fmt::join(arm.unguarded, ", "));
    if (!arm.left_out_friction.empty())
      fmt::print("    the URDF's friction is not simulated; give link_friction in the model's file: {}\n",
                 fmt::join(arm.left_out_friction, ", "));
  }
  for (const auto& object : scene.objects) {
    fmt::print("  object {}: {}, {}\n", object.name,
               object.fixed ? "fixed" : fmt::format("free, {:g} kg", object.mass), place_text(object.X_WO));
  }
  for (const auto& text : scene.lifted) fmt::print("  contact bound raised: {}\n", text);
  for (const auto& text : scene.unsafer_laws) fmt::print("  law with reduced safeguards: {}\n", text);
  for (const auto& text : scene.lowered) fmt::print("  {}\n", text);
  for (const auto& text : scene.near_leaders) fmt::print("  {}\n", text);
  for (const auto& text : softened_laws(scene, session.registry())) fmt::print("  warning: {}\n", text);
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
  scene_option(command, *scene);
  program.on(command, [scene] { return run(*scene); });
}

}  // namespace multipanda::cli
