#pragma once

#include "commission/arms_run.hpp"
#include "commission/findings.hpp"

// The tour's own motions and what is measured in them: the same code on an arm and on its virtual twin.
namespace multipanda::commission {

// Each joint alone by kJointStep_rad towards the middle of its range and back, at most kJointSpeed.
struct JointMotionFigures {
  JointVector error_rad;    // at the end of the way out (n x 1)
  JointVector moved_rad;    // signed, in the requested direction (n x 1)
  JointVector friction_nm;  // half the difference of the torques of both directions (n x 1)
  double others_rad = 0;    // largest motion of a joint that should rest
  Json curves;              // per joint: t, q, q_d is known, tau
};
JointMotionFigures measure_joint_motion(ArmsRun& run, ArmIndex arm);
double joint_motion_seconds(std::size_t joints);  // how long it takes

// The hand by kCartesianStep_m up, along x and along y of the world, each time back.
struct CartesianFigures {
  double error_m = 0, error_rad = 0;  // the largest at an end
  Json curves;                        // t, x, y, z relative to the start
};
CartesianFigures measure_cartesian_motion(ArmsRun& run, ArmIndex arm);

// Joint 1 is stopped in the middle of a motion.
struct StopFigures {
  double time_s = 0, angle_rad = 0;  // until it rests; from the stop
};
StopFigures measure_stop(ArmsRun& run, ArmIndex arm);

// Joint 4 swings by kWiggle_rad, then by half of it in half the period: how much later the measured torque
// shows the commanded one, without what friction feigns.
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

// The motor also works against friction, which leads the torque of inertia by a quarter of a period: the
// measured torque seems too early. At the same speed and half the period, inertia takes twice the torque and
// the shift is half of half of it in time: what is a quarter at `fast` of that at `slow` cancels.
DelayFigures delay_without_friction(const DelayFigures& slow, const DelayFigures& fast);

Json list(const JointVector& values);

}  // namespace multipanda::commission
