#pragma once

#include <memory>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "core/model/model_terms.hpp"
#include "core/record/cycle_record.hpp"
#include "runtime/motion/joint_move.hpp"
#include "scene/scene.hpp"

namespace multipanda {

// How far and how fast the arms of a run moved, and how hard they pressed: taken from the simulation that
// precedes a run on arms, so that a person knows the motion in advance.
class MotionExtent {
 public:
  MotionExtent(const Scene& scene, const std::vector<std::shared_ptr<const ArmModel>>& models);

  void take(const CycleRecord& record);  // in order, one thread
  // One object per arm: arm, hand_m (from its first position), hand_m_per_s, joint (from 1, the one with the
  // largest motion), joint_rad, joint_rad_per_s, force_n (true contact force, or 0), lowest_m and highest_m
  // (of the hand, along the base's z).
  nlohmann::ordered_json json() const;

  // A run on arms that moves farther than its simulation has missed a surface or an object. Describes the
  // first arm beyond these margins; empty: none. `expected`: json() of the simulation. Same thread as take().
  static constexpr double kFarther = 0.05;      // hand: distance from the start, and height, beyond the
                                                // simulation's [m]
  static constexpr double kFaster = 0.25;       // hand [m/s]
  static constexpr double kTurnedMore = 0.2;    // joint, such as an elbow that swings aside [rad]
  static constexpr double kTurnedFaster = 0.7;  // joint [rad/s]
  std::string beyond(const nlohmann::ordered_json& expected) const;

 private:
  static constexpr std::uint64_t kEvery = 5;  // cycles
  struct Arm {
    std::string name;
    Pose X_BW;
    ModelTerms terms;
    bool begun = false;
    JointArray q0{};
    Vector3 p0 = Vector3::Zero();
    std::size_t joint = 0;
    double hand = 0, hand_speed = 0, angle = 0, joint_speed = 0, force = 0, lowest = 0, highest = 0;
  };
  std::vector<Arm> arms_;
};

// Description for the person, one line per arm.
std::string describe_extent(const nlohmann::ordered_json& extent);

// Where arms come too close to each other, to themselves or to objects, during motions that start together
// and last equally long: the closest pair of bodies, compared with its distances at both ends. The shapes are
// those of collision avoidance, so a mounted tool counts only with its tool_shapes.
struct PathClearance {
  double at_start = 0, at_end = 0, least = 0;  // of this pair; infinite: all stay far apart [m]
  std::string pair;                            // "left link5, right hand"

  // Closer than `margin` on the way, but not at an end of the path: an arm may start in contact, but only
  // with bodies that it touches there.
  bool blocked(double margin) const;
};

// `with_objects`: false: planes only, because a person has removed everything else.
PathClearance path_clearance(const Scene& scene, const std::vector<JointMove>& moves, bool with_objects);

}  // namespace multipanda
