#pragma once

#include <map>
#include <string>
#include <urdf_model/pose.h>
#include <vector>

namespace multipanda::ros2_control_tests {

// One <ros2_control> tag.
struct Component {
  std::string name, plugin;
  std::vector<std::string> arms;
  std::map<std::string, std::string> parameters;   // <param>s of the hardware
  std::vector<std::string> commands = {"effort"};  // of every joint, for plugins that take them from the tag
  int joints = 7;                                  // of every arm
};

// ros2_control's own mock hardware: given positions that never change, efforts as commanded.
Component mock_component(const std::string& name, const std::vector<std::string>& arms);
// Arms of this project, side by side and 0.6 m apart, in one otherwise empty world.
Component mujoco_component(const std::string& name, const std::vector<std::string>& arms);
// The same arms behind sockets; `addresses`: one per arm.
Component fci_component(const std::string& name, const std::vector<std::string>& arms,
                        const std::vector<std::string>& addresses);

// A URDF with the arms' joints <arm>_joint1..7 on the link `world`, and the tags. It has only what a
// controller_manager needs of the arm: names and limits.
std::string robot(const std::vector<Component>& components);

// The same with the arms' masses and frames: the project's model `fer`, once per arm, all in one place.
std::string modeled_robot(const Component& component);

// The <ros2_control> tag of a component.
std::string tag(const Component& component);

// Joint positions of mock hardware, and of simulated arms at the start.
const std::vector<double>& home();
std::string joint_name(const std::string& arm, int number);  // from 1

}  // namespace multipanda::ros2_control_tests

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
