#include <cmath>
#include <numbers>
#include <stdexcept>

#include <fmt/format.h>

#include "sysid/identification/identify.hpp"
#include "sysid/measured/scene_model.hpp"

namespace multipanda {
namespace {

void add(std::optional<RigidBody>& body, const Load& load) {
  if (!(load.mass > 0)) return;
  const RigidBody more{load.mass, load.p_FC, load.inertia_C};
  body = body ? merged(*body, more) : more;
}

bool same(const std::optional<RigidBody>& a, const std::optional<RigidBody>& b) {
  if (!a || !b) return !a && !b;
  return std::abs(a->mass - b->mass) < 1e-6 && (a->com - b->com).norm() < 1e-6 &&
         (a->inertia - b->inertia).norm() < 1e-6;
}

std::string in_words(const std::optional<RigidBody>& tool) {
  if (!tool) return "no tool";
  return fmt::format("a tool of {:.4f} kg at ({:.4f}, {:.4f}, {:.4f}) m", tool->mass, tool->com.x(),
                     tool->com.y(), tool->com.z());
}

}  // namespace

Mounting mounting_of(const MeasuredLog& log) {
  Mounting out;
  if (log.gravity_B) {
    out.gravity_B = *log.gravity_B;
    out.base_told = true;
  }
  if (log.scene_text.empty()) return out;
  const Scene scene = rebuild_scene(log.scene_text, log.scene_path);
  for (const SceneArm& arm : scene.arms) {
    if (arm.name != log.arm && !(log.arm.empty() && scene.arms.size() == 1)) continue;
    out.told = out.base_told = true;
    out.hand = arm.hand;
    add(out.tool_without_load, arm.tool);
    out.tool = out.tool_without_load;
    add(out.tool, arm.load_declared);
    out.gravity_B = arm.X_WB.rotation.transpose() * Vector3(0, 0, -9.81);
    return out;
  }
  throw std::invalid_argument(log.source + ": its scene has no arm '" + log.arm + "'");
}

bool same_gravity(const Vector3& a, const Vector3& b) {
  constexpr double kDegree = std::numbers::pi / 180;
  return a.cross(b).norm() < std::sin(kDegree) * a.norm() * b.norm() && a.dot(b) > 0;
}

std::string in_words(const Mounting& mounting) {
  const Vector3 down = mounting.gravity_B.normalized();
  const auto rounded = [](double x) { return std::round(100 * x) / 100 + 0.0; };  // no "-0.00"
  return fmt::format("gravity along ({:.2f}, {:.2f}, {:.2f}) of its base", rounded(down.x()),
                     rounded(down.y()), rounded(down.z()));
}

void refuse_unlike(std::span<const MeasuredLog> logs, std::span<const Mounting> mountings, bool with_load) {
  const Vector3 level(0, 0, -9.81);
  for (std::size_t i = 0; i < logs.size(); ++i) {
    const Mounting &first = mountings[0], &one = mountings[i];
    const auto refuse = [&](std::size_t other, const std::string& found, const std::string& there,
                            const std::string& advice) {
      throw LogRefused(
          fmt::format("{}: {}, but {}: {}; {}", logs[i].source, found, logs[other].source, there, advice));
    };
    if (one.hand != first.hand) {
      refuse(0, one.hand ? "with hand" : "without hand", first.hand ? "with hand" : "without hand",
             "identify them separately, or set --hand or --no-hand for all");
    }
    const auto& tool = with_load ? one.tool : one.tool_without_load;
    const auto& other_tool = with_load ? first.tool : first.tool_without_load;
    if (!same(tool, other_tool)) {
      refuse(0, in_words(tool), in_words(other_tool),
             "identify them separately, or set --tool MASS X Y Z for all");
    }
    if (one.base_told) continue;
    for (std::size_t k = 0; k < logs.size(); ++k) {
      if (!mountings[k].base_told || same_gravity(mountings[k].gravity_B, level)) continue;
      refuse(k, "its base is unknown", in_words(mountings[k]),
             "give its base with --base LOG=ROLL,PITCH,YAW [rad], or in the first line of a CSV file: "
             "'# base_rpy_rad: ROLL PITCH YAW'");
    }
  }
}

}  // namespace multipanda
