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

// A robot of another manufacturer, from its URDF. Its arms' joints get the names that this project's hardware
// uses, <arm>_joint1, ...; everything else stays.
class ImportedRobot {
 public:
  struct Arm {
    std::string name, base_link, tip_link;
  };
  // Throws std::runtime_error if the file has no such robot.
  ImportedRobot(const std::string& file, const std::vector<Arm>& arms);

  int joints(const std::string& arm) const { return static_cast<int>(chains_.at(arm).joints.size()); }
  // The robot's description, with `component` in place of its ros2_control tag.
  std::string description(const Component& component) const;
  // Pose of the tip in the base at these joint positions, from the URDF's numbers alone.
  urdf::Pose tip(const std::string& arm, const std::vector<double>& q) const;

 private:
  struct Segment {
    urdf::Pose origin;
    urdf::Vector3 axis;
    bool moves;
  };
  struct Chain {
    std::vector<Segment> segments;    // from the base on
    std::vector<std::string> joints;  // moving joints, with the URDF's names
  };
  static Chain chain(const urdf::Model& model, const Arm& arm);

  std::string text_;
  std::map<std::string, Chain> chains_;
};

}  // namespace multipanda::ros2_control_tests
