#pragma once

#include <map>
#include <string>
#include <vector>

namespace multipanda::ros {

// Whose time stands in the stamps of messages.
//   simulation  the loop's time, published on /clock
//   system      this computer's wall clock
//   automatic   simulation where all arms are simulated, else system
enum class StampTime { automatic, simulation, system };

// How a run speaks ROS: the scene's section `ros:`, then what the command line says.
struct RosOptions {
  std::string node = "multipanda";
  std::string name_space;  // "" or "/": the root
  StampTime time = StampTime::automatic;
  // Topics' rates [Hz] by name ("joint_states", "robot_state", ...); 0: off. What is not named has its
  // default.
  std::map<std::string, double> rates_hz;
  std::vector<std::string> arguments;  // for rcl: "-r", "joint_states:=arms" ...
  // False on a node that has parameters of its own (ros2_control): then only ParameterTable is used.
  bool parameter_services = true;

  double rate_hz(const std::string& topic, double otherwise) const {
    const auto found = rates_hz.find(topic);
    return found == rates_hz.end() ? otherwise : found->second;
  }
};

}  // namespace multipanda::ros
