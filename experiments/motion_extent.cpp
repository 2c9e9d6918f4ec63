#include "experiments/motion_extent.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include <fmt/format.h>

#include "core/geometry/shape.hpp"
#include "core/model/model_terms.hpp"
#include "scene/build.hpp"

namespace multipanda {
namespace {

constexpr int kPieces = 100;
constexpr double kInfinite = std::numeric_limits<double>::infinity();
constexpr double kUsual = 0.02;  // margin by which the pairs are compared [m]
constexpr double kFar = 0.5;     // bounding spheres farther apart than this are not checked [m]

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

MotionExtent::MotionExtent(const Scene& scene, const std::vector<std::shared_ptr<const ArmModel>>& models) {
  for (std::size_t i = 0; i < scene.arms.size(); ++i) {
    Arm arm{.name = scene.arms[i].name, .X_BW = scene.arms[i].X_WB.inverse(), .terms = ModelTerms(models[i])};
    const ArmConfig config = arm_config(scene.arms[i]);
    arm.terms.set_config(config.frames, config.tool, config.load);
    arms_.push_back(std::move(arm));
  }
}

void MotionExtent::take(const CycleRecord& record) {
  for (std::size_t i = 0; i < arms_.size(); ++i) {
    Arm& arm = arms_[i];
    const ArmSample& sample = record.arms[i];
    if (sample.sequence == 0) continue;
    if (sample.has_contact_truth)
      arm.force = std::max(arm.force, Eigen::Map<const Vector3>(sample.F_K_W_true.data()).norm());
    const auto n = arm.terms.model().joint_count();
    if (!arm.begun) arm.q0 = sample.q;
    for (std::size_t j = 0; j < n; ++j) {
      arm.joint_speed = std::max(arm.joint_speed, std::abs(sample.dq[j]));
      const double angle = std::abs(sample.q[j] - arm.q0[j]);
      if (angle > arm.angle) {
        arm.angle = angle;
        arm.joint = j;
      }
    }
    if (arm.begun && record.cycle % kEvery != 0) continue;
    const auto size = static_cast<Eigen::Index>(n);
    arm.terms.update(JointVector(Eigen::Map<const Eigen::VectorXd>(sample.q.data(), size)),
                     JointVector(Eigen::Map<const Eigen::VectorXd>(sample.dq.data(), size)));
    const Vector3 p_BE = (arm.X_BW * arm.terms.X_WE()).position;
    if (!arm.begun) {
      arm.p0 = p_BE;
      arm.lowest = arm.highest = p_BE.z();
      arm.begun = true;
    }
    arm.hand = std::max(arm.hand, (p_BE - arm.p0).norm());
    arm.hand_speed = std::max(arm.hand_speed, arm.terms.V_WE().linear().norm());
    arm.lowest = std::min(arm.lowest, p_BE.z());
    arm.highest = std::max(arm.highest, p_BE.z());
  }
}

nlohmann::ordered_json MotionExtent::json() const {
  auto list = nlohmann::ordered_json::array();
  for (const auto& arm : arms_) {
    list.push_back({{"arm", arm.name},
                    {"hand_m", arm.hand},
                    {"hand_m_per_s", arm.hand_speed},
                    {"joint", arm.joint + 1},
                    {"joint_rad", arm.angle},
                    {"joint_rad_per_s", arm.joint_speed},
                    {"force_n", arm.force},
                    {"lowest_m", arm.lowest},
                    {"highest_m", arm.highest}});
  }
  return list;
}

std::string MotionExtent::beyond(const nlohmann::ordered_json& expected) const {
  for (std::size_t i = 0; i < arms_.size() && i < expected.size(); ++i) {
    const Arm& arm = arms_[i];
    if (!arm.begun) continue;
    const auto more = [&](const char* what, double value, const char* key, double margin, const char* unit) {
      const double bound = expected[i].at(key).get<double>() + margin;
      return (margin > 0 ? value > bound : value < bound)
                 ? fmt::format("{} of arm '{}' {} {:.2f} {}, in simulation {:.2f} {}",
                               std::string(key).starts_with("joint") ? "a joint" : "the hand", arm.name, what,
                               value, unit, bound - margin, unit)
                 : std::string();
    };
    for (const std::string& text :
         {more("went", arm.hand, "hand_m", kFarther, "m"),
          more("moved at", arm.hand_speed, "hand_m_per_s", kFaster, "m/s"),
          more("sank to a height of", arm.lowest, "lowest_m", -kFarther, "m"),
          more("rose to a height of", arm.highest, "highest_m", kFarther, "m"),
          more("turned by", arm.angle, "joint_rad", kTurnedMore, "rad"),
          more("turned at", arm.joint_speed, "joint_rad_per_s", kTurnedFaster, "rad/s")}) {
      if (!text.empty()) return text;
    }
  }
  return {};
}

std::string describe_extent(const nlohmann::ordered_json& extent) {
  std::string text;
  for (const auto& arm : extent) {
    const auto number = [&arm](const char* key) { return arm.at(key).get<double>(); };
    text += fmt::format(
        "  arm '{}': hand up to {:.2f} m from its start, at up to {:.2f} m/s, {:.2f} to {:.2f} m above its "
        "base; joint {} by {:.2f} rad, joints at up to {:.2f} rad/s",
        arm.at("arm").get<std::string>(), number("hand_m"), number("hand_m_per_s"), number("lowest_m"),
        number("highest_m"), arm.at("joint").get<int>(), number("joint_rad"), number("joint_rad_per_s"));
    if (number("force_n") > 0) text += fmt::format("; presses with up to {:.0f} N", number("force_n"));
    text += '\n';
  }
  if (!text.empty()) text.pop_back();
  return text;
}

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
