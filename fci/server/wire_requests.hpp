#pragma once

#include <optional>

#include "arm_interface/arm_interface.hpp"
#include "core/cycle/backend.hpp"
#include "fci/wire/requests.hpp"

// Requests of the wire as requests to the arm. None: an argument is not finite or outside of Franka's
// documented range.
namespace multipanda::fci {

std::optional<ArmRequest> arm_request(const SetCollisionBehaviorRequest& request);
std::optional<ArmRequest> arm_request(const SetJointImpedanceRequest& request);
std::optional<ArmRequest> arm_request(const SetCartesianImpedanceRequest& request);
std::optional<ArmRequest> arm_request(const SetGuidingModeRequest& request);
std::optional<ArmRequest> arm_request(const SetEEToKRequest& request);
// X_FNE: the arm's nominal end effector in the flange.
std::optional<ArmRequest> arm_request(const SetNEToEERequest& request, const Pose& X_FNE);
std::optional<ArmRequest> arm_request(const SetLoadRequest& request);

// The motion that a Move requests.
MotionRequest motion_request(const MoveRequest& request);

void fill(InterfaceCommand& command, const RobotCommand& from);

Status status_of(MotionStart start);
Status status_of(MotionEnd end);

}  // namespace multipanda::fci
