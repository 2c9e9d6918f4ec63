#pragma once

#include <limits>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "commission/arms_run.hpp"

namespace multipanda::commission {

using Json = nlohmann::ordered_json;

// A figure without limit is only shown.
inline constexpr double kShown = std::numeric_limits<double>::infinity();

// One figure of a step.
struct Reading {
  std::string arm;       // empty: of the computer, or of all arms
  std::string quantity;  // "largest torque at rest"
  double value = 0;
  std::string unit;       // "N m"
  double limit = 0;       // infinite: shown only
  bool at_least = false;  // the value must reach the limit; otherwise it may not exceed it

  bool good() const;  // false for a value that is not a number
};

enum class Verdict { go, no_go, skipped };
std::string to_string(Verdict verdict);

// The result of a step. The first figure that is not good makes it a no-go.
struct StepResult {
  Verdict verdict = Verdict::go;
  std::vector<Reading> readings;
  std::vector<std::string> notes;       // information for the person, not judged
  std::string found, expected, remedy;  // of a no-go
  Json measured = Json::object();       // curves for the page, by arm

  // Figures with unit and limit; `remedy` and `found` (in words) are used if the value is beyond the limit or
  // not a number.
  void at_most(const std::string& arm, const std::string& quantity, double value, const std::string& unit,
               double limit, const std::string& remedy, const std::string& found = {});
  void at_least(const std::string& arm, const std::string& quantity, double value, const std::string& unit,
                double limit, const std::string& remedy, const std::string& found = {});
  // A figure that is not judged.
  void show(const std::string& arm, const std::string& quantity, double value, const std::string& unit);
  void fail(std::string what_found, std::string what_expected, std::string what_to_do);

 private:
  void add(Reading reading, const std::string& remedy, const std::string& found);
};

Json to_json(const StepResult& result);
std::string reading_text(const Json& reading);  // text of an element of "readings"

// The tour's own motions and their measurements: the same code for an arm and its virtual twin.

// Each joint alone by kJointStep_rad towards the middle of its range and back, at most kJointSpeed.
struct JointMotionFigures {
  JointVector error_rad;    // at the far end (n x 1)
  JointVector moved_rad;    // signed, in the requested direction (n x 1)
  JointVector friction_nm;  // half the difference of the torques of both directions (n x 1)
  double others_rad = 0;    // largest motion of a joint that should not move
  Json curves;              // per joint: t, q, q_d is known, tau
};
JointMotionFigures measure_joint_motion(ArmsRun& run, ArmIndex arm);
double joint_motion_seconds(std::size_t joints);  // duration

// The hand by kCartesianStep_m up, along x and along y of the world, each time out and back.
struct CartesianFigures {
  double error_m = 0, error_rad = 0;  // largest at an end
  Json curves;                        // t, x, y, z relative to the start
};
CartesianFigures measure_cartesian_motion(ArmsRun& run, ArmIndex arm);

// Joint 1 is stopped in the middle of a motion.
struct StopFigures {
  double time_s = 0, angle_rad = 0;  // from the stop to rest
};
StopFigures measure_stop(ArmsRun& run, ArmIndex arm);

// Joint 4 swings by kWiggle_rad, then by half of it in half the period: delay from commanded to measured
// torque, without the effect of friction.
struct DelayFigures {
  double torque_delay_s = 0;
  double fit = 0;  // share of the measured torque that the shifted command explains, 0 to 1
};
DelayFigures measure_delay(ArmsRun& run, ArmIndex arm);

// In hold.
struct NoiseFigures {
  JointVector q_rad, dq_rad_per_s, tau_nm;  // rms about the mean (n x 1)
};
NoiseFigures measure_noise(ArmsRun& run, ArmIndex arm, double seconds);

// The lag of y behind x, by least squares over shifts up to `longest_s` either way (a x + b with a > 0 fitted
// at each), samples of `period_s`. `fit`: the coefficient of determination.
DelayFigures lag_of(const std::vector<double>& x, const std::vector<double>& y, double period_s,
                    double longest_s);

// The motor also works against friction, which leads the inertial torque by a quarter of a period, so the
// measured torque appears too early. At the same speed and half the period, the inertial torque doubles and
// the shift in time is a quarter: the combination of `fast` and `slow` cancels it.
DelayFigures delay_without_friction(const DelayFigures& slow, const DelayFigures& fast);

Json list(const JointVector& values);

}  // namespace multipanda::commission
