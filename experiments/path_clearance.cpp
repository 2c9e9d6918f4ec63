#include "experiments/path_clearance.hpp"

#include <algorithm>
#include <limits>

#include <fmt/format.h>

#include "core/geometry/distance.hpp"
#include "core/model/model_terms.hpp"
#include "scene/build.hpp"

namespace multipanda {
namespace {

constexpr int kPieces = 100;
constexpr double kFar = 0.5;  // bounding spheres farther apart than this are not looked at [m]

struct Body {
  std::string name;
  std::size_t arm = 0;
  int joint = -1;
  bool against_obstacles = true;
  ConvexShape shape;
  Pose X_JS, X_WS;
  BoundingSphere sphere;
};

class Bodies {
 public:
  explicit Bodies(const Scene& scene, bool with_objects) {
    for (std::size_t i = 0; i < scene.arms.size(); ++i) {
      const auto model = build_arm_model(scene.arms[i]);
      terms_.emplace_back(model);
      const std::size_t first = bodies_.size();
      for (const auto& shape : model->collision_shapes()) {
        bodies_.push_back({.name = scene.arms[i].name + " " + shape.name,
                           .arm = i,
                           .joint = shape.joint,
                           .against_obstacles = shape.scene,
                           .shape = shape.shape,
                           .X_JS = shape.X_JS,
                           .X_WS = {},
                           .sphere = bounding_sphere(shape.shape)});
      }
      for (const auto& [a, b] : model->self_pairs()) pairs_.emplace_back(first + a, first + b);
    }
    for (std::size_t a = 0; a < bodies_.size(); ++a) {
      for (std::size_t b = a + 1; b < bodies_.size(); ++b) {
        if (bodies_[a].arm != bodies_[b].arm && (bodies_[a].joint >= 0 || bodies_[b].joint >= 0))
          pairs_.emplace_back(a, b);
      }
    }
    for (const auto& obstacle : build_cycle_config(scene).obstacles) {
      if (with_objects || obstacle.shape.kind == ConvexShape::Kind::half_space)
        obstacles_.push_back(obstacle);
    }
  }

  void place(std::size_t arm, const JointVector& q) {
    ModelTerms& terms = terms_[arm];
    terms.update(q, JointVector::Zero(q.size()));
    for (auto& body : bodies_) {
      if (body.arm != arm) continue;
      body.X_WS = (body.joint < 0 ? terms.model().X_WB() : terms.X_WJ(static_cast<std::size_t>(body.joint))) *
                  body.X_JS;
    }
  }

  double least(std::string& pair) const {
    double least = std::numeric_limits<double>::infinity();
    const auto look = [&](const Body& a, const ConvexShape& shape, const Pose& X_W, const std::string& name) {
      const double distance = closest_points(a.shape, a.X_WS, shape, X_W).distance;
      if (distance >= least) return;
      least = distance;
      pair = a.name + ", " + name;
    };
    for (const auto& [i, k] : pairs_) {
      const Body &a = bodies_[i], &b = bodies_[k];
      const double apart = (a.X_WS * a.sphere.center - b.X_WS * b.sphere.center).norm();
      if (apart - a.sphere.radius - b.sphere.radius < std::min(least, kFar)) look(a, b.shape, b.X_WS, b.name);
    }
    for (const auto& body : bodies_) {
      if (!body.against_obstacles || body.joint < 0) continue;
      for (const auto& obstacle : obstacles_) look(body, obstacle.shape, obstacle.X_WO, obstacle.name);
    }
    return least;
  }

 private:
  std::vector<ModelTerms> terms_;
  std::vector<Body> bodies_;
  std::vector<std::pair<std::size_t, std::size_t>> pairs_;
  std::vector<Obstacle> obstacles_;
};

}  // namespace

bool PathClearance::blocked(double margin) const {
  return least < std::min({margin, at_start, at_end}) - 1e-3;
}

PathClearance path_clearance(const Scene& scene, const std::vector<JointMove>& moves, bool with_objects) {
  Bodies bodies(scene, with_objects);
  PathClearance result{.least = std::numeric_limits<double>::infinity(), .pair = {}};
  for (std::size_t i = 0; i < scene.arms.size(); ++i) bodies.place(i, scene.arms[i].q_start);
  for (int k = 0; k <= kPieces; ++k) {
    for (const auto& move : moves) {
      const JointVector way = move.goal - move.from;
      bodies.place(move.arm, move.from + k * way / kPieces);
    }
    std::string pair;
    const double distance = bodies.least(pair);
    if (k == 0) result.at_start = distance;
    if (k == kPieces) result.at_end = distance;
    if (distance < result.least) {
      result.least = distance;
      result.pair = pair;
    }
  }
  return result;
}

}  // namespace multipanda
