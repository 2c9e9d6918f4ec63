#pragma once

#include <string>

namespace multipanda {

// How a run appears in ROS 2 (`run --ros`); it has no effect on the arms.
struct RosSection {
  enum class Time { automatic, simulation, system };
  // Names and message types of another system, beside our own.
  enum class Compat { none, multipanda_ros2, franka_ros2 };

  // How often each group of topics is published [Hz of the loop's time]; 0: never. A rate means every n-th
  // record, so that 1000 Hz is every one at a control period of 1 ms.
  struct Rates {
    double joint_states = 100;
    double robot_state = 100;  // <arm>/robot_state
    double model = 30;         // <arm>/model
    double wrench = 100;       // <arm>/wrench
    double tf = 100;
    double references = 100;  // of controllets' inputs
    double outputs = 100;     // of controllets
    double gripper = 30;      // <arm>_gripper/joint_states
    double object_poses = 30;
    double markers = 10;  // ~/markers, for viewers
    double clock = 1000;
    double loop_statistics = 1;
    double diagnostics = 1;
  };

  std::string node = "multipanda";
  std::string name_space = "/";  // of the node; "/": none
  Time time = Time::automatic;   // of the stamps; automatic: simulated where all arms are
  Compat compat = Compat::none;
  Rates rates_hz;
};

}  // namespace multipanda
