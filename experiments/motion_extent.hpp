#pragma once

#include <memory>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "core/model/model_terms.hpp"
#include "core/record/cycle_record.hpp"
#include "scene/scene.hpp"

namespace multipanda {

// How far and how fast the arms of a run moved, and how hard they pressed: of the run in simulation that
// precedes one on arms, so that a person knows what comes.
class MotionExtent {
 public:
  MotionExtent(const Scene& scene, const std::vector<std::shared_ptr<const ArmModel>>& models);

  void take(const CycleRecord& record);  // in order, one thread
  // One object per arm: arm, hand_m (from where it was first), hand_m_per_s, joint (from 1, the one that
  // turned most), joint_rad, joint_rad_per_s, force_n (true contact force, or 0), lowest_m and highest_m (of
  // the hand, along the base's z).
  nlohmann::ordered_json json() const;

  // A run on arms that goes farther than its simulation did has missed something: a surface that is not
  // there, or an object. The first arm that is beyond these margins, in words; empty: none. `expected`:
  // json() of the simulation. Same thread as take().
  static constexpr double kFarther = 0.05;      // hand, from the start, below and above the simulation's [m]
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

// The text for the person, one line per arm.
std::string describe_extent(const nlohmann::ordered_json& extent);

}  // namespace multipanda
