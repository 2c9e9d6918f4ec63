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
constexpr double kInfinite = std::numeric_limits<double>::infinity();
constexpr double kUsual = 0.02;  // margin by which the pairs are compared [m]
constexpr double kFar = 0.5;     // bounding spheres farther apart than this are not looked at [m]

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
    for (std::size_t i = 0; i < bodies_.size(); ++i) {
      if (!bodies_[i].against_obstacles || bodies_[i].joint < 0) continue;
      for (std::size_t k = 0; k < obstacles_.size(); ++k) obstacle_pairs_.emplace_back(i, k);
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

  // Signed, of every pair in a fixed order; infinite: far apart [m].
  std::vector<double> distances() const {
    std::vector<double> list;
    for (const auto& [i, k] : pairs_) {
      const Body &a = bodies_[i], &b = bodies_[k];
      const double apart = (a.X_WS * a.sphere.center - b.X_WS * b.sphere.center).norm();
      list.push_back(apart - a.sphere.radius - b.sphere.radius < kFar
                         ? closest_points(a.shape, a.X_WS, b.shape, b.X_WS).distance
                         : kInfinite);
    }
    for (const auto& [i, k] : obstacle_pairs_)
      list.push_back(
          closest_points(bodies_[i].shape, bodies_[i].X_WS, obstacles_[k].shape, obstacles_[k].X_WO)
              .distance);
    return list;
  }

  std::string name_of(std::size_t pair) const {
    if (pair < pairs_.size())
      return bodies_[pairs_[pair].first].name + ", " + bodies_[pairs_[pair].second].name;
    const auto& [body, obstacle] = obstacle_pairs_[pair - pairs_.size()];
    return bodies_[body].name + ", " + obstacles_[obstacle].name;
  }

 private:
  std::vector<ModelTerms> terms_;
  std::vector<Body> bodies_;
  std::vector<std::pair<std::size_t, std::size_t>> pairs_, obstacle_pairs_;
  std::vector<Obstacle> obstacles_;
};

}  // namespace

bool PathClearance::blocked(double margin) const {
  return least < std::min({margin, at_start, at_end}) - 1e-3;
}

PathClearance path_clearance(const Scene& scene, const std::vector<JointMove>& moves, bool with_objects) {
  Bodies bodies(scene, with_objects);
  for (std::size_t i = 0; i < scene.arms.size(); ++i) bodies.place(i, scene.arms[i].q_start);
  std::vector<double> first, last, least;
  for (int k = 0; k <= kPieces; ++k) {
    for (const auto& move : moves) {
      const JointVector way = move.goal - move.from;
      bodies.place(move.arm, move.from + k * way / kPieces);
    }
    last = bodies.distances();
    if (k == 0) first = least = last;
    for (std::size_t pair = 0; pair < last.size(); ++pair) least[pair] = std::min(least[pair], last[pair]);
  }
  PathClearance result{.at_start = kInfinite, .at_end = kInfinite, .least = kInfinite, .pair = {}};
  double worst = kInfinite;
  for (std::size_t pair = 0; pair < least.size(); ++pair) {
    const double spare = least[pair] - std::min({kUsual, first[pair], last[pair]});
    if (spare > worst || (spare == worst && least[pair] >= result.least)) continue;
    worst = spare;
    result = {
        .at_start = first[pair], .at_end = last[pair], .least = least[pair], .pair = bodies.name_of(pair)};
  }
  return result;
}

}  // namespace multipanda
