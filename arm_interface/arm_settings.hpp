#pragma once

#include <memory>
#include <optional>
#include <string>

#include "core/cycle/backend.hpp"
#include "core/model/arm_model.hpp"
#include "core/state/arm_state.hpp"

namespace multipanda {

// Settings of an arm: frames, loads, stiffnesses of its own controllers, contact thresholds, guiding.
struct ArmSettings {
  ArmFrames frames;
  Load tool, load;
  JointVector joint_stiffness;        // of the arm's own joint controller [N m/rad] (n x 1)
  Vector6 cartesian_stiffness;        // of the arm's own Cartesian controller, in K [N/m, N m/rad]
  SetCollisionThresholds thresholds;  // contact and reflex
  SetGuidingMode guiding;             // free axes while the guiding buttons are pressed
};

// Franka's default stiffnesses; thresholds at the model's torque limits and 100 N, 100 N m; guiding
// in all axes.
ArmSettings default_settings(const ArmModel& model);

// Thresholds for a real arm whose scene names none, since those of an earlier program may be arbitrarily
// high. The figures are ours: the arm stops at 80 N and 25 N m in K, far below 280 N, the transient limit of
// ISO/TS 15066 for hand and fingers, and at 40 N m in a joint (60 N at 0.65 m) or its largest torque. Contact
// is reported from 20 N m and 20 N on, as libfranka's examples do. `given` applies where it is lower: for
// motions without contact, whatever the scene allows.
SetCollisionThresholds careful_thresholds(const ArmModel& model,
                                          const std::optional<SetCollisionThresholds>& given = {});

// Why the load is invalid for any arm, or an empty string.
std::string check_load(const Load& load);
// Why the pose is not valid, or an empty string. `name`: of the pose.
std::string check_pose(const Pose& X, const char* name);
// Why a request to an arm of that model is invalid, or an empty string. A payload may not exceed its largest
// load: the arm would push upwards with the weight of a missing load.
std::string check_request(const ArmRequest& request, const ArmModel& model);

// The manufacturer's hand as declared by its arms ("end effector" in their settings, m_ee F_x_Cee I_ee of
// their states): rounded figures, which differ from those of its parts. In the flange frame.
Load manufacturers_hand_as_declared();

// The hand's declared body for a model (in the flange): the figures above for the manufacturer's hand,
// otherwise the model's own.
Load declared_hand(const Load& hand);

}  // namespace multipanda
