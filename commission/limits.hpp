#pragma once

// Go and no-go limits of the tour (docs/commission.md lists them with the reasons) and the range of its
// motions. The figures are ours; the manufacturer publishes none for commissioning.
namespace multipanda::commission {

// --- network ---
inline constexpr double kLostShare = 0.01;         // of the states; for arms on this computer:
inline constexpr double kLostShareVirtual = 0.05;  // arms on this computer: load delays them
inline constexpr double kRoundTripP99_us = 1000;   // a period; a torque that takes longer is always late

// --- end effector and gravity, at rest ---
inline constexpr double kDeclaredTorque = 0.4;  // declared against scene, worst pose [N m]
inline constexpr double kGravityTorque = 1.5;   // measured against model, any joint [N m]
inline constexpr double kTilt = 0.1;            // of the base, if it explains the difference [rad]
inline constexpr double kTouchTorque = 1.5;     // change of the external torque that counts as a touch [N m]
inline constexpr double kTouchShare = 0.4;      // largest share of it at another arm
inline constexpr double kTouchWait_s = 30;

// --- hold and hand guiding ---
inline constexpr double kHoldDrift_m = 0.01, kHoldDrift_rad = 0.05;
inline constexpr double kGuided_m = 0.03;      // distance that counts as guided
inline constexpr double kGuideDrift_m = 0.02;  // of the released flange within a second
inline constexpr double kGuideWait_s = 60;
// Of joints 1 to 4, which carry the arm, during hand guiding: a faster arm falls, and is held [rad/s].
inline constexpr double kGuideSpeed = 1;

// --- payload ---
inline constexpr double kPayload_kg = 0.15;
inline constexpr double kPayloadTorque = 1.5;  // [N m]
inline constexpr double kPoseApart_rad = 0.2;  // between two poses of the payload check, any joint

// --- own motions: range, speed and accuracy ---
inline constexpr double kJointStep_rad = 0.05, kJointSpeed = 0.1;  // [rad], [rad/s]
inline constexpr double kJointError_rad = 0.02, kOtherJoint_rad = 0.02;
inline constexpr double kCartesianStep_m = 0.03, kCartesianSpeed = 0.05;  // [m], [m/s]
inline constexpr double kCartesianError_m = 0.01, kCartesianError_rad = 0.05;
inline constexpr double kStopStep_rad = 0.1, kStopSpeed = 0.15;  // the motion that is stopped
inline constexpr double kStopTime_s = 0.5, kStopAngle_rad = 0.03;
inline constexpr double kButtonWait_s = 60;
inline constexpr double kWiggle_rad = 0.004, kWigglePeriod_s = 0.25;  // of joint 4, and half of both
inline constexpr double kLongestLag_s = 0.02;                         // search range
inline constexpr double kTorqueDelay_s = 0.010;
inline constexpr double kSuccessRate = 0.9, kSuccessRateVirtual = 0.5;  // of commands, by the arm
inline constexpr double kNoiseVelocity = 0.02, kNoiseTorque = 0.4;      // [rad/s], [N m], rms
inline constexpr double kFriction_nm = 4;  // above the published friction of every joint of a Panda

// --- known weight ---
inline constexpr double kWeightShare = 0.1, kWeightForce = 1.5;  // the larger one applies [N]

// --- bases ---
inline constexpr int kFewestPoints = 4, kMostPoints = 12;
inline constexpr double kStillSpeed = 0.02;       // [rad/s]
inline constexpr double kAway_m = 0.15;           // distance of an arm from the points before the next arm is
                                                  // guided to them
inline constexpr double kBaseResidual_m = 0.003;  // rms
inline constexpr double kBaseWidth_m = 0.05;
inline constexpr double kBaseMoved_m = 0.05;  // from the scene's; more means another scene, or a wrong point
// Points in mirrored order fit an upside-down base: its gravity compensation would accelerate the arm.
inline constexpr double kBaseTurned_rad = 0.1;

}  // namespace multipanda::commission
