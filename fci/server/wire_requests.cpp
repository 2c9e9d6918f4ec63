#include "fci/server/wire_requests.hpp"

#include <algorithm>
#include <cmath>

#include "fci/server/state_packet.hpp"

namespace multipanda::fci {
namespace {

template <std::size_t N>
bool all_within(const std::array<double, N>& values, double lowest, double highest) {
  return std::all_of(values.begin(), values.end(), [&](double v) { return v >= lowest && v <= highest; });
}

template <typename Vector, std::size_t N>
void put(Vector& to, const std::array<double, N>& from) {
  to.resize(static_cast<Eigen::Index>(N));
  for (std::size_t i = 0; i < N; ++i) to[static_cast<Eigen::Index>(i)] = from[i];
}

ContactThresholds thresholds(const std::array<double, 7>& torque_lower,
                             const std::array<double, 7>& torque_upper,
                             const std::array<double, 6>& force_lower,
                             const std::array<double, 6>& force_upper) {
  ContactThresholds result;
  put(result.torque_lower, torque_lower);
  put(result.torque_upper, torque_upper);
  put(result.wrench_lower, force_lower);
  put(result.wrench_upper, force_upper);
  return result;
}

}  // namespace

std::optional<ArmRequest> arm_request(const SetCollisionBehaviorRequest& r) {
  return SetCollisionThresholds{
      .nominal = thresholds(r.lower_torque_thresholds_nominal, r.upper_torque_thresholds_nominal,
                            r.lower_force_thresholds_nominal, r.upper_force_thresholds_nominal),
      .acceleration =
          thresholds(r.lower_torque_thresholds_acceleration, r.upper_torque_thresholds_acceleration,
                     r.lower_force_thresholds_acceleration, r.upper_force_thresholds_acceleration)};
}

std::optional<ArmRequest> arm_request(const SetJointImpedanceRequest& r) {
  if (!all_within(r.K_theta, 0, 14250)) return std::nullopt;  // [N m/rad]
  SetJointStiffness result;
  put(result.stiffness, r.K_theta);
  return result;
}

std::optional<ArmRequest> arm_request(const SetCartesianImpedanceRequest& r) {
  for (std::size_t i = 0; i < 6; ++i) {
    const bool linear = i < 3;  // [N/m], otherwise [N m/rad]
    if (!(r.K_x[i] >= (linear ? 10 : 1) && r.K_x[i] <= (linear ? 3000 : 300))) return std::nullopt;
  }
  SetCartesianStiffness result;
  put(result.stiffness, r.K_x);
  return result;
}

std::optional<ArmRequest> arm_request(const SetGuidingModeRequest& r) {
  SetGuidingMode result;
  for (std::size_t i = 0; i < 6; ++i) {
    if (r.guiding_mode[i] > 1) return std::nullopt;
    result.axes[i] = r.guiding_mode[i] == 1;
  }
  result.elbow = r.nullspace;
  return result;
}

std::optional<ArmRequest> arm_request(const SetEEToKRequest& r) {
  if (!is_transform(r.EE_T_K)) return std::nullopt;
  return SetFrames{.X_FE = {}, .X_EK = with_proper_rotation(pose_of(r.EE_T_K))};
}

std::optional<ArmRequest> arm_request(const SetNEToEERequest& r, const Pose& X_FNE) {
  if (!is_transform(r.NE_T_EE)) return std::nullopt;
  return SetFrames{.X_FE = X_FNE * with_proper_rotation(pose_of(r.NE_T_EE)), .X_EK = {}};
}

std::optional<ArmRequest> arm_request(const SetLoadRequest& r) {
  SetLoad result;
  result.load.mass = r.m_load;
  put(result.load.p_FC, r.F_x_Cload);
  std::copy(r.I_load.begin(), r.I_load.end(), result.load.inertia_C.data());  // both column-major
  return result;
}

MotionRequest motion_request(const MoveRequest& request) {
  MotionRequest result;
  result.controller = static_cast<ArmController>(published(request.controller));  // the same order
  result.generator = static_cast<MotionGenerator>(published(request.generator));
  result.asynchronous = request.use_async_motion_generator;
  put(result.dq_max, request.maximum_velocity);
  return result;
}

void fill(InterfaceCommand& command, const RobotCommand& from) {
  put(command.q_c, from.q_c);
  put(command.dq_c, from.dq_c);
  command.O_T_EE_c = from.O_T_EE_c;
  put(command.O_dP_EE_c, from.O_dP_EE_c);
  command.has_elbow = from.valid_elbow;
  command.elbow_c = from.elbow_c;
  put(command.tau_J_d, from.tau_J_d);
  command.motion_finished = from.motion_generation_finished;
  command.torque_finished = from.torque_command_finished;
}

Status status_of(MotionStart start) {
  switch (start) {
    case MotionStart::started:
      return Status::motion_started;
    case MotionStart::not_possible:
      return Status::not_possible;
    case MotionStart::invalid_argument:
      return Status::invalid_argument;
    case MotionStart::singular:
      return Status::singular;
  }
  return Status::not_possible;
}

Status status_of(MotionEnd end) {
  switch (end) {
    case MotionEnd::finished:
      return Status::success;
    case MotionEnd::preempted:
      return Status::preempted;
    case MotionEnd::reflex:
    case MotionEnd::still_moving:  // libfranka reports it specially after a finish
      return Status::reflex_aborted;
    case MotionEnd::user_stop:
      return Status::emergency_aborted;
    case MotionEnd::input_error:
      return Status::input_error_aborted;
    case MotionEnd::none:
      break;
  }
  return Status::aborted;
}

}  // namespace multipanda::fci
