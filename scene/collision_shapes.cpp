#include "scene/collision_shapes.hpp"

#include <algorithm>

namespace multipanda {

ConvexShape convex_shape(ShapeType shape, const Vector3& size) {
  switch (shape) {
    case ShapeType::plane:
      return ConvexShape::half_space();
    case ShapeType::sphere:
      return ConvexShape::sphere(Vector3::Zero(), 0.5 * size.x());
    case ShapeType::cylinder:
      return ConvexShape::cylinder(0.5 * size.x(), size.z());
    case ShapeType::capsule: {
      const Vector3 end(0, 0, 0.5 * size.z());  // of the straight part
      return ConvexShape::capsule(-end, end, 0.5 * size.x());
    }
    case ShapeType::box:
      break;
  }
  return ConvexShape::box(size);
}

void add_tool_shapes(const std::vector<ToolShape>& tool, const Pose& X_JF, ArmModelSource& source) {
  auto& parts = source.collision_shapes;
  // The arm's last joint, even if no shape moves with it.
  const int last = static_cast<int>(source.limits.q_min.size()) - 1;
  const std::size_t others = parts.size();
  for (std::size_t i = 0; i < tool.size(); ++i) {
    parts.push_back(
        {"tool " + std::to_string(i), last, convex_shape(tool[i].shape, tool[i].size), X_JF * tool[i].X_FS});
    for (std::size_t k = 0; k < others; ++k) {
      if (parts[k].joint < last - 1) source.self_pairs.emplace_back(k, parts.size() - 1);
    }
  }
}

std::vector<Obstacle> fixed_obstacles(const Scene& scene) {
  std::vector<Obstacle> obstacles;
  for (const auto& object : scene.objects) {
    if (!object.fixed) continue;
    const bool is_placed = std::ranges::any_of(scene.timeline, [&](const TimelineEvent& event) {
      return event.what == TimelineEvent::What::place && event.object == object.name;
    });
    obstacles.push_back({object.name, convex_shape(object.shape, object.size), object.X_WO, is_placed});
  }
  return obstacles;
}

}  // namespace multipanda
