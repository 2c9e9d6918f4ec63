#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "scene/scene.hpp"

// Arms that approach an obstacle at a given speed, with and without collision avoidance, over MuJoCo.
namespace multipanda::approach {

enum class Kind { table, post, self, apart, together };  // apart, together: two arms, two controllets or one
inline constexpr int kKinds = 5;
std::string to_string(Kind kind);

// A scene, and the motion of its set-points.
struct Approach {
  Kind kind = Kind::table;
  Scene scene;  // its controllets have the feature switched on
  double duration_s = 0;
  double speed = 0;  // at which the gap closes [m/s]
  // The paths of the set-points from the arms' start, one per arm: of the end effector along the unit vector
  // `way` [m], or of the joints along `joint_way`.
  struct Path {
    Vector3 way = Vector3::Zero();
    JointVector joint_way = {};
    double length = 0, rate = 0;  // [m] or [rad], and per second
  };
  std::vector<Path> paths;
};

// Seeded; the seed determines the kind. `attempt` draws another approach of the same kind.
Approach draw(std::uint32_t seed, std::uint32_t attempt);

struct Outcome {
  double start = 0;                            // distance at the start [m]
  double clearance = 1e9;                      // smallest distance of any pair, from the plant's joints [m]
  double speed = 0;                            // closing speed of the first gap below 0.05 m [m/s]
  bool touched = false;                        // contact of an arm with the scene, itself or the other arm
  double torque_share = 0;                     // largest requested torque (law plus feature) over its limit
  std::uint64_t torque_cut = 0, rate_cut = 0;  // cycles in which the limiter cut the torque, or its rate
  std::string taken_out;                       // reason if a law lost its arms, otherwise empty
};
Outcome run(const Approach& approach, bool avoid);

// The first draw of that seed that touches without the feature: it starts apart, closes at about the speed
// and is stopped by no limit. `without` is that run.
Approach draw_touching(std::uint32_t seed, Outcome& without);

}  // namespace multipanda::approach
