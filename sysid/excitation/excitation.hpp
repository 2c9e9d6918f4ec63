#pragma once

#include <atomic>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>

#include "sysid/excitation/base_condition.hpp"
#include "sysid/excitation/motion_limits.hpp"

// Motions that excite an arm's base parameters (docs/excitation.md).
namespace multipanda {

struct ExcitationOptions {
  double period = 8, cycles = 2, ramp = 1;  // of the base frequency [s], [1], [s]
  std::size_t parts = 6;                    // harmonics, 1 to 1 + kMaxHarmonics
  bool hand = true;                         // on the flange, if the robot has one
  ExcitationLimits limits;
  std::uint64_t seed = 1;
  std::size_t random_motions = 100;  // feasible ones; the search starts at the best of them
  std::size_t evaluations = 16000;
  std::size_t threads = 2;  // affect only the computing time
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

// Random motions within every limit: about the home configuration, with each joint's swing a random
// fraction of what its own limits allow, scaled down together if the whole arm would exceed a limit. Throws
// std::runtime_error if too few of many fit.
std::vector<ExcitationMotion> random_motions(const RobotDescription& robot, const ExcitationOptions& options);

// The condition number of the base regressor over one base period at full rate.
double condition_of(BaseCondition& condition, const ExcitationMotion& motion);

// Takes about a minute on two cores. Throws std::invalid_argument (options) and std::runtime_error (no
// feasible motion).
Excitation optimize_excitation(const RobotDescription& robot, const ExcitationOptions& options);

// A scene file whose only arm, of `model` (a name or a path), goes to the motion's start, moves, and rests.
// It runs on every backend. `note` becomes a comment.
std::string excitation_scene(const Excitation& excitation, const std::string& model, bool hand,
                             const std::string& note);

// Gains of the joint impedance in that scene, as text of its `parameters`. They are soft enough for arms that
// answer 3 ms late through 30 Hz, including a light last joint, and stiff enough that friction and an unknown
// payload cause errors of only some hundredths of a radian.
std::string excitation_gains(std::size_t joints);

// Start time of the motion in that scene [s]; before it the arm goes to the start.
inline constexpr double kExcitationBegins = 5;

}  // namespace multipanda
