#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "core/trajectory/joint_motion.hpp"
#include "core/trajectory/pose_motion.hpp"
#include "motion_generators/circular_field/course.hpp"
#include "motion_generators/publish.hpp"
#include "motion_generators/set_point_channel.hpp"

namespace multipanda {

// Limits of joint motions, each one number for all joints of an arm.
struct UniformJointLimits {
  double velocity = 0.5;      // [rad/s]
  double acceleration = 2.0;  // [rad/s^2]
  double jerk = 50.0;         // [rad/s^3]
  JointMotionLimits of(std::size_t joints) const;
};

// The path of one arm. Its via points are either all joint positions or all poses in the world.
struct ViaTrack {
  std::string arm;                  // arm of the run, at which the track begins
  std::vector<JointVector> joints;  // [rad]
  std::vector<Pose> poses;
  std::vector<circular_field::Destination> publish;
  Quantity quantity() const { return joints.empty() ? Quantity::pose : Quantity::joints; }
};

// A plan as read from its file.
struct ViaPlan {
  std::string name;
  double scale = 1;     // fraction of all limits
  bool repeat = false;  // from the last via point to the first again, until stopped
  UniformJointLimits joint_limits;
  PoseMotionLimits pose_limits;
  std::vector<ViaTrack> tracks;
};

// Reads a file (docs/motion_generator.md). Throws std::invalid_argument with "file:line: cause".
ViaPlan load_via_plan(const std::filesystem::path& file);

// Executes a plan. All tracks begin together; their durations differ. One thread.
class ViaRun {
 public:
  // `starts` has one entry per track. Throws std::invalid_argument with the track's arm if it
  // cannot be planned.
  ViaRun(ViaPlan plan, const std::vector<SetPointChannel::Arm>& starts);

  void step(double dt);
  void brake();  // every track comes to rest, if necessary off its path
  double time() const { return time_; }
  double duration() const;  // of the longest track, without repetitions
  bool finished() const;    // always false if the plan repeats
  bool at_rest() const;
  std::size_t passed(std::size_t track) const;  // via points passed, including repetitions
  const ViaPlan& plan() const { return plan_; }
  // Values as in a Target.
  std::vector<double> values(std::size_t track) const;

 private:
  using Motion = std::variant<JointMotion, PoseMotion>;
  struct Leg {  // the current motion of a track
    Motion motion;
    double begin = 0;        // [s]
    std::size_t passed = 0;  // via points passed before it
    bool braking = false;
  };
  Motion again(const ViaTrack& track, const Motion& before) const;

  ViaPlan plan_;
  std::vector<Leg> legs_;
  double time_ = 0;
};

// Start states of the tracks of a plan. Forwards the channel's exceptions.
std::vector<SetPointChannel::Arm> starts_in(SetPointChannel& channel, const ViaPlan& plan);

// Opens streams to the inputs that the plan names and publishes to them once per period. Forwards the
// channel's exceptions.
PublishReport publish_via(ViaRun& run, SetPointChannel& channel, const PublishOptions& options);

}  // namespace multipanda
