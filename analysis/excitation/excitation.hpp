#pragma once

#include <atomic>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>

#include "analysis/excitation/base_condition.hpp"
#include "analysis/excitation/motion_limits.hpp"

// Motions that show an arm's base parameters best (docs/excitation.md).
namespace multipanda {

struct ExcitationOptions {
  double period = 8, cycles = 2, ramp = 1;  // of the base frequency [s], [1], [s]
  std::size_t parts = 6;                    // harmonics, 1 to 1 + kMaxOvertones
  bool hand = true;                         // on the flange, where the robot has one
  MotionLimits limits;
  std::uint64_t seed = 1;
  std::size_t random_motions = 100;  // feasible ones, of which the best is where the search begins
  std::size_t evaluations = 16000;
  std::size_t threads = 2;  // change nothing but the time
  std::function<void(const std::string& line)> progress;
  const std::atomic<bool>* stop = nullptr;  // true: the best so far
};

struct Excitation {
  ExcitationMotion motion;
  double condition = 0;                         // of the base regressor, columns scaled
  double random_best = 0, random_median = 0;    // of the random feasible motions
  std::vector<LimitUse> use;                    // every limit, at each millisecond
  std::size_t parameters = 0, evaluations = 0;  // base parameters; motions tried
};

// Random motions that keep to every limit: about the home configuration, each joint's swing a random part of
// what its own limits allow, made smaller together where the arm as a whole would not fit.
// Throws std::runtime_error if too few of many fit.
std::vector<ExcitationMotion> random_motions(const RobotDescription& robot, const ExcitationOptions& options);

// The condition number of the base regressor over one base period at full rate.
double condition_of(BaseCondition& condition, const ExcitationMotion& motion);

// Takes about a minute on two cores. Throws std::invalid_argument (options), std::runtime_error (no room).
Excitation optimise_excitation(const RobotDescription& robot, const ExcitationOptions& options);

// A scene file whose only arm, of `model` (a name or a path), goes to the motion's start, moves, and rests;
// usable on every backend. `note` becomes a comment.
std::string excitation_scene(const Excitation& excitation, const std::string& model, bool hand,
                             const std::string& note);

// Gains of the joint impedance for it, as text of a scene's `parameters`: soft enough for arms that answer 3
// ms late through 30 Hz, light last joint included, and stiff enough for friction and an unknown payload to
// cost some hundredths of a radian.
std::string excitation_gains(std::size_t joints);

// Time of the motion in that scene [s]; before it the arm goes to the start.
inline constexpr double kExcitationBegins = 5;

}  // namespace multipanda
