#include "tested_robot.hpp"

#include <cmath>
#include <sensor_msgs/msg/joint_state.hpp>
#include <trajectory_msgs/msg/joint_trajectory.hpp>

namespace multipanda::ros2_control_tests {
namespace {

// Two arms, each owned by a multimode controller of its own, by one for both, or by another controller.
const char* const kParameters = R"(
controller_manager:
  ros__parameters:
    update_rate: 1000
    multimode: {type: multipanda_controller/MultimodeController}
    multimode_left: {type: multipanda_controller/MultimodeController}
    multimode_right: {type: multipanda_controller/MultimodeController}
    joint_states: {type: joint_state_broadcaster/JointStateBroadcaster}
    forward_right: {type: forward_command_controller/ForwardCommandController}
    turn_right: {type: forward_command_controller/ForwardCommandController}
    shift_right: {type: forward_command_controller/MultiInterfaceForwardCommandController}
    trajectory_left: {type: joint_trajectory_controller/JointTrajectoryController}
    trajectory_right: {type: joint_trajectory_controller/JointTrajectoryController}
multimode:
  ros__parameters:
    arm_names: [left, right]
    arms: ARMS
    controllets:
      left_joints: {type: joint_impedance, arms: left}
      right_joints: {type: joint_impedance, arms: right}
      left_pose: {type: cartesian_impedance, arms: left}
      both: {type: dual_cartesian_impedance, arms: [left, right]}
    active: [left_joints, right_joints]
multimode_left:
  ros__parameters:
    arm_names: [left]
    controllets: {left_joints: {type: joint_impedance, arms: left}}
    active: [left_joints]
multimode_right:
  ros__parameters:
    arm_names: [right]
    arms: {right: {base: {position_m: [0.0, 0.6, 0.0]}}}
    controllets: {right_joints: {type: joint_impedance, arms: right}}
    active: [right_joints]
forward_right:
  ros__parameters:
    joints: [right_joint1, right_joint2, right_joint3, right_joint4, right_joint5, right_joint6, right_joint7]
    interface_name: effort
turn_right:
  ros__parameters:
    joints: [right_joint1, right_joint2, right_joint3, right_joint4, right_joint5, right_joint6, right_joint7]
    interface_name: velocity
shift_right:
  ros__parameters:
    joint: right_ee_cartesian_velocity
    interface_names: [tx, ty, tz, omega_x, omega_y, omega_z]
trajectory_left:
  ros__parameters:
    joints: [left_joint1, left_joint2, left_joint3, left_joint4, left_joint5, left_joint6, left_joint7]
    command_interfaces: [position]
    state_interfaces: [position, velocity]
    interpolate_from_desired_state: true
    open_loop_control: true
trajectory_right:
  ros__parameters:
    joints: [right_joint1, right_joint2, right_joint3, right_joint4, right_joint5, right_joint6, right_joint7]
    command_interfaces: [position]
    state_interfaces: [position, velocity]
    interpolate_from_desired_state: true
    open_loop_control: true
)";

}  // namespace

std::string parameters(const std::string& more) {
  std::string text = kParameters;
  text.replace(text.find("ARMS"), 4,
               "{left: {" + more + "}, right: {" + more + (more.empty() ? "" : ", ") +
                   "base: {position_m: [0.0, 0.6, 0.0]}}}");
  if (more.empty()) text.replace(text.find("left: {}, "), 10, "");
  return text;
}

double Robot::worst_speed(const std::string& arm) {
  double worst = 0;
  for (int j = 1; j <= 7; ++j)
    worst = std::max(worst, managed.probe().worst(joint_name(arm, j) + "/velocity"));
  return worst;
}

double Robot::distance(const std::string& arm, const std::vector<double>& goal) {
  double worst = 0;
  for (int j = 1; j <= 7; ++j)
    worst = std::max(worst, std::abs(q(arm, j) - goal[static_cast<std::size_t>(j - 1)]));
  return worst;
}

std::vector<double> Robot::where(const std::string& arm) {
  std::vector<double> positions;
  for (int j = 1; j <= 7; ++j) positions.push_back(q(arm, j));
  return positions;
}

void Robot::send_joints(const std::string& topic, const std::string& arm, const std::vector<double>& q_d) {
  sensor_msgs::msg::JointState message;
  for (int j = 1; j <= 7; ++j) message.name.push_back(joint_name(arm, j));
  message.position = q_d;
  senders_.push_back(send(topic, message));
}

void Robot::send_trajectory(const std::string& controller, const std::string& arm,
                            const std::vector<double>& q_d, int seconds) {
  trajectory_msgs::msg::JointTrajectory message;
  for (int j = 1; j <= 7; ++j) message.joint_names.push_back(joint_name(arm, j));
  message.points.resize(1);
  message.points[0].positions = q_d;
  // To rest: a quintic. Positions alone give a straight line, whose step in velocity stops an arm.
  message.points[0].velocities.assign(7, 0.0);
  message.points[0].accelerations.assign(7, 0.0);
  message.points[0].time_from_start.sec = seconds;
  senders_.push_back(send("/" + controller + "/joint_trajectory", message));
}

std::vector<double> home_with(int joint, double change) {
  std::vector<double> q = home();
  q[static_cast<std::size_t>(joint - 1)] += change;
  return q;
}

}  // namespace multipanda::ros2_control_tests
