#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "generators/circular_field/course.hpp"
#include "generators/publish.hpp"
#include "generators/set_point_link.hpp"
#include "generators/via_points/joint_motion.hpp"
#include "generators/via_points/pose_motion.hpp"

namespace multipanda {

// Limits of joint motions where a file has one number for all joints of an arm.
struct UniformJointLimits {
  double velocity = 0.5;      // [rad/s]
  double acceleration = 2.0;  // [rad/s^2]
  double jerk = 50.0;         // [rad/s^3]
  JointMotionLimits of(std::size_t joints) const;
};

// One arm's way. Via points are all joint positions or all poses (world).
struct ViaTrack {
  std::string arm;                  // begins where this arm of the run is
  std::vector<JointVector> joints;  // [rad]
  std::vector<Pose> poses;
  std::vector<circular_field::Destination> publish;
  Quantity quantity() const { return joints.empty() ? Quantity::pose : Quantity::joints; }
};

// What there is to do, as data.
struct ViaPlan {
  std::string name;
  double scale = 1;     // of all limits
  bool repeat = false;  // from the last via point to the first again, until stopped
  UniformJointLimits joint_limits;
  PoseMotionLimits pose_limits;
  std::vector<ViaTrack> tracks;
};

// Reads a file (docs/motion_generator.md). Throws std::invalid_argument, "file:line: what was expected".
ViaPlan load_via_plan(const std::filesystem::path& file);

// Carries a plan out: all tracks begin together, each takes its own time. One thread.
class ViaRun {
 public:
  // `starts`: per track. Throws std::invalid_argument for what cannot be planned, naming the track's arm.
  ViaRun(ViaPlan plan, const std::vector<SetPointLink::Arm>& starts);

  void step(double dt);
  void brake();  // every track comes to rest, off its way if it must
  double time() const { return time_; }
  double duration() const;  // of the longest track, once through
  bool finished() const;    // never where the plan repeats
  bool at_rest() const;
  std::size_t passed(std::size_t track) const;  // via points, repetitions included
  const ViaPlan& plan() const { return plan_; }
  // Values as in a Target.
  std::vector<double> values(std::size_t track) const;

 private:
  using Motion = std::variant<JointMotion, PoseMotion>;
  struct Leg {  // a track's motion now
    Motion motion;
    double begin = 0;        // [s]
    std::size_t passed = 0;  // before it
    bool braking = false;
  };
  Motion again(const ViaTrack& track, const Motion& before) const;

  ViaPlan plan_;
  std::vector<Leg> legs_;
  double time_ = 0;
};

// Where the tracks of a plan begin. Throws what the link throws.
std::vector<SetPointLink::Arm> starts_in(SetPointLink& link, const ViaPlan& plan);

// Publishes at the period's rate to the inputs that the plan names; opens their streams. Throws what the link
// throws.
PublishReport publish_via(ViaRun& run, SetPointLink& link, const PublishOptions& options);

}  // namespace multipanda
