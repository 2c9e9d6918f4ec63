#pragma once

#include <atomic>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>

#include "sysid/excitation/base_condition.hpp"
#include "sysid/excitation/excitation_motion.hpp"

// Motions that excite the base parameters of an arm (docs/identification.md).
namespace multipanda {

struct ExcitationOptions {
  double period = 8, cycles = 2, ramp = 1;  // of the base frequency [s], [1], [s]
  std::size_t parts = 6;                    // harmonics, 1 to 1 + kMaxHarmonics
  bool hand = true;                         // on the flange, if the robot has one
  ExcitationLimits limits;
  std::uint64_t seed = 1;
  std::size_t random_motions = 100;  // feasible ones; the search starts at the best of them
  std::size_t evaluations = 16000;
  std::size_t threads = 2;  // changes the computing time only
  std::function<void(const std::string& line)> progress;
  const std::atomic<bool>* stop = nullptr;  // true: stop with the best motion so far
};

struct Excitation {
  ExcitationMotion motion;
  double condition = 0;                         // of the base regressor, columns scaled
  double random_best = 0, random_median = 0;    // of the random feasible motions
  std::vector<LimitUse> use;                    // every limit, at each millisecond
  std::size_t parameters = 0, evaluations = 0;  // number of base parameters; motions tried
};

// Random motions within every limit: around the home configuration. Each joint's amplitude is a random
// fraction of what its limits allow; all are scaled down together if the arm would exceed a limit. Throws
// std::runtime_error if too few candidates are feasible.
std::vector<ExcitationMotion> random_motions(const RobotDescription& robot, const ExcitationOptions& options);

// The condition number of the base regressor over one base period at full rate.
double condition_of(BaseCondition& condition, const ExcitationMotion& motion);

// Takes about a minute on two cores. Throws std::invalid_argument (options) and std::runtime_error (no
// feasible motion).
Excitation optimize_excitation(const RobotDescription& robot, const ExcitationOptions& options);

// A scene file whose only arm, of `model` (a name or a path), goes to the motion's start, moves, and rests.
// It runs on every backend: the rotors that the model states act, and the law knows them, or they would swing
// on its springs. `note` becomes a comment.
std::string excitation_scene(const Excitation& excitation, const RobotDescription& robot,
                             const std::string& model, bool hand, const std::string& note);

// Gains of the joint impedance in that scene, as text of its `parameters`. Soft enough for arms with 3 ms
// delay and 30 Hz torque bandwidth, including a light last joint; stiff enough that friction and an unknown
// payload cause errors of a few hundredths of a radian.
std::string excitation_gains(std::size_t joints);

// Start time of the motion in that scene [s]; until then the arm moves to the start.
inline constexpr double kExcitationBegins = 5, kExcitationApproach = 4;

// Timeline events (items of a YAML list): the move to `q`, then the motion.
std::string reference_event(double at_s, const std::string& controllet, const JointVector& q);
std::string motion_event(double at_s, const std::string& controllet, const ExcitationMotion& motion);

}  // namespace multipanda
