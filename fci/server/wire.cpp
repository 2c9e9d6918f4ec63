#include "fci/server/wire.hpp"

#include <algorithm>
#include <cmath>

#include "arm_interface/arm_settings.hpp"
#include "fci/model/model_library.hpp"
#include "scene/build.hpp"

namespace multipanda::fci {

namespace {

template <typename Vector, std::size_t N>
void put(std::array<double, N>& to, const Vector& from) {
  for (std::size_t i = 0; i < N; ++i) to[i] = from(static_cast<Eigen::Index>(i));
}

void put(std::array<double, 9>& to, const Matrix3& from) {
  for (std::size_t i = 0; i < 9; ++i) to[i] = from.data()[i];  // both column-major
}

void put(std::array<std::uint8_t, kErrorCount>& to, std::uint64_t flags) {
  for (std::size_t i = 0; i < kErrorCount; ++i) to[i] = static_cast<std::uint8_t>(flags >> i & 1u);
}

RobotMode wire_mode(ArmMode mode) {
  switch (mode) {
    case ArmMode::idle:
      return RobotMode::idle;
    case ArmMode::move:
      return RobotMode::move;
    case ArmMode::guiding:
      return RobotMode::guiding;
    case ArmMode::reflex:
      return RobotMode::reflex;
    case ArmMode::user_stopped:
      return RobotMode::user_stopped;
    case ArmMode::recovering:
      return RobotMode::automatic_error_recovery;
    case ArmMode::other:
    case ArmMode::disconnected:
      break;
  }
  return RobotMode::other;
}

// Hand and tool as in a real arm's settings: the hand with the manufacturer's rounded figures.
RigidBody declared_end_effector(const RobotDescription& robot, const SceneArm& arm) {
  if (!arm.hand) return end_effector(robot, false, arm.tool);
  const RigidBody hand = end_effector(robot, true, {});
  const Load declared = declared_hand({hand.mass, hand.com, hand.inertia});
  const RigidBody body{declared.mass, declared.p_FC, declared.inertia_C};
  return arm.tool.mass > 0 ? merged(body, {arm.tool.mass, arm.tool.p_FC, arm.tool.inertia_C}) : body;
}

}  // namespace

Pose as_in_settings(Pose X) {
  X.rotation = (X.rotation.array() * 1e4).round() * 1e-4;
  return X;
}

bool is_transform(const std::array<double, 16>& from) {
  constexpr double kSlack = 1e-5;
  for (const double value : from) {
    if (!std::isfinite(value)) return false;
  }
  if (std::abs(from[3]) > kSlack || std::abs(from[7]) > kSlack || std::abs(from[11]) > kSlack ||
      std::abs(from[15] - 1) > kSlack) {
    return false;
  }
  const Matrix3 R = pose_of(from).rotation;
  return (R * R.transpose() - Matrix3::Identity()).cwiseAbs().maxCoeff() < 3 * kSlack && R.determinant() > 0;
}

void fill(RobotState& state, std::uint64_t message_id, const SimulatedArm& arm, const FixedConfig& config) {
  const ArmState& seen = arm.state();
  const InterfaceState& own = arm.interface();
  const ArmSettings& set = arm.settings();

  state.message_id = message_id;
  state.O_T_EE = column_major(own.X_BE);
  state.O_T_EE_d = column_major(own.X_BE_d);
  state.O_T_EE_c = column_major(own.X_BE_c);
  state.EE_T_K = column_major(set.frames.X_EK);
  const Pose X_NEE = config.X_FNE.inverse() * set.frames.X_FE, X_FNE = as_in_settings(config.X_FNE);
  state.F_T_NE = column_major(X_FNE);
  state.NE_T_EE = column_major(X_NEE);
  state.F_T_EE = column_major({X_FNE.rotation * X_NEE.rotation, X_FNE * X_NEE.position});
  state.m_ee = config.ee.mass;
  put(state.I_ee, config.ee.inertia);
  put(state.F_x_Cee, config.ee.com);
  state.m_load = set.load.mass;
  put(state.I_load, set.load.inertia_C);
  put(state.F_x_Cload, set.load.p_FC);

  state.elbow = own.elbow;
  state.elbow_d = own.elbow_d;
  state.elbow_c = own.elbow_c;
  state.delbow_c = own.delbow_c;
  state.ddelbow_c = own.ddelbow_c;

  put(state.tau_J, seen.tau_J);
  put(state.tau_J_d, seen.tau_J_d);
  put(state.dtau_J, own.dtau_J);
  put(state.q, seen.q);
  put(state.dq, seen.dq);
  put(state.q_d, own.q_d);
  put(state.dq_d, own.dq_d);
  put(state.ddq_d, own.ddq_d);
  put(state.theta, own.theta);
  put(state.dtheta, own.dtheta);

  put(state.joint_contact, own.joint_contact);
  put(state.joint_collision, own.joint_collision);
  put(state.cartesian_contact, own.cartesian_contact);
  put(state.cartesian_collision, own.cartesian_collision);
  put(state.tau_ext_hat_filtered, own.tau_ext_hat);
  put(state.O_F_ext_hat_K, own.F_B_B.vector);
  put(state.K_F_ext_hat_K, own.F_K_K.vector);
  put(state.O_dP_EE_d, own.V_BE_d.vector);
  put(state.O_dP_EE_c, own.V_BE_c.vector);
  put(state.O_ddP_EE_c, own.A_BE_c);
  put(state.O_ddP_O, config.gravity_B);

  state.motion_generator_mode = static_cast<std::uint8_t>(own.generator);  // same order as on the wire
  state.controller_mode = static_cast<std::uint8_t>(own.controller);
  state.robot_mode = static_cast<std::uint8_t>(wire_mode(own.mode));
  put(state.errors, own.errors);
  put(state.reflex_reason, own.reflex_reason);
  state.control_command_success_rate = own.command_success_rate;
}

void show_idle(RobotState& state, const SimulatedArm& arm) {
  state.motion_generator_mode = static_cast<std::uint8_t>(MotionGeneratorMode::idle);
  state.controller_mode = static_cast<std::uint8_t>(ControllerMode::other);
  state.robot_mode = static_cast<std::uint8_t>(wire_mode(arm.mode()));
  put(state.errors, arm.errors());
  if (arm.errors() != 0) put(state.reflex_reason, arm.errors());
  state.control_command_success_rate = 0;
}

void show_torque_taken(RobotState& state, const JointVector& tau) { put(state.tau_J_d, tau); }

// A Panda's systems use versions 4 or 5, those of a Franka Research 3 6 to 10 (docs/fci.md). Only a Research
// 3 has velocity limits that depend on position; an arm without Cartesian limits is neither.
VersionRange versions_of(const SceneArm& arm, const RobotDescription& robot) {
  if (arm.fci && arm.fci->version != 0) {
    const auto version = static_cast<std::uint16_t>(arm.fci->version);
    return {version, version};
  }
  if (robot.position_based_velocity) return {6, kNewestVersion};
  if (robot.cartesian) return {kOldestVersion, 5};
  return {};
}

FixedConfig fixed_config(const SceneArm& arm) {
  const RobotDescription robot = robot_of(arm);
  FixedConfig config{.X_FNE = {},
                     .ee = declared_end_effector(robot, arm),
                     .gravity_B = arm.X_WB.rotation.transpose() * Vector3(0, 0, -9.81),
                     .versions = versions_of(arm, robot)};
  if (arm.hand) config.X_FNE = robot.hand->mount.pose() * robot.hand->tcp.pose();
  return config;
}

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
