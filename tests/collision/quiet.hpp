#pragma once

#include <cstdint>
#include <string>

#include "scene/scene.hpp"

// Arms that are sent to goals within the range of collision avoidance, where its force and the law's balance:
// over a table, beside another arm, between two walls. The seed determines place, plant, robot, bounds.
namespace multipanda::quiet {

enum class Place { table, beside, walls };
inline constexpr std::uint32_t kPlaces = 3;

struct Goal {
  Place place = Place::table;
  std::string name;  // "table, realistic, fr3, flat, bounded"
  Scene scene;       // the first arm is sent
  Pose X_goal;       // of its end effector
};
Goal draw(std::uint32_t seed);

struct Outcome {
  std::uint64_t interventions = 0;  // of any kind, both arms
  std::string first;                // the first kind, if any
  double swing =
      0;  // in the last second: largest peak to peak of the hand's middle and sides about their drift [m]
  double offset = 0;  // of the end effector from its goal at the end [m]
  double force = 0;   // largest of a pair at the end [N]
};
Outcome run(const Goal& goal);

}  // namespace multipanda::quiet
