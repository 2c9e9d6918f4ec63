#pragma once

#include <cstddef>
#include <vector>

#include "core/record/cycle_record.hpp"

// Fields that messages about an arm share: the log's ArmState and ArmCommand, and ROS' RobotState.
namespace multipanda {

// Copies the first `count` values; the vector keeps its memory.
inline void set_joints(std::vector<double>& out, const JointArray& joints, std::size_t count) {
  out.assign(joints.begin(), joints.begin() + static_cast<std::ptrdiff_t>(count));
}

// Sets what an arm of `n` joints measured and reported in one cycle.
template <class Message>
void set_arm_state(Message& out, const ArmSample& sample, std::size_t n) {
  out.sequence = sample.sequence;
  out.robot_time_ns = sample.t_robot_ns;
  out.age = sample.age_s;
  out.mode = sample.mode;
  out.errors = sample.errors;
  out.config_version = sample.config_version;
  out.command_success_rate = sample.command_success_rate;
  set_joints(out.q, sample.q, n);
  set_joints(out.dq, sample.dq, n);
  set_joints(out.tau_j, sample.tau_J, n);
  set_joints(out.tau_j_d, sample.tau_J_d, n);
  set_joints(out.tau_ext, sample.tau_ext, sample.has_tau_ext ? n : 0);
  out.has_gripper = sample.has_gripper;
  out.gripper_width = sample.gripper_width;
  out.gripper_max_width = sample.gripper_max_width;
  out.gripper_grasped = sample.gripper_grasped;
  out.gripper_moving = sample.gripper_moving;
}

// Sets what the loop computed for an arm of `n` joints and sent to it in one cycle.
template <class Message>
void set_arm_command(Message& out, const ArmSample& sample, std::size_t n) {
  out.due = sample.due;
  out.interventions = sample.interventions;
  set_joints(out.tau_controllet, sample.tau_controllet, n);
  set_joints(out.tau_feature, sample.tau_feature, n);
  set_joints(out.tau_cmd, sample.tau_cmd, n);
}

}  // namespace multipanda
