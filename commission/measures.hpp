#pragma once

#include "commission/arms_run.hpp"
#include "commission/findings.hpp"

// The tour's own motions and their measurements: the same code for an arm and its virtual twin.
namespace multipanda::commission {

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
