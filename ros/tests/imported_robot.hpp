#pragma once

#include <map>
#include <string>
#include <urdf_model/pose.h>
#include <vector>

#include "descriptions.hpp"

namespace urdf {
class Model;
}

namespace multipanda::ros2_control_tests {

// Another maker's robot from its URDF. Its arms' joints get the names that this project's hardware gives
// them, <arm>_joint1, ...; nothing else of the robot is changed.
class ImportedRobot {
 public:
  struct Arm {
    std::string name, base_link, tip_link;
  };
  // Throws std::runtime_error if there is no such robot in the file.
  ImportedRobot(const std::string& file, const std::vector<Arm>& arms);

  int joints(const std::string& arm) const { return static_cast<int>(chains_.at(arm).joints.size()); }
  // The robot's description, with `component` in place of what it says of ros2_control.
  std::string description(const Component& component) const;
  // The tip in the base at these joint positions, from the URDF's figures alone.
  urdf::Pose tip(const std::string& arm, const std::vector<double>& q) const;

 private:
  struct Segment {
    urdf::Pose origin;
    urdf::Vector3 axis;
    bool moves;
  };
  struct Chain {
    std::vector<Segment> segments;    // from the base on
    std::vector<std::string> joints;  // that move, in the URDF's words
  };
  static Chain chain(const urdf::Model& model, const Arm& arm);

  std::string text_;
  std::map<std::string, Chain> chains_;
};

}  // namespace multipanda::ros2_control_tests
