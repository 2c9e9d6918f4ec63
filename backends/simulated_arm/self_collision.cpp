#include "backends/simulated_arm/self_collision.hpp"

#include <algorithm>
#include <map>

namespace multipanda {

SelfCollision::SelfCollision(const ArmModel& model) {
  using Kind = ConvexShape::Kind;
  const auto& shapes = model.collision_shapes();
  std::vector<std::size_t> used;
  for (const auto& [a, b] : model.self_pairs()) {
    used.push_back(a);
    used.push_back(b);
  }
  std::sort(used.begin(), used.end(), [&](std::size_t a, std::size_t b) {
    return std::pair(shapes[a].joint, a) < std::pair(shapes[b].joint, b);
  });
  used.erase(std::unique(used.begin(), used.end()), used.end());
  std::map<std::size_t, std::uint16_t> place_of;
  bodies_.reserve(used.size());
  for (const std::size_t i : used) {
    place_of[i] = static_cast<std::uint16_t>(bodies_.size());
    Body body;
    body.joint = shapes[i].joint;
    body.shape = shapes[i].shape;
    body.X_JS = shapes[i].X_JS;
    body.is_segment = body.shape.kind == Kind::capsule || body.shape.kind == Kind::sphere;
    if (body.shape.kind == Kind::sphere) body.shape.p1 = body.shape.p0;
    body.sphere = bounding_sphere(body.shape);
    body.sphere.center = body.X_JS * body.sphere.center;
    place(body, model.X_WB());  // permanently if it belongs to the base
    bodies_.push_back(body);
  }
  for (const auto& [a, b] : model.self_pairs()) pairs_.push_back({place_of[a], place_of[b]});
}

void SelfCollision::place(Body& body, const Pose& X_WJ) {
  body.center = X_WJ * body.sphere.center;
  body.X_WS = X_WJ * body.X_JS;
  if (body.is_segment) {
    body.p0 = body.X_WS * body.shape.p0;
    body.p1 = body.X_WS * body.shape.p1;
  }
}

double SelfCollision::nearest(ModelTerms& terms) {
  int joint = -1;
  Pose X_WJ;
  for (Body& body : bodies_) {
    if (body.joint < 0) continue;
    if (body.joint != joint) {
      joint = body.joint;
      X_WJ = terms.X_WJ(static_cast<std::size_t>(joint));
    }
    place(body, X_WJ);
  }
  double least = kMargin;
  for (const Pair& pair : pairs_) {
    const Body &a = bodies_[pair.a], &b = bodies_[pair.b];
    const double reach = a.sphere.radius + b.sphere.radius + least;
    if ((a.center - b.center).squaredNorm() > reach * reach) continue;
    const double distance =
        a.is_segment && b.is_segment
            ? closest_capsules(a.p0, a.p1, a.shape.radius, b.p0, b.p1, b.shape.radius).distance
            : closest_points(a.shape, a.X_WS, b.shape, b.X_WS).distance;
    least = std::min(least, distance);
  }
  return least;
}

void SelfCollision::stand_at(ModelTerms& terms) {
  constexpr double kFurther = 0.002;  // remaining distance of approach [m]
  const double distance = nearest(terms);
  margin_ = distance < kMargin ? distance - kFurther : kMargin;
}

ReflexDetail SelfCollision::check(ModelTerms& terms) {
  const double distance = nearest(terms);
  if (distance >= kMargin) margin_ = kMargin;
  if (distance >= margin_) return {};
  return {.error = ArmError::self_collision_avoidance_violation, .value = distance, .limit = margin_};
}

}  // namespace multipanda
