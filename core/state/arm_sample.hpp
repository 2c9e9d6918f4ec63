#pragma once

#include <array>
#include <bitset>
#include <cstdint>

#include "core/types/capacity.hpp"

// One arm in one cycle. Each quantity is one line of the tables below. From it come the member of ArmSample,
// its field in shared records, which Python and the page read by name, in the JSON of a run's state, in the
// rows of worlds in Python, and in the messages of logs and ROS; of what an arm's interface reports, the
// member of InterfaceReport, too. tools/arm_fields.py adds new lines to the .msg files and to
// docs/live_input.md.
//
//   FIELD(type, member, name, message field, known, description [unit])
//
// `name` is the key in records and JSON, with its unit. `known` is the member that says whether the arm
// reports the quantity; otherwise a list of numbers is empty, or not numbers where it has a fixed place. A
// member that no message has is named no_message. record_cycle.cpp sets the members of measured and
// commanded quantities.
namespace multipanda {

using JointArray = std::array<double, kMaxJoints>;  // the first joint_count values are valid
using WrenchArray = std::array<double, 6>;          // force [N], torque [N m]
using PoseArray = std::array<double, 12>;           // position [m], then the columns of the rotation
using ElbowArray = std::array<double, 2>;
using JointFlags = std::bitset<kMaxJoints>;  // bit i: joint i + 1
using AxisFlags = std::bitset<6>;            // x y z roll pitch yaw

// clang-format off
// What the arm measures and reports.
#define MULTIPANDA_MEASURED_FIELDS(FIELD)                                                                              \
  FIELD(std::uint64_t, sequence, sequence, sequence, always, "counter of the arm's packets; 0: none yet")              \
  FIELD(std::int64_t, t_robot_ns, t_robot_ns, robot_time_ns, always, "the arm's own clock [ns]")                       \
  FIELD(double, age_s, age_s, age, always, "age of the packet at the start of the cycle [s]")                          \
  FIELD(std::uint8_t, mode, mode, mode, always, "by its number: other, idle, move, ...")                               \
  FIELD(std::uint64_t, errors, errors, errors, always, "bit i: error flag i of the arm's control interface")           \
  FIELD(std::uint32_t, config_version, config_version, config_version, always, "changes with frames, tool and load")   \
  FIELD(double, command_success_rate, command_success_rate, command_success_rate, always,                              \
        "fraction of the last commands that reached the arm in time, 0 to 1")                                          \
  FIELD(JointArray, q, q_rad, q, always, "measured joint position [rad]")                                              \
  FIELD(JointArray, dq, dq_rad_per_s, dq, always, "measured joint velocity [rad/s]")                                   \
  FIELD(JointArray, tau_J, tau_J_nm, tau_j, always, "measured link-side joint torque, gravity included [N m]")         \
  FIELD(JointArray, tau_J_d, tau_J_d_nm, tau_j_d, always, "torque command in use by the arm, without gravity [N m]")   \
  FIELD(JointArray, tau_ext, tau_ext_nm, tau_ext, has_tau_ext,                                                         \
        "estimated external joint torque: what the arm exerts on its environment [N m]")                               \
  FIELD(WrenchArray, F_K_W_est, wrench_n_nm, wrench, has_wrench_estimate,                                              \
        "estimated wrench on the environment, about K, world axes [N, N m]")                                           \
  FIELD(WrenchArray, F_K_W_true, contact_wrench_n_nm, contact, has_contact_truth,                                      \
        "the same from the simulator's contacts on hand and tool [N, N m]")                                            \
  FIELD(bool, has_gripper, has_gripper, has_gripper, always, "the gripper's fields are valid, as it last reported")    \
  FIELD(double, gripper_width, gripper_width_m, gripper_width, has_gripper, "between the fingers [m]")                 \
  FIELD(bool, gripper_grasped, gripper_grasped, gripper_grasped, has_gripper,                                          \
        "holds an object of the requested width")                                                                      \
  FIELD(bool, gripper_moving, gripper_moving, gripper_moving, has_gripper, "carries out a request")                    \
  FIELD(double, gripper_max_width, gripper_max_width_m, gripper_max_width, has_gripper, "0 until it is known [m]")     \
  FIELD(bool, has_report, has_report, has_report, always, "the quantities of the next table are valid")

// What its own interface follows and signals besides; the members of InterfaceReport.
#define MULTIPANDA_REPORTED_FIELDS(FIELD)                                                                              \
  FIELD(JointArray, q_d, q_d_rad, q_d, has_report, "desired joint position [rad]")                                     \
  FIELD(JointArray, dq_d, dq_d_rad_per_s, dq_d, has_report, "desired joint velocity [rad/s]")                          \
  FIELD(JointArray, theta, theta_rad, theta, has_report, "motor position [rad]")                                       \
  FIELD(PoseArray, X_BE_d, X_BE_d, x_be_d, has_report, "O_T_EE_d: desired end effector in the base [m, quaternion]")   \
  FIELD(PoseArray, X_BE_c, X_BE_c, x_be_c, has_report, "O_T_EE_c: the one commanded last [m, quaternion]")             \
  FIELD(ElbowArray, elbow, elbow, elbow, has_report, "position of joint 3 [rad], sign of joint 4")                     \
  FIELD(JointFlags, joint_contact, joint_contact, joint_contact, has_report, "above the lower torque threshold")       \
  FIELD(JointFlags, joint_collision, joint_collision, joint_collision, has_report,                                     \
        "above the upper torque threshold; kept until recovery")                                                       \
  FIELD(AxisFlags, cartesian_contact, cartesian_contact, cartesian_contact, has_report,                                \
        "above the lower force threshold: x y z roll pitch yaw, in K")                                                 \
  FIELD(AxisFlags, cartesian_collision, cartesian_collision, cartesian_collision, has_report,                          \
        "above the upper force threshold; kept until recovery")                                                        \
  FIELD(std::uint64_t, last_motion_errors, last_motion_errors, last_motion_errors, has_report,                         \
        "why the last motion ended, as errors; 0: without an error")

// Decisions of the loop for it.
#define MULTIPANDA_COMMANDED_FIELDS(FIELD)                                                                             \
  FIELD(std::uint16_t, owner, owner, no_message, always, "controllet that owns the arm, by its number")                \
  FIELD(bool, due, due, due, always, "the arm got a torque in this cycle")                                             \
  FIELD(std::uint64_t, interventions, interventions, interventions, always, "of the safety stage on this arm, so far") \
  FIELD(JointArray, tau_controllet, tau_controllet_nm, tau_controllet, always, "computed by the owner [N m]")          \
  FIELD(JointArray, tau_feature, tau_feature_nm, tau_feature, always, "sum over the owner's features [N m]")           \
  FIELD(JointArray, tau_cmd, tau_cmd_nm, tau_cmd, always, "sent, after the safety stage [N m]")

#define MULTIPANDA_ARM_FIELDS(FIELD)   \
  MULTIPANDA_MEASURED_FIELDS(FIELD)    \
  MULTIPANDA_REPORTED_FIELDS(FIELD)    \
  MULTIPANDA_COMMANDED_FIELDS(FIELD)
// clang-format on

struct ArmSample {
#define MULTIPANDA_MEMBER(type, member, name, message, known, doc) type member{};
  MULTIPANDA_ARM_FIELDS(MULTIPANDA_MEMBER)
#undef MULTIPANDA_MEMBER
  bool has_tau_ext = false, has_wrench_estimate = false, has_contact_truth = false;
  static constexpr bool always = true;
};

}  // namespace multipanda
