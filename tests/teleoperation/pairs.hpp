#pragma once

#include <array>
#include <string>

#include "scene/scene.hpp"

// Two persons lead two leaders, which lead two followers, all in one scene and one loop, in free motion.
namespace multipanda::teleoperation {

// How a pair is led: "teleoperation" owns both of its arms. With "joint_follower" and "pose_follower" the
// leader is in gravity_compensation, and the follower's law owns the follower only.
struct Pairs {
  std::array<std::string, 2> laws;
  PlantFidelity plant = PlantFidelity::ideal();
  std::array<bool, 2> moves = {true, true};  // the person leads somewhere
};

struct PairOutcome {
  double way = 0;           // of the leader's hand, largest [m]
  double hand_error = 0;    // of the follower's true hand to where its leader's leads, largest [m]
  double joint_error = 0;   // of a joint to the leader's, largest [rad]
  double follower_way = 0;  // of the follower's hand, largest [m]
  bool kept = true;         // all laws still owned their arms at the end
};

struct PairsOutcome {
  std::array<PairOutcome, 2> pairs;
  std::string interventions;  // of the safety stage
};

PairsOutcome run(const Pairs& pairs);

}  // namespace multipanda::teleoperation
